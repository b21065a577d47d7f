"""What the mounting of finger and cell adds to the readings, as columns beside the model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.session_model.discrepancy import Places
from fingermodel.diagnosis.settings import LEVER_MM

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]


def turned_by_setting(observations: Observations, rows: Rows) -> Floats:
    """(n, k) change of every reading per radian by which the cell is turned about each axis in one setting.

    A posture is set by clamping the finger anew, at the tip and at the bone. What is turned is what was read.

    Args:
        observations: of the session.
        rows: (n,) indices of the readings into the flattened (cases, 6) wrench.
    """
    inputs, reading = observations.inputs, np.nan_to_num(observations.wrench)
    turned = np.concatenate([np.cross(np.eye(3)[:, None], part) for part in np.split(reading, 2, axis=1)], axis=2)
    place = np.stack([np.asarray(inputs.setting), np.asarray(inputs.at_bone)], axis=1)
    check, columns = np.asarray(inputs.is_check), []
    for own in np.unique(place[~check], axis=0):
        here = (place == own).all(axis=1) & ~check
        columns += [(t * here[:, None]).reshape(-1)[rows] for t in turned]
    return np.array(columns).T


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
