"""The elastic hood of a finger as numbers: its network in a posture, what pulls it, and what it delivers."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax import Array

from fingermodel.hood.network import Shape
from fingermodel.hood.parts import ElasticHood

# A group's stiffness runs from 1/16 to 16 times the file's as its parameter runs from 0 to 1.
STIFFNESS_RANGE = 16.0


def home(hood: ElasticHood, length: Array) -> Array:
    """Places of the nodes on the unrolled straight finger [mm]: (nodes, 2).

    Args:
        hood: whose nodes they are.
        length: (bones,) from joint centre to joint centre [mm], 0 for the first bone and for the last one, for which
            the length of the one before stands in.
    """
    bones, last = np.arange(length.shape[0]), length.shape[0] - 1
    bone, places = np.array(hood.bones), np.array(hood.places)
    unit = bones == np.where(bone == last, last - 1, bone)[:, None]
    along = (bones < bone[:, None]) + places[:, :1] * unit
    return jnp.stack([-along @ length, (places[:, 1:] * unit) @ length], axis=1)


def shape_of(hood: ElasticHood, length: Array, excursion: Array, fraction: Array) -> Shape:
    """The network's numbers in one posture.

    Args:
        hood: whose network it is.
        length: (bones,) [mm] as in `home`.
        excursion: (springs,) by how much the joints lengthen what crosses them, against the straight finger [mm].
        fraction: parameters in the order of `ElasticHood.fractions`.
    """
    numbers = _named(hood, fraction)
    straight = jnp.asarray(hood.network.incidence) @ home(hood, length)
    bent = jnp.stack([excursion, jnp.zeros_like(excursion)], axis=1)
    span = straight + bent
    rest = straight + numbers["follow"] * bent
    # Equal vectors give 0 exactly, so a network that follows the posture is at rest in it.
    slack = jnp.sum((rest - span) * (rest + span), axis=1) / (_norm(rest) + _norm(span))
    powers = jnp.zeros(len(hood.stiffness))
    for name, springs in hood.groups:
        within = np.isin(np.arange(len(hood.stiffness)), springs)
        powers = powers + within * (2.0 * numbers[f"k_{name}"] - 1.0)
    stiffness = jnp.asarray(hood.stiffness) * STIFFNESS_RANGE**powers
    return Shape(span, slack, stiffness, jnp.asarray(hood.slide), jnp.asarray(hood.tether))


def pulls_of(hood: ElasticHood, tension: dict[str, Array], fraction: Array) -> Array:
    """Pull of the muscles at every node [N]: (nodes, 2)."""
    numbers = _named(hood, fraction)
    enters = jnp.stack([tension[m] * numbers.get(f"{m}_EM", 1.0) for m in hood.members])
    at = jnp.asarray(np.eye(len(hood.network.nodes))[:, [node for _, node, *_ in hood.pulls]])
    return at @ (enters[:, None] * np.array([direction for _, _, *direction in hood.pulls]))


def delivered(hood: ElasticHood, tension: Array, direction: Array) -> dict[str, Array]:
    """Tension of the finger's slips [N]: what their springs pull along the finger.

    A spring that crosses a joint askew turns it by its part along the finger alone (virtual work of its excursion).
    """
    out: dict[str, Array] = {}
    for i, slip in enumerate(hood.slips):
        if slip:
            out[slip] = out.get(slip, jnp.zeros(())) + tension[i] * direction[i, 0]
    return out


def _named(hood: ElasticHood, fraction: Array) -> dict[str, Array]:
    return dict(zip(hood.fractions, jnp.asarray(fraction), strict=True))


def _norm(vectors: Array) -> Array:
    return jnp.sqrt(jnp.sum(vectors * vectors, axis=-1))
