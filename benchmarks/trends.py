"""What is said of benches where something changes with time or load, and how often that is said without cause.

    python -m benchmarks.trends [--each 6] [--first 0]

Readings of the first simulator are changed: the cell's gain drifts, it saturates, or one tendon is pulled ever more.
Every second session has an effect of the catalogue. The ordinary kinds of scatter (see `benchmarks.scatter`) are the
sessions in which nothing changes so.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.machine import publish
from benchmarks.scatter import KINDS as ORDINARY
from fingermodel.diagnosis.diagnose import Diagnosis, diagnose
from fingermodel.session import Session
from tests.scattered import Floats, Rng, with_gain_drift, with_readings, with_saturation, with_tension_drift
from tests.simulator import draw_session, draw_truth

HERE = Path(__file__).parent
# With what is to be said, and what it changes by from one end to the other [%].
CHANGES: dict[str, tuple[Callable[[Session], Floats], tuple[str, str], float]] = {
    "gain from -3 to +3 % through the session": (with_gain_drift, ("the cell's gain", "time"), 6.0),
    "tension of FDP from -4 to +4 %": (with_tension_drift, ("what FDP pulls", "time"), 8.0),
    "gain 8 % lower at the largest load": (with_saturation, ("the cell's gain", "load"), -8.0),
}


def diagnosed(seed: int, change: Callable[[Session], Floats]) -> tuple[set[str], Diagnosis]:
    """Names of what is hidden in a session, and its diagnosis."""
    effects = draw_truth("one", seed).effects if seed % 2 else {}
    with tempfile.TemporaryDirectory() as folder:
        draw_session(Path(folder), seed, effects, nuisance_scale=1.0)
        bench = Session.open(folder)
        changed = with_readings(bench, change(bench))
    return set(effects), diagnose(changed.model, changed.observations)


def _with_seed(scatter: Callable[[Session, Rng], Floats], seed: int) -> Callable[[Session], Floats]:
    return lambda bench: scatter(bench, np.random.default_rng(seed))


def line(kind: str, found: list[tuple[set[str], Diagnosis]], wanted: tuple[str, str] | None, by: float) -> str:
    """One row of the page."""
    trends = [d.trend for _, d in found if d.trend]
    right = [t for t in trends if (t.what, t.along) == wanted]
    size = [(t.course[-1] - t.course[0]) / by for t in right]
    counts = (
        len(trends),
        len(right),
        sum(d.verdict.kind == "nothing_missing" for _, d in found),
        sum(bool(set(d.verdict.effects) - {h.split(".")[0] for h in hidden}) for hidden, d in found),
        sum(bool(d.faults) for _, d in found),
    )
    told = f"{100.0 * float(np.median(size)):.0f} %" if size else ""
    return f"| {kind} | {' | '.join(f'{n}/{len(found)}' for n in counts)} | {told} |"


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--each", type=int, default=6, help="sessions of each change")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--out", type=Path, default=HERE / "trends.md")
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.each)
    lines = [
        "# Benches where something changes with time or load",
        "",
        f"Made by `python -m benchmarks.trends --each {given.each} --first {given.first}`.",
        "",
        "| change | a trend said | the right one | nothing missing | a false name | a fault of the session "
        "| size said, of the true one |",
        "|---|---|---|---|---|---|---|",
    ]
    for kind, (change, wanted, by) in CHANGES.items():
        lines.append(line(kind, [diagnosed(seed, change) for seed in seeds], wanted, by))
        print(lines[-1], flush=True)
    for kind, scatter in ORDINARY.items():
        drawn = [diagnosed(seed, _with_seed(scatter, seed)) for seed in seeds]
        lines.append(line(f"none: {kind}", drawn, None, 1.0))
        print(lines[-1], flush=True)
    publish(given.out, lines)


if __name__ == "__main__":
    main()
