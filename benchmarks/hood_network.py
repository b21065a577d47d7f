"""The elastic hood at its least energy: ours, one and in batch, and SciPy's minimisers of the same energy.

    python -m benchmarks.hood_network [--cases 2048] [--rivals 200] [--out FILE]

Every case has its own posture and muscle forces, over the whole range of a clamp. Writes `benchmarks/hood_network.md`.
"""

from __future__ import annotations

import argparse
import datetime as dt
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.machine import Timing, commit, describe_machine, publish, repeat, wait_until_quiet
from fingermodel.extensor import segment_tensions
from fingermodel.fingers import Finger
from fingermodel.fingers.files import read_finger
from fingermodel.hood.network import Shape
from fingermodel.hood.parts import ElasticHood, Network
from fingermodel.hood.sharing import hood_state
from fingermodel.kinematics import joint_poses
from fingermodel.model import clamp_forces_batch, jax_values

Floats = NDArray[np.float64]
FINGER, RHOMBUS = "synek2019_network", "synek2019_initial"
SINGLE_MS, BATCH = 5.0, 2000
REPETITIONS = 5
HERE = Path(__file__).parent


def draw(cases: int, muscles: int) -> tuple[Floats, Floats]:
    """Postures (n, 4) [rad] of all that a clamp is set to, and tensions (n, muscles) [N], some muscles at rest."""
    rng = np.random.default_rng(1)
    lowest, highest = np.deg2rad([[-10.0, -20.0, 0.0, 0.0], [10.0, 60.0, 90.0, 60.0]])
    tension = rng.uniform(0.0, 30.0, (cases, muscles)) * (rng.random((cases, muscles)) < 0.8)
    return rng.uniform(lowest, highest, (cases, 4)), tension


@partial(jax.jit, static_argnums=0)
def _slips(topology: Any, values: Any, posture: jax.Array, tension: jax.Array) -> jax.Array:
    return segment_tensions(topology, values, tension, joint_poses(topology, values, posture))


@partial(jax.jit, static_argnums=0)
def _states(topology: Any, values: Any, posture: jax.Array, tension: jax.Array) -> Any:
    def one(q: jax.Array, t: jax.Array) -> Any:
        muscle = dict(zip(topology.muscles, t, strict=True))
        state = hood_state(topology, values, muscle, joint_poses(topology, values, q))
        return state.shape, state.pulls, state.settled.springs.tension, state.settled.ways

    return jax.vmap(one)(posture, tension)


class ScipyHood:
    """The rival: the same energy and its gradient in NumPy, each case by `scipy.optimize.minimize`."""

    def __init__(self, network: Network, shape: Shape, pulls: Floats) -> None:
        self.distal, self.proximal = np.array(network.ends).T
        self.moves = np.array(network.moves)
        self.nodes = len(network.nodes)
        self.shape, self.pulls = Shape(*(np.asarray(x) for x in shape)), pulls  # type: ignore[arg-type]

    def tension(self, case: int, method: str) -> Floats:
        """Tension of the springs (springs,) [N]."""
        span, slack, stiffness, slide, tether = (np.asarray(x[case]) for x in self.shape)
        pulls, rest = self.pulls[case], np.linalg.norm(span, axis=1) + slack
        at = np.zeros((self.nodes, 2))

        def stretched(ways: Floats) -> tuple[Floats, Floats, Floats]:
            at[:] = 0.0
            at[self.moves] += slide * ways[:, None]
            line = span + at[self.proximal] - at[self.distal]
            length = np.sqrt((line * line).sum(axis=1))
            return np.maximum(length - rest, 0.0), line, length

        def energy(ways: Floats) -> tuple[float, Floats]:
            over, line, length = stretched(ways)
            force = (stiffness * over / length)[:, None] * line
            slope = -pulls.copy()
            np.add.at(slope, self.proximal, force)
            np.add.at(slope, self.distal, -force)
            value = 0.5 * (stiffness * over * over).sum() - (pulls * at).sum() + 0.5 * tether * (ways * ways).sum()
            return float(value), (slope[self.moves] * slide).sum(axis=1) + tether * ways

        options = {"gtol": 1e-6, "maxiter": 10_000}
        answer = minimize(energy, np.zeros(len(self.moves)), args=(), method=method, jac=True, options=options)  # type: ignore[call-overload]
        return np.asarray(stiffness * stretched(answer.x)[0])


