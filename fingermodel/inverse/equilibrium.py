"""The finger in equilibrium under a tip wrench: tensions of all slips and contact forces at all joints.

The same kinematics, moment arms and segments as the forward model: where `statics.py` solves Jᵀ W = τ for the wrench,
here the wrench is known and the tensions that make τ are sought. A contact force is what the child bone does to its
parent at a joint, in the parent's axes: all tendon segments that cross the joint, less what the finger does at its tip.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from fingermodel.extensor import segment_tensions
from fingermodel.fingers import FingerValues, Topology
from fingermodel.inverse.closures import slip_names
from fingermodel.kinematics import joint_poses, tip_kinematics
from fingermodel.model import with_anatomy
from fingermodel.statics import joint_loads
from fingermodel.tendons import joint_pulls, moment_arms

Floats = NDArray[np.float64]
# Cases a pass of the compiled programs, of the derivatives and of all others.
SLOPES, PORTION = 32, 128
Given = TypeVar("Given")
Answer = TypeVar("Answer")


class Balance(NamedTuple):
    """What holds a tip wrench.

    Attributes:
        slip: (slips,) tension of every tendon and slip [N], in the order of `slip_names`; positive pulls.
        contact: (joints, 3) force of each child bone on its parent [N], parent's axes.
    """

    slip: Array
    contact: Array


class Cases(NamedTuple):
    """Cases with all that they may differ in.

    Attributes:
        anatomy: (n, anatomy parameters) tendon points [mm] and fractions, as `model.with_anatomy` reads them.
        posture: (n, rotations) [rad].
        wrench: (n, 6) of the finger on what holds its tip, as in `balance_case`.
    """

    anatomy: Floats
    posture: Floats
    wrench: Floats


class Demand(NamedTuple):
    """What a wrench asks of the muscles, and what they can do about it.

    Attributes:
        arms: (rotations, muscles) torque of a unit tension of each muscle, through the hood [mm].
        torque: (rotations,) that the tendons must make [N mm].
        tip: (6, rotations) torque that holds a unit of each component of the wrench.
    """

    arms: Array
    torque: Array
    tip: Array


def incidence(topology: Topology) -> Floats:
    """Which segment belongs to which slip: (segments, slips) of 0 and 1."""
    names = slip_names(topology)
    return np.array([[float(segment.slip == name) for name in names] for segment in topology.segments])


def anatomy_of(values: FingerValues) -> Floats:
    """Tendon points and fractions as `model.with_anatomy` reads them: (anatomy parameters,)."""
    parts = (values.proximal_point, values.distal_point, values.fraction)
    return np.concatenate([np.ravel(np.asarray(part)) for part in parts])


def balance_case(topology: Topology, laws: Array, values: FingerValues, posture: Array, wrench: Array) -> Balance:
    """Solve the moments and a closure's laws for the tensions (linear in the wrench).

    Args:
        topology: of the finger.
        laws: (slips - rotations, slips), of `Closure.matrix`.
        values: the finger's numbers.
        posture: (rotations,) [rad].
        wrench: (6,) of the finger on what it presses or what holds it, about the load point, most distal bone's axes
            [N, N mm].
    """
    belongs = incidence(topology)
    poses = joint_poses(topology, values, posture)
    pulls = joint_pulls(topology, values, poses)
    torque = tip_kinematics(topology, values, poses).jacobian.T @ wrench
    matrix = jnp.concatenate([moment_arms(topology, poses, pulls) @ belongs, laws])
    slip = jnp.linalg.solve(matrix, jnp.concatenate([torque, jnp.zeros(len(laws))]))
    return Balance(slip, joint_loads(poses, pulls, belongs @ slip, wrench))


def balances(topology: Topology, laws: Floats, values: FingerValues, cases: Cases) -> Balance:
    """`balance_case` of every case, as NumPy arrays with a leading axis of cases."""
    return _in_portions(PORTION, cases, lambda c: _balances(topology, jnp.asarray(laws), values, c))


def balance_slopes(topology: Topology, laws: Floats, values: FingerValues, cases: Cases) -> Balance:
    """Derivatives of `balance_case`: as `balances`, with a last axis over (anatomy, posture, wrench)."""
    return _in_portions(SLOPES, cases, lambda c: _slopes(topology, jnp.asarray(laws), values, c))


def demands(topology: Topology, values: FingerValues, cases: Cases) -> Demand:
    """What each case asks of the muscles.

    Raises:
        ModelError: a hood without fixed fractions, for which no torque of a unit tension is all there is to know.
    """
    return _in_portions(PORTION, cases, lambda c: _demands(topology, values, c))


def loads_of(topology: Topology, values: FingerValues, cases: Cases, tension: Floats) -> Balance:
    """Slips and contact forces for muscle tensions (n, muscles) through the finger's own hood."""
    return _in_portions(PORTION, (cases, tension), lambda both: _loads(topology, values, *both))


