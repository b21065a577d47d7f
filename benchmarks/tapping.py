"""Joint torques and muscle forces of a tap in 200 instants, against MuJoCo's inverse dynamics and SciPy's programmes.

    python -m benchmarks.tapping [--steps 200] [--times 30] [--out FILE]

Everything is warm: finger, muscles and movement are read, programs compiled. The rivals do their part of the same tap
in the same run, and their answers are held against ours. Writes `benchmarks/tapping.md`.
"""

from __future__ import annotations

import argparse
import datetime as dt
import os
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import block_diag, csr_matrix

from benchmarks.machine import OWN_SHARE, Timing, commit, describe_machine, publish, repeat, wait_until_quiet
from fingermodel.compiled.compilation import prepare_jax
from fingermodel.dynamics.inertia import ChainInertia, chain_inertia
from fingermodel.dynamics.inverse import Movement, inverse_dynamics
from fingermodel.dynamics.motion import read_motion
from fingermodel.fingers import Finger
from fingermodel.fingers.files import read_finger
from fingermodel.muscles.hill import at_rest
from fingermodel.muscles.muscle_files import read_muscles
from fingermodel.recruitment.minmax import Recruitment, min_max
from fingermodel.recruitment.moments import arms_and_excursions
from fingermodel.studies.movement import work_out

Floats = NDArray[np.float64]

HERE = Path(__file__).parent
FINGER, MOTION, MUSCLES = "wu2008_index", "wu2008_tap", "wu2008"
AIM_MS = 50.0


class MujocoChain:
    """The finger's moving bones as bodies of MuJoCo, in mm, t and N."""

    def __init__(self, finger: Finger, inertia: ChainInertia, gravity: Floats) -> None:
        topology, values = finger.topology, finger.values
        spec = mujoco.MjSpec()
        spec.option.gravity = gravity
        parent, axis = spec.worldbody, iter(np.asarray(values.axis))
        for i, joint in enumerate(topology.joints):
            body = parent.add_body(
                name=topology.bones[joint.child],
                pos=values.centre[i],
                mass=inertia.mass[i],
                ipos=inertia.centre[i],
                inertia=inertia.moments[i],
                explicitinertial=True,
            )
            for _ in joint.rotations:
                body.add_joint(axis=next(axis))
            parent = body
        parent.add_site(name="tip", pos=values.load_point)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.tip = self.model.site("tip").id

    def torque(self, movement: Movement) -> Floats:
        """(n, rotations) joint torques [N mm], instant by instant."""
        posture, rate, change, force = (np.asarray(part) for part in movement)
        model, data = self.model, self.data
        out, reach = np.empty(posture.shape), np.empty((3, model.nv))
        for i in range(len(out)):
            data.qpos, data.qvel, data.qacc = posture[i], rate[i], change[i]
            mujoco.mj_inverse(model, data)
            mujoco.mj_jacSite(model, data, reach, None, self.tip)
            out[i] = data.qfrc_inverse - force[i] @ reach
        return out


