"""Tendons that wrap, as other software has them: round a cylinder about the joint's flexion axis.

Landsmeer's first model keeps a resting tendon's line as it is at 0°, or at another angle where it comes to rest. On a
joint with one axis its moment arm is then constant, as that of a tendon on a cylinder is, and the two are the same as
long as that line touches the cylinder between its ends. A line that leans along the axis is the same tendon as a flat
one whose ends lie at other radii: the length between points at radii a and b, h apart along the axis, is
√(a² + b² + h² − 2ab cos θ) at every angle.

On a joint with two axes ours has no length of which the moment arms were the slopes, and no path has its arms exactly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations, product

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fingermodel.fingers import Finger, Joint
from fingermodel.model import jax_values, posture_moment_arms

Floats = NDArray[np.float64]

# Where an inexact cylinder is held against ours: flexion, and every other rotation [rad].
FLEXION_RANGE = (-0.5, 1.6)
OTHER_RANGE = (-0.3, 0.3)
# Slopes are taken over a step, and are good to this.
NOTHING_MM = 1e-6
_POSTURES = 4000
_STEP = 1e-5


@dataclass(frozen=True)
class JointHead:
    """A cylinder about a flexion axis.

    Attributes:
        joint: index of the joint.
        before: how many of its rotations carry the axis, those proximal of flexion.
        centre: (3,) of the joint in its parent bone [mm].
        axis: (3,) unit vector, in the parent's axes at the zero posture.
        side: (3,) unit vector from the axis to the tendon, at the zero posture.
        radius: [mm].
    """

    joint: int
    before: int
    centre: Floats
    axis: Floats
    side: Floats
    radius: float


@dataclass(frozen=True)
class TendonLine:
    """A segment as a path.

    Attributes:
        proximal: (3,) end in the proximal bone [mm].
        distal: (3,) end in the distal bone [mm].
        head: that it wraps on; None for a straight path.
        fault: greatest of the path's moment arms against ours about each rotation, over `FLEXION_RANGE` and
            `OTHER_RANGE` [mm]; empty where there is none.
        reason: of that, in words.
    """

    proximal: Floats
    distal: Floats
    head: JointHead | None = None
    fault: Mapping[str, float] = field(default_factory=dict)
    reason: str = ""

    @property
    def exact(self) -> bool:
        """Whether the path has our moment arms in every posture."""
        return not self.reason


def tendon_lines(finger: Finger) -> tuple[TendonLine, ...]:
    """Return every segment's path, with what it cannot say of Landsmeer's first model."""
    lines = [_line(finger, index) for index in range(len(finger.topology.segments))]
    if all(line.exact for line in lines):
        return tuple(lines)
    topology, values = finger.topology, jax_values(finger.values)
    rng = np.random.default_rng(0)
    bends = flexions(finger)
    low, high = (np.where(bends, a, b) for a, b in zip(FLEXION_RANGE, OTHER_RANGE, strict=True))
    postures = np.concatenate([_corners(low, high), rng.uniform(low, high, (_POSTURES, len(low)))])
    ours = np.asarray(jax.vmap(lambda q: posture_moment_arms(topology, values, q))(jnp.asarray(postures)))
    return tuple(
        line if line.exact else _with_fault(finger, index, line, postures, ours[:, :, index])
        for index, line in enumerate(lines)
    )


def _corners(low: Floats, high: Floats) -> Floats:
    """Postures with two angles at the ends of their ranges and the others at 0, where faults are largest."""
    rows = [np.zeros(len(low))]
    for i, j in combinations(range(len(low)), 2):
        for a, b in product((low, high), repeat=2):
            row = np.zeros(len(low))
            row[i], row[j] = a[i], b[j]
            rows.append(row)
    return np.array(rows)


def flexions(finger: Finger) -> NDArray[np.bool_]:
    """Which rotations are flexion: (rotations,)."""
    return np.array([i == joint.flexion for joint in finger.topology.joints for i in range(len(joint.rotations))])


def _line(finger: Finger, index: int) -> TendonLine:
    topology, values = finger.topology, finger.values
    segment = topology.segments[index]
    ends = np.asarray(values.proximal_point)[index], np.asarray(values.distal_point)[index]
    crossed = [j for j in topology.joints if segment.proximal_bone < j.child <= segment.distal_bone]
    if segment.wrap == "straight" or all(j.flexion < 0 for j in crossed):
        return TendonLine(*ends)
    if len(crossed) > 1:
        return TendonLine(*ends, reason="it spans several joints")
    return _on_head(finger, crossed[0], *ends, segment.wrap == "landsmeer1_palmar", segment.rests_at)


def _on_head(
    finger: Finger, joint: Joint, proximal: Floats, distal: Floats, palmar: bool, rests_at: float
) -> TendonLine:
    """The cylinder that the line touches where it comes to rest, and that line at 0°."""
    topology, values = finger.topology, finger.values
    index = topology.joints.index(joint)
    first = sum(len(j.rotations) for j in topology.joints[:index])
    centre, axis = np.asarray(values.centre)[index], np.asarray(values.axis)[first + joint.flexion]
    bent = Rotation.from_rotvec(axis * rests_at)
    ends = [point - axis * (axis @ point) for point in (proximal - centre, bent.apply(distal))]
    height = float(axis @ (proximal - centre - distal))
    single = len(joint.rotations) == 1
    if single:
        ends = _flat(ends, height)
    along = ends[0] - ends[1]
    moment = float(axis @ np.cross(ends[1], along))
    if moment == 0.0 or (moment > 0.0) != palmar:
        return TendonLine(proximal, distal, reason="it lies on the other side of its joint's axis")
    radius = abs(moment) / float(np.linalg.norm(along))
    foot = ends[0] - along * (ends[0] @ along) / (along @ along)
    head = JointHead(index, joint.flexion, centre, axis, foot / np.linalg.norm(foot), radius)
    if not single:
        return TendonLine(proximal, distal, head, reason="its joint has more than one axis")
    if height != 0.0:
        middle = axis * (axis @ (proximal - centre + distal)) / 2.0
        proximal, distal = centre + middle + ends[0], middle + bent.inv().apply(ends[1])
    touches = ends[0] @ along > 0.0 and ends[1] @ along < 0.0
    return TendonLine(proximal, distal, head, reason="" if touches else "its line passes its joint off its end")


def _flat(ends: list[Floats], height: float) -> list[Floats]:
    """Ends in one plane (from the axis) whose distance is at every angle what it was `height` apart along the axis."""
    radii = [float(np.linalg.norm(end)) for end in ends]
    if min(radii) == 0.0 or height == 0.0:
        return ends
    # a + b and a - b, from a² + b² and ab.
    total = np.hypot(radii[0] + radii[1], height)
    apart = np.hypot(radii[0] - radii[1], height) * (1.0 if radii[0] >= radii[1] else -1.0)
    return [end * (0.5 * (total + s * apart) / r) for end, r, s in zip(ends, radii, (1.0, -1.0), strict=True)]


def _with_fault(finger: Finger, index: int, line: TendonLine, postures: Floats, ours: Floats) -> TendonLine:
    theirs = np.zeros_like(ours)
    for rotation in range(postures.shape[1]):
        step = np.zeros(postures.shape[1])
        step[rotation] = _STEP
        ahead, behind = (path_lengths(finger, index, line, postures + s * step) for s in (1.0, -1.0))
        theirs[:, rotation] = (behind - ahead) / (2.0 * _STEP)
    worst = np.max(np.abs(theirs - ours), axis=0)
    fault = {name: float(x) for name, x in zip(finger.topology.rotations, worst, strict=True) if x > NOTHING_MM}
    return replace(line, fault=fault)


def path_lengths(finger: Finger, index: int, line: TendonLine, postures: Floats) -> Floats:
    """Lengths of a segment's path in postures (n, rotations) [rad]: (n,) [mm]."""
    topology = finger.topology
    segment = topology.segments[index]
    axes, centres = np.asarray(finger.values.axis), np.asarray(finger.values.centre)
    crossed = [i for i, j in enumerate(topology.joints) if segment.proximal_bone < j.child <= segment.distal_bone]
    first = {i: sum(len(j.rotations) for j in topology.joints[:i]) for i in crossed}

    def turned(point: Floats, joint: int, rotations: range) -> Floats:
        for i in reversed(rotations):
            at = first[joint] + i
            point = Rotation.from_rotvec(postures[:, at, None] * axes[at]).apply(point)
        return point

    # The distal end as the proximal bone sees it.
    distal = np.tile(line.distal, (len(postures), 1))
    head = line.head
    if head is None:
        for i in reversed(crossed):
            distal = centres[i] + turned(distal, i, range(len(topology.joints[i].rotations)))
        straight: Floats = np.linalg.norm(line.proximal - distal, axis=1)
        return straight
    # A cylinder stands still in the frame that carries its axis.
    distal = turned(distal, head.joint, range(head.before, len(topology.joints[head.joint].rotations)))
    proximal = np.tile(line.proximal - head.centre, (len(postures), 1))
    for i in range(head.before):
        at = first[head.joint] + i
        proximal = Rotation.from_rotvec(-postures[:, at, None] * axes[at]).apply(proximal)
    return _round(head, proximal, distal)


