"""Predictions of any posture and load, in portions that the service takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from daq.errors import InputError
from fingertwin.client.exchange import Exchange, path_of, reading
from fingertwin.client.summaries import Floats

# Load cases of one request.
PORTION = 10_000
Columns = Mapping[str, ArrayLike]


@dataclass(frozen=True, eq=False)
class Prediction:
    """Forces that the finger exerts on what holds it: x proximal, y dorsal, z radial.

    Attributes:
        model: that predicted.
        tip_force_N: (n, 3) in the distal phalanx's axes; NaN where the finger is straight.
        tip_moment_Nmm: (n, 3) about the load point in the mid pulp.
        bone_force_N: (n, 3) in the metacarpal's axes.
    """

    model: str
    tip_force_N: Floats
    tip_moment_Nmm: Floats
    bone_force_N: Floats

    def __len__(self) -> int:
        return len(self.tip_force_N)


def predict(
    exchange: Exchange,
    postures_deg: Columns,
    masses_g: Columns | None,
    tensions_N: Columns | None,
    more: dict[str, Any],
) -> Prediction:
    """Ask for predictions.

    Args:
        exchange: with the service.
        postures_deg: angle of each joint [deg]; a number, or one for each load case. An abduction left out is 0.
        masses_g: weight on each tendon; or
        tensions_N: the tension in each.
        more: model, tension factor, gravity.

    Raises:
        InputError: columns of different lengths, or a number that is none.
        ServiceError: the service refused.
    """
    columns = {
        name: _columns(given, name)
        for name, given in (("postures_deg", postures_deg), ("masses_g", masses_g), ("tensions_N", tensions_N))
        if given is not None
    }
    lengths = {len(values) for part in columns.values() for values in part.values()}
    count = max(lengths, default=1)
    if lengths - {1, count}:
        raise InputError(f"columns of {', '.join(map(str, sorted(lengths)))} load cases", "as many in each, or one")
    names = ("tip_force_N", "tip_moment_Nmm", "bone_force_N")
    parts: dict[str, list[Floats]] = {name: [] for name in names}
    model = ""
    for first in range(0, count, PORTION):
        portion = {name: _portion(part, first, count) for name, part in columns.items()}
        answer = exchange.post(path_of("predictions"), portion | more, again=True)
        with reading("predictions"):
            model = answer["model"]
            for name in names:
                parts[name].append(np.array(answer[name], dtype=np.float64).reshape(-1, 3))
    return Prediction(model, *(np.concatenate(parts[name]) for name in names))


def _columns(given: Columns, what: str) -> dict[str, Floats]:
    return {name: _column(values, f"{what} {name}") for name, values in given.items()}


def _column(values: ArrayLike, what: str) -> Floats:
    expected = "a number, or one for each load case"
    try:
        column = np.atleast_1d(np.asarray(values, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise InputError(f"{what}: {values!r:.60}", expected) from error
    if column.ndim != 1 or not len(column):
        raise InputError(f"{what} of shape {column.shape}", expected)
    wrong = np.flatnonzero(~np.isfinite(column))
    if len(wrong):
        raise InputError(f"{what} is {column[wrong[0]]} in row {wrong[0]}", "finite numbers")
    return column


def _portion(part: dict[str, Floats], first: int, count: int) -> dict[str, list[float]]:
    return {n: (v if len(v) == 1 < count else v[first : first + PORTION]).tolist() for n, v in part.items()}
