"""From muscle tensions and a posture to the tensions of the slips that an elastic hood delivers."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from fingermodel.fingers import FingerValues, Topology
from fingermodel.hood.elastic import delivered, home, pulls_of, shape_of
from fingermodel.hood.equilibrium import Settled, equilibrium
from fingermodel.hood.network import Shape
from fingermodel.hood.parts import ElasticHood
from fingermodel.kinematics import JointPose
from fingermodel.tendons import joint_pulls, moment_arms, segment_lengths

# Force that may be missing at a node, as a share of the largest pull.
UNBALANCED = 1e-6


class HoodState(NamedTuple):
    """An elastic hood under load in one posture.

    Attributes:
        home: (nodes, 2) where nothing pulls, on the unrolled straight finger [mm].
        shape: its numbers in the posture.
        pulls: (nodes, 2) of the muscles [N].
        settled: at rest under them.
        slips: tension of each slip of the finger that it delivers [N].
    """

    home: Array
    shape: Shape
    pulls: Array
    settled: Settled
    slips: dict[str, Array]


def hood_state(
    topology: Topology, values: FingerValues, muscle: dict[str, Array], poses: tuple[JointPose, ...]
) -> HoodState:
    """Settle a finger's elastic hood.

    Args:
        topology: with an `ElasticHood`.
        values: the finger's numbers.
        muscle: tension of every muscle [N].
        poses: of `joint_poses`.
    """
    hood = topology.hood
    assert isinstance(hood, ElasticHood)  # noqa: S101 - the caller has looked
    length = bone_lengths(topology, values)
    crossing = {slip: i for i, slip in enumerate(dict.fromkeys(s for s in hood.slips if s))}
    by_slip = slip_excursions(topology, values, poses, tuple(crossing))
    excursion = jnp.asarray([[float(s == slip) for slip in crossing] for s in hood.slips]) @ by_slip
    shape = shape_of(hood, length, excursion, jnp.asarray(values.fraction))
    pulls = pulls_of(hood, muscle, jnp.asarray(values.fraction))
    settled = equilibrium(hood.network, shape, pulls)
    # A network that did not settle has no answer: better none than a wrong one.
    lost = jnp.max(jnp.abs(settled.unbalanced)) > UNBALANCED * jnp.maximum(1.0, jnp.max(jnp.abs(pulls)))
    tension = jnp.where(lost, jnp.nan, settled.springs.tension)
    slips = delivered(hood, tension, settled.springs.direction)
    return HoodState(home(hood, length), shape, pulls, settled, slips)


def bone_lengths(topology: Topology, values: FingerValues) -> Array:
    """Length of every bone from its own joint centre to the next one [mm], 0 where it has no second joint."""
    found = {joint.parent: jnp.asarray(values.centre[i]) for i, joint in enumerate(topology.joints) if joint.parent > 0}
    none = jnp.zeros(())
    return jnp.stack([_norm(found[i]) if i in found else none for i in range(len(topology.bones))])


def slip_excursions(
    topology: Topology, values: FingerValues, poses: tuple[JointPose, ...], slips: tuple[str, ...]
) -> Array:
    """By how much a posture lengthens the slips against the straight finger [mm]: (slips,).

    Its derivative with respect to a flexion angle is minus the moment arm, wrapped segments included, so the hood's
    energy and the torque of its slips agree.
    """
    chosen = [i for i, s in enumerate(topology.segments) if s.slip in slips]
    segments = tuple(topology.segments[i] for i in chosen)
    topology = replace(topology, segments=segments)
    proximal, distal = (jnp.asarray(p)[np.array(chosen)] for p in (values.proximal_point, values.distal_point))
    values = values._replace(proximal_point=proximal, distal_point=distal)
    across = np.array([[s.proximal_bone < j.child <= s.distal_bone for s in segments] for j in topology.joints])
    straight = _norm(proximal - across.T.astype(float) @ jnp.asarray(values.centre) - distal)
    change = segment_lengths(topology, values, poses) - straight
    arms = moment_arms(topology, poses, joint_pulls(topology, values, poses))
    first = 0
    for index, joint in enumerate(topology.joints):
        if joint.flexion >= 0 and any(segments[i].wrap != "straight" for i in np.flatnonzero(across[index])):
            cosine, sine = poses[index].cosine[joint.flexion], poses[index].sine[joint.flexion]
            dorsal = np.array([s.wrap == "landsmeer1_dorsal" for s in segments]) & across[index]
            palmar = np.array([s.wrap == "landsmeer1_palmar" for s in segments]) & across[index]
            resting = (dorsal & (sine >= 0.0)) | (palmar & (sine < 0.0))
            # A segment that rests on the bone keeps its straight part; what grows is the arc on the bone.
            change = change - jnp.where(resting, arms[first + joint.flexion] * jnp.arctan2(sine, cosine), 0.0)
        first += len(joint.rotations)
    return jnp.asarray([[float(s.slip == slip) for s in segments] for slip in slips]) @ change


def _norm(vectors: Array) -> Array:
    return jnp.sqrt(jnp.sum(vectors * vectors, axis=-1))
