"""Posture to rotations: any chain of joints, any axes, any order, for one posture; batched by `jax.vmap`."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from fingermodel.fingers import FingerValues, Topology


class JointPose(NamedTuple):
    """One joint in one posture.

    Attributes:
        rotation: (3, 3) takes a vector's components in the child bone to the parent bone.
        axes: (rotations of the joint, 3) in the child bone's frame.
        cosine: (rotations of the joint,) of their angles.
        sine: (rotations of the joint,).
    """

    rotation: Array
    axes: Array
    cosine: Array
    sine: Array


def cross(a: Array, b: Array) -> Array:
    """Cross product over the last axis; written out so that the compiler fuses it with its neighbours."""
    return jnp.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        axis=-1,
    )


def rotate(vectors: Array, axis: Array, cosine: Array, sine: Array) -> Array:
    """Rotate vectors (..., 3) about a unit axis (3,) by angles (...,) (Rodrigues); negate the sine to rotate back."""
    c, s = cosine[..., None], sine[..., None]
    along = jnp.sum(vectors * axis, axis=-1, keepdims=True)
    return vectors * c + cross(axis, vectors) * s + axis * (along * (1.0 - c))


def turn(axis: Array, cosine: Array, sine: Array) -> Array:
    """Matrix (3, 3) of a rotation about a unit axis, its angle given as cosine and sine."""
    x, y, z = axis
    zero = jnp.zeros(())
    skew = jnp.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]])
    return cosine * jnp.eye(3) + sine * skew + (1.0 - cosine) * jnp.outer(axis, axis)


def joint_poses(topology: Topology, values: FingerValues, posture: Array) -> tuple[JointPose, ...]:
    """Return every joint's pose, proximal to distal, for a posture (rotations,) in rad."""
    return poses_of_turns(topology, values, jnp.cos(posture), jnp.sin(posture))


def poses_of_turns(topology: Topology, values: FingerValues, cosine: Array, sine: Array) -> tuple[JointPose, ...]:
    """Return every joint's pose for angles given by their cosines and sines (rotations,)."""
    poses, first = [], 0
    for joint in topology.joints:
        last = first + len(joint.rotations)
        axes: list[Array] = []
        rotation = jnp.eye(3)
        # From the most distal rotation inwards, so that each axis is carried back through those beyond it.
        for i in reversed(range(first, last)):
            axis = jnp.asarray(values.axis[i])
            matrix = turn(axis, cosine[i], sine[i])
            axes.insert(0, axis @ rotation if axes else axis)
            rotation = matrix @ rotation if len(axes) > 1 else matrix
        poses.append(JointPose(rotation, jnp.stack(axes), cosine[first:last], sine[first:last]))
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
