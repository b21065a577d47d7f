"""Errors that a group of cases has in common, as columns beside the model: of a weight, a line or a setting."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fingermodel.arrays import Floats, Ints, Mask
from fingermodel.budget import Budget
from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.settings import ANGLE_RAD, LEVER_MM, READING

# Tensions [N] that agree in so many digits are of one weight.
_ALIKE_DIGITS = 6
# Half waves by which a zero moves within a setting.
_WAVES = (1, 2, 3)


class GroupErrors(NamedTuple):
    """How large errors are that a group of cases has in common: of one weight, one tendon's line, or one setting.

    For each setting the finger is clamped, and the cell tared, anew.
    """

    weight: float  # of each weight that hangs in several cases, relative
    line_rad: float  # by which each tendon's line at the metacarpal is turned about each axis
    # That the tare missed along each axis, at the tip and at the bone; of a moment `LEVER_MM` times as many N mm.
    zero_N: float
    drift_N: float  # by which that zero moves to and fro within the setting, as `zero_N`
    turn_rad: float  # by which the cell is turned about each axis, at the tip and at the bone
    hold_mm: float  # by which the tip is held elsewhere along each axis
    apart_rad: float  # by which each joint angle differs at the tip, and the other way at the bone, from their mean

    @classmethod
    def usual(cls, budget: Budget) -> GroupErrors:
        """Of each setting as large as a budget states those of a whole session; of usual weights and lines."""
        turn, apart = np.deg2rad([budget.cell_rotation_sd_deg, budget.angle_sd_deg / np.sqrt(2.0)]).tolist()
        zero, hold = budget.zero_tip_sd_N, budget.mount_offset_sd_mm
        return cls(READING.scale, ANGLE_RAD.scale, zero, zero, turn, hold, apart)


def by_group(
    observations: Observations, rows: Ints, suture: Floats, by_tension: Floats, by_angle: Floats
) -> dict[str, Floats]:
    """(n, k) change of every reading per unit of each of the errors, in one group a column.

    What is turned, and what has a lever, is what was read.

    Args:
        observations: of the session.
        rows: (n,) indices of the readings into the flattened (cases, 6) wrench.
        suture: (muscles, 3) direction of each tendon at the metacarpal.
        by_tension: (n, muscles) change of every reading by the logarithm of each tension.
        by_angle: (n, rotations) change of every reading per radian of each joint angle.
    """
    inputs, reading = observations.inputs, np.nan_to_num(observations.wrench).reshape(-1, 2, 3)
    force, moment = (np.cross(np.eye(3)[:, None], reading[:, k]) for k in (0, 1))
    turned, lever = (np.concatenate(both, axis=2) for both in ((force, moment), (np.zeros_like(force), force)))
    of_turn, of_hold = (whole.reshape(3, -1)[:, rows].T for whole in (turned, lever))
    setting, bone, check = (np.asarray(of)[rows // 6] for of in (inputs.setting, inputs.at_bone, inputs.is_check))
    settings = np.unique(setting[~check])
    at_tip, at_bone = ([1.0 * ((setting == k) & (bone == at) & ~check) for k in settings] for at in (False, True))
    unit = np.where(rows % 6 < 3, 1.0, LEVER_MM)[:, None] * np.eye(6)[rows % 6]
    zeros = [here for of_mount in (at_tip, at_bone) if sum(here.any() for here in of_mount) > 1 for here in of_mount]
    sign = np.where(bone, -1.0, 1.0)
    both = [(tip + other) * sign for tip, other in zip(at_tip, at_bone, strict=True) if tip.any() and other.any()]
    return {
        "weight": _of_weights(np.asarray(inputs.tension), rows // 6, by_tension),
        "line_rad": in_each([1.0 * (bone & ~check)], _of_lines(np.asarray(inputs.tension), rows, suture)),
        "zero_N": in_each(zeros, unit),
        "drift_N": in_each(_to_and_fro([*at_tip, *at_bone], np.asarray(inputs.elapsed)[rows // 6]), unit),
        "turn_rad": in_each([*at_tip, *at_bone], of_turn),
        "hold_mm": in_each(at_tip, of_hold),
        "apart_rad": in_each(both, by_angle),
    }


def _of_weights(tension: Floats, cases: Ints, by_tension: Floats) -> Floats:
    """Columns (n, k) of the error of each weight that hangs in several cases.

    Half of its variance is of the weight on whichever tendon, half of what hangs on one tendon.
    """
    rounded, columns = np.round(tension, _ALIKE_DIGITS), list[Floats]()
    each_tendon = np.eye(tension.shape[1], dtype=bool)
    for weight in np.unique(rounded[rounded > 0.0]):
        hangs = rounded == weight
        several = [on for on in (hangs, *(hangs & tendon for tendon in each_tendon)) if on.any(axis=1).sum() > 1]
        columns += [(on[cases] * by_tension).sum(axis=1) / np.sqrt(2.0) for on in several]
    return np.array(columns).reshape(-1, len(cases)).T


def _of_lines(tension: Floats, rows: Ints, suture: Floats) -> Floats:
    """Change (n, 3 muscles) of every reading at the metacarpal per radian of each tendon's line about each axis."""
    across = np.cross(np.eye(3)[:, None], suture)
    pulled = np.zeros((len(tension), *across.shape[:2], 6))
    pulled[..., :3] = tension[:, None, :, None] * across
    return pulled[rows // 6, :, :, rows % 6].reshape(len(rows), -1)


def _to_and_fro(where: Sequence[Floats], elapsed: Floats) -> list[Floats]:
    """Slow changes (n,) in each of some sets of readings (n,): the slower, the larger."""
    out = list[Floats]()
    for here in where:
        of_here = elapsed[here > 0.0]
        lasts = np.ptp(of_here) if len(of_here) else 0.0
        if lasts > 0.0:
            out += list((here[:, None] * waves((elapsed - of_here.min()) / lasts)).T)
    return out


def waves(share: Floats) -> Floats:
    """Slow changes (n, k) over a time of which a share (n,) has passed: half waves, the slower, the larger."""
    halves = np.array(_WAVES)
    return np.cos(np.pi * share[:, None] * halves) / halves


def in_each(where: Sequence[Floats | Mask], changes: Floats) -> Floats:
    """Changes (n, c) as columns (n, k) of their own in each of some sets of readings (n,); none that are nothing."""
    columns = np.concatenate([np.zeros((len(changes), 0)), *[here[:, None] * changes for here in where]], axis=1)
    return columns[:, columns.any(axis=0)]


def zero_moments(observations: Observations, rows: Ints, size_N: float) -> Floats:
    """Columns (n, k) of the moments at the tip that the tare missed, one for each mounting and axis.

    Args:
        observations: of the session.
        rows: (n,) indices of the readings into the flattened (cases, 6) wrench.
        size_N: of the force that the tare missed there.
    """
    mounting = np.asarray(observations.inputs.mounting)[rows // 6]
    tip = np.array(observations.locations)[rows // 6] == "tip"
    here = [(mounting == k) & tip & (rows % 6 == c) for c in (3, 4, 5) for k in np.unique(mounting)]
    return in_each(here, np.full((len(rows), 1), LEVER_MM * size_N))
