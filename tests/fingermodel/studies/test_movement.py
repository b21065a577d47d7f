"""A movement: its muscles carry the torques, and no instant could do with a less busy muscle."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import linprog

from fingermodel.fingers.files import read_finger
from fingermodel.muscles.muscle_files import read_muscles
from fingermodel.recruitment.moments import arms_and_excursions
from fingermodel.studies.movement import MovementResult, move

STEPS = 61


MUSCLES = ("FDP", "FDS", "EC", "EI", "RI", "UI", "LU")


@pytest.fixture(scope="module")
def result() -> MovementResult:
    return move("wu2008_tap", "wu2008_index", "wu2008", STEPS)


def test_muscles_carry_the_torques_at_every_instant(result: MovementResult) -> None:
    finger = read_finger(result.finger)
    muscles = read_muscles(result.muscle_set, finger)
    arms, longer = arms_and_excursions(finger.topology, finger.values, muscles.calibration, result.posture_rad)
    carried = np.einsum("nrm,nm->nr", arms, result.force)
    assert_allclose(carried, result.torque_Nmm, atol=1e-9 * np.abs(result.torque_Nmm).max())
    assert_allclose(result.length_mm, muscles.length_mm + longer)
    assert (result.active_N >= 0.0).all()
    assert (result.passive_N >= 0.0).all()
    # So that the bound by isometric strength is not beyond what fibres can give at their length and speed.
    assert (result.activation <= 1.0).all()


def test_no_instant_can_do_with_a_less_busy_muscle(result: MovementResult) -> None:
    """The largest activity is that of the linear programme, solved apart by SciPy (Eq 3)."""
    finger = read_finger(result.finger)
    muscles = read_muscles(result.muscle_set, finger)
    arms, _ = arms_and_excursions(finger.topology, finger.values, muscles.calibration, result.posture_rad)
    left = result.torque_Nmm - np.einsum("nrm,nm->nr", arms, result.passive_N)
    strength = np.asarray(muscles.values.max_force)
    count = len(MUSCLES)
    for activity, arm, torque in zip(result.activity, arms, left, strict=True):
        least = linprog(
            np.append(np.zeros(count), 1.0),
            A_ub=np.hstack([np.eye(count), -np.ones((count, 1))]),
            b_ub=np.zeros(count),
            A_eq=np.hstack([arm * strength, np.zeros((len(torque), 1))]),
            b_eq=torque,
            bounds=(0.0, None),
        )
        assert activity.max() == pytest.approx(least.fun, rel=1e-6)
