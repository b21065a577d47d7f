"""Tip force of activated muscles at rest: fibre and tendon in equilibrium, moment arms, passive torques, the clamp.

The tip is held by a clamp that carries the finger's `reactions`, as in every other prediction; force and torque on it
follow from the joint torques (Jᵀ W = τ). Muscles' lengths are those of the calibration's posture and what the joints
have moved since: straight pieces and Landsmeer's rule by integrating their moment arms, surfaces by their lengths.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from fingermodel.extensor import segment_tensions
from fingermodel.fingers import Finger, FingerValues, Topology
from fingermodel.isometric.passive import PassiveTorques, passive_torque, read_passive
from fingermodel.isometric.surfaces import Cylinders, Wrap, read_wraps, wrap_lengths
from fingermodel.kinematics import joint_poses, tip_kinematics
from fingermodel.muscles.hill import Curves, HillState, HillValues, isometric
from fingermodel.muscles.muscle_files import MuscleSet
from fingermodel.tendons import joint_pulls, moment_arms

jax.config.update("jax_enable_x64", True)

Floats = NDArray[np.float64]
# Nodes of the quadrature of an excursion along a straight path in the space of postures.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


class Structure(NamedTuple):
    """What the compiler keys on."""

    topology: Topology
    wraps: tuple[Wrap, ...]


class Numbers(NamedTuple):
    """The arrays that moment arms and lengths follow from.

    Attributes:
        values: of the finger.
        cylinders: under the segments that wrap.
        passive: torques of the joints.
        calibration: (rotations,) posture in which the lengths are known [rad].
        length: (muscles,) of muscle and tendon together there [mm].
    """

    values: FingerValues
    cylinders: Cylinders
    passive: PassiveTorques
    calibration: Array | Floats
    length: Array | Floats


class Placed(NamedTuple):
    """A finger held at the tip in one posture, whatever its muscles do.

    Attributes:
        arms: (rotations, muscles) moment arms, flexion positive [mm].
        length: (muscles,) of muscle and tendon together [mm].
        passive_torque: (rotations,) of the joints themselves [N mm].
        jacobian: (6, rotations) of the load point [mm/rad] over spin [rad/rad], most distal bone's axes.
        wrench: (6, rotations) on the tip clamp by a unit torque about each rotation.
    """

    arms: Array
    length: Array
    passive_torque: Array
    jacobian: Array
    wrench: Array


class Held(NamedTuple):
    """What active muscles do to a finger that is held.

    Attributes:
        tension: (muscles,) of the tendons [N].
        active: (muscles,) part of it from the contractile elements [N].
        passive: (muscles,) part of it from the parallel elements [N].
        fibre: (muscles,) length of the fibres, in optimal lengths.
        muscle_torque: (rotations,) of all muscles [N mm].
        tip: (6,) force [N] and torque about the load point [N mm] on the tip clamp, most distal bone's axes.
        unbalanced: (muscles,) fibre's pull along the tendon less the tendon's [N].
    """

    tension: Array
    active: Array
    passive: Array
    fibre: Array
    muscle_torque: Array
    tip: Array
    unbalanced: Array


@dataclass(frozen=True)
class IsometricFinger:
    """A finger with Hill muscles, its surfaces and its passive torques.

    Attributes:
        finger: with its file's blocks.
        muscles: in the finger's order.
    """

    finger: Finger
    muscles: MuscleSet

    @cached_property
    def structure(self) -> Structure:
        """The static part, hashable."""
        return Structure(self.finger.topology, read_wraps(self.finger)[0])

    @cached_property
    def numbers(self) -> Numbers:
        """The arrays."""
        muscles = self.muscles
        return Numbers(
            self.finger.values,
            read_wraps(self.finger)[1],
            read_passive(self.finger),
            muscles.calibration,
            muscles.length_mm,
        )

    @property
    def hill(self) -> HillValues:
        """Numbers of the muscles, (muscles,) each."""
        return HillValues(*(np.asarray(v, dtype=float) for v in self.muscles.values))

    def place(self, posture_rad: Floats) -> Placed:
        """Moment arms, lengths and the clamp in a posture (rotations,).

        Raises:
            ModelError: an elastic hood, whose slips have no fixed shares.
        """
        return place_jit(self.structure, self.numbers, jnp.asarray(posture_rad, dtype=float))

    def hold(self, placed: Placed, activation: Floats) -> Held:
        """Activate the muscles (n, muscles) from 0 to 1 where the finger is placed: a leading axis n on all."""
        return hold_batch(self.muscles.curves, self.hill, placed, jnp.asarray(activation, dtype=float))

    def activation_of(self, placed: Placed, tension: Floats) -> Floats:
        """Activations (muscles,) that give tensions (muscles,) [N]; 0 or 1 where a tension is out of reach."""
        levels = activation_of(self.muscles.curves, self.hill, placed.length, jnp.asarray(tension))
        found: Floats = np.asarray(levels)
        return found


def muscle_arms(structure: Structure, numbers: Numbers, posture: Array) -> Array:
    """Torque about every rotation by a unit tension of every muscle [mm]: (rotations, muscles)."""
    return _arms(structure, numbers, posture, with_surfaces=True)


def _arms(structure: Structure, numbers: Numbers, posture: Array, *, with_surfaces: bool) -> Array:
    """As `muscle_arms`; without surfaces, the segments that run over one have none."""
    topology, values = structure.topology, numbers.values
    poses = joint_poses(topology, values, posture)
    arms = moment_arms(topology, poses, joint_pulls(topology, values, poses))
    if structure.wraps:
        over = np.array([w.segment for w in structure.wraps])
        own = -jax.jacrev(lambda q: _surface_lengths(structure, numbers, q))(posture).T if with_surfaces else 0.0
        arms = arms.at[:, over].set(own)
    return arms @ _shares(topology, values)


def _shares(topology: Topology, values: FingerValues) -> Array:
    """Tension of every segment by a unit tension of every muscle: (segments, muscles)."""
    return jax.vmap(lambda t: segment_tensions(topology, values, t), out_axes=1)(jnp.eye(len(topology.muscles)))


def _surface_lengths(structure: Structure, numbers: Numbers, posture: Array) -> Array:
    values = numbers.values
    poses = joint_poses(structure.topology, values, posture)
    ends = (jnp.asarray(values.proximal_point), jnp.asarray(values.distal_point))
    return wrap_lengths(structure.wraps, numbers.cylinders, ends, jnp.asarray(values.centre), poses)


def muscle_lengths(structure: Structure, numbers: Numbers, posture: Array) -> Array:
    """Length of muscle and tendon together in a posture (rotations,) [mm]: (muscles,)."""
    start = jnp.asarray(numbers.calibration)
    way = posture - start
    nodes = start + 0.5 * (_NODES[:, None] + 1.0) * way
    arms = jax.vmap(lambda q: _arms(structure, numbers, q, with_surfaces=False))(nodes)
    length = jnp.asarray(numbers.length) - jnp.einsum("k,r,krm->m", 0.5 * _WEIGHTS, way, arms)
    if structure.wraps:
        over = np.array([w.segment for w in structure.wraps])
        longer = _surface_lengths(structure, numbers, posture) - _surface_lengths(structure, numbers, start)
        length = length + longer @ _shares(structure.topology, numbers.values)[over]
    return length


def place(structure: Structure, numbers: Numbers, posture: Array) -> Placed:
    """Moment arms, lengths, passive torques and the clamp in a posture (rotations,) [rad]; differentiable."""
    topology, values = structure.topology, numbers.values
    jacobian = tip_kinematics(topology, values, joint_poses(topology, values, posture)).jacobian
    rows = np.array(topology.reactions)
    return Placed(
        arms=muscle_arms(structure, numbers, posture),
        length=muscle_lengths(structure, numbers, posture),
        passive_torque=passive_torque(numbers.passive, posture),
        jacobian=jacobian,
        wrench=jnp.zeros_like(jacobian).at[rows].set(jnp.linalg.inv(jacobian[rows].T)),
    )


place_jit = partial(jax.jit, static_argnums=0)(place)


def _states(curves: Curves, muscles: HillValues, length: Array, activation: Array) -> HillState:
    return jax.vmap(lambda m, whole, a: isometric(curves, m, whole, a))(muscles, length, activation)


def hold(curves: Curves, muscles: HillValues, placed: Placed, activation: Array) -> Held:
    """Activate the muscles (muscles,) of a finger held in a posture; differentiable."""
    m = muscles
    state = _states(curves, m, placed.length, activation)
    pulled = placed.arms @ state.tension
    across = m.fibre * jnp.sin(m.pennation)
    along = jnp.sqrt(jnp.maximum((state.length * m.fibre) ** 2 - across**2, 0.0))
    by_tendon = m.max_force * jax.vmap(curves.tendon)((placed.length - along) / m.slack - 1.0)
    return Held(
        tension=state.tension,
        active=state.active,
        passive=state.passive,
        fibre=state.length,
        muscle_torque=pulled,
        tip=placed.wrench @ (pulled + placed.passive_torque),
        unbalanced=jnp.where(state.tension > 0.0, state.tension - by_tendon, 0.0),
    )


@partial(jax.jit, static_argnums=0)
def hold_batch(curves: Curves, muscles: HillValues, placed: Placed, activation: Array) -> Held:
    """`hold` with activations (n, muscles): a leading axis n on all."""
    return jax.vmap(lambda a: hold(curves, muscles, placed, a))(activation)


@partial(jax.jit, static_argnums=0)
def activation_of(curves: Curves, muscles: HillValues, length: Array, tension: Array) -> Array:
    """Activations (muscles,) that give tensions (muscles,) [N]; 0 or 1 where a tension is out of reach."""

    def halve(_: int, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = 0.5 * (low + high)
        short = _states(curves, muscles, length, middle).tension < tension
        return jnp.where(short, middle, low), jnp.where(short, high, middle)

    low, high = jax.lax.fori_loop(0, 50, halve, (jnp.zeros_like(tension), jnp.ones_like(tension)))
    return 0.5 * (low + high)
