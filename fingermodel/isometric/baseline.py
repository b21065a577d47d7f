"""Activations that put a wanted force on the tip: those whose greatest share of strength is least (min/max)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daq.errors import ModelError
from fingermodel.fingers import COMPONENTS
from fingermodel.isometric.forces import IsometricFinger, Placed
from fingermodel.recruitment.minmax import RecruitmentError, min_max

Floats = NDArray[np.float64]


def least_activity(finger: IsometricFinger, placed: Placed, force_N: Floats, *, torque_free: bool = True) -> Floats:
    """Activations (muscles,) of 0 to 1 that put this force on the clamp, as on a wall that the fingertip presses.

    What muscles and joints do at rest is taken off first; the active tensions are recruited by min/max.

    Args:
        finger: with its muscles.
        placed: where it is held.
        force_N: (3,) of the finger on the clamp, most distal bone's axes.
        torque_free: whether the clamp may feel no torque, as a wall without friction; else it feels any.

    Raises:
        ModelError: a force beyond the muscles' strength.
    """
    count = len(finger.finger.topology.muscles)
    rest, full = np.asarray(finger.hold(placed, np.stack([np.zeros(count), np.ones(count)])).tension)
    rows = [c for c in finger.finger.topology.reactions if torque_free or c < 3]
    wrench = np.asarray(placed.wrench)[rows]
    unit = wrench @ np.asarray(placed.arms)
    left = np.r_[force_N, np.zeros(3)][rows] - wrench @ np.asarray(placed.passive_torque) - unit @ rest
    room = np.maximum(full - rest, 1e-9)
    try:
        shared = min_max(unit[None], left[None], room, rotations=tuple(COMPONENTS[c] for c in rows))
    except RecruitmentError:
        size = ", ".join(f"{name} {x:g}" for name, x in zip(COMPONENTS, force_N, strict=False))
        raise ModelError(
            f"a tip force of {size} N, beyond the muscles' strength in this posture",
            "a force that they can make together",
            "Ask for less, or for another direction",
        ) from None
    activation = finger.activation_of(placed, rest + shared.force[0])
    # Bisection ends a rounding above zero.
    rested: Floats = np.where(shared.force[0] > 1e-9, activation, 0.0)
    return rested
