"""How often a slip of the pen is named, what was really done is told, and an effect is found beside it.

    python -m benchmarks.slips [--each 4] [--seed-from COMMIT] [--out FILE]

On sessions of the independent simulator: each kind of slip and none, with an effect drawn from the catalogue and
without one, with a scatter of 0, 1 and 2 % from case to case. With an effect the session without its slip is
diagnosed too. Seeds come from a commit's name. A slip shows where it
moves the readings of its cases by more than three times what noise and scatter do (RMS over forces). Writes
`benchmarks/slips.md`, and every session's outcome beside it as JSON lines.
"""

from __future__ import annotations

import datetime as dt
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import commit, publish, sessions_parser
from benchmarks.random_worlds import base_seed
from benchmarks.recovery import rate_line
from tests.simulator import draw_session, draw_truth
from tests.simulator.protocols import PROTOCOLS
from tests.simulator.slips import KINDS, Done

SCATTERS = (0.0, 0.01, 0.02)
# From here on a slip shows: times what noise and scatter do.
SHOWS = 3.0


def one_session(seed: int, kind: str | None, acts: bool, scatter: float) -> dict[str, Any]:
    """Draw a session with a slip, diagnose it, and keep what was done and what was said."""
    from fingermodel.session import Session
    from server.application.diagnosing import diagnosis_answer, run_diagnosis

    plan, effects = PROTOCOLS["dev"](), draw_truth("one", seed).effects if acts else {}
    done = Done(seed, scatter, kind)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        true = draw_session(place, seed, effects, nuisance_scale=1.0, done=done)
        said = draw_session(place / "as stated", seed, effects, nuisance_scale=1.0, done=lambda p: (done(p)[1], p))
        clean = draw_session(place / "clean", seed, effects, nuisance_scale=1.0)
        bench = Session.open(place)
        began = time.perf_counter()
        body = diagnosis_answer(bench, run_diagnosis(bench))
        seconds = time.perf_counter() - began
        plain = None
        if acts and kind is not None:
            draw_session(place / "no slip", seed, effects, nuisance_scale=1.0, done=Done(seed, scatter))
            bench = Session.open(place / "no slip")
            plain = diagnosis_answer(bench, run_diagnosis(bench))["effects"]
    wrong = done.wrong(plan)
    moved = np.array([true.wrench[c][:3] - said.wrench[c][:3] for c in wrong]).reshape(-1, 3)
    size = np.array([clean.wrench[c][:3] for c in wrong]).reshape(-1, 3)
    noise = np.hypot(0.01, scatter * np.linalg.norm(size, axis=1).max(initial=0.0))
    shown = float(np.sqrt(np.mean(moved**2)) / noise) if len(wrong) else 0.0
    truth = {c.id: (dict(c.masses_g), c.posture) for c in plan.cases}
    first = body["suspects"][0] if body["suspects"] else None
    like = first["reads_like"][0] if first and first["reads_like"] else None
    told = like is not None and first is not None and (like["masses_g"], like["posture"]) == truth[first["case"]]
    return {
        "seed": seed,
        "kind": kind,
        "effects": sorted({name.split(".")[0] for name in effects}),
        "scatter": scatter,
        "wrong": list(wrong),
        "shows": shown,
        "verdict": body["verdict"],
        "named": body["effects"],
        "named_without_slip": plain,
        "suspects": [(s["case"], s["probability"]) for s in body["suspects"]],
        "first_like": None if like is None else like["words"],
        "told": told,
        "faults": body["session_faults"],
        "seconds": seconds,
    }


def report(rows: list[dict[str, Any]], each: int) -> list[str]:
    """Lines of the page."""

    def first(row: dict[str, Any]) -> bool:
        return bool(row["suspects"]) and row["suspects"][0][0] in row["wrong"] and row["suspects"][0][1] >= 0.9

    seen = [r for r in rows if r["kind"] and r["shows"] >= SHOWS]
    clean = [r for r in rows if r["kind"] is None]
    beside = [r for r in seen if r["effects"] and r["named_without_slip"] == r["effects"]]
    alone = [r for r in seen if not r["effects"]]
    return [
        "# Slips of the pen",
        "",
        f"`python -m benchmarks.slips --each {each}`, {dt.datetime.now(tz=dt.UTC).date()}, commit {commit()}; "
        f"{len(rows)} sessions, {np.median([r['seconds'] for r in rows]):.1f} s each (median, compiling included).",
        "",
        "| figure | rate | 95 % (Wilson) | count |",
        "|---|---|---|---|",
        rate_line("a slip that shows: named first, 0.9 or more", [first(r) for r in seen]),
        *(rate_line(f"- {kind}", [first(r) for r in seen if r["kind"] == kind]) for kind in KINDS),
        *(rate_line(f"- scatter {100 * s:g} %", [first(r) for r in seen if r["scatter"] == s]) for s in SCATTERS),
        rate_line(
            "an effect that is found without the slip: found beside one that shows, and nothing else",
            [r["named"] == r["effects"] for r in beside],
        ),
        rate_line(
            "an effect without a slip: found, and nothing else",
            [r["named"] == r["effects"] for r in clean if r["effects"]]
            + [r["named_without_slip"] == r["effects"] for r in seen if r["effects"]],
        ),
        rate_line("no effect beside a slip that shows: nothing named", [not r["named"] for r in alone]),
        rate_line("no slip: a case accused, 0.5 or more", [bool(r["suspects"]) for r in clean]),
        rate_line("no fault of the session: one named", [bool(r["faults"]) for r in rows]),
        "",
        "What was really done is told exactly (masses and posture) where the first suspect is right: "
        f"{sum(r['told'] for r in seen if first(r))}/{sum(first(r) for r in seen)}; amount and tare cannot be.",
        "",
    ]


def main() -> None:
    options = sessions_parser(__doc__, 4, "kind, effect and scatter", __file__).parse_args()
    base = base_seed(options.seed_from)
    plans = [(k, a, s) for _ in range(options.each) for s in SCATTERS for a in (False, True) for k in (*KINDS, None)]
    rows = []
    with options.out.with_suffix(".jsonl").open("w", encoding="utf-8") as kept:
        for number, (kind, acts, scatter) in enumerate(plans):
            rows.append(one_session(base + number, kind, acts, scatter))
            kept.write(json.dumps(rows[-1]) + "\n")
            kept.flush()
    publish(options.out, report(rows, options.each))


if __name__ == "__main__":
    main()
