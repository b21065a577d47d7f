"""A network of springs that only pull, laid out on the unrolled dorsum of a finger: its shape, energy and slopes.

Every bone's surface is taken as developable (a cylinder of any section), so that a fibre that wraps round it is a
straight line once it is unrolled. Positions are (along, around) [mm]: along the finger, proximal positive, and around
the bone from its dorsal midline, radial positive. A joint that bends lengthens what crosses it by an excursion.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from fingermodel.hood.parts import Network

# A spring that is neither stretched nor slack counts as taut in slopes, so that a network at rest has some.
AT_REST_MM = 1e-12


class Shape(NamedTuple):
    """The numbers of a network in one posture.

    Attributes:
        span: (springs, 2) from a spring's distal end to its proximal one where nothing pulls [mm].
        slack: (springs,) by how much its rest length exceeds the length of `span` [mm].
        stiffness: (springs,) [N/mm].
        slide: (ways, 2) unit vectors along which nodes slide, in the order of `Network.moves`.
        tether: of every way of sliding, to where it was [N/mm]: loose tissue that keeps a node that nothing holds.
    """

    span: Array
    slack: Array
    stiffness: Array
    slide: Array
    tether: Array


class Springs(NamedTuple):
    """What the springs do.

    Attributes:
        length: (springs,) [mm].
        elongation: (springs,) beyond the rest length [mm], negative where slack.
        tension: (springs,) [N], exactly 0 where slack.
        direction: (springs, 2) unit vectors from the distal end to the proximal one.
    """

    length: Array
    elongation: Array
    tension: Array
    direction: Array


def parting(network: Network, shape: Shape) -> Array:
    """How the ends of each spring move apart for each way of sliding: (springs, ways, 2)."""
    return jnp.asarray(network.incidence[:, np.array(network.moves, int)])[:, :, None] * shape.slide


def displacements(network: Network, shape: Shape, ways: Array) -> Array:
    """Displacement of every node [mm] (nodes, 2) for distances slid (ways,)."""
    return jnp.asarray(network.sliding.T) @ (shape.slide * ways[:, None])


def springs_of(network: Network, shape: Shape, ways: Array) -> Springs:
    """What the springs do once the nodes have slid by (ways,) [mm]."""
    moved = network.incidence @ displacements(network, shape, ways)
    line = shape.span + moved
    length, before = _norm(line), _norm(shape.span)
    # The difference of two lengths without cancellation: stiff springs would turn rounding into newtons.
    elongation = jnp.sum((shape.span + line) * moved, axis=-1) / (length + before) - shape.slack
    return Springs(length, elongation, shape.stiffness * _stretched(elongation), line / length[:, None])


def energy(network: Network, shape: Shape, pulls: Array, ways: Array) -> Array:
    """Total potential energy [N mm]: strain energy, less the work of the pulls, plus the tether's.

    Args:
        network: who is tied to whom.
        shape: its numbers.
        pulls: (nodes, 2) of the muscles [N], dead loads.
        ways: (ways,) distance that each node has slid [mm].
    """
    stretched = _stretched(springs_of(network, shape, ways).elongation)
    strain = 0.5 * jnp.sum(shape.stiffness * stretched * stretched)
    work = jnp.sum(pulls * displacements(network, shape, ways))
    return strain - work + 0.5 * shape.tether * jnp.sum(ways * ways)


def unbalanced(network: Network, shape: Shape, pulls: Array, ways: Array) -> Array:
    """Slope of the energy: the force [N] that is missing for equilibrium along each way of sliding (ways,)."""
    springs = springs_of(network, shape, ways)
    at_nodes = network.incidence.T @ (springs.tension[:, None] * springs.direction) - pulls
    return jnp.sum((network.sliding @ at_nodes) * shape.slide, axis=-1) + shape.tether * ways


def stiffness_matrix(network: Network, shape: Shape, ways: Array, taut: Array | None = None) -> Array:
    """Curvature of the energy [N/mm]: (ways, ways), positive definite.

    Args:
        network: who is tied to whom.
        shape: its numbers.
        ways: (ways,) [mm].
        taut: (springs,) bool; by default what is taut there, at rest included.
    """
    springs = springs_of(network, shape, ways)
    if taut is None:
        taut = springs.elongation >= -AT_REST_MM
    apart = parting(network, shape)
    stretch = jnp.sum(apart * springs.direction[:, None], axis=-1)
    normal = jnp.stack([-springs.direction[:, 1], springs.direction[:, 0]], axis=-1)
    turn = jnp.sum(apart * normal[:, None], axis=-1)
    material = jnp.where(taut, shape.stiffness, 0.0)
    matrix = (stretch.T * material) @ stretch + (turn.T * (springs.tension / springs.length)) @ turn
    return matrix + shape.tether * jnp.eye(len(network.moves))


@jax.custom_jvp
def _stretched(elongation: Array) -> Array:
    return jnp.maximum(elongation, 0.0)


@_stretched.defjvp
def _stretched_slope(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    (elongation,), (change,) = primals, tangents
    return _stretched(elongation), jnp.where(elongation >= -AT_REST_MM, change, 0.0)


def _norm(vectors: Array) -> Array:
    return jnp.sqrt(jnp.sum(vectors * vectors, axis=-1))