@dataclass(frozen=True)
class Problem:
    """What is shared out: moment arms (n, rotations, muscles), torques (n, rotations), strengths (muscles,)."""

    arms: Floats
    torque: Floats
    strength: Floats

    def ours(self, rotations: tuple[str, ...]) -> Recruitment:
        """Min/max recruitment, all stages."""
        return min_max(self.arms, self.torque, self.strength, rotations=rotations)

    def one_by_one(self) -> Floats:
        """(n,) largest activities by SciPy's HiGHS, a programme an instant, first stage alone."""
        count = self.arms.shape[2]
        upper = np.hstack([np.eye(count), -np.ones((count, 1))])
        cost, none = np.append(np.zeros(count), 1.0), np.zeros(count)
        out = np.empty(len(self.torque))
        for i, (arms, torque) in enumerate(zip(self.arms, self.torque, strict=True)):
            equal = np.hstack([arms * self.strength, np.zeros((len(torque), 1))])
            out[i] = np.asarray(linprog(cost, upper, none, equal, torque, (0.0, None), method="highs").x)[-1]
        return out

    def together(self) -> Floats:
        """(n,) the same, all instants as one sparse programme."""
        n, rotations, count = self.arms.shape
        upper = np.hstack([np.eye(count), -np.ones((count, 1))])
        equal = np.concatenate([self.arms * self.strength, np.zeros((n, rotations, 1))], axis=2)
        answer = linprog(  # type: ignore[call-overload] # sparse matrices are taken, but not in its types
            np.tile(np.append(np.zeros(count), 1.0), n),
            block_diag([csr_matrix(upper)] * n, format="csr"),
            np.zeros(n * count),
            block_diag([csr_matrix(e) for e in equal], format="csr"),
            self.torque.ravel(),
            (0.0, None),
            method="highs",
        )
        return np.asarray(answer.x).reshape(n, -1)[:, -1]


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--times", type=int, default=30)
    parser.add_argument("--out", type=Path, default=HERE / "tapping.md")
    given = parser.parse_args()
    prepare_jax()
    finger, motion = read_finger(FINGER), read_motion(MOTION)
    muscles, inertia = read_muscles(MUSCLES, finger), chain_inertia(finger)
    topology, values, gravity = finger.topology, finger.values, motion.gravity_mm_s2
    movement = motion.sample(topology, motion.times(given.steps))
    chain = MujocoChain(finger, inertia, gravity)

    def dynamics() -> Floats:
        return np.asarray(inverse_dynamics(topology, values, inertia, gravity, movement).torque)

    def geometry() -> tuple[Floats, Floats]:
        return arms_and_excursions(topology, values, muscles.calibration, np.asarray(movement.posture))

    arms, longer = geometry()
    rate = -np.einsum("nrm,nr->nm", arms, np.asarray(movement.rate))

    def passive() -> Floats:
        found = at_rest(muscles.curves, muscles.values, muscles.max_speed_mm_s, muscles.length_mm + longer, rate)
        return np.asarray(found[0])

    left = dynamics() - np.einsum("nrm,nm->nr", arms, passive())
    problem = Problem(arms, left, np.asarray(muscles.values.max_force))
    shared = problem.ours(topology.rotations)
    apart = float(np.abs(dynamics() - chain.torque(movement)).max())
    ones, all_ = problem.one_by_one(), problem.together()
    gap = max(float(np.abs(found / shared.largest - 1.0).max()) for found in (ones, all_))
    works: list[tuple[str, Callable[[], object]]] = [
        (
            "**the whole tap, `fingermodel.studies.movement.work_out`**",
            lambda: work_out(motion, finger, muscles, given.steps),
        ),
        ("inverse dynamics, ours", dynamics),
        ("inverse dynamics, MuJoCo's `mj_inverse` instant by instant", lambda: chain.torque(movement)),
        ("moment arms and excursions, ours", geometry),
        ("passive forces, ours", passive),
        ("recruitment, ours, all stages", lambda: problem.ours(topology.rotations)),
        ("recruitment, `scipy.optimize.linprog` one by one, first stage alone", problem.one_by_one),
        ("recruitment, `scipy.optimize.linprog` with all instants as one sparse programme, first stage alone",
         problem.together),
    ]  # fmt: skip
    for _, work in works:
        work()
    wait_until_quiet()
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    timings = [(name, repeat(work, given.times, patience_s=60.0)) for name, work in works]
    whole = timings[0][1]
    verdict = "held" if 1e3 * whole.median < AIM_MS else "MISSED" if whole.own_share > OWN_SHARE else "disturbed"
    lines = [
        "# A tap in 200 instants" if given.steps == 200 else f"# A tap in {given.steps} instants",
        "",
        f"Made by `python -m benchmarks.tapping --steps {given.steps} --times {given.times}` on "
        f"{dt.datetime.now(dt.UTC).date()}, commit {commit()}.",
        f"{describe_machine()}. MuJoCo {version('mujoco')}, SciPy {version('scipy')}, JAX {version('jax')}.",
        f"Aim: inverse dynamics and recruitment under {AIM_MS:g} ms; the whole tap takes "
        f"{1e3 * whole.median:.1f} ms in the median: {verdict}. One-minute load when it began: {load:.1f}.",
        "",
        "| | best [ms] | median [ms] | of the core |",
        "|---|---|---|---|",
        *(_row(name, timing) for name, timing in timings),
        "",
        f"Warm. Torques differ from MuJoCo's by {apart:.1e} N mm at most, the largest activities from SciPy's by",
        f"a share of {gap:.1e} at most. Ours solves {shared.programmes} programmes one by one, all stages together;",
        "what their bases prove optimal elsewhere is not solved again. SciPy's runs stop after the first stage:",
        "a muscle that is not the busiest may be anywhere below it.",
        "",
    ]
    publish(given.out, lines)


def _row(name: str, timing: Timing) -> str:
    return f"| {name} | {1e3 * timing.least:.2f} | {1e3 * timing.median:.2f} | {timing.own_share:.0%} |"


if __name__ == "__main__":
    main()
