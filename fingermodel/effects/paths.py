"""How far a tendon's path has turned, along its real course through the finger."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from fingermodel.effects.places import at
from fingermodel.kinematics import cross
from fingermodel.stages import State


def turned_so_far(state: State, slip: str) -> dict[int, Array]:
    """Total change of direction [rad] of a tendon from the first bone's axis up to each joint, by segment index.

    The path runs straight from point to point: over each joint from the distal point to the proximal one, and within a
    bone from one joint's distal point to the next joint's proximal point. Each corner counts with its whole angle.
    """
    topology, values = state.topology, state.values
    out: dict[int, Array] = {}
    before = jnp.array([1.0, 0.0, 0.0])  # the tendon runs along the first bone, in that bone's frame
    total = jnp.zeros(())
    last: int | None = None
    for joint, pose, pulls in zip(topology.joints, state.poses, state.pulls, strict=True):
        segments = at(topology, slip, joint.name)
        if segments:
            index = segments[0]
            if last is not None:
                inside = values.distal_point[last] - values.proximal_point[index]
                total = total + _angle(before, inside)
                before = inside
            crossing = pulls.direction[pulls.segments.index(index)]
            total = total + _angle(before, pose.rotation @ crossing)
            out[index] = total
            before, last = crossing, index
        else:
            before = pose.rotation.T @ before
    return out


def _angle(a: Array, b: Array) -> Array:
    """Angle between two vectors, with a slope of zero and not of nothing where they are parallel."""
    normal = cross(a, b)
    return jnp.arctan2(jnp.sqrt(jnp.sum(normal * normal) + 1e-16), jnp.sum(a * b))
