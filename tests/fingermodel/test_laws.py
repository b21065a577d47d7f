"""Laws that hold for any finger: work, balance, superposition, and that nothing depends on how one looks at it."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from fingermodel.extensor import segment_tensions
from fingermodel.fingers import FingerValues, Topology
from fingermodel.fingers.files import read_finger
from fingermodel.kinematics import TipKinematics, joint_poses, tip_kinematics
from fingermodel.model import clamp_forces_batch, jax_values, posture_moment_arms
from fingermodel.session import Session
from fingermodel.statics import ClampForces, clamp_forces, joint_loads, joint_torques
from fingermodel.tendons import joint_pulls, segment_lengths
from tests.fingermodel.fingers import FINGERS, random_case, six_axes, straight

seeds = st.integers(0, 2**32 - 1)


class Everything(NamedTuple):
    """What one posture and set of tensions gives, step by step."""

    kinematics: TipKinematics
    torque: jax.Array
    forces: ClampForces
    loads: jax.Array
    pulled_at_first: jax.Array


@pytest.fixture(params=FINGERS)
def finger_name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@given(seed=seeds)
def test_moment_arm_is_minus_the_derivative_of_the_tendons_length(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for topology, values in (_straight("an1979_middle"), _straight("synek2019_initial"), six_axes(seed)):
        posture = jnp.asarray(rng.uniform(-0.8, 1.2, len(topology.rotations)))
        arms = posture_moment_arms(topology, values, posture)
        rate = _length_rate(topology, values, posture)
        assert_allclose(np.asarray(arms), -np.asarray(rate).T, atol=1e-10)


@given(seed=seeds)
def test_tip_force_does_the_tendons_work(seed: int) -> None:
    """Virtual work: what the tendons do along any small motion, the tip does too."""
    rng = np.random.default_rng(seed)
    topology, values = six_axes(seed)
    posture, tension = jnp.asarray(rng.uniform(-0.5, 1.0, 6)), jnp.asarray(rng.uniform(0, 9, 6))
    found = _everything(topology, values, posture, tension)
    forces, torque, jacobian = found.forces, found.torque, np.asarray(found.kinematics.jacobian)
    motion = rng.normal(size=6)
    scale = np.abs(jacobian.T @ np.asarray(forces.tip)).max() + np.abs(np.asarray(torque)).max()
    assert_allclose(np.asarray(forces.tip) @ jacobian @ motion, np.asarray(torque) @ motion, atol=1e-9 * scale)


@given(seed=seeds)
def test_forces_superpose(seed: int) -> None:
    rng = np.random.default_rng(seed)
    finger = read_finger(FINGERS[seed % len(FINGERS)])
    topology, values = finger.topology, jax_values(finger.values)
    posture, a = random_case(finger, rng)
    b, k = rng.uniform(0, 9, len(topology.muscles)), rng.uniform(0.1, 3.0)
    tensions = jnp.asarray(np.stack([a, b, a + k * b]))
    forces = clamp_forces_batch(topology, values, jnp.tile(jnp.asarray(posture), (3, 1)), tensions)
    for f in (np.asarray(forces.tip), np.asarray(forces.bone)):
        assert_allclose(f[2], f[0] + k * f[1], atol=1e-9 * (1 + np.abs(f).max()))


@given(seed=seeds)
def test_rotating_everything_rotates_the_answer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    topology, values = six_axes(seed)
    turn = Rotation.random(random_state=seed % 2**31).as_matrix()
    turned = FingerValues(
        *(jnp.asarray(np.asarray(v) @ turn.T) if np.ndim(v) and np.shape(v)[-1] == 3 else v for v in values)
    )
    posture, tension = jnp.asarray(rng.uniform(-0.5, 1.0, (1, 6))), jnp.asarray(rng.uniform(0, 9, (1, 6)))
    before = clamp_forces_batch(topology, values, posture, tension)
    after = clamp_forces_batch(topology, turned, posture, tension)
    tip = np.asarray(before.tip)[0]
    scale = 1e-8 * (1 + np.abs(tip).max())
    assert_allclose(np.asarray(after.tip)[0], np.concatenate([turn @ tip[:3], turn @ tip[3:]]), atol=scale)
    assert_allclose(np.asarray(after.bone)[0], turn @ np.asarray(before.bone)[0], atol=scale)


@given(seed=seeds)
def test_forces_and_moments_on_the_whole_finger_balance(seed: int) -> None:
    """The finger pushes on its two clamps with what the tendons pull, and no joint adds or loses a force."""
    rng = np.random.default_rng(seed)
    finger = read_finger(FINGERS[seed % len(FINGERS)])
    topology, values = finger.topology, jax_values(finger.values)
    posture, tension = random_case(finger, rng)
    found = _everything(topology, values, jnp.asarray(posture), jnp.asarray(tension))
    forces = found.forces
    out = np.asarray(forces.bone) + np.asarray(found.kinematics.to_base) @ np.asarray(forces.tip)[:3]
    assert_allclose(out, tension @ np.asarray(values.suture), atol=1e-9)
    # At the first joint: the bone feels the joint's load, and what pulleys turn (Eq 4).
    turned = tension @ np.asarray(values.suture) - np.asarray(found.pulled_at_first)
    assert_allclose(np.asarray(found.loads)[0] + turned, np.asarray(forces.bone), atol=1e-9)


def test_wrapped_arms_stay_as_they_are_at_zero(finger_name: str) -> None:
    finger = read_finger(finger_name)
    topology, values = finger.topology, jax_values(finger.values)
    at = {name: i for i, name in enumerate(topology.rotations)}
    flat = np.asarray(posture_moment_arms(topology, values, jnp.zeros(len(at))))
    for sign, wrap, bent in ((1, "landsmeer1_dorsal", 0.9), (-1, "landsmeer1_palmar", -0.3)):
        posture = np.array([bent if name != "abduction" else 0.0 for name in topology.rotations])
        arms = np.asarray(posture_moment_arms(topology, values, jnp.asarray(posture)))
        other = np.asarray(posture_moment_arms(topology, values, jnp.asarray(-posture)))
        wrapped = [i for i, s in enumerate(topology.segments) if s.wrap == wrap]
        assert wrapped, f"{finger_name} has no {wrap} segment ({sign})"
        for i in wrapped:
            row = at[topology.segments[i].joint]
            assert arms[row, i] == pytest.approx(flat[row, i], abs=1e-12)
            assert abs(other[row, i] - flat[row, i]) > 1e-3


def test_derivatives_with_respect_to_every_parameter_agree_with_differences() -> None:
    bench = Session.open("synek2019_H01", catalogue=False)
    model, inputs = bench.model, bench.observations.inputs
    case = jax.tree.map(lambda field: field[:1], inputs)
    rng = np.random.default_rng(3)
    theta = model.initial + rng.normal(size=len(model.initial)) * 0.01
    exact = np.asarray(model.jacobian(case, theta))[0]
    step = 1e-6
    for i in range(len(theta)):
        up, down = theta.copy(), theta.copy()
        up[i] += step
        down[i] -= step
        above, below = (np.asarray(model.predict(case, t).reading)[0] for t in (up, down))
        size = 2e-6 * (1 + np.abs(exact[:, i]).max())
        assert_allclose(exact[:, i], (above - below) / (2 * step), atol=size, err_msg=model.parameters.names[i])


def test_null_errors_of_the_rig_change_nothing_exactly() -> None:
    bench = Session.open("synek2019_H01", catalogue=False)
    prediction = bench.model.predict(bench.observations.inputs)
    at_tip = np.array([location == "tip" for location in bench.observations.locations])
    reading = np.asarray(prediction.reading)
    assert np.array_equal(reading[at_tip], np.asarray(prediction.forces.tip)[at_tip])
    assert np.array_equal(reading[~at_tip, :3], np.asarray(prediction.forces.bone)[~at_tip])


def _straight(name: str) -> tuple[Topology, FingerValues]:
    finger = straight(read_finger(name))
    return finger.topology, jax_values(finger.values)


@partial(jax.jit, static_argnums=0)
def _length_rate(topology: Topology, values: FingerValues, posture: jax.Array) -> jax.Array:
    return jax.jacobian(lambda q: segment_lengths(topology, values, joint_poses(topology, values, q)))(posture)


@partial(jax.jit, static_argnums=0)
def _everything(topology: Topology, values: FingerValues, posture: jax.Array, tension: jax.Array) -> Everything:
    poses = joint_poses(topology, values, posture)
    pulls = joint_pulls(topology, values, poses)
    pull = segment_tensions(topology, values, tension)
    torque = joint_torques(poses, pulls, pull)
    forces = clamp_forces(topology, values, poses, tension, torque)
    first = poses[0].rotation @ (pull[np.array(pulls[0].segments)] @ pulls[0].direction)
    loads = joint_loads(poses, pulls, pull, forces.tip)
    return Everything(tip_kinematics(topology, values, poses), torque, forces, loads, first)
