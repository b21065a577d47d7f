"""Where effects act: segments, joints and locations by name, for any finger that has them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jax import Array
from numpy.typing import NDArray

from fingermodel.fingers import Joint, Topology
from fingermodel.rows import spread
from fingermodel.stages import Layout, State


def at(topology: Topology, slip: str, joint: str) -> tuple[int, ...]:
    """Indices of a slip's segments at a joint."""
    return tuple(i for i, s in enumerate(topology.segments) if s.slip == slip and s.joint == joint)


def beyond(topology: Topology, slip: str, joint: str) -> tuple[int, ...]:
    """Indices of a slip's segments distal to a joint."""
    order = [j.name for j in topology.joints]
    limit = order.index(joint)
    return tuple(i for i, s in enumerate(topology.segments) if s.slip == slip and order.index(s.joint) > limit)


def flexors(topology: Topology) -> tuple[str, ...]:
    """Flexor tendons in a sheath that the finger has."""
    slips = {s.slip for s in topology.segments}
    return tuple(m for m in ("FDP", "FDS") if m in topology.muscles and m in slips)


def intrinsics(topology: Topology) -> tuple[int, ...]:
    """Indices of the segments of RI, UI and LU at the MCP joint."""
    return tuple(i for slip in ("RI", "UI", "LU") for i in at(topology, slip, "MCP"))


def flexion_joints(topology: Topology) -> tuple[Joint, ...]:
    """Joints that flex."""
    return tuple(j for j in topology.joints if j.flexion >= 0)


def flexion_of(topology: Topology, joint: str) -> int | None:
    """Index of a joint's flexion among the rotations; None where the finger has no such joint or flexion."""
    first = 0
    for j in topology.joints:
        if j.name == joint and j.flexion >= 0:
            return first + j.flexion
        first += len(j.rotations)
    return None


def locations(layout: Layout) -> tuple[str, ...]:
    """Where the cell sits, tip before bone."""
    used = {location for location, _ in layout.mountings}
    return tuple(place for place in ("tip", "bone") if place in used)


def flexions(topology: Topology) -> NDArray[np.float64]:
    """Return the matrix that spreads one value for each flexion joint over all rotations."""
    rows = [flexion_of(topology, j.name) for j in flexion_joints(topology)]
    return spread([r for r in rows if r is not None], len(topology.rotations))


def shifted(state: State, segments: Sequence[int], dorsal: Array, distal: Array | float = 1.0) -> State:
    """Move both points of some segments along y of their bones [mm]: all as far, or each (segments,) by its own.

    The distal points move by that share.
    """
    values = state.values
    each = (dorsal * np.ones(len(segments))) @ spread(segments, len(state.topology.segments))
    moved = each[:, None] * np.array([0.0, 1.0, 0.0])
    return state._replace(
        values=values._replace(
            proximal_point=values.proximal_point + moved,
            distal_point=values.distal_point + distal * moved,
        )
    )
