"""Activation: the baseline is what was asked for, heads go together, and forces add up."""

from __future__ import annotations

import numpy as np
import pytest

from fingermodel.studies.activation import LEVELS_PCT, activate
from fingermodel.studies.activation_result import ActivationResult, angle_between

THUMB = "barry2018_thumb"


@pytest.fixture(scope="module")
def pinch() -> ActivationResult:
    return activate(THUMB, force_N={"palmar": 20.0, "radial": 2.0}, lost={"ADP": 1.0})


def test_the_baseline_is_the_force_asked_for(pinch: ActivationResult) -> None:
    assert pinch.force_N == pytest.approx([0.0, -20.0, 2.0], abs=1e-6)
    assert pinch.torque_Nmm == pytest.approx(0.0, abs=1e-5)


def test_heads_lose_activation_together(pinch: ActivationResult) -> None:
    assert [d.muscle for d in pinch.deficits] == ["FPL", "FPB", "EPL", "EPB", "APL", "APB", "OPP", "ADP"]
    assert pinch.muscles[-2:] == ("ADPo", "ADPt")
    assert pinch.lost_force_N == pytest.approx(pinch.deficit("ADP").force_N[-1])


def test_every_muscle_starts_from_the_same_force_in_steps_of_a_quarter(pinch: ActivationResult) -> None:
    for d in pinch.deficits:
        assert tuple(d.levels_pct) == LEVELS_PCT
        assert d.force_N[0] == pytest.approx(pinch.force_N)
        assert d.change_deg()[0] == pytest.approx(0.0, abs=1e-6)
        assert d.change_pct[0] == pytest.approx(0.0)


def test_forces_of_single_muscles_add_up_to_that_of_all() -> None:
    everything = activate(THUMB)
    total = sum(m.force_N for m in everything.alone)
    assert everything.force_N == pytest.approx(total, abs=1e-6)


@pytest.mark.parametrize(
    ("one", "other", "angle"),
    [
        pytest.param([1, 0, 0], [0, 2, 0], 90.0, id="square"),
        pytest.param([1, 0, 0], [3, 0, 0], 0.0, id="along"),
        pytest.param([0, 1, 0], [0, -1, 0], 180.0, id="against"),
        pytest.param([1, 0, 0], [0, 0, 0], None, id="none"),
    ],
)
def test_angles_between_forces(one: list[float], other: list[float], angle: float | None) -> None:
    assert angle_between(np.array(one, float), np.array(other, float)) == (
        None if angle is None else pytest.approx(angle)
    )
