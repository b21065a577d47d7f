"""What a fit counts with besides what plateau and tare state, and how each kind of scatter is told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


class ScatterKind(NamedTuple):
    """How a kind of scatter is told.

    Attributes:
        key: of it in an answer.
        unit: of it there.
        factor: from its own unit to that one.
        title: of a row that tells it.
        words: what follows its size.
        least: size from which it is worth telling, in that unit.
    """

    key: str
    unit: str
    factor: float
    title: str
    words: str
    least: float


_DEG = float(np.rad2deg(1.0))
# All but that of the tensions (see `ReadingErrors`).
OTHER_SCATTER = {
    "component": ScatterKind(
        "component", "pct", 100.0, "scatter of each component by itself", " % of each component by itself", 0.4
    ),
    "direction": ScatterKind(
        "direction", "pct", 100.0, "scatter of forces in every direction", " % of the force in every direction", 0.4
    ),
    "angle_rad": ScatterKind("angle", "deg", _DEG, "scatter of joint angles", "° of each joint angle", 0.2),
    "weight": ScatterKind("weight", "pct", 100.0, "error of each weight", " % of each weight", 0.4),
    "line_rad": ScatterKind(
        "line", "deg", _DEG, "turn of each tendon's line at the bone", "° of each tendon's line at the bone", 0.2
    ),
    "zero_N": ScatterKind("zero", "mN", 1000.0, "zero, by setting", " mN of the zero from setting to setting", 5.0),
    "drift_N": ScatterKind(
        "drift", "mN", 1000.0, "drift of the zero within a setting", " mN of the zero's drift within a setting", 5.0
    ),
    "turn_rad": ScatterKind(
        "mounting",
        "deg",
        _DEG,
        "turn of the cell by setting",
        "° of the cell's orientation from setting to setting",
        0.2,
    ),
    "hold_mm": ScatterKind(
        "hold",
        "mm",
        1.0,
        "place where the tip is held, by setting",
        " mm of where the tip is held from setting to setting",
        0.2,
    ),
    "apart_rad": ScatterKind(
        "apart",
        "deg",
        _DEG,
        "joint angles at tip and bone, by setting",
        "° of each joint angle between tip and bone",
        0.2,
    ),
}


@dataclass(frozen=True)
class ReadingErrors:
    """What a fit counts with besides what plateau and tare state, as the readings have it whatever acts.

    Attributes:
        scatter: of each tension from case to case, relative.
        extra_noise_N: of each reading by itself (ten times as many N mm of a moment); None where noise is assumed.
        not_counted: ids of cases that stand apart from all others: their reading may be anything.
        component: scatter of each component of the reading, relative to what is expected of it.
        direction: scatter of the force in every direction: of each component, relative to the force.
        angle_rad: scatter of each joint angle from case to case.
        weight: error of each weight that hangs in several cases, relative.
        line_rad: how far each tendon's line at the metacarpal is turned about each axis.
        zero_N: what the tare missed in each setting (ten times as many N mm of a moment).
        drift_N: by which that zero moves to and fro within a setting.
        turn_rad: how far the cell is turned in each setting.
        hold_mm: how far from its usual place the tip is held in each setting.
        apart_rad: how far each joint angle of a setting differs between tip and bone from their mean.
    """

    scatter: float = 0.0
    extra_noise_N: float | None = None
    not_counted: tuple[str, ...] = ()
    component: float = 0.0
    direction: float = 0.0
    angle_rad: float = 0.0
    weight: float = 0.0
    line_rad: float = 0.0
    zero_N: float = 0.0
    drift_N: float = 0.0
    turn_rad: float = 0.0
    hold_mm: float = 0.0
    apart_rad: float = 0.0


# What a fit counts with that is told of nothing else.
AS_STATED = ReadingErrors()


def other_scatter(sizes: Mapping[str, float]) -> list[str]:
    """Say what of the scatter beside that of the tensions is worth telling.

    Args:
        sizes: by kind (see `ReadingErrors`).
    """
    told = [(kind.factor * sizes.get(name, 0.0), kind) for name, kind in OTHER_SCATTER.items()]
    return [f"{size:.1f}{kind.words}" for size, kind in told if size >= kind.least]
