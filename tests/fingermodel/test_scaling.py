"""Laws of scaling: forces depend on ratios of lengths alone, arms scale with them, an arm asked for is had."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from daq.errors import ModelError
from fingermodel.fingers import Finger
from fingermodel.fingers.files import read_finger
from fingermodel.model import clamp_forces_batch, jax_values
from fingermodel.scaling import (
    flexion_arms,
    match_moment_arms,
    mean_moment_arms,
    phalanx_lengths,
    scale_by,
    scale_to_bones,
)
from fingermodel.statics import ClampForces
from tests.fingermodel.fingers import Floats, random_case

HUMAN = "synek2019_initial"
POSTURES = [np.deg2rad(q) for q in ((0, 55, 57, 25), (0, 40, 55, 35), (0, -20, 50, 45), (0, 0, 65, 50))]
factors = st.floats(0.3, 3.0)
seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module", params=[HUMAN, "an1979_middle", "wu2008_index"])
def finger(request: pytest.FixtureRequest) -> Finger:
    return read_finger(request.param)


def by_one(finger: Finger, factor: float) -> Finger:
    return scale_by(finger, dict.fromkeys(finger.topology.bones, factor))


def forces(finger: Finger, posture: Floats, tension: Floats) -> ClampForces:
    return clamp_forces_batch(finger.topology, jax_values(finger.values), posture[None], tension[None])


@given(factor=factors, seed=seeds)
def test_scaled_as_a_whole_forces_stay_and_arms_and_moments_scale(finger: Finger, factor: float, seed: int) -> None:
    """Statics knows no length of its own: N per N cannot change, mm and N mm take the factor."""
    posture, tension = random_case(finger, np.random.default_rng(seed))
    scaled = by_one(finger, factor)
    before, after = forces(finger, posture, tension), forces(scaled, posture, tension)
    assert_allclose(after.tip[0, :3], before.tip[0, :3], rtol=1e-9, atol=1e-9)
    assert_allclose(after.bone, before.bone, rtol=1e-9, atol=1e-9)
    assert_allclose(after.tip[0, 3:], factor * np.asarray(before.tip[0, 3:]), rtol=1e-9, atol=1e-8)
    assert_allclose(flexion_arms(scaled, posture), factor * flexion_arms(finger, posture), rtol=1e-12, atol=1e-12)


@given(ratios=st.lists(factors, min_size=3, max_size=3))
def test_scaling_by_one_is_the_identity_and_scaling_back_returns(finger: Finger, ratios: list[float]) -> None:
    bones = finger.topology.bones[1:]
    for ours, theirs in zip(by_one(finger, 1.0).values, finger.values, strict=True):
        assert np.array_equal(ours, theirs)
    there = scale_by(finger, dict(zip(bones, ratios, strict=True)))
    back = scale_by(there, dict(zip(bones, (1.0 / r for r in ratios), strict=True)))
    for ours, theirs in zip(back.values, finger.values, strict=True):
        assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12)


@given(lengths=st.tuples(st.floats(20, 90), st.floats(12, 60), st.floats(8, 40)))
def test_the_bones_come_out_as_long_as_was_asked(lengths: tuple[float, float, float]) -> None:
    human = read_finger(HUMAN)
    wanted = dict(zip(human.topology.bones[1:], lengths, strict=True))
    scaled = scale_to_bones(human, wanted, phalanx_lengths(human))
    between_joints = scaled.phalanx_lengths_mm()
    assert between_joints == pytest.approx({bone: wanted[bone] for bone in ("PP", "MP")})
    grown = np.linalg.norm(scaled.values.load_point) / np.linalg.norm(human.values.load_point)
    assert grown == pytest.approx(wanted["DP"] / phalanx_lengths(human)["DP"])


@given(index=st.integers(0, 12), factor=st.floats(0.7, 1.3))
def test_an_arm_that_is_asked_for_is_had_and_no_other_moves(index: int, factor: float) -> None:
    human = read_finger(HUMAN)
    before = mean_moment_arms(human, POSTURES)
    name = human.topology.segments[index].name
    wanted = factor * float(before[index])
    matched = match_moment_arms(human, {name: wanted}, POSTURES)
    after = mean_moment_arms(matched, POSTURES)
    assert after[index] == pytest.approx(wanted, abs=1e-8)
    assert_allclose(np.delete(after, index), np.delete(before, index), atol=1e-12)
    for ours, theirs in zip(matched.values, human.values, strict=True):
        moved = np.abs(np.asarray(ours) - np.asarray(theirs)) > 0.0
        assert not (moved[..., [0, 2]].any() if moved.ndim == 2 else moved.any())


def test_the_published_lengths_follow_from_the_files() -> None:
    """Table 3 of Synek et al. 2019, the last phalanx from its load point at mid pulp."""
    assert {b: round(x, 1) for b, x in phalanx_lengths(read_finger("synek2019_optimised")).items()} == {
        "PP": 47.0,
        "MP": 28.8,
        "DP": 19.0,
    }
    assert phalanx_lengths(read_finger("synek2019_bonobo")) == pytest.approx(
        {"PP": 57.8, "MP": 38.1, "DP": 20.4}, abs=0.01
    )


def test_a_load_point_beyond_mid_pulp_gives_no_length() -> None:
    """20 mm from the joint, the tapping finger is not held at mid pulp: its last bone would be the longest but one."""
    assert set(phalanx_lengths(read_finger("wu2008_index"))) == {"PP", "MP"}


def test_what_cannot_be_scaled_is_said() -> None:
    human = read_finger(HUMAN)
    with pytest.raises(ModelError, match="no length for DP"):
        scale_to_bones(human, {"PP": 40.0, "MP": 25.0}, phalanx_lengths(human))
    with pytest.raises(ModelError, match=r"no segment MCP\.EPL"):
        match_moment_arms(human, {"MCP.EPL": 5.0}, POSTURES)
    with pytest.raises(ModelError, match="no shift within 15 mm"):
        match_moment_arms(human, {"MCP.FDP": 40.0}, POSTURES)
