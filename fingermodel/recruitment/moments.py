"""Moment arms of whole muscles: the joint torque of a unit tension, shared out by the hood."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from fingermodel.extensor import segment_tensions
from fingermodel.fingers import FingerValues, Topology
from fingermodel.kinematics import joint_poses
from fingermodel.statics import joint_torques
from fingermodel.tendons import joint_pulls

jax.config.update("jax_enable_x64", True)

Floats = NDArray[np.float64]
# Nodes of the quadrature of a muscle's excursion along a straight path in the space of postures.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)


def muscle_moments(topology: Topology, values: FingerValues, posture: Array) -> Array:
    """Torque about every rotation by a unit tension of every muscle in one posture [mm]: (rotations, muscles)."""
    poses = joint_poses(topology, values, posture)
    pulls = joint_pulls(topology, values, poses)

    def torque(tension: Array) -> Array:
        return joint_torques(poses, pulls, segment_tensions(topology, values, tension))

    return jax.vmap(torque, out_axes=1)(jnp.eye(len(topology.muscles)))


@partial(jax.jit, static_argnums=0)
def muscle_moments_batch(topology: Topology, values: FingerValues, posture: Array) -> Array:
    """`muscle_moments` of postures (n, rotations): (n, rotations, muscles)."""
    return jax.vmap(lambda q: muscle_moments(topology, values, q))(posture)


def arms_and_excursions(
    topology: Topology, values: FingerValues, start: Floats, posture: Floats
) -> tuple[Floats, Floats]:
    """Moment arms of every muscle, and by how much it is longer than in the posture `start`.

    The excursion does the joint torques' work: its rate is minus the moment arms times the rates of the joints. A
    muscle that feeds several slips moves as their mean, weighted by their shares.

    Args:
        topology: of the finger.
        values: of the finger.
        start: (rotations,) [rad].
        posture: (n, rotations) [rad].

    Returns:
        Arms (n, rotations, muscles) and excursions (n, muscles) [mm].
    """
    way = posture - start
    nodes = start + 0.5 * (_NODES[:, None, None] + 1.0) * way
    # All postures in one call: another number of them would be another program.
    every = np.concatenate([posture[None], nodes])
    flat = muscle_moments_batch(topology, values, jnp.asarray(every.reshape(-1, posture.shape[1])))
    arms = np.asarray(flat).reshape(*every.shape, -1)
    longer: Floats = -np.einsum("k,nr,knrm->nm", 0.5 * _WEIGHTS, way, arms[1:])
    return arms[0], longer
