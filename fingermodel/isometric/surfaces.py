"""Tendons over cylinders: the shortest path between two points that passes a cylinder on a given side.

Unrolled, the surface is a plane, so a path that winds along the cylinder is straight there: its length is that of its
projection across the axis and of its rise along it. A moment arm is minus the slope of the length (virtual work).
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from fingermodel.fingers import Finger
from fingermodel.kinematics import JointPose

Floats = NDArray[np.float64]
SIDES = {
    "dorsal": (0.0, 1.0, 0.0),
    "palmar": (0.0, -1.0, 0.0),
    "radial": (0.0, 0.0, 1.0),
    "ulnar": (0.0, 0.0, -1.0),
}


class Wrap(NamedTuple):
    """Which segment runs over a surface (static).

    Attributes:
        segment: index of the segment.
        joint: index of the joint that it crosses.
        on_child: whether the surface is on the joint's child bone.
    """

    segment: int
    joint: int
    on_child: bool


class Cylinders(NamedTuple):
    """The cylinder under every such segment, in the axes of the bone that carries it.

    Attributes:
        centre: (wraps, 3) a point of its axis, from the bone's own joint centre [mm].
        axis: (wraps, 3) unit vector.
        side: (wraps, 3) unit vector square to the axis, towards the side on which the tendon passes.
        radius: (wraps,) [mm].
    """

    centre: Array | Floats
    axis: Array | Floats
    side: Array | Floats
    radius: Array | Floats


def read_wraps(finger: Finger) -> tuple[tuple[Wrap, ...], Cylinders]:
    """The wrapping surfaces of a finger, from its file."""
    document, unit, topology = finger.document, finger.length_unit_mm, finger.topology
    surfaces = {s["name"]: s for s in document.get("surfaces", [])}
    joints = [j.name for j in topology.joints]
    wraps: list[Wrap] = []
    rows: list[tuple[Floats, Floats, Floats, float]] = []
    for index, segment in enumerate(document.get("segments", [])):
        if "over" not in segment:
            continue
        surface, joint = surfaces[segment["over"]["surface"]], joints.index(segment["joint"])
        on_child = topology.bones.index(surface["bone"]) == topology.joints[joint].child
        axis = np.array(surface["axis"], dtype=float)
        axis /= np.linalg.norm(axis)
        side = np.array(SIDES[segment["over"]["side"]])
        side = side - axis * (axis @ side)
        wraps.append(Wrap(index, joint, on_child))
        rows.append((unit * np.array(surface["centre"]), axis, side / np.linalg.norm(side), unit * surface["radius"]))
    empty = np.zeros((0, 3))
    if not rows:
        return (), Cylinders(empty, empty, empty, np.zeros(0))
    centre, axes, sides, radius = (np.array(column) for column in zip(*rows, strict=True))
    return tuple(wraps), Cylinders(centre, axes, sides, radius)


def wrapped_length(start: Array, end: Array, cylinder: Cylinders) -> Array:
    """Length of the path between two points (3,) that passes one cylinder on its side [mm].

    Straight where the line between them passes clear of the cylinder on that side, or where an end lies inside it.

    Args:
        start: in the axes of the cylinder's bone, from that bone's joint centre [mm].
        end: likewise.
        cylinder: one, without the leading axis.
    """
    across = jnp.cross(cylinder.axis, cylinder.side)
    plane = jnp.stack([jnp.asarray(cylinder.side), across])
    flat = [plane @ (point - cylinder.centre) for point in (start, end)]
    rise = (end - start) @ cylinder.axis
    away = [jnp.sqrt(p @ p) for p in flat]
    outside = (away[0] > cylinder.radius) & (away[1] > cylinder.radius)
    # Held off the surface, where the slopes of the branch that is not taken would have no bound.
    held = [jnp.where(outside, d, 2.0 * cylinder.radius) for d in away]
    angles = [jnp.arctan2(p[1], p[0]) for p in flat]
    arc = jnp.abs(angles[0] - angles[1]) - sum(jnp.arccos(cylinder.radius / d) for d in held)
    tangents = sum(jnp.sqrt(d * d - cylinder.radius**2) for d in held)
    apart = flat[1] - flat[0]
    straight = jnp.sqrt(apart @ apart)
    over = jnp.where(outside & (arc > 0.0), tangents + cylinder.radius * arc, straight)
    return jnp.sqrt(over * over + rise * rise)


def wrap_lengths(
    wraps: tuple[Wrap, ...],
    cylinders: Cylinders,
    ends: tuple[Array, Array],
    centre: Array,
    poses: tuple[JointPose, ...],
) -> Array:
    """Lengths of the segments that run over a surface [mm]: (wraps,).

    Args:
        wraps: which segments (static).
        cylinders: under them.
        ends: proximal and distal points (segments, 3), each in its bone.
        centre: (joints, 3) joint centres in the parent bones.
        poses: of `joint_poses`.
    """
    if not wraps:
        return jnp.zeros(0)
    starts, stops = [], []
    for wrap in wraps:
        start, end = (jnp.asarray(p)[wrap.segment] for p in ends)
        origin, rotation = jnp.asarray(centre)[wrap.joint], poses[wrap.joint].rotation
        # Points on the parent are given from its own joint centre, as the joint's centre is.
        if wrap.on_child:
            start = rotation.T @ (start - origin)
        else:
            end = origin + rotation @ end
        starts.append(start)
        stops.append(end)
    return jax.vmap(wrapped_length)(jnp.stack(starts), jnp.stack(stops), Cylinders(*map(jnp.asarray, cylinders)))
