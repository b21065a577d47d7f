"""Inverse dynamics: Lagrange's equations, the balance of energy, the static limit, and the whole finger's momentum."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from fingermodel.dynamics.inertia import ChainInertia, chain_inertia
from fingermodel.dynamics.inverse import Movement, inverse_dynamics
from fingermodel.fingers import FingerValues, Topology
from fingermodel.fingers.files import read_finger
from fingermodel.model import jax_values, tip_kinematics_batch
from tests.fingermodel.fingers import six_axes

Floats = NDArray[np.float64]
seeds = st.integers(0, 2**32 - 1)
KINDS = ("index", "six axes")


class Chain(NamedTuple):
    topology: Topology
    values: FingerValues
    inertia: ChainInertia
    gravity: jax.Array


def _chain(kind: str, seed: int) -> Chain:
    rng = np.random.default_rng(seed)
    if kind == "index":
        finger = read_finger("wu2008_index")
        topology, values, inertia = finger.topology, jax_values(finger.values), chain_inertia(finger)
    else:
        topology, values = six_axes(seed)
        inertia = ChainInertia(
            rng.uniform(1e-6, 2e-5, 3), rng.normal(size=(3, 3)) * 9.0, rng.uniform(1e-4, 3e-3, (3, 3))
        )
    return Chain(topology, values, inertia, jnp.asarray(rng.normal(size=3) * 9810.0))


def _movement(chain: Chain, seed: int, count: int = 5) -> Movement:
    rng = np.random.default_rng(seed + 1)
    shape = (count, len(chain.topology.rotations))
    posture, rate, change = (jnp.asarray(rng.normal(size=shape) * s) for s in (0.6, 12.0, 400.0))
    return Movement(posture, rate, change, jnp.asarray(rng.normal(size=(count, 3)) * 2.0))


def _places(topology: Topology, values: FingerValues, centre: jax.Array, q: jax.Array) -> tuple[jax.Array, ...]:
    """Orientation (3, 3) and centre of mass of every bone, and the load point, by rotation matrices multiplied out."""
    turn, at = jnp.eye(3), jnp.zeros(3)
    turns, centres, first = [], [], 0
    for j, joint in enumerate(topology.joints):
        at = at + turn @ values.centre[j]
        for i in range(first, first + len(joint.rotations)):
            x, y, z = values.axis[i]
            zero = jnp.zeros(())
            skew = jnp.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]])
            turn = turn @ (jnp.eye(3) + jnp.sin(q[i]) * skew + (1.0 - jnp.cos(q[i])) * skew @ skew)
        first += len(joint.rotations)
        turns.append(turn)
        centres.append(at + turn @ centre[j])
    return jnp.stack(turns), jnp.stack(centres), at + turn @ values.load_point


class Lagrange(NamedTuple):
    """What Lagrange's equations need in many postures: mass matrix, potential energy, its slope, reach of the tip."""

    mass: Floats
    potential: Floats
    slope: Floats
    reach: Floats


@partial(jax.jit, static_argnums=0)
def _lagrange(
    topology: Topology, rest: tuple[FingerValues, ChainInertia, jax.Array], posture: jax.Array
) -> tuple[jax.Array, ...]:
    values, inertia, gravity = rest
    mass, moments = jnp.asarray(inertia.mass), jnp.asarray(inertia.moments)

    def at(q: jax.Array) -> tuple[jax.Array, ...]:
        def places(p: jax.Array) -> tuple[jax.Array, ...]:
            return _places(topology, values, jnp.asarray(inertia.centre), p)

        turns, centres, _ = places(q)
        turned, velocity, reach = jax.jacfwd(places)(q)
        skew = jnp.einsum("jba,jbcr->jacr", turns, turned)
        spin = jnp.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
        matrix = jnp.einsum("j,jar,jas->rs", mass, velocity, velocity) + jnp.einsum(
            "ja,jar,jas->rs", moments, spin, spin
        )
        weight = mass[:, None] * gravity
        return matrix, -jnp.sum(weight * centres), -jnp.einsum("ja,jar->r", weight, velocity), reach

    return jax.vmap(at)(posture)


def _at(chain: Chain, posture: Floats) -> Lagrange:
    return Lagrange(*(np.asarray(x) for x in _lagrange(chain.topology, tuple(chain[1:]), jnp.asarray(posture))))


def _rate(of: Callable[[float], Floats], h: float = 1e-4) -> Floats:
    """Derivative at 0, by four differences."""
    return (8.0 * (of(h) - of(-h)) - (of(2 * h) - of(-2 * h))) / (12.0 * h)


