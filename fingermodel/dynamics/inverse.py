"""Inverse dynamics of a finger: the joint torques behind a movement and a force at the tip.

Recursive Newton–Euler over the same chain as the statics (`kinematics.py`): outwards the spins and accelerations of
every bone, inwards the forces and moments that each bone takes from the one before. Without motion and gravity the
torques are Jᵀ W of Eq 2 (Synek et al. 2019), W being what the finger exerts.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from fingermodel.dynamics.inertia import ChainInertia
from fingermodel.fingers import FingerValues, Topology
from fingermodel.kinematics import JointPose, joint_poses
from fingermodel.vectors import cross

jax.config.update("jax_enable_x64", True)


class Movement(NamedTuple):
    """A movement and what acts on the tip, at one instant or, with a leading axis, at many.

    Attributes:
        posture: (rotations,) [rad].
        rate: (rotations,) [rad/s].
        acceleration: (rotations,) [rad/s²].
        tip_force: (3,) on the finger at its load point [N], axes of the first bone.
    """

    posture: Array
    rate: Array
    acceleration: Array
    tip_force: Array


class JointDynamics(NamedTuple):
    """What moves a finger.

    Attributes:
        torque: (rotations,) that the muscles must exert [N mm], flexion positive.
        reaction: (joints, 3) force of each parent bone on its child without what tendons add [N], child's axes.
    """

    torque: Array
    reaction: Array


class _Motion(NamedTuple):
    """Spin [rad/s], its rate [rad/s²] and acceleration of the joint centre [mm/s²] of one bone, in its own axes."""

    spin: Array
    spin_rate: Array
    acceleration: Array


def joint_dynamics(
    topology: Topology, values: FingerValues, inertia: ChainInertia, gravity: Array, movement: Movement
) -> JointDynamics:
    """Torques and reactions at one instant.

    Args:
        topology: of the finger.
        values: of the finger.
        inertia: of its moving bones.
        gravity: (3,) acceleration of free fall [mm/s²], axes of the first bone.
        movement: at that instant.
    """
    poses = joint_poses(topology, values, movement.posture)
    motions = _outwards(topology, values, poses, gravity, movement)
    to_tip = poses[0].rotation.T
    for pose in poses[1:]:
        to_tip = pose.rotation.T @ to_tip
    force = -(to_tip @ movement.tip_force)
    moment = cross(jnp.asarray(values.load_point), force)
    torques: list[Array] = []
    reactions: list[Array] = []
    for index in reversed(range(len(poses))):
        spin, spin_rate, acceleration = motions[index]
        centre, moments = inertia.centre[index], inertia.moments[index]
        at_centre = acceleration + cross(spin_rate, centre) + cross(spin, cross(spin, centre))
        needed = inertia.mass[index] * at_centre
        force = force + needed
        moment = moment + cross(jnp.asarray(centre), needed)
        moment = moment + moments * spin_rate + cross(spin, moments * spin)
        torques.insert(0, poses[index].axes @ moment)
        reactions.insert(0, force)
        if index > 0:
            # What the child asks for, the parent has to give at the child's joint.
            force = poses[index].rotation @ force
            moment = poses[index].rotation @ moment + cross(jnp.asarray(values.centre[index]), force)
    return JointDynamics(jnp.concatenate(torques), jnp.stack(reactions))


def _outwards(
    topology: Topology, values: FingerValues, poses: tuple[JointPose, ...], gravity: Array, movement: Movement
) -> list[_Motion]:
    """Motion of every bone; that the base rises against gravity stands for the weight of all bones."""
    spin = spin_rate = jnp.zeros(3)
    acceleration = -gravity
    motions: list[_Motion] = []
    first = 0
    for index, pose in enumerate(poses):
        last = first + len(topology.joints[index].rotations)
        rate, change = movement.rate[first:last], movement.acceleration[first:last]
        centre = jnp.asarray(values.centre[index])
        at_joint = acceleration + cross(spin_rate, centre) + cross(spin, cross(spin, centre))
        back = pose.rotation.T
        own = pose.axes.T @ rate
        carried = back @ spin
        # An axis turns with the rotations beyond it, seen from the child.
        beyond = [pose.axes[i + 1 :].T @ rate[i + 1 :] for i in range(last - first)]
        turning = sum((cross(a, b) * r for a, b, r in zip(pose.axes, beyond, rate, strict=True)), jnp.zeros(3))
        spin_rate = back @ spin_rate + cross(carried, own) + pose.axes.T @ change + turning
        spin = carried + own
        acceleration = back @ at_joint
        motions.append(_Motion(spin, spin_rate, acceleration))
        first = last
    return motions


@partial(jax.jit, static_argnums=0)
def inverse_dynamics(
    topology: Topology, values: FingerValues, inertia: ChainInertia, gravity: Array, movement: Movement
) -> JointDynamics:
    """Torques and reactions at many instants: `joint_dynamics` over the leading axis of `movement`."""
    return jax.vmap(lambda at: joint_dynamics(topology, values, inertia, gravity, at))(movement)
