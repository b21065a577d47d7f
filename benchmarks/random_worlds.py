"""How good the stated probabilities are, on sessions in which everything is drawn: the release's measure.

    python -m benchmarks.random_worlds [--sessions 200] [--seed-from COMMIT] [--workers 1] [--out FILE] [--resume]
                                       [--against OLD]

The sessions (`tests/random_worlds`) share no code with the model. Nothing, one or two effects of the catalogue or a
composed law outside it is hidden, from far below to far above what noise and budget hide. The seeds come from a
commit's name. Writes `benchmarks/random_worlds.md` and every session's outcome beside it, so that a run that was
stopped can be resumed, or reported as far as it went (`--resume --sessions 0`). `--against` compares with the outcomes
of another run on the same sessions. A mass in kilograms is refused when a session is read, with its case's name: it is
put right as a user would, and counts neither as a slip that is named nor as one that is missed.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import subprocess
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import yaml

from benchmarks import random_worlds_scores as scores
from benchmarks.machine import commit, publish, use_all_cores
from benchmarks.random_worlds_report import comparison, report

HERE = Path(__file__).parent
# Sessions after which is said how many are done.
_TOLD = 20


def base_seed(name: str | None) -> int:
    """Seed that a commit's name stands for, by its first seven digits; by default of the commit that is measured."""
    if name is None:
        name = subprocess.run(
            ["git", "rev-parse", "HEAD"],
            cwd=HERE,
            check=True,
            capture_output=True,
            text=True,
        ).stdout.strip()
    return int(name[:7], 16)


def one_session(seed: tuple[int, int], measured: str) -> dict[str, Any]:
    """Draw a session, diagnose it, and keep what was hidden and what was answered."""
    from fingermodel.session import Session
    from server.application.diagnosing import diagnosis_answer, run_diagnosis
    from tests.random_worlds import write_world

    with tempfile.TemporaryDirectory() as folder:
        truth = write_world(Path(folder), seed)
        row: dict[str, Any] = {"seed": list(seed), "commit": measured, "truth": truth, "answer": None, "refused": None}
        row["mended"] = mended(Path(folder) / "session.yaml")
        began = time.perf_counter()
        try:
            bench = Session.open(folder)
            row["answer"] = scores.kept_of(diagnosis_answer(bench, run_diagnosis(bench)))
        except Exception as error:
            # Whatever it is, the user has no answer.
            row["refused"] = f"{type(error).__name__}: {error}"[:300]
        row["wall_s"] = round(time.perf_counter() - began, 2)
    # Plain values only, as they will be read back.
    out: dict[str, Any] = json.loads(json.dumps(row, default=float))
    return out


def mended(file: Path) -> list[str]:
    """Write masses below 1 g, which are refused by name, as the kilograms that they are; return their cases."""
    document = yaml.safe_load(file.read_text(encoding="utf-8"))
    cases = []
    for case in document["cases"]:
        light = {m: 1000.0 * g for m, g in (case.get("masses_g") or {}).items() if 0.0 < g < 1.0}
        if light:
            case["masses_g"].update(light)
            cases.append(case["id"])
    if cases:
        file.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    return cases


def read_rows(file: Path) -> list[dict[str, Any]]:
    """Outcomes that were kept, sorted by seed."""
    rows = [json.loads(line) for line in file.with_suffix(".jsonl").read_text(encoding="utf-8").splitlines()]
    return sorted(rows, key=lambda r: r["seed"])


def run(jobs: Sequence[tuple[int, int]], workers: int, keep: Path) -> None:
    """Diagnose these sessions and add their outcomes to a file, each as soon as it is there."""
    spawn, measured = multiprocessing.get_context("spawn"), commit()
    with keep.open("a", encoding="utf-8") as log, ProcessPoolExecutor(workers, mp_context=spawn) as pool:
        asked = [pool.submit(one_session, job, measured) for job in jobs]
        for done, future in enumerate(as_completed(asked), 1):
            error = future.exception()
            if error is not None:
                pool.shutdown(wait=False, cancel_futures=True)
                lost = "a process was killed" if isinstance(error, BrokenProcessPool) else "a world was not made"
                raise SystemExit(f"{lost} ({error}); what was done is kept, --resume goes on")
            log.write(json.dumps(future.result()) + "\n")
            log.flush()
            if done % _TOLD == 0 or done == len(jobs):
                print(f"{done} of {len(jobs)}", flush=True)


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=200)
    parser.add_argument("--seed-from", help="commit whose name the seeds come from; by default the one measured")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--out", type=Path, default=HERE / "random_worlds.md")
    parser.add_argument("--resume", action="store_true", help="keep the outcomes that there are")
    parser.add_argument("--against", type=Path, help="outcomes of another run")
    given = parser.parse_args()
    if given.out.suffix == ".jsonl":
        parser.error("--out FILE.jsonl: a report, such as FILE.md; the outcomes are kept beside it as FILE.jsonl")
    use_all_cores()
    keep, base = given.out.with_suffix(".jsonl"), base_seed(given.seed_from)
    if not given.resume:
        keep.write_text("", encoding="utf-8")
    done = {tuple(r["seed"]) for r in read_rows(keep)} if keep.exists() else set()
    run([(base, k) for k in range(given.sessions) if (base, k) not in done], given.workers, keep)
    rows = read_rows(keep)
    command = f"python -m benchmarks.random_worlds --sessions {len(rows)} --seed-from {base:07x}"
    lines = report(rows, command)
    if given.against:
        lines += comparison(rows, read_rows(given.against))
    publish(given.out, lines)


if __name__ == "__main__":
    main()