@pytest.mark.parametrize("kind", [pytest.param("index", marks=pytest.mark.full), "six axes"])
@settings(max_examples=15)
@given(seed=seeds)
def test_newton_and_euler_agree_with_lagrange(kind: str, seed: int) -> None:
    """τ = M q̈ + Ṁ q̇ − ∂T/∂q + ∂V/∂q − Jᵀ F, with M by differentiating places alone."""
    chain = _chain(kind, seed)
    movement = _movement(chain, seed)
    q, rate, change, force = (np.asarray(part) for part in movement)
    here = _at(chain, q)
    turning = _rate(lambda t: _at(chain, q + t * rate).mass)
    energy_slope = np.stack(
        [
            _rate(lambda t, one=one: 0.5 * np.einsum("nr,nrs,ns->n", rate, _at(chain, q + t * one).mass, rate))  # type: ignore[misc]
            for one in np.eye(q.shape[1])
        ],
        axis=1,
    )
    expected = np.einsum("nrs,ns->nr", here.mass, change) + np.einsum("nrs,ns->nr", turning, rate)
    expected += here.slope - energy_slope - np.einsum("nar,na->nr", here.reach, force)
    found = np.asarray(inverse_dynamics(*chain, movement).torque)
    assert_allclose(found, expected, atol=1e-7 * (1.0 + np.abs(expected).max()))


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=15)
@given(seed=seeds)
def test_energy_balances(kind: str, seed: int) -> None:
    """What torques and tip force do, kinetic and potential energy gain: along q(t) = q + q̇ t + q̈ t²/2."""
    chain = _chain(kind, seed)
    movement = _movement(chain, seed)
    q, rate, change, force = (np.asarray(part) for part in movement)
    torque = np.asarray(inverse_dynamics(*chain, movement).torque)
    velocity = np.einsum("nar,nr->na", _at(chain, q).reach, rate)
    power = (torque * rate).sum(axis=1) + (force * velocity).sum(axis=1)

    def energy(t: float) -> Floats:
        moved, faster = q + rate * t + 0.5 * change * t**2, rate + change * t
        there = _at(chain, moved)
        return 0.5 * np.einsum("nr,nrs,ns->n", faster, there.mass, faster) + there.potential

    gained = _rate(energy, 1e-5)
    assert_allclose(power, gained, atol=1e-6 * (1.0 + np.abs(gained).max()))


@given(seed=seeds)
def test_at_rest_and_without_weight_it_is_eq_2(seed: int) -> None:
    """τ = Jᵀ W, with W what the finger exerts in the last bone's axes."""
    chain = _chain("six axes", seed)
    movement = _movement(chain, seed)
    still = movement._replace(rate=jnp.zeros_like(movement.rate), acceleration=jnp.zeros_like(movement.rate))
    torque = np.asarray(inverse_dynamics(*chain[:3], jnp.zeros(3), still).torque)
    tip = tip_kinematics_batch(chain.topology, chain.values, movement.posture)
    exerted = -np.einsum("nji,nj->ni", np.asarray(tip.to_base), np.asarray(movement.tip_force))
    expected = np.einsum("nij,ni->nj", np.asarray(tip.jacobian)[:, :3], exerted)
    assert_allclose(torque, expected, atol=1e-9 * (1.0 + np.abs(expected).max()))


@given(seed=seeds)
def test_the_base_carries_weight_and_tip_force(seed: int) -> None:
    """Held still, the reaction at the first joint is what the whole finger weighs less what the tip is pushed with."""
    chain = _chain("index", seed)
    movement = _movement(chain, seed)
    still = movement._replace(rate=jnp.zeros_like(movement.rate), acceleration=jnp.zeros_like(movement.rate))
    reaction = np.asarray(inverse_dynamics(*chain, still).reaction)[:, 0]
    whole = -np.asarray(chain.gravity) * chain.inertia.mass.sum() - np.asarray(movement.tip_force)
    assert_allclose(np.linalg.norm(reaction, axis=1), np.linalg.norm(whole, axis=1), rtol=1e-9)


def test_falling_freely_nothing_is_felt() -> None:
    """A finger at rest in a frame that falls with gravity has no torque: gravity enters as an acceleration alone."""
    chain = _chain("index", 3)
    movement = _movement(chain, 3)
    twice = inverse_dynamics(*chain[:3], 2.0 * chain.gravity, movement).torque
    once = inverse_dynamics(*chain, movement).torque
    none = inverse_dynamics(*chain[:3], jnp.zeros(3), movement).torque
    assert_allclose(np.asarray(twice - once), np.asarray(once - none), atol=1e-9)
