"""What is said of benches whose cases scatter in one way or another: clean sessions, and sessions with one effect.

    python -m benchmarks.scatter [--each 8] [--first 0]

Readings of the first simulator are changed. Case by case: all of a case by one factor, each component by one of its
own, the force's direction, or as by other joint angles. By weight, or by each tendon's line. Or setting by setting: as
by a cell that is turned, a zero that is off or drifts, a tip that is held elsewhere, or joint angles that differ
between tip and bone. Every second session has an effect of the catalogue.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.machine import publish
from fingermodel.diagnosis.diagnose import Diagnosis, diagnose
from fingermodel.diagnosis.posterior.hyper import SCATTER
from fingermodel.fitting.reading_errors import OTHER_SCATTER
from fingermodel.session import Session
from tests.scattered import (
    Floats,
    Rng,
    by_angle,
    by_component,
    by_direction,
    by_drift,
    by_hold,
    by_line,
    by_mount,
    by_one_factor,
    by_setting,
    by_weight,
    by_zero,
    with_readings,
)
from tests.simulator import draw_session, draw_truth

HERE = Path(__file__).parent
UNITS = {"pct": " %", "deg": "°", "mm": " mm", "mN": " mN"}


KINDS: dict[str, Callable[[Session, Rng], Floats]] = {
    "one factor a case, 2 %": by_one_factor,
    "each component by itself, 1.5 %": by_component,
    "direction, 1.1° about each axis": by_direction,
    "joint angles, 1°": by_angle,
    "each weight, 1 %": by_weight,
    "the cell in each setting, 1° about each axis": by_setting,
    "each tendon's line at the bone, 1.5°": by_line,
    "the zero of each setting, 20 mN": by_zero,
    "the zero within each setting, a cosine of 20 mN": by_drift,
    "where the tip is held in each setting, 1 mm": by_hold,
    "joint angles of each setting at tip and bone, 1°": by_mount,
}


def diagnosed(seed: int, change: Callable[[Session, Rng], Floats]) -> tuple[tuple[str, ...], Diagnosis]:
    """Names of what is hidden in a session whose cases scatter, and its diagnosis."""
    effects = draw_truth("one", seed).effects if seed % 2 else {}
    with tempfile.TemporaryDirectory() as folder:
        draw_session(Path(folder), seed, effects, nuisance_scale=1.0)
        bench = Session.open(folder)
        rough = with_readings(bench, change(bench, np.random.default_rng(seed)))
    return tuple(effects), diagnose(rough.model, rough.observations)


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--each", type=int, default=8, help="sessions of each kind of scatter")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    given = parser.parse_args()
    lines = [
        "# Benches whose cases scatter in one way or another",
        "",
        f"Made by `python -m benchmarks.scatter --each {given.each} --first {given.first}`.",
        "",
        "| scatter | clean: nothing missing | none of the catalogue | an effect named | hidden effect found alone "
        "| another named | read: tensions, components, directions, angles, weights, lines, zeros, drift, cell, hold, "
        "tip and bone |",
        "|---|---|---|---|---|---|---|",
    ]
    for kind, change in KINDS.items():
        found = [diagnosed(seed, change) for seed in range(given.first, given.first + given.each)]
        clean = [d.verdict for hidden, d in found if not hidden]
        acting = [(set(hidden), d.verdict) for hidden, d in found if hidden]
        counts = (
            sum(v.kind == "nothing_missing" for v in clean),
            sum(v.kind == "none_of_catalogue" for v in clean),
            sum(bool(v.effects) for v in clean),
        )
        alone = sum(v.kind == "found" and set(v.names) == hidden for hidden, v in acting)
        false = sum(bool(v.kind == "found" and set(v.names) - hidden) for hidden, v in acting)
        scatter = np.median([100.0 * d.posterior.hyperparameter(SCATTER)[0] for _, d in found])
        others = [d.posterior.other_scatter for _, d in found]
        usual = [(kind.factor * np.median([o[name][0] for o in others]), kind) for name, kind in OTHER_SCATTER.items()]
        told = [*(f"{n}/{len(clean)}" for n in counts), *(f"{n}/{len(acting)}" for n in (alone, false))]
        read = ", ".join([f"{scatter:.1f} %", *(f"{size:.1f}{UNITS[kind.unit]}" for size, kind in usual)])
        lines.append(f"| {kind} | {' | '.join(told)} | {read} |")
        print(lines[-1], flush=True)
    publish(HERE / "scatter.md", lines)


if __name__ == "__main__":
    main()
