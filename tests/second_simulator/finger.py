"""The finger without anything wrong: tendon strands over three joints, the extensor hood, and what holds the tip.

Lengths in mm, forces in N, angles in rad. x points proximal, y dorsal, z radial. The tip's clamp carries a force and
the moment about z; the joints have no other torque than the tendons'.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TypeAlias

import numpy as np
import yaml
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
# Of a strand: its slip and the joint that it crosses.
Segment: TypeAlias = tuple[str, str]

DATA = Path(__file__).parents[2] / "data"
JOINTS = ("MCP", "PIP", "DIP")
BONES = ("PP", "MP", "DP")
MUSCLES = ("RI", "LU", "UI", "FDP", "FDS", "EDC")
TO_CENTRAL_SLIP = ("RI_ES", "LU_ES", "UI_ES", "EDC_ES")
# Which of the four torques (MCP, abduction, PIP, DIP) are of flexion.
FLEXIONS = np.array([0, 2, 3])
ALONG = np.array([1.0, 0.0, 0.0])
DORSAL = np.array([0.0, 1.0, 0.0])
RADIAL = np.array([0.0, 0.0, 1.0])


def unit(vector: Floats) -> Floats:
    """The same direction with length one."""
    out: Floats = vector / np.linalg.norm(vector)
    return out


def cross(a: Floats, b: Floats) -> Floats:
    """Vector product; NumPy's own is slow on single vectors."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def angle_between(a: Floats, b: Floats) -> float:
    """Between two directions [rad]."""
    return float(np.arctan2(np.linalg.norm(cross(a, b)), a @ b))


def turning(axis: Floats, angle: float) -> Floats:
    """Rotation matrix about an axis of any length."""
    x, y, z = unit(axis)
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    out: Floats = np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew
    return out


def turning_by(vector: Floats) -> Floats:
    """Rotation matrix of a rotation vector."""
    angle = float(np.linalg.norm(vector))
    return turning(vector, angle) if angle else np.eye(3)


def softplus(x: float, width: float) -> float:
    """The positive part, rounded over `width`."""
    return float(width * np.logaddexp(0.0, x / width))


def logistic(x: float) -> float:
    """From 0 to 1."""
    return float(1.0 / (1.0 + np.exp(-x)))


def logit(share: float) -> float:
    """Inverse of `logistic`."""
    return float(np.log(share / (1.0 - share)))


@dataclass
class Strand:
    """What crosses one joint: a point in the bone before it and one in the bone beyond, from the joint's centre."""

    proximal: Floats
    distal: Floats
    wrap: str

    def copy(self) -> Strand:
        """With points of its own."""
        return Strand(self.proximal.copy(), self.distal.copy(), self.wrap)


@dataclass
class Finger:
    """The numbers of one specimen.

    Attributes:
        strands: by slip and joint.
        fraction: of the hood by name, `RI_ES` to the central slip, `RI_EM` into the hood at all.
        shaft: length of each bone between centres, of the last to the clamp.
        axis: of each joint's flexion, in the bone before it.
        glide: (3,) by which the bone beyond each joint has moved along the bone before it.
        centre_shift: (3,) by which the joint's centre has moved and the bone has not.
        abduction_axis: in the metacarpal, where flexion does not carry it.
    """

    strands: dict[Segment, Strand]
    fraction: dict[str, float]
    shaft: dict[str, float]
    axis: dict[str, Floats] = field(default_factory=lambda: dict.fromkeys(JOINTS, RADIAL))
    glide: Floats = field(default_factory=lambda: np.zeros(3))
    centre_shift: Floats = field(default_factory=lambda: np.zeros(3))
    abduction_axis: Floats | None = None

    def copy(self) -> Finger:
        """One that may be changed."""
        strands = {k: s.copy() for k, s in self.strands.items()}
        return Finger(strands, dict(self.fraction), dict(self.shaft), dict(self.axis))


@cache
def read_numbers() -> Finger:
    """The published finger."""
    text = (DATA / "fingers" / "an1979_middle.yaml").read_text(encoding="utf-8")
    document = yaml.safe_load(text)
    mm = float(document["length_unit"]["value_mm"])
    joints = {j["name"]: j for j in document["joints"]}
    strands = {
        (s["slip"], s["joint"]): Strand(
            proximal=np.array(s["proximal"], dtype=float) * mm,
            distal=np.array(s["distal"], dtype=float) * mm - joints[s["joint"]]["distal_origin"] * mm * ALONG,
            wrap=s.get("wrap", ""),
        )
        for s in document["segments"]
    }
    fraction = {k: float(v["value"]) for k, v in document["hood"]["fractions"].items() if k != "UI_EM"}
    to_next = {bone: -joints[joint]["centre"][0] * mm for bone, joint in (("PP", "PIP"), ("MP", "DIP"))}
    return Finger(strands, fraction, {**to_next, "DP": -float(document["load_point"]["offset_mm"][0])})


