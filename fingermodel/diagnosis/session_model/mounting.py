"""What the mounting of finger and cell adds to the readings, as columns beside the model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fingermodel.budget import Budget
from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.session_model.discrepancy import Places
from fingermodel.diagnosis.settings import LEVER_MM

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]


class MountingErrors(NamedTuple):
    """How large errors of a mounting are that are made anew in each setting, for which the finger is clamped anew.

    Attributes:
        turn_rad: by which the cell is turned about each axis, at the tip and at the bone.
        hold_mm: by which the tip is held elsewhere along each axis.
        apart_rad: by which each joint angle differs at the tip, and the other way at the bone, from their mean.
    """

    turn_rad: float = 0.0
    hold_mm: float = 0.0
    apart_rad: float = 0.0

    @classmethod
    def stated(cls, budget: Budget) -> MountingErrors:
        """As large as a budget states those of a whole session."""
        turn, apart = np.deg2rad([budget.cell_rotation_sd_deg, budget.angle_sd_deg / np.sqrt(2.0)]).tolist()
        return cls(turn, budget.mount_offset_sd_mm, apart)


def clamped_anew(observations: Observations, rows: Rows, by_angle: Floats) -> dict[str, Floats]:
    """(n, k) change of every reading per unit of each of the errors, in one setting a column.

    What is turned, and what has a lever, is what was read.

    Args:
        observations: of the session.
        rows: (n,) indices of the readings into the flattened (cases, 6) wrench.
        by_angle: (n, rotations) change of every reading per radian of each joint angle.
    """
    inputs, reading = observations.inputs, np.nan_to_num(observations.wrench).reshape(-1, 2, 3)
    force, moment = (np.cross(np.eye(3)[:, None], reading[:, k]) for k in (0, 1))
    turned, lever = (np.concatenate(both, axis=2) for both in ((force, moment), (np.zeros_like(force), force)))
    of_turn, of_hold = (whole.reshape(3, -1)[:, rows].T for whole in (turned, lever))
    setting, bone, check = (np.asarray(of)[rows // 6] for of in (inputs.setting, inputs.at_bone, inputs.is_check))
    settings = np.unique(setting[~check])
    at_tip, at_bone = ([1.0 * ((setting == k) & (bone == at) & ~check) for k in settings] for at in (False, True))
    sign = np.where(bone, -1.0, 1.0)
    both = [(tip + other) * sign for tip, other in zip(at_tip, at_bone, strict=True) if tip.any() and other.any()]
    return {
        "turn_rad": _in_each([*at_tip, *at_bone], of_turn),
        "hold_mm": _in_each(at_tip, of_hold),
        "apart_rad": _in_each(both, by_angle),
    }


def _in_each(where: Sequence[Floats], changes: Floats) -> Floats:
    """Changes (n, c) as columns (n, k) of their own in each of some sets of readings (n,); none that are nothing."""
    columns = np.concatenate([np.zeros((len(changes), 0)), *[here[:, None] * changes for here in where]], axis=1)
    return columns[:, columns.any(axis=0)]


def zero_moments(observations: Observations, at: Places, rows: Rows, size_N: float) -> list[Floats]:
    """Columns (n,) of the moments at the tip that the tare missed, one for each mounting and axis.

    Args:
        observations: of the session.
        at: where each reading belongs.
        rows: (n,) indices of the readings into the flattened (cases, 6) wrench.
        size_N: of the force that the tare missed there.
    """
    mounting, out = np.asarray(observations.inputs.mounting)[at.cases], []
    tip = np.array([place == "tip" for place in observations.locations])[at.cases]
    for c in (3, 4, 5):
        for k in np.unique(mounting):
            column = LEVER_MM * size_N * ((mounting == k) & tip & (rows % 6 == c))
            if column.any():
                out.append(column.astype(float))
    return out
