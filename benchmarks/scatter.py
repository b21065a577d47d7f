"""What is said of benches whose cases scatter in one way or another: clean sessions, and sessions with one effect.

    python -m benchmarks.scatter [--each 8] [--first 0]

Readings of the first simulator are changed, case by case: all of a case by one factor, each component by one of its
own, the force's direction, or as by other joint angles; or setting by setting, as by a cell that is turned. Every
second session has an effect of the catalogue.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.machine import publish
from fingermodel.diagnosis.diagnose import Diagnosis, diagnose
from fingermodel.session import Session
from tests.simulator import draw_session, draw_truth

Floats = NDArray[np.float64]
Rng = np.random.Generator
HERE = Path(__file__).parent


def by_one_factor(bench: Session, rng: Rng) -> Floats:
    """Each case by one factor, 2 %."""
    wrench = _wrench(bench)
    return wrench * (1.0 + 0.02 * rng.normal(size=(len(wrench), 1)))


def by_component(bench: Session, rng: Rng) -> Floats:
    """Each component by itself, 1.5 %."""
    wrench = _wrench(bench)
    return wrench * (1.0 + 0.015 * rng.normal(size=wrench.shape))


def by_direction(bench: Session, rng: Rng) -> Floats:
    """Each case turned, 0.02 rad about each axis."""
    wrench = _wrench(bench)
    turn = Rotation.from_rotvec(0.02 * rng.normal(size=(len(wrench), 3)))
    return np.concatenate([turn.apply(wrench[:, :3]), turn.apply(wrench[:, 3:])], axis=1)


def by_angle(bench: Session, rng: Rng) -> Floats:
    """Each case at other joint angles, 1 degree."""
    wrench, inputs = _wrench(bench), bench.observations.inputs
    posture = np.array(inputs.posture)
    posture[: len(wrench)] += np.deg2rad(rng.normal(size=posture[: len(wrench)].shape))
    there, here = (
        np.asarray(bench.model.predict(i, bench.model.initial).reading)[: len(wrench)]
        for i in (inputs._replace(posture=jnp.asarray(posture)), inputs)
    )
    return wrench + there - here


def by_setting(bench: Session, rng: Rng) -> Floats:
    """Each posture, at the tip and at the bone, with the cell turned by 1 degree about each axis."""
    wrench, inputs = _wrench(bench), bench.observations.inputs
    place = 2 * np.asarray(inputs.setting) + np.asarray(inputs.at_bone)
    turn = Rotation.from_rotvec(np.deg2rad(1.0) * rng.normal(size=(place.max() + 1, 3)))[place[: len(wrench)]]
    return np.concatenate([turn.apply(wrench[:, :3]), turn.apply(wrench[:, 3:])], axis=1)


KINDS: dict[str, Callable[[Session, Rng], Floats]] = {
    "one factor a case, 2 %": by_one_factor,
    "each component by itself, 1.5 %": by_component,
    "direction, 1.1° about each axis": by_direction,
    "joint angles, 1°": by_angle,
    "the cell in each setting, 1° about each axis": by_setting,
}


def diagnosed(seed: int, change: Callable[[Session, Rng], Floats]) -> tuple[tuple[str, ...], Diagnosis]:
    """Names of what is hidden in a session whose cases scatter, and its diagnosis."""
    effects = draw_truth("one", seed).effects if seed % 2 else {}
    with tempfile.TemporaryDirectory() as folder:
        draw_session(Path(folder), seed, effects, nuisance_scale=1.0)
        bench = Session.open(folder)
        wrench = change(bench, np.random.default_rng(seed))
        cases = tuple(replace(c, wrench=w) for c, w in zip(bench.measured.cases, wrench, strict=True))
        rough = Session.of(replace(bench.measured, cases=cases))
    return tuple(effects), diagnose(rough.model, rough.observations)


def _wrench(bench: Session) -> Floats:
    return np.array([case.wrench for case in bench.measured.cases])


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
        "| another named | read: tensions, components, directions, angles, cell |",
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
        scatter = np.median([100.0 * d.posterior.scatter[0] for _, d in found])
        others = [d.posterior.other_scatter for _, d in found]
        component, aside = (np.median([100.0 * o[k][0] for o in others]) for k in ("component", "direction"))
        angle, cell = (np.rad2deg(np.median([o[k][0] for o in others])) for k in ("angle_rad", "mounting_rad"))
        told = [*(f"{n}/{len(clean)}" for n in counts), *(f"{n}/{len(acting)}" for n in (alone, false))]
        read = f"{scatter:.1f} %, {component:.1f} %, {aside:.1f} %, {angle:.1f}°, {cell:.1f}°"
        lines.append(f"| {kind} | {' | '.join(told)} | {read} |")
        print(lines[-1], flush=True)
    publish(HERE / "scatter.md", lines)


if __name__ == "__main__":
    main()
