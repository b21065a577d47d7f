"""A million predictions, each with its own posture and tensions: ours, MuJoCo's, and plain NumPy's."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import repeat, table, wait_until_quiet
from benchmarks.mujoco_batch import MujocoBatch
from benchmarks.numpy_finger import NumpyFinger
from fingermodel.fingers import Finger
from fingermodel.fingers.files import read_finger
from fingermodel.many_cases import many_cases
from fingermodel.model import clamp_forces_batch, jax_values
from tests.fingermodel.fingers import straight

Floats = NDArray[np.float64]
Forces = tuple[Floats, Floats]

CASES = 1_000_000
REPETITIONS = 5
TARGET = 3_000_000
# Numbers of an operation whose rate is measured: two of them and the answer fit the second-level cache.
ROOM = 8192


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
    wait_until_quiet()
    limits(
        [
            ("straight tendons", plain, known["straight tendons"][1]),
            ("wrapping tendons", wrapped, known["wrapping tendons"][1]),
        ]
    )


def limits(fingers: list[tuple[str, Finger, float]]) -> None:
    """Print what the same arithmetic would take at the core's measured rates, and nothing else."""
    rates = core_rates()
    rows = []
    for name, finger, seconds in fingers:
        counts = many_cases(finger.topology, finger.values).operations()
        least = sum(count / rates[kind] for kind, count in counts.items())
        spent = [f"{count:,} ({1e9 * count / rates[kind]:.0f})" for kind, count in counts.items()]
        rows.append([name, *spent, f"{1 / least:,.0f}", f"{least * CASES / seconds:.0%}"])
    table(
        "The limit of the core: operations a case (and the nanoseconds that they take at the best)",
        ["", *rates, "cases/s at the limit", "reached"],
        rows,
        "Rates measured on this core in NumPy: "
        + ", ".join(f"{kind} {rate / 1e9:.2f}" for kind, rate in rates.items())
        + " × 10⁹/s. Matrix products: of two large square matrices; all others on numbers in the second-level cache.",
    )


def core_rates() -> dict[str, float]:
    """Operations a second of each kind that the core does where nothing else holds it up."""
    rng = np.random.default_rng(2)
    a, b, out = rng.uniform(0.5, 1.0, (3, ROOM))
    square, other = rng.uniform(size=(2, 1024, 1024))
    product = np.empty_like(square)
    works: dict[str, tuple[Callable[[], object], float]] = {
        "in matrix products": (lambda: np.matmul(square, other, out=product), 2.0 * 1024**3),
        "plain": (lambda: np.multiply(a, b, out=out), ROOM),
        "divisions": (lambda: np.divide(a, b, out=out), ROOM),
        "square roots": (lambda: np.sqrt(a, out=out), ROOM),
        "tangents": (lambda: np.tan(a, out=out), ROOM),
    }
    return {kind: count / best_of(work) for kind, (work, count) in works.items()}


def best_of(work: Callable[[], object], times: int = 200, seconds: float = 1.0) -> float:
    """Shortest time of a short piece of work [s]."""
    best, began = np.inf, perf_counter()
    for _ in range(times):
        start = perf_counter()
        work()
        best = min(best, perf_counter() - start)
        if perf_counter() - began > seconds:
            break
    return float(best)


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
