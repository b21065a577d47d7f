"""Posture to rotations: any chain of joints, any axes, any order, for one posture; batched by `jax.vmap`."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from fingermodel.fingers import FingerValues, Topology
from fingermodel.vectors import cross


class JointPose(NamedTuple):
    """One joint in one posture.

    Attributes:
        rotation: (3, 3) takes a vector's components in the child bone to the parent bone.
        unflexed: (3, 3) the same with the joint's flexion at 0 deg.
        axes: (rotations of the joint, 3) in the child bone's frame.
        cosine: (rotations of the joint,) of their angles.
        sine: (rotations of the joint,).
    """

    rotation: Array
    unflexed: Array
    axes: Array
    cosine: Array
    sine: Array


def turn(axis: Array, cosine: Array, sine: Array) -> Array:
    """Matrices (…, 3, 3) of rotations about unit axes (…, 3), their angles given as cosines and sines (…,)."""
    unit = np.eye(3)
    cosine, sine, across = cosine[..., None, None], sine[..., None, None], axis[..., None, :]
    return cosine * unit + sine * cross(unit, across) + (1.0 - cosine) * (axis[..., :, None] * across)


def turn_about(coordinate: int, cosine: Array, sine: Array) -> Array:
    """Matrix (3, 3) of a rotation about a coordinate axis, its angle given as cosine and sine."""
    unit = np.eye(3)
    along = np.outer(unit[coordinate], unit[coordinate])
    return cosine * (unit - along) + sine * np.cross(unit, unit[coordinate]) + along


def joint_poses(topology: Topology, values: FingerValues, posture: Array) -> tuple[JointPose, ...]:
    """Return every joint's pose, proximal to distal, for a posture (rotations,) in rad."""
    # All at once: four operations of a kind would each be compiled, and differentiated, by itself.
    every_axis = jnp.asarray(values.axis)
    cosine, sine = jnp.cos(posture), jnp.sin(posture)
    matrices = turn(every_axis, cosine, sine)
    poses, first = [], 0
    for joint in topology.joints:
        last = first + len(joint.rotations)
        axes: list[Array] = []
        rotation: Array | None = None
        unflexed: Array | None = None
        # From the most distal rotation inwards, so that each axis is carried back through those beyond it.
        for i in reversed(range(first, last)):
            axis, matrix = every_axis[i], matrices[i]
            axes.insert(0, axis if rotation is None else axis @ rotation)
            rotation = matrix if rotation is None else matrix @ rotation
            if i - first != joint.flexion:
                unflexed = matrix if unflexed is None else matrix @ unflexed
        same = jnp.eye(3)
        poses.append(
            JointPose(
                same if rotation is None else rotation,
                same if unflexed is None else unflexed,
                jnp.stack(axes),
                cosine[first:last],
                sine[first:last],
            )
        )
        first = last
    return tuple(poses)


class TipKinematics(NamedTuple):
    """How the load point moves, in the axes of the most distal bone.

    Attributes:
        jacobian: (6, rotations) velocity of the load point [mm/rad] over spin [rad/rad].
        to_base: (3, 3) takes components in the most distal bone to the first one.
    """

    jacobian: Array
    to_base: Array


def tip_kinematics(topology: Topology, values: FingerValues, poses: tuple[JointPose, ...]) -> TipKinematics:
    """Jacobian of the load point and orientation of the most distal bone."""
    spins: list[Array] = []
    levers: list[Array] = []
    to_base = jnp.eye(3)
    lever = jnp.asarray(values.load_point)
    for index in reversed(range(len(topology.joints))):
        outermost = index == len(topology.joints) - 1
        pose = poses[index]
        spin = pose.axes if outermost else pose.axes @ to_base
        spins.insert(0, spin)
        levers.insert(0, jnp.broadcast_to(lever, spin.shape))
        to_base = pose.rotation if outermost else pose.rotation @ to_base
        # The next joint inwards sees the load point from its own centre.
        lever = lever + jnp.asarray(values.centre[index]) @ to_base
    spin = jnp.concatenate(spins)
    return TipKinematics(jnp.concatenate([cross(spin, jnp.concatenate(levers)), spin], axis=1).T, to_base)
