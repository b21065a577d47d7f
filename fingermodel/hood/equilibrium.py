"""Where a network comes to rest: the minimum of its total potential energy, with exact slopes.

A spring's energy is a convex function of its length, and the length is one of its ends' positions, so the energy is
convex as long as nodes slide along lines or planes: there is one minimum, and Newton's method with a line search finds
it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from fingermodel.hood.network import Shape, Springs, springs_of, stiffness_matrix, unbalanced
from fingermodel.hood.parts import Network

STEPS = 100
# Missing forces relative to the largest pull: what is wanted, and below which a step that gains nothing ends the
# search, since the rest is rounding.
RESIDUAL, ROUNDING = 1e-13, 1e-9
# Lengths of a step that are tried together, ever shorter: a loaded node that no spring holds yet is sent far away.
LENGTHS = 10.0 ** -np.arange(4)
# How often the best length is then narrowed down: more cost more than the steps that they save.
NARROWED = 6


class Settled(NamedTuple):
    """A network at rest.

    Attributes:
        ways: (ways,) distance that each node has slid [mm].
        springs: what the springs do.
        unbalanced: (ways,) force that is missing for equilibrium [N].
    """

    ways: Array
    springs: Springs
    unbalanced: Array


def equilibrium(network: Network, shape: Shape, pulls: Array) -> Settled:
    """Return the network at rest under pulls (nodes, 2) [N]; differentiable with respect to shape and pulls."""
    ways = settle(network, shape, pulls)
    return Settled(ways, springs_of(network, shape, ways), unbalanced(network, shape, pulls, ways))


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def settle(network: Network, shape: Shape, pulls: Array) -> Array:
    """Distances slid (ways,) [mm] at the least energy."""
    along = jnp.sum((network.sliding @ pulls) * shape.slide, axis=-1)
    load = jnp.maximum(1.0, jnp.max(jnp.abs(along), initial=0.0))
    still = jnp.zeros(len(network.moves))
    # From the answer of springs that also push: where nothing is stretched yet there is no other curvature to go by.
    first = solved(stiffness_matrix(network, shape, still, jnp.ones(len(network.springs), bool)), along)

    def missing(ways: Array) -> Array:
        return unbalanced(network, shape, pulls, ways)

    def largest(left: Array) -> Array:
        return jnp.max(jnp.abs(left), initial=0.0)

    def going(state: tuple[Array, Array, Array, Array]) -> Array:
        _, left, before, steps = state
        now = largest(left)
        rounding = (now <= ROUNDING * load) & (now >= before)
        return (now > RESIDUAL * load) & (steps < STEPS) & ~rounding

    def step(state: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        ways, left, _, steps = state
        change = solved(stiffness_matrix(network, shape, ways), -left)
        # The energy's slope along the step rises through 0 at its least: no cancellation, as its values would have.
        tried = ways + best_length(lambda length: missing(ways + length * change) @ change) * change
        return tried, missing(tried), largest(left), steps + 1

    ways, *_ = jax.lax.while_loop(going, step, (first, missing(first), jnp.asarray(jnp.inf), jnp.zeros((), int)))
    return ways


def best_length(slope: Callable[[Array], Array]) -> Array:
    """Where along a step the slope of the energy passes 0: the whole step, or less (regula falsi, Illinois)."""
    lengths = jnp.asarray(LENGTHS)
    slopes = jax.vmap(slope)(lengths)
    short = slopes <= 0.0
    low = jnp.max(jnp.where(short, lengths, 0.0))
    high = jnp.min(jnp.where(short, 1.0, lengths))
    at_low = jnp.where(short.any(), jnp.max(jnp.where(short, slopes, -jnp.inf)), slope(jnp.zeros(())))
    at_high = jnp.min(jnp.where(short, jnp.inf, slopes))

    def narrow(_: int, ends: tuple[Array, ...]) -> tuple[Array, ...]:
        low, high, at_low, at_high, side = ends
        middle = jnp.clip((low * at_high - high * at_low) / (at_high - at_low), low, high)
        value = slope(middle)
        below = value <= 0.0
        # The end that stays counts half the next time, so that it does not stay for good.
        return (
            jnp.where(below, middle, low),
            jnp.where(below, high, middle),
            jnp.where(below, value, jnp.where(side == -1, 0.5 * at_low, at_low)),
            jnp.where(below, jnp.where(side == 1, 0.5 * at_high, at_high), value),
            jnp.where(below, 1, -1),
        )

    whole = slopes[0] <= 0.0
    begin = (low, high, at_low, jnp.where(whole, 1.0, at_high), jnp.zeros((), int))
    low, high, at_low, at_high, _ = jax.lax.fori_loop(0, NARROWED, narrow, begin)
    return jnp.where(whole, 1.0, jnp.where((low > 0.0) & (-at_low < at_high), low, high))


@settle.defjvp
def _settle_slope(network: Network, primals: tuple[Shape, Array], tangents: tuple[Shape, Array]) -> tuple[Array, Array]:
    """The slope stays 0 along the minimum: H du = -dg (implicit function theorem)."""
    ways = settle(network, *primals)
    _, change = jax.jvp(lambda shape, pulls: unbalanced(network, shape, pulls, ways), primals, tangents)
    return ways, solved(stiffness_matrix(network, primals[0], ways), -change)


def solved(matrix: Array, right: Array) -> Array:
    """Solve a small symmetric positive definite system (n, n) x = (n,)."""
    return jax.scipy.linalg.cho_solve(jax.scipy.linalg.cho_factor(matrix), right)


@partial(jax.jit, static_argnums=0)
def equilibria(network: Network, shape: Shape, pulls: Array) -> Settled:
    """Settle many: shape and pulls with a leading axis on every field."""
    return jax.vmap(lambda s, p: equilibrium(network, s, p))(shape, pulls)