def ours(finger: Finger) -> Callable[[Floats, Floats], Floats]:
    """Forces of the clamped finger in batch, NumPy in and out."""
    values = jax_values(finger.values)
    return lambda posture, tension: np.asarray(clamp_forces_batch(finger.topology, values, posture, tension).tip)


def one_by_one(finger: Finger, posture: Floats, tension: Floats) -> Floats:
    """Seconds of each case alone, NumPy in and out."""
    values = jax_values(finger.values)
    seconds = []
    for q, t in zip(posture, tension, strict=True):
        began = time.perf_counter()
        np.asarray(_slips(finger.topology, values, q, t))
        seconds.append(time.perf_counter() - began)
    return np.array(seconds[1:])


def timed(rival: ScipyHood, method: str, cases: range) -> tuple[Timing, list[Floats]]:
    """Time the rival once on some cases; tensions of the springs with it."""
    out: dict[int, Floats] = {}
    # A repetition that was disturbed is made anew, so the answers are kept by case.
    timing = repeat(lambda: out.update((i, rival.tension(i, method)) for i in cases), 1)
    return timing, list(out.values())


def _row(name: str, timing: Timing, cases: int) -> str:
    return f"| {name} | {1e3 * timing.least / cases:.4f} ms | {cases / timing.least:,.0f} | | |"


def main() -> None:
    """Time them and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=2048)
    parser.add_argument("--rivals", type=int, default=200)
    parser.add_argument("--out", type=Path, default=HERE / "hood_network.md")
    given = parser.parse_args()
    finger, rhombus = read_finger(FINGER), read_finger(RHOMBUS)
    hood = finger.topology.hood
    assert isinstance(hood, ElasticHood)
    posture, tension = draw(given.cases, len(finger.topology.muscles))
    values = jax_values(finger.values)
    network_batch, rhombus_batch = ours(finger), ours(rhombus)
    for warm in (network_batch, rhombus_batch):
        warm(posture, tension)
    one_by_one(finger, posture[:3], tension[:3])
    shape, pulls, forces, _ = _states(finger.topology, values, posture, tension)
    rival = ScipyHood(hood.network, shape, np.asarray(pulls))
    wait_until_quiet()
    alone = one_by_one(finger, posture[:500], tension[:500])
    batch = repeat(lambda: network_batch(posture, tension), REPETITIONS)
    fixed = repeat(lambda: rhombus_batch(posture, tension), REPETITIONS)
    rows = [
        f"| ours, one case at a time | {1e3 * np.median(alone):.2f} ms (95 %: {1e3 * np.quantile(alone, 0.95):.2f}) | "
        f"{1 / np.mean(alone):,.0f} | 1 | |",
        _row("ours, hood, finger and clamp in batch", batch, given.cases),
        _row("for scale: Winslow's rhombus, finger and clamp in batch", fixed, given.cases),
    ]
    some = range(min(given.rivals, given.cases))
    for method in ("BFGS", "L-BFGS-B", "CG"):
        timing, theirs = timed(rival, method, some)
        off = np.array([np.abs(t - np.asarray(forces[i])).max() for i, t in zip(some, theirs, strict=True)])
        rows.append(
            f"| SciPy, {method} | {1e3 * timing.least / len(some):.2f} ms | {len(some) / timing.least:,.0f} | "
            f"{timing.least / len(some) / np.mean(alone):.1f} | {np.median(off):.1e} N, at most {off.max():.1e} N |"
        )
    lines = [
        "# The elastic hood at its least energy",
        "",
        f"Made by `python -m benchmarks.hood_network --cases {given.cases} --rivals {given.rivals}` on "
        f"{dt.datetime.now(dt.UTC).date()}, commit {commit()}. {describe_machine()}.",
        f"Aim: under {SINGLE_MS:g} ms a posture and load, {BATCH:,} a second in batch.",
        f"{given.cases:,} cases of `{FINGER}`, each with its own posture and muscle forces up to 30 N (a fifth: none).",
        "",
        "| | a case | cases a second | time / ours alone | differs from ours |",
        "|---|---|---|---|---|",
        *rows,
        "",
        f"The best of {REPETITIONS} repetitions; ours had {batch.own_share:.0%} of the core in batch. NumPy arrays in "
        "and out, float64, compiled beforehand.",
        "SciPy: the same energy and its exact gradient in NumPy, to a gradient of 1e-6 N, from the network at rest; "
        f"{given.rivals} of the cases. It is given the network's numbers in each posture; ours finds them too.",
        "",
    ]
    publish(given.out, lines)


if __name__ == "__main__":
    main()
