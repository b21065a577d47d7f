"""Kinematics, moment arms and forces agree with MuJoCo, which knows nothing of our equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from fingermodel.fingers import Finger, FingerValues, Topology
from fingermodel.fingers.files import read_finger
from fingermodel.model import clamp_forces_batch, jax_values, posture_moment_arms, tip_kinematics_batch
from tests.fingermodel.fingers import FINGERS, Floats, six_axes, straight

pytest.importorskip("mujoco")

from tests.fingermodel.mujoco_finger import MujocoFinger

COUNT = 200
NEWTON = 1e-9
# Beyond it the tip force hangs on rounding: the clamped finger is all but singular there.
WORST_CONDITION = 1e3


@dataclass(frozen=True)
class Trial:
    """A finger, the same in MuJoCo, seeded postures (n, rotations) [rad] and tensions (n, muscles) [N]."""

    topology: Topology
    values: FingerValues
    theirs: MujocoFinger
    posture: Floats
    tension: Floats


@pytest.fixture(scope="module", params=[*FINGERS, "skew axes", "six axes"])
def trial(request: pytest.FixtureRequest) -> Trial:
    """Every shipped finger with straight tendons, and fingers whose axes are neither orthogonal nor aligned."""
    topology, values = _finger(str(request.param))
    return _trial(topology, values, np.random.default_rng(11), (-0.4, 1.2))


@pytest.fixture(scope="module", params=FINGERS)
def shipped(request: pytest.FixtureRequest) -> Finger:
    """Every shipped finger as it is, with tendons that wrap."""
    return read_finger(str(request.param))


def test_moment_arms(trial: Trial) -> None:
    for posture in trial.posture:
        ours = np.asarray(posture_moment_arms(trial.topology, trial.values, posture))
        assert_allclose(ours, trial.theirs.pose(posture).moment_arms, rtol=0, atol=1e-11)


def test_tip_kinematics(trial: Trial) -> None:
    ours = tip_kinematics_batch(trial.topology, trial.values, trial.posture)
    for jacobian, to_base, posture in zip(
        np.asarray(ours.jacobian), np.asarray(ours.to_base), trial.posture, strict=True
    ):
        theirs = trial.theirs.pose(posture)
        assert_allclose(jacobian, theirs.jacobian, rtol=0, atol=1e-11)
        assert_allclose(to_base, theirs.to_base, rtol=0, atol=1e-13)


def test_forces_on_both_clamps(trial: Trial) -> None:
    assert_same_forces(trial)


@pytest.mark.parametrize(
    ("bend", "unwrapped"),
    [((0.15, 1.0), "landsmeer1_palmar"), ((-0.6, -0.15), "landsmeer1_dorsal")],
    ids=["flexed", "extended"],
)
def test_forces_where_no_loaded_tendon_wraps(shipped: Finger, bend: tuple[float, float], unwrapped: str) -> None:
    """Flexors run free in flexion, what enters the hood in extension: no posture frees both, so load one of them."""
    topology = shipped.topology
    trial = _trial(topology, jax_values(shipped.values), np.random.default_rng(12), bend)
    hood = topology.hood
    assert hood is not None
    free = [(m in hood.members) == (unwrapped == "landsmeer1_dorsal") for m in topology.muscles]
    assert_same_forces(Trial(trial.topology, trial.values, trial.theirs, trial.posture, trial.tension * free))


@pytest.mark.parametrize(
    ("bend", "wrapped"),
    [((0.15, 1.0), "landsmeer1_dorsal"), ((-0.6, -0.15), "landsmeer1_palmar")],
    ids=["flexed", "extended"],
)
def test_flexion_arms_where_tendons_wrap(shipped: Finger, bend: tuple[float, float], wrapped: str) -> None:
    """A tendon that lies on the bone has the arm that MuJoCo finds for the joint at 0°, every other one its own."""
    topology = shipped.topology
    trial = _trial(topology, jax_values(shipped.values), np.random.default_rng(13), bend)
    flexions = [topology.rotations.index(j.rotations[j.flexion]) for j in topology.joints]
    for posture in trial.posture:
        ours = np.asarray(posture_moment_arms(topology, trial.values, posture))
        bent = trial.theirs.pose(posture).moment_arms
        unbent = trial.theirs.pose(np.where(np.isin(np.arange(len(posture)), flexions), 0.0, posture)).moment_arms
        for i, segment in enumerate(topology.segments):
            row = flexions[topology.joints.index(topology.joint(segment.joint))]
            theirs = unbent if segment.wrap == wrapped else bent
            assert ours[row, i] == pytest.approx(theirs[row, i], rel=0, abs=1e-11)


def assert_same_forces(trial: Trial) -> None:
    ours = clamp_forces_batch(trial.topology, trial.values, trial.posture, trial.tension)
    theirs = [trial.theirs.forces(q, t) for q, t in zip(trial.posture, trial.tension, strict=True)]
    # A torque of 1e-9 N at a lever of a finger's length is the same error as a force of 1e-9 N.
    scale = np.array([1.0, 1.0, 1.0, 50.0, 50.0, 50.0])
    assert_allclose(np.asarray(ours.tip) / scale, np.array([tip for tip, _ in theirs]) / scale, rtol=0, atol=NEWTON)
    assert_allclose(np.asarray(ours.bone), np.array([bone for _, bone in theirs]), rtol=0, atol=NEWTON)


def _finger(name: str) -> tuple[Topology, FingerValues]:
    if name == "six axes":
        return six_axes(5)
    if name == "skew axes":
        finger = _skew(straight(read_finger("an1979_middle")), np.random.default_rng(6))
    else:
        finger = straight(read_finger(name))
    return finger.topology, jax_values(finger.values)


def _skew(finger: Finger, rng: np.random.Generator) -> Finger:
    """Turn every axis and suture some 20° its own way, and take joint centres and load point off the bones' axes."""
    values = finger.values
    skew = {
        name: Rotation.from_rotvec(rng.normal(0.0, 0.35, np.shape(vectors))).apply(np.asarray(vectors))
        for name, vectors in (("axis", values.axis), ("suture", values.suture))
    }
    aside = {
        name: np.asarray(points) + rng.normal(0.0, 2.0, np.shape(points))
        for name, points in (("centre", values.centre), ("load_point", values.load_point))
    }
    return finger.replace_values(**skew, **aside)


def _trial(topology: Topology, values: FingerValues, rng: np.random.Generator, bend: tuple[float, float]) -> Trial:
    """Draw COUNT postures between two angles [rad], abduction within 0.25, that determine the tip force."""
    theirs = MujocoFinger(topology, values)
    aside = np.array([name == "abduction" for name in topology.rotations])
    postures: list[Floats] = []
    while len(postures) < COUNT:
        n = len(topology.rotations)
        posture = np.where(aside, rng.uniform(-0.25, 0.25, n), rng.uniform(*bend, n))
        if _condition(topology, theirs.pose(posture).jacobian) < WORST_CONDITION:
            postures.append(posture)
    return Trial(topology, values, theirs, np.array(postures), rng.uniform(0.0, 9.0, (COUNT, len(topology.muscles))))


def _condition(topology: Topology, jacobian: Floats) -> float:
    # A typical lever makes rows of force and of moment comparable.
    unit = np.array([1.0, 1.0, 1.0, 20.0, 20.0, 20.0])
    return float(np.linalg.cond((jacobian * unit[:, None])[list(topology.reactions)]))
