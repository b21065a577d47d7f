"""The least sum of squared stresses: conditions of an optimum, torques out of reach, loads that nobody read."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from fingermodel.inverse.least_stress import least_stress

Floats = NDArray[np.float64]


def arms_and_area() -> tuple[Floats, Floats]:
    arms = np.array(
        [
            [5.4, 8.0, 5.6, 11.1, 12.3, -9.6],
            [8.6, 8.0, -8.5, 0.2, -2.0, -0.5],
            [-2.0, -2.0, -1.5, 10.0, 8.4, -4.0],
            [-1.0, -1.2, -1.0, 5.4, 0.0, -0.8],
        ]
    )
    return arms, np.array([3.5, 0.3, 2.8, 4.8, 4.8, 2.5])


@given(pulled=st.lists(st.floats(0.0, 20.0), min_size=6, max_size=6))
def test_least_stress_balances_and_meets_the_conditions_of_an_optimum(pulled: list[float]) -> None:
    """Karush, Kuhn and Tucker: the gradient is made of the moments' multipliers, and of bounds only where they act."""
    arms, area = arms_and_area()
    torque = arms @ np.array(pulled)
    found = least_stress(arms, torque, area)
    size = 1.0 + float(np.abs(torque).max())
    assert (found.tension >= 0.0).all()
    np.testing.assert_allclose(arms @ found.tension, torque - found.unbalanced, atol=1e-7 * size)
    assert np.linalg.norm(found.unbalanced) < 1e-6 * size
    stress = found.tension / area
    assert (stress**2).sum() <= ((np.array(pulled) / area) ** 2).sum() * (1 + 1e-9) + 1e-12
    free = found.tension > 1e-6 * size
    if free.sum() >= 4:
        multiplier, *_ = np.linalg.lstsq((arms * area)[:, free].T, stress[free], rcond=None)
        slope = stress - (arms * area).T @ multiplier
        assert np.abs(slope[free]).max() < 1e-6 * size
        assert slope[~free].min(initial=0.0) > -1e-6 * size


def test_a_torque_out_of_reach_is_met_as_nearly_as_pulling_can() -> None:
    arms, area = arms_and_area()
    arms, area = arms[:, :5], area[:5]
    # Without the long extensor nothing undoes what a flexor does.
    found = least_stress(arms, -5.0 * arms[:, 3], area)
    assert np.linalg.norm(found.unbalanced) > 1.0
    gain = arms.T @ found.unbalanced
    # No muscle that pulls a little more, or less where it pulls at all, would bring it nearer.
    assert gain.max() < 1e-6
    assert np.abs(gain[found.tension > 1e-9]).max(initial=0.0) < 1e-6


@given(pulled=st.lists(st.floats(0.0, 20.0), min_size=6, max_size=6), moment=st.floats(-200.0, 200.0))
def test_a_moment_that_may_take_any_value_changes_nothing(pulled: list[float], moment: float) -> None:
    """What is asked of the muscles is then the least over all moments: none does with less, and none is asked of."""
    arms, area = arms_and_area()
    column = np.array([[1.0, 0.1, 1.0, 1.0]])
    torque = arms @ np.array(pulled)
    found = least_stress(arms, torque, area, column)
    shifted = least_stress(arms, torque + moment * column[0], area, column)
    size = 1.0 + float(np.abs(torque).max()) + abs(moment)
    np.testing.assert_allclose(shifted.tension, found.tension, atol=1e-6 * size)
    missed = arms @ found.tension - torque
    np.testing.assert_allclose(missed, missed @ column[0] / (column @ column[0]) * column[0], atol=1e-7 * size)
    held = least_stress(arms, torque, area)
    assert ((found.tension / area) ** 2).sum() <= ((held.tension / area) ** 2).sum() * (1 + 1e-6) + 1e-9
