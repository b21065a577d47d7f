"""How often a law that sessions share is found, and how often one is seen where none is: on the independent simulator.

    python -m benchmarks.shared_law [--groups 20] [--seed-from COMMIT] [--permutations 199] [--out FILE]

Groups of three to six sessions of different specimens: with one law outside the catalogue that all share, with a law
of each one's own, and with none. A law is a torque drawn at random: joint, tendon, angle, and a size of 0.5 to 4 mm.
Writes `benchmarks/shared_law.md`, and every group's outcome beside it as JSON lines.
"""

from __future__ import annotations

import argparse
import datetime as dt
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import commit, publish
from benchmarks.random_worlds import base_seed
from benchmarks.recovery import rate_line
from tests.shared_specimens import TorqueLaw, specimen
from tests.simulator.finger import MUSCLES

KINDS = ("shared", "own", "none")


def drawn(rng: np.random.Generator) -> TorqueLaw:
    """A law at random."""
    size = float(2.0 ** rng.uniform(-1.0, 2.0)) * float(rng.choice([-1.0, 1.0]))
    joint, angle = str(rng.choice(["MCP", "PIP", "DIP"])), str(rng.choice(["MCP", "PIP", "DIP", ""]))
    return TorqueLaw(joint, str(rng.choice(MUSCLES)), angle, round(size, 3))


def one_group(seed: int, kind: str, permutations: int) -> dict[str, Any]:
    """Draw a group, look for what it shares, and keep what was hidden and what was said."""
    from fingermodel.diagnosis.posterior.fitting import Fitter
    from fingermodel.diagnosis.posterior.hyper import Hyperparameters
    from fingermodel.diagnosis.session_model.candidates import NOTHING, Candidates
    from fingermodel.diagnosis.session_model.session import session_of
    from fingermodel.diagnosis.several_sessions.shared_finding import shared_finding

    rng = np.random.default_rng([seed, 5])
    count, common = int(rng.integers(3, 7)), drawn(rng)
    fits, laws = [], []
    with tempfile.TemporaryDirectory() as folder:
        for k in range(count):
            own = {"shared": (common,), "own": (drawn(rng),), "none": ()}[kind]
            laws.append([w.formula for w in own])
            size = float(2.0 ** rng.uniform(-1.0, 1.0))
            bench, observations = specimen(Path(folder) / str(k), seed * 10 + k, own, size)
            session = session_of(bench.model, observations)
            fitter = Fitter(session, Candidates.of(bench.model), Hyperparameters.of(session))
            fits.append(fitter.fit(NOTHING, session.problem.centre, fitter.hyper.start(0)))
    began = time.perf_counter()
    names = [str(k) for k in range(count)]
    found = shared_finding(names, names, fits, permutations)
    assert found is not None
    curve, first = found.curve, found.laws[0] if found.laws else None
    top = curve.parts[int(np.argmax(curve.log_evidence_lost))]
    out: dict[str, Any] = {
        "seed": seed,
        "kind": kind,
        "sessions": count,
        "laws": laws,
        "k_mm": common.k_mm if kind == "shared" else None,
        "found": found.is_shared,
        "p": found.permutation_p,
        "over_own": curve.log_evidence,
        "stage": curve.stage,
        "top": list(top),
        "first": None if first is None else [first.name, *first.rivals],
        "value": None if first is None else first.value,
        "seconds": time.perf_counter() - began,
    }
    if kind == "shared":
        arms = next(c for c in found.curves if c.stage == "arms")
        part = arms.parts.index((common.muscle, common.joint))
        angle = arms.rotations.index(common.angle) if common.angle else None
        truth = common.k_mm * (np.ones(len(arms.postures)) if angle is None else np.sin(arms.postures[:, angle]))
        out["curve_error"] = float(np.linalg.norm(arms.mean[part] - truth) / np.linalg.norm(truth))
        out["place"] = top == (common.muscle, common.joint)
        out["named"] = first is not None and common.formula in (first.name, *first.rivals)
    return out


def report(rows: list[dict[str, Any]], command: str) -> list[str]:
    """Lines of the page."""
    shared = [r for r in rows if r["kind"] == "shared"]
    large = [r for r in shared if abs(r["k_mm"]) >= 1.0]
    found = [r for r in shared if r["found"]]
    apart = [r for r in rows if r["kind"] != "shared"]
    errors = sorted(r["curve_error"] for r in found)
    return [
        "# A law that specimens share",
        "",
        f"`{command}`, {dt.datetime.now(tz=dt.UTC).date()}, commit {commit()}; "
        f"{len(rows)} groups of three to six sessions, {np.median([r['seconds'] for r in rows]):.1f} s each "
        "beside the fits (median).",
        "",
        "| figure | rate | 95 % (Wilson) | count |",
        "|---|---|---|---|",
        rate_line("a shared law: found", [r["found"] for r in shared]),
        rate_line("a shared law of 1 mm or more: found", [r["found"] for r in large]),
        rate_line("found: its tendon and joint first", [r["place"] for r in found]),
        rate_line(
            "found: its formula first, or among what cannot be parted from the first", [r["named"] for r in found]
        ),
        rate_line("a law of each one's own: seen as shared", [r["found"] for r in apart if r["kind"] == "own"]),
        rate_line("no law: seen as shared", [r["found"] for r in apart if r["kind"] == "none"]),
        "",
        "Error of the curve found, as a share of the truth (RMS over postures): "
        + (
            f"{errors[len(errors) // 2]:.2f} (median), {errors[int(0.9 * len(errors))]:.2f} (nine in ten)."
            if errors
            else "–"
        ),
        "",
    ]


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--groups", type=int, default=20, help="of each kind")
    parser.add_argument("--seed-from", default=None, metavar="COMMIT")
    parser.add_argument("--permutations", type=int, default=199)
    parser.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".md"))
    options = parser.parse_args()
    base = base_seed(options.seed_from) % 10**6
    rows = []
    with options.out.with_suffix(".jsonl").open("w", encoding="utf-8") as kept:
        for number in range(3 * options.groups):
            rows.append(one_group(base + number, KINDS[number % 3], options.permutations))
            kept.write(json.dumps(rows[-1], default=float) + "\n")
            kept.flush()
    publish(options.out, report(rows, f"python -m benchmarks.shared_law --groups {options.groups}"))


if __name__ == "__main__":
    main()