@dataclass(frozen=True)
class Bones:
    """Where the bones are, in the metacarpal's axes.

    Attributes:
        before: by joint, from the axes of the bone before it to the metacarpal's; after: of the bone beyond.
        origin: by joint, from where the points of its strands are given.
        centre: by joint, about which its bones turn.
        axis: (4, 3) of MCP, abduction, PIP and DIP.
        tip: where the clamp holds the distal phalanx.
    """

    before: Mapping[str, Floats]
    after: Mapping[str, Floats]
    origin: Mapping[str, Floats]
    centre: Mapping[str, Floats]
    axis: Floats
    tip: Floats

    @property
    def distal_phalanx(self) -> Floats:
        """From its axes to the metacarpal's."""
        return self.after["DIP"]


def placed(finger: Finger, flexion: Floats, abduction: float) -> Bones:
    """Place the bones for the three flexions and the abduction."""
    before, after, origin, centre = {}, {}, {}, {}
    turn, at, axes = np.eye(3), np.zeros(3), []
    lengths = (0.0, finger.shaft["PP"], finger.shaft["MP"])
    for i, (joint, length) in enumerate(zip(JOINTS, lengths, strict=True)):
        at = at + turn @ ((finger.glide[i] - length) * ALONG)
        before[joint], origin[joint] = turn, at
        centre[joint] = at + turn @ ALONG * finger.centre_shift[i]
        axes.append(turn @ finger.axis[joint])
        turn = turn @ turning(finger.axis[joint], float(flexion[i]))
        if joint == "MCP":
            sideways = turn @ DORSAL if finger.abduction_axis is None else finger.abduction_axis
            axes.append(sideways)
            turn = turning(sideways, abduction) @ turn
        after[joint] = turn
    return Bones(before, after, origin, centre, np.array(axes), at - finger.shaft["DP"] * (turn @ ALONG))


@dataclass(frozen=True)
class Line:
    """A strand under tension: its two points, and its directions (towards proximal) on either side of the joint."""

    distal_at: Floats
    distal_way: Floats
    proximal_way: Floats
    proximal_at: Floats


def routed(finger: Finger, bones: Bones, flexion: Floats) -> dict[Segment, Line]:
    """Straight lines, or Landsmeer's first model where the strand lies on the bone.

    There its direction stays in the distal bone what it is without flexion.
    """
    lines = {}
    for (slip, joint), strand in finger.strands.items():
        before, after, origin = bones.before[joint], bones.after[joint], bones.origin[joint]
        theta = float(flexion[JOINTS.index(joint)])
        if ("dorsal" in strand.wrap and theta > 0.0) or ("palmar" in strand.wrap and theta < 0.0):
            straight = unit(strand.proximal - strand.distal)
            distal_way, proximal_way = after @ straight, before @ straight
        else:
            distal_way = proximal_way = unit(before @ strand.proximal - after @ strand.distal)
        lines[slip, joint] = Line(
            origin + after @ strand.distal, distal_way, proximal_way, origin + before @ strand.proximal
        )
    return lines


def shared(fraction: Mapping[str, float], pull: Mapping[str, float]) -> dict[Segment, float]:
    """Tensions of the hood's slips, as Winslow's rhombus divides them."""
    radial = pull["RI"] * fraction["RI_EM"]
    central = fraction["RI_ES"] * radial + fraction["LU_ES"] * pull["LU"]
    central += fraction["UI_ES"] * pull["UI"] + fraction["EDC_ES"] * pull["EDC"]
    half = 0.5 * (1.0 - fraction["EDC_ES"]) * pull["EDC"]
    radial_band = (1.0 - fraction["RI_ES"]) * radial + (1.0 - fraction["LU_ES"]) * pull["LU"] + half
    ulnar_band = (1.0 - fraction["UI_ES"]) * pull["UI"] + half
    bands = {("RB", "PIP"): radial_band, ("UB", "PIP"): ulnar_band}
    return {("ES", "PIP"): central, **bands, ("TE", "DIP"): radial_band + ulnar_band}


def joint_torques(bones: Bones, lines: Mapping[Segment, Line], tension: Mapping[Segment, float]) -> Floats:
    """Of MCP flexion, abduction, PIP and DIP (4,) [N mm]."""
    moment = {joint: np.zeros(3) for joint in JOINTS}
    for (slip, joint), line in lines.items():
        moment[joint] += cross(line.distal_at - bones.centre[joint], line.distal_way) * tension[slip, joint]
    return np.array([moment[j] @ axis for j, axis in zip(("MCP", "MCP", "PIP", "DIP"), bones.axis, strict=True)])


def held_at_tip(bones: Bones, torque: Floats) -> Floats:
    """Force and moment about z on the clamp (4,), in the distal phalanx's axes, that these joint torques make."""
    to_tip = bones.distal_phalanx.T
    work = np.empty((4, 4))
    for i, (axis, joint) in enumerate(zip(bones.axis, ("MCP", "MCP", "PIP", "DIP"), strict=True)):
        work[i, :3] = to_tip @ cross(axis, bones.tip - bones.centre[joint])
        work[i, 3] = (to_tip @ axis)[2]
    return np.asarray(np.linalg.solve(work, torque), dtype=np.float64)