def _in_portions(size: int, given: Given, program: Callable[[Given], Answer]) -> Answer:
    """Run a program on portions of one size, the last one filled up: no number of cases is compiled for on its own."""
    n = len(jax.tree.leaves(given)[0])
    parts = []
    for first in range(0, n, size):
        rows = np.minimum(np.arange(first, first + size), n - 1)
        part = program(jax.tree.map(lambda x, rows=rows: jnp.asarray(np.asarray(x)[rows]), given))
        parts.append(jax.tree.map(np.asarray, part))
    whole: Answer = jax.tree.map(lambda *leaves: np.concatenate(leaves)[:n], *parts)
    return whole


@partial(jax.jit, static_argnums=0)
def _balances(topology: Topology, laws: Array, values: FingerValues, cases: Cases) -> Balance:
    def one(case: Cases) -> Balance:
        own = with_anatomy(topology, values, case.anatomy)  # type: ignore[arg-type]
        return balance_case(topology, laws, own, case.posture, case.wrench)  # type: ignore[arg-type]

    return jax.vmap(one)(cases)


@partial(jax.jit, static_argnums=0)
def _slopes(topology: Topology, laws: Array, values: FingerValues, cases: Cases) -> Balance:
    def one(case: Cases) -> Balance:
        parts = [jnp.asarray(x) for x in case]
        ends = np.cumsum([len(x) for x in parts])[:-1]

        def at(z: Array) -> Balance:
            anatomy, posture, wrench = jnp.split(z, ends)
            return balance_case(topology, laws, with_anatomy(topology, values, anatomy), posture, wrench)

        return jax.jacrev(at)(jnp.concatenate(parts))

    return jax.vmap(one)(cases)


@partial(jax.jit, static_argnums=0)
def _demands(topology: Topology, values: FingerValues, cases: Cases) -> Demand:
    def one(case: Cases) -> Demand:
        own = with_anatomy(topology, values, case.anatomy)  # type: ignore[arg-type]
        poses = joint_poses(topology, own, case.posture)  # type: ignore[arg-type]
        at_segments = moment_arms(topology, poses, joint_pulls(topology, own, poses))
        # With fixed fractions the hood is linear, so unit tensions give all there is to know.
        shares = jax.vmap(lambda t: segment_tensions(topology, own, t))(jnp.eye(len(topology.muscles)))
        jacobian = tip_kinematics(topology, own, poses).jacobian
        return Demand(at_segments @ shares.T, jacobian.T @ case.wrench, jacobian)

    return jax.vmap(one)(cases)


@partial(jax.jit, static_argnums=0)
def _loads(topology: Topology, values: FingerValues, cases: Cases, tension: Array) -> Balance:
    belongs = incidence(topology)
    mean = belongs / belongs.sum(axis=0)

    def one(case: Cases, t: Array) -> Balance:
        own = with_anatomy(topology, values, case.anatomy)  # type: ignore[arg-type]
        poses = joint_poses(topology, own, case.posture)  # type: ignore[arg-type]
        segment = segment_tensions(topology, own, t, poses)
        loads = joint_loads(poses, joint_pulls(topology, own, poses), segment, case.wrench)  # type: ignore[arg-type]
        # A slip's tension is the same along all of its segments.
        return Balance(segment @ mean, loads)

    return jax.vmap(one)(cases, tension)
