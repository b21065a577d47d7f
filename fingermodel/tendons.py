"""Lines of action, wrapping and moment arms: what a tensioned tendon does to each joint.

A segment runs straight from a point on its distal bone to a point on its proximal one. Where it would lie on the bone
(an extensor in flexion, a flexor in hyperextension) Landsmeer's first model holds: the line of action stays as it is at
0° relative to the distal bone, so the moment arm is constant (Chao et al. 1989; Synek et al. 2019, p. 7). A segment may
come to rest at another angle than 0°.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from fingermodel.fingers import FingerValues, Topology
from fingermodel.kinematics import JointPose, turn
from fingermodel.rows import picked
from fingermodel.vectors import cross


class Pulls(NamedTuple):
    """All tendon segments that cross one joint, per unit tension, in the frame of the joint's child bone.

    Attributes:
        segments: their indices.
        direction: (segments, 3) unit vectors from the distal point towards the proximal one (u of Eq 3).
        moment: (segments, 3) of that unit pull about the joint's centre [mm].
    """

    segments: tuple[int, ...]
    direction: Array
    moment: Array


def joint_pulls(topology: Topology, values: FingerValues, poses: tuple[JointPose, ...]) -> tuple[Pulls, ...]:
    """Return the pulls at every joint, joints proximal to distal."""
    collected: list[list[Pulls]] = [[] for _ in topology.joints]
    for bones, segments in _groups(topology).items():
        crossed = _crossed(topology, bones)
        anchor, line = _lines(topology, values, poses, crossed, segments)
        direction = line / jnp.sqrt(jnp.sum(line * line, axis=-1, keepdims=True))
        moment = cross(anchor, direction)
        for index in reversed(crossed):
            collected[index].append(Pulls(segments, direction, moment))
            if index != crossed[0]:
                rotation = poses[index].rotation
                direction, moment = direction @ rotation.T, moment @ rotation.T
                moment = moment + cross(jnp.asarray(values.centre[index]), direction)
    return tuple(_joined(parts) for parts in collected)


def moment_arms(topology: Topology, poses: tuple[JointPose, ...], pulls: tuple[Pulls, ...]) -> Array:
    """Moment arm of every segment about every rotation [mm], flexion positive: (rotations, segments)."""
    rows = []
    for pose, at_joint in zip(poses, pulls, strict=True):
        arms = pose.axes @ at_joint.moment.T
        rows.append(jnp.zeros((len(arms), len(topology.segments))).at[:, np.array(at_joint.segments, int)].set(arms))
    return jnp.concatenate(rows)


def segment_lengths(topology: Topology, values: FingerValues, poses: tuple[JointPose, ...]) -> Array:
    """Length of every segment [mm]: (segments,). While it runs straight, its derivative is minus the moment arm."""
    lengths = jnp.zeros(len(topology.segments))
    for bones, segments in _groups(topology).items():
        _, line = _lines(topology, values, poses, _crossed(topology, bones), segments)
        lengths = lengths.at[np.array(segments)].set(jnp.sqrt(jnp.sum(line * line, axis=-1)))
    return lengths


def _groups(topology: Topology) -> dict[tuple[int, int], tuple[int, ...]]:
    """Segments that join the same two bones are computed together."""
    groups: dict[tuple[int, int], list[int]] = {}
    for i, segment in enumerate(topology.segments):
        groups.setdefault((segment.proximal_bone, segment.distal_bone), []).append(i)
    return {bones: tuple(indices) for bones, indices in groups.items()}


def _crossed(topology: Topology, bones: tuple[int, int]) -> list[int]:
    """Indices of the joints between two bones."""
    return [i for i, joint in enumerate(topology.joints) if bones[0] < joint.child <= bones[1]]


def _lines(
    topology: Topology,
    values: FingerValues,
    poses: tuple[JointPose, ...],
    crossed: list[int],
    segments: tuple[int, ...],
) -> tuple[Array, Array]:
    """Distal points (n, 3), and the vectors from there to the proximal points, in the distal bone's frame."""
    point = picked(jnp.asarray(values.proximal_point), segments)
    for index in crossed:
        point = _carried(topology, poses[index], index, point - jnp.asarray(values.centre[index]), segments)
    anchor = picked(jnp.asarray(values.distal_point), segments)
    return anchor, point - anchor


def _carried(topology: Topology, pose: JointPose, index: int, point: Array, segments: tuple[int, ...]) -> Array:
    """Points (n, 3) of the parent bone in the child's frame, not flexed further for segments that rest on the bone."""
    joint = topology.joints[index]
    wraps = [topology.segments[s].wrap for s in segments]
    moved = point @ pose.rotation
    if joint.flexion < 0 or set(wraps) == {"straight"}:
        return moved
    dorsal = np.array([w == "landsmeer1_dorsal" for w in wraps])
    palmar = np.array([w == "landsmeer1_palmar" for w in wraps])
    at = np.array([topology.segments[s].rests_at for s in segments])
    unmoved = point if len(joint.rotations) == 1 else point @ pose.unflexed
    cosine, sine = pose.cosine[joint.flexion], pose.sine[joint.flexion]
    if at.any():
        extended = jnp.arctan2(sine, cosine) < at
        bent = turn(pose.axes[joint.flexion], jnp.cos(at), jnp.sin(at))
        unmoved = jnp.sum(unmoved[:, :, None] * bent, axis=1)
    else:
        # Joints stay within ±180°, so the sine tells flexion from extension.
        extended = sine < 0.0
    resting = jnp.where(extended, palmar, dorsal)
    return jnp.where(resting[:, None], unmoved, moved)


def _joined(parts: list[Pulls]) -> Pulls:
    if len(parts) == 1:
        return parts[0]
    if not parts:
        return Pulls((), jnp.zeros((0, 3)), jnp.zeros((0, 3)))
    return Pulls(
        tuple(s for part in parts for s in part.segments),
        jnp.concatenate([p.direction for p in parts]),
        jnp.concatenate([p.moment for p in parts]),
    )
