"""Forces of a clamped finger under tendon loads (Synek et al. 2019, Eqs 2–4), signed as the load cell reads them.

The paper's Eqs 3 and 4 give forces on the finger; here every force is the one that the finger exerts: on the tip clamp,
on the more proximal bone at a joint, on the metacarpal clamp.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from fingermodel.fingers import FingerValues, Topology
from fingermodel.kinematics import JointPose, tip_kinematics
from fingermodel.rows import picked, spread
from fingermodel.tendons import Pulls


class ClampForces(NamedTuple):
    """What a finger does to its two clamps.

    Attributes:
        tip: (6,) force [N] and torque about the load point [N mm] on the tip clamp, distal phalanx's axes.
        bone: (3,) net force on the metacarpal clamp [N], metacarpal's axes.
    """

    tip: Array
    bone: Array


def joint_torques(poses: tuple[JointPose, ...], pulls: tuple[Pulls, ...], segment_tension: Array) -> Array:
    """Torque of all tendons about every rotation [N mm]: (rotations,), flexion positive."""
    # All joints at once: the products of each would be compiled, and differentiated, by themselves.
    segments = [s for at_joint in pulls for s in at_joint.segments]
    joints = [j for j, at_joint in enumerate(pulls) for _ in at_joint.segments]
    rotations = [j for j, pose in enumerate(poses) for _ in range(pose.axes.shape[0])]
    crossing = np.equal.outer(rotations, joints).astype(float)
    moments = picked(segment_tension, segments)[:, None] * jnp.concatenate([p.moment for p in pulls])
    return jnp.sum(jnp.concatenate([pose.axes for pose in poses]) * (crossing @ moments), axis=-1)


def clamp_forces(
    topology: Topology, values: FingerValues, poses: tuple[JointPose, ...], tension: Array, torque: Array
) -> ClampForces:
    """Solve Jᵀ W = τ (Eq 2) for what the tip clamp carries, and balance the whole finger for the bone (Eq 4).

    Args:
        topology: whose `reactions` name the wrench components the clamp carries, as many as there are rotations.
        values: the finger's numbers.
        poses: of `joint_poses`.
        tension: (muscles,) [N], as it leaves the first bone.
        torque: (rotations,) [N mm].
    """
    tip = tip_kinematics(topology, values, poses)
    wrench = solve_small(picked(tip.jacobian, topology.reactions).T, torque) @ spread(topology.reactions, 6)
    return ClampForces(wrench, tension @ jnp.asarray(values.suture) - tip.to_base @ wrench[:3])


def joint_loads(poses: tuple[JointPose, ...], pulls: tuple[Pulls, ...], segment_tension: Array, tip: Array) -> Array:
    """Force of each child bone on its parent at the joint [N], parent's axes (Eq 3): (joints, 3).

    Args:
        poses: of `joint_poses`.
        pulls: of `joint_pulls`.
        segment_tension: (segments,) [N].
        tip: (6,) wrench on the tip clamp.
    """
    loads: list[Array] = []
    outer = tip[:3]
    for pose, at_joint in zip(reversed(poses), reversed(pulls), strict=True):
        pulled = picked(segment_tension, at_joint.segments) @ at_joint.direction
        outer = pose.rotation @ outer
        loads.insert(0, pose.rotation @ pulled - outer)
    return jnp.stack(loads)


def solve_small(matrix: Array, right: Array) -> Array:
    """Solve a small square system (n, n) x = (n,).

    At n = 4, the clamped finger, the adjugate is written out: it vectorises over a batch, which LAPACK's one-by-one
    factorisation does not (a third faster over the whole prediction).
    """
    return _solved(matrix, right) if matrix.shape[-1] == 4 else jnp.linalg.solve(matrix, right)


@jax.custom_jvp
def _solved(matrix: Array, right: Array) -> Array:
    return jnp.sum(_inverse(matrix) * right, axis=-1)


@_solved.defjvp
def _slope_of_solved(primals: tuple[Array, Array], tangents: tuple[Array, Array]) -> tuple[Array, Array]:
    """From the system itself, A dx = db - dA x: the slopes of the adjugate would be a program of their own."""
    (matrix, right), (matrix_dot, right_dot) = primals, tangents
    inverse = _inverse(matrix)
    x = jnp.sum(inverse * right, axis=-1)
    return x, jnp.sum(inverse * (right_dot - jnp.sum(matrix_dot * x, axis=-1)), axis=-1)


def _inverse(matrix: Array) -> Array:
    """Inverse of a matrix (4, 4)."""
    a = [[matrix[i, j] for j in range(4)] for i in range(4)]
    # 2 x 2 minors of the upper and the lower two rows, columns (0,1) (0,2) (0,3) (1,2) (1,3) (2,3).
    pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
    s = [a[0][i] * a[1][j] - a[0][j] * a[1][i] for i, j in pairs]
    c = [a[2][i] * a[3][j] - a[2][j] * a[3][i] for i, j in pairs]
    determinant = s[0] * c[5] - s[1] * c[4] + s[2] * c[3] + s[3] * c[2] - s[4] * c[1] + s[5] * c[0]
    adjugate = [
        [
            a[1][1] * c[5] - a[1][2] * c[4] + a[1][3] * c[3],
            -a[0][1] * c[5] + a[0][2] * c[4] - a[0][3] * c[3],
            a[3][1] * s[5] - a[3][2] * s[4] + a[3][3] * s[3],
            -a[2][1] * s[5] + a[2][2] * s[4] - a[2][3] * s[3],
        ],
        [
            -a[1][0] * c[5] + a[1][2] * c[2] - a[1][3] * c[1],
            a[0][0] * c[5] - a[0][2] * c[2] + a[0][3] * c[1],
            -a[3][0] * s[5] + a[3][2] * s[2] - a[3][3] * s[1],
            a[2][0] * s[5] - a[2][2] * s[2] + a[2][3] * s[1],
        ],
        [
            a[1][0] * c[4] - a[1][1] * c[2] + a[1][3] * c[0],
            -a[0][0] * c[4] + a[0][1] * c[2] - a[0][3] * c[0],
            a[3][0] * s[4] - a[3][1] * s[2] + a[3][3] * s[0],
            -a[2][0] * s[4] + a[2][1] * s[2] - a[2][3] * s[0],
        ],
        [
            -a[1][0] * c[3] + a[1][1] * c[1] - a[1][2] * c[0],
            a[0][0] * c[3] - a[0][1] * c[1] + a[0][2] * c[0],
            -a[3][0] * s[3] + a[3][1] * s[1] - a[3][2] * s[0],
            a[2][0] * s[3] - a[2][1] * s[1] + a[2][2] * s[0],
        ],
    ]
    return jnp.stack([jnp.stack(row) for row in adjugate]) / determinant
