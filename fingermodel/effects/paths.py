"""How far a tendon's path has turned, along its real course through the finger."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax import Array

from fingermodel.effects.places import at
from fingermodel.stages import State
from fingermodel.vectors import cross


def turned_so_far(state: State, slip: str) -> tuple[tuple[int, ...], Array]:
    """Total change of direction [rad] of a tendon from the first bone's axis up to each joint: segments, and of each.

    The path runs straight from point to point: over each joint from the distal point to the proximal one, and within a
    bone from one joint's distal point to the next joint's proximal point. Each corner counts with its whole angle.
    """
    topology, values = state.topology, state.values
    before: Array = jnp.array([1.0, 0.0, 0.0])  # the tendon runs along the first bone, in that bone's frame
    corners: list[tuple[Array, Array]] = []
    ends: dict[int, int] = {}
    last: int | None = None
    for joint, pose, pulls in zip(topology.joints, state.poses, state.pulls, strict=True):
        segments = at(topology, slip, joint.name)
        if segments:
            index = segments[0]
            if last is not None:
                inside = values.distal_point[last] - values.proximal_point[index]
                corners.append((before, inside))
                before = inside
            crossing = pulls.direction[pulls.segments.index(index)]
            corners.append((before, pose.rotation @ crossing))
            ends[index] = len(corners)
            before, last = crossing, index
        else:
            before = pose.rotation.T @ before
    if not corners:
        return (), jnp.zeros(0)
    first, second = (jnp.stack(sides) for sides in zip(*corners, strict=True))
    passed = np.arange(len(corners)) < np.array(list(ends.values()))[:, None]
    return tuple(ends), jnp.asarray(passed.astype(float)) @ _angle(first, second)


def _angle(a: Array, b: Array) -> Array:
    """Angles (n,) between vectors (n, 3), with a slope of zero and not of nothing where they are parallel."""
    normal = cross(a, b)
    return jnp.arctan2(jnp.sqrt(jnp.sum(normal * normal, axis=-1) + 1e-16), jnp.sum(a * b, axis=-1))
