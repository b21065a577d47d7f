"""MuJoCo, given the same points, hinges and cylinders, has the same moment arms: another program's wrapping."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from fingermodel.fingers import Finger
from fingermodel.fingers.files import read_finger
from fingermodel.isometric.forces import IsometricFinger, muscle_arms
from fingermodel.isometric.surfaces import read_wraps
from fingermodel.muscles.muscle_files import read_muscles
from tests.fingermodel.exchanged import required

Floats = NDArray[np.float64]
FINGERS = {
    "barry2018_index": ([0.0, -0.26, 0.0, 0.0], [1.4, 0.26, 1.4, 1.2]),
    "barry2018_thumb": ([-0.4, -0.4, 0.0, 0.0], [0.4, 0.4, 0.7, 1.0]),
}


def _numbers(values: object) -> str:
    return " ".join(f"{float(x):.12g}" for x in np.ravel(np.asarray(values)))


def mjcf(finger: Finger) -> str:
    """The finger's chain, one tendon a segment, a cylinder under each that wraps; millimetres."""
    topology, values = finger.topology, finger.values
    wraps, cylinders = read_wraps(finger)
    inside = dict.fromkeys(range(len(topology.bones)), "")
    over: dict[int, str] = {}
    for i, wrap in enumerate(wraps):
        joint = topology.joints[wrap.joint]
        centre, axis, side, radius = (np.asarray(field)[i] for field in cylinders)
        inside[joint.child if wrap.on_child else joint.parent] += (
            f'<geom name="c{i}" type="cylinder" size="{radius} 5" pos="{_numbers(centre)}" zaxis="{_numbers(axis)}"/>'
            f'<site name="e{i}" pos="{_numbers(centre + 2.0 * radius * side)}"/>'
        )
        over[wrap.segment] = f'<geom geom="c{i}" sidesite="e{i}"/>'
    tendons = ""
    for i, segment in enumerate(topology.segments):
        inside[segment.proximal_bone] += f'<site name="p{i}" pos="{_numbers(values.proximal_point[i])}"/>'
        inside[segment.distal_bone] += f'<site name="d{i}" pos="{_numbers(values.distal_point[i])}"/>'
        tendons += f'<spatial name="s{i}"><site site="p{i}"/>{over.get(i, "")}<site site="d{i}"/></spatial>'
    body, first = inside[0], 0
    for joint, centre in zip(topology.joints, values.centre, strict=True):
        body += f'<body pos="{_numbers(centre)}"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
        for k, name in enumerate(joint.rotations):
            body += f'<joint name="{name}" axis="{_numbers(values.axis[first + k])}"/>'
        first += len(joint.rotations)
        body += inside[joint.child]
    chain = body + "</body>" * len(topology.joints)
    return f'<mujoco><compiler angle="radian"/><worldbody>{chain}</worldbody><tendon>{tendons}</tendon></mujoco>'


@pytest.mark.parametrize("name", FINGERS)
def test_moment_arms_over_surfaces_are_mujocos(name: str) -> None:
    mujoco = required("mujoco")
    finger = read_finger(name)
    held = IsometricFinger(finger, read_muscles(name, finger))
    model = mujoco.MjModel.from_xml_string(mjcf(finger))
    data = mujoco.MjData(model)
    topology = finger.topology
    sums = np.array([[s.slip == m for s in topology.segments] for m in topology.muscles], dtype=float)
    low, high = FINGERS[name]
    postures = np.random.default_rng(1).uniform(low, high, (60, 4))
    ours = np.asarray(jax.jit(jax.vmap(lambda q: muscle_arms(held.structure, held.numbers, q)))(jnp.asarray(postures)))
    theirs = np.zeros_like(ours)
    for i, posture in enumerate(postures):
        data.qpos[:] = posture
        mujoco.mj_forward(model, data)
        slope = np.zeros((model.ntendon, model.nv))
        slope[np.repeat(np.arange(model.ntendon), model.ten_J_rownnz), model.ten_J_colind] = data.ten_J
        theirs[i] = -(sums @ slope).T
    assert_allclose(ours, theirs, atol=1e-6)