def _round(head: JointHead, proximal: Floats, distal: Floats) -> Floats:
    """Lengths of shortest paths between points (n, 3), past the side of the cylinder where the tendon lies."""
    plane = np.stack([head.side, np.cross(head.axis, head.side)], axis=1)
    ends = [proximal @ plane, distal @ plane]
    height = (proximal - distal) @ head.axis
    apart = ends[1] - ends[0]
    share = np.clip(-np.sum(ends[0] * apart, axis=1) / np.sum(apart * apart, axis=1), 0.0, 1.0)
    nearest = ends[0] + share[:, None] * apart
    free = (np.linalg.norm(nearest, axis=1) >= head.radius) & (nearest[:, 0] >= 0.0)
    radii = [np.maximum(np.linalg.norm(end, axis=1), head.radius) for end in ends]
    angles = [np.arctan2(end[:, 1], end[:, 0]) for end in ends]
    arc = np.abs(angles[0] - angles[1]) - sum(np.arccos(head.radius / radius) for radius in radii)
    wrapped = sum(np.sqrt(radius**2 - head.radius**2) for radius in radii) + head.radius * arc
    flat = np.where(free, np.linalg.norm(apart, axis=1), wrapped)
    lengths: Floats = np.sqrt(flat**2 + height**2)
    return lengths
