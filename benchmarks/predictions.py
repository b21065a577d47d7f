"""A million predictions, each with its own posture and tensions: ours, MuJoCo's, and plain NumPy's."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import repeat, table, wait_until_quiet
from benchmarks.mujoco_batch import MujocoBatch
from benchmarks.numpy_finger import NumpyFinger
from fingermodel.finger_files import read_finger
from fingermodel.fingers import Finger
from fingermodel.model import clamp_forces_batch, jax_values
from tests.fingermodel.fingers import straight

Floats = NDArray[np.float64]
Forces = tuple[Floats, Floats]

CASES = 1_000_000
REPETITIONS = 5
TARGET = 1_000_000


def main() -> None:
    """Time them and print the table."""
    wrapped = read_finger("an1979_middle")
    plain = straight(wrapped)
    posture, tension = draw(len(wrapped.topology.muscles))
    rivals: list[tuple[str, Callable[[Floats, Floats], Forces]]] = [
        ("straight tendons: ours", ours(plain)),
        ("straight tendons: MuJoCo", MujocoBatch(plain.topology, plain.values).forces),
        ("straight tendons: NumPy", NumpyFinger(plain.topology, plain.values).forces),
        ("wrapping tendons: ours", ours(wrapped)),
        ("wrapping tendons: NumPy", NumpyFinger(wrapped.topology, wrapped.values).forces),
    ]
    rows, known = [], dict[str, tuple[Forces, float]]()
    for name, forces in rivals:
        finger = name.partition(":")[0]
        answer = forces(posture, tension)
        wait_until_quiet()
        timing = repeat(lambda forces=forces: forces(posture, tension), REPETITIONS)  # type: ignore[misc]
        reference, best = known.setdefault(finger, (answer, timing.least))
        rows.append(
            [
                name,
                f"{CASES / timing.least:,.0f}",
                f"{CASES / timing.median:,.0f}",
                f"{timing.least / best:.2f}",
                f"{largest_difference(answer, reference):.0e} N",
                f"{timing.own_share:.0%}",
            ]
        )
    table(
        f"Predictions: {CASES:,} cases, each with its own posture and tensions (target: {TARGET:,} cases/s)",
        ["", "cases/s, best", "median", "time / ours", "differs", "of the core"],
        rows,
        "NumPy arrays in, NumPy arrays out, float64, compiled beforehand. MuJoCo: `mujoco.batch.Batch.forward` to the "
        "position stage on one thread (faster than a loop of `mj_kinematics`, `mj_comPos`, `mj_tendon`), contacts and "
        "constraints off; what it has no function for (hood, solution for the tip) is the NumPy rival's code.",
    )


def draw(muscles: int) -> tuple[Floats, Floats]:
    """Postures (n, 4) [rad] of all that a clamp is set to, and tensions (n, muscles) [N]."""
    rng = np.random.default_rng(1)
    lowest, highest = np.deg2rad([[-20.0, -10.0, 15.0, 10.0], [60.0, 10.0, 75.0, 60.0]])
    return rng.uniform(lowest, highest, (CASES, 4)), rng.uniform(0.0, 9.0, (CASES, muscles))


def ours(finger: Finger) -> Callable[[Floats, Floats], Forces]:
    """Return our batch as a function from arrays to arrays."""
    values = jax_values(finger.values)

    def forces(posture: Floats, tension: Floats) -> Forces:
        answer = clamp_forces_batch(finger.topology, values, posture, tension)
        return np.asarray(answer.tip), np.asarray(answer.bone)

    return forces


def largest_difference(a: Forces, b: Forces) -> float:
    """Largest difference of a force at tip or bone [N]."""
    return float(max(np.abs(a[0][:, :3] - b[0][:, :3]).max(), np.abs(a[1] - b[1]).max()))


if __name__ == "__main__":
    main()
