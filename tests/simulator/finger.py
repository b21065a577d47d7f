"""A clamped finger in plain NumPy, one posture at a time: pose, lines of action, hood, statics.

Everything is computed in the metacarpal's axes (x proximal, y dorsal, z radial; mm, N, N mm) and brought to the distal
phalanx's only at the end. Flexion is positive about +z. The finger has an MCP joint with flexion and, carried by it,
abduction; a PIP and a DIP joint with flexion; and tendon segments that each cross one joint.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import yaml
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]

DATA = Path(__file__).parents[2] / "data"
JOINTS = ("MCP", "PIP", "DIP")
BONES = ("PP", "MP", "DP")
ROTATIONS = ("MCP", "abduction", "PIP", "DIP")
FLEXIONS = np.array([0, 2, 3])
MUSCLES = ("RI", "LU", "UI", "FDP", "FDS", "EDC")
_JOINT_OF_ROTATION = np.array([0, 0, 1, 2])
_RESTS_WHEN = {"straight": 0, "landsmeer1_dorsal": 1, "landsmeer1_palmar": -1}


@dataclass
class Finger:
    """The numbers of one specimen; arrays are replaced, never written into.

    Attributes:
        slips: name of what pulls each segment.
        joint: (segments,) index of the joint that each segment crosses.
        rests: (segments,) 1 where it lies on the bone in flexion, -1 in hyperextension, 0 nowhere.
        centre: (3, 3) joint centres in the bone before them, from that bone's own joint centre [mm].
        flexion_axis: (3, 3) of each joint in the bone before it.
        abduction_axis: (3,) of the MCP joint, in the frame that its flexion carries.
        abduction_first: share of the MCP flexion that comes after abduction (0: abduction is carried by all of it).
        proximal: (segments, 3) points in the bone before the joint; distal: in the bone after it [mm].
        fraction: shares of the hood by name, `RI_ES` to the central slip, `RI_EM` into the hood at all.
        load_point: (3,) where the clamp holds the distal phalanx, from the DIP centre [mm].
        suture: (6, 3) direction in which each tendon leaves the metacarpal.
        twist: stiffness of the tip clamp about x and y against that along its axes [mm²]; 0 where it swivels freely.
    """

    slips: tuple[str, ...]
    joint: NDArray[np.intp]
    rests: NDArray[np.intp]
    centre: Floats
    flexion_axis: Floats
    abduction_axis: Floats
    abduction_first: float
    proximal: Floats
    distal: Floats
    fraction: dict[str, float]
    load_point: Floats
    suture: Floats
    twist: float = 0.0

    def of(self, *slips: str, joint: str | None = None) -> NDArray[np.bool_]:
        """Which segments belong to these slips (at that joint)."""
        named = np.array([s in slips for s in self.slips])
        return named if joint is None else named & (self.joint == JOINTS.index(joint))


@dataclass(frozen=True)
class Pose:
    """Where the bones are, metacarpal's axes.

    Attributes:
        turn: (4, 3, 3) from each bone's axes (metacarpal first) to the metacarpal's.
        resting: (3, 3, 3) the same of the bones beyond a joint, had it no flexion against the bone before it.
        centre: (3, 3) joint centres.
        axis: (4, 3) motion of the finger per radian of each rotation.
    """

    turn: Floats
    resting: Floats
    centre: Floats
    axis: Floats


@cache
def _document(name: str) -> dict[str, Any]:
    out: dict[str, Any] = yaml.safe_load((DATA / "fingers" / f"{name}.yaml").read_text(encoding="utf-8"))
    return out


def fraction_widths(name: str = "an1979_middle") -> dict[str, float | None]:
    """How far the file says that each fraction of the hood may be off, None where it does not say."""
    return {k: v.get("sd") for k, v in _document(name)["hood"]["fractions"].items()}


def read_numbers(name: str = "an1979_middle") -> Finger:
    """Read a finger's numbers from its file, in mm about the joint centres."""
    document = _document(name)
    unit = float(document["length_unit"]["value_mm"])
    joints = {j["name"]: j for j in document["joints"]}
    rotations = [r["name"] for j in document["joints"] for r in j["rotations"]]
    if tuple(joints) != JOINTS or tuple(rotations) != ROTATIONS or tuple(document["muscles"]) != MUSCLES:
        raise ValueError(f"{name} is not a finger with {ROTATIONS} and {MUSCLES}")
    segments = document["segments"]
    head = np.array([joints[s["joint"]]["centre"] for s in segments], dtype=float)
    base = np.array([[joints[s["joint"]]["distal_origin"], 0.0, 0.0] for s in segments], dtype=float)
    return Finger(
        slips=tuple(s["slip"] for s in segments),
        joint=np.array([JOINTS.index(s["joint"]) for s in segments]),
        rests=np.array([_RESTS_WHEN[s.get("wrap", "straight")] for s in segments]),
        centre=unit * np.array([joints[j]["centre"] for j in JOINTS], dtype=float),
        flexion_axis=np.array([joints[j]["rotations"][0]["axis"] for j in JOINTS], dtype=float),
        abduction_axis=np.array(joints["MCP"]["rotations"][1]["axis"], dtype=float),
        abduction_first=0.0,
        proximal=unit * (np.array([s["proximal"] for s in segments], dtype=float) + head),
        distal=unit * (np.array([s["distal"] for s in segments], dtype=float) - base),
        fraction={k: float(v["value"]) for k, v in document["hood"]["fractions"].items()},
        load_point=np.array(document["load_point"]["offset_mm"], dtype=float),
        suture=np.tile([1.0, 0.0, 0.0], (len(MUSCLES), 1)),
    )


def cross(a: Floats, b: Floats) -> Floats:
    """Vector product over the last axis."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def turning(vector: Floats) -> Floats:
    """Rotation matrix of a rotation vector [rad]."""
    x, y, z = vector.tolist()
    angle = float(np.sqrt(x * x + y * y + z * z))
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    # Half angles keep both quotients exact for small rotations.
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    out: Floats = np.eye(3) + first * skew + second * (skew @ skew)
    return out


def pose(finger: Finger, angles: Floats) -> Pose:
    """Place the bones for angles (4,) [rad] of `ROTATIONS`."""
    turn, centre, axis, resting = [np.eye(3)], np.empty((3, 3)), np.empty((4, 3)), np.empty((3, 3, 3))
    origin = np.zeros(3)
    for j, theta in enumerate(angles[FLEXIONS].tolist()):
        before, about = turn[-1], finger.flexion_axis[j]
        origin = origin + before @ finger.centre[j]
        centre[j] = origin
        if j == 0:
            late = finger.abduction_first
            sideways = turning(angles[1] * finger.abduction_axis)
            early = turning((1.0 - late) * theta * about)
            after = early @ sideways @ turning(late * theta * about)
            axis[0] = (1.0 - late) * about + late * (after @ about)
            axis[1] = early @ finger.abduction_axis
            resting[0] = sideways
        else:
            after = before @ turning(theta * about)
            axis[j + 1] = before @ about
            resting[j] = np.eye(3)
        turn.append(after)
    return Pose(np.array(turn), resting, centre, axis)


def moment_arms(finger: Finger, posed: Pose, angles: Floats) -> Floats:
    """Moment per unit tension of every segment about every rotation [mm]: (4, segments)."""
    arms = np.zeros((4, len(finger.slips)))
    for j in range(3):
        chosen = np.flatnonzero(finger.joint == j)
        before, after = posed.turn[j], posed.turn[j + 1]
        proximal, distal = finger.proximal[chosen] - finger.centre[j], finger.distal[chosen]
        line = proximal @ before.T - distal @ after.T
        side = 1 if angles[FLEXIONS[j]] >= 0.0 else -1
        lying = finger.rests[chosen] == side
        if lying.any():
            # Where a tendon lies on the bone its line of action stays the one of no flexion in the bone beyond.
            line[lying] = (proximal[lying] @ posed.resting[j] - distal[lying]) @ after.T
        line /= np.sqrt((line * line).sum(axis=1, keepdims=True))
        moment = cross(distal @ after.T, line)
        for i in np.flatnonzero(j == _JOINT_OF_ROTATION):
            arms[i, chosen] = moment @ posed.axis[i]
    return arms


def rhombus(fraction: dict[str, float], pull: Floats) -> dict[str, float]:
    """Tension of every slip [N]: the flexors' own, and what Winslow's rhombus makes of the others."""
    tension = dict(zip(MUSCLES, pull.tolist(), strict=True))
    central, band = 0.0, {"RB": 0.0, "UB": 0.0}
    for muscle, sides in (("RI", "R"), ("LU", "R"), ("UI", "U"), ("EDC", "RU")):
        enters = tension[muscle] * fraction.get(f"{muscle}_EM", 1.0)
        central += enters * fraction[f"{muscle}_ES"]
        for side in sides:
            band[f"{side}B"] += enters * (1.0 - fraction[f"{muscle}_ES"]) / len(sides)
    return {**tension, "ES": central, **band, "TE": band["RB"] + band["UB"]}


def clamped(finger: Finger, posed: Pose, pull: Floats, torque: Floats) -> tuple[Floats, Floats]:
    """What the finger does to its clamps.

    Args:
        finger: its load point and sutures are used.
        posed: where the bones are.
        pull: (6,) tension with which the tendons leave the metacarpal [N].
        torque: (4,) of all tendons about the rotations [N mm].

    Returns:
        Wrench on the tip clamp about the load point, distal phalanx's axes (6,) [N, N mm], of which a clamp without
        twist carries Fx, Fy, Fz and Mz; and the force on the metacarpal clamp (3,) [N].
    """
    to_tip = posed.turn[3].T
    point = posed.centre[2] + posed.turn[3] @ finger.load_point
    motion = cross(posed.axis, point - posed.centre[_JOINT_OF_ROTATION]) @ to_tip.T
    spin = posed.axis @ to_tip.T
    tip = np.zeros(6)
    if finger.twist > 0.0:
        # Springs in parallel share what the joints ask for; their units of length are those of the distal phalanx.
        stiffness = np.array([1.0, 1.0, 1.0, finger.twist, finger.twist, 100.0])
        all_six = np.column_stack([motion, spin])
        tip[:] = stiffness * (np.linalg.solve((all_six * stiffness) @ all_six.T, torque) @ all_six)
    else:
        tip[[0, 1, 2, 5]] = np.linalg.solve(np.column_stack([motion, spin[:, 2]]), torque)
    return tip, pull @ finger.suture - posed.turn[3] @ tip[:3]


def finger_forces(finger: Finger, angles: Floats, pull: Floats) -> tuple[Floats, Floats]:
    """Tip wrench and bone force, as `clamped` gives them, of a finger in which nothing else acts."""
    posed = pose(finger, angles)
    slips = rhombus(finger.fraction, pull)
    torque = moment_arms(finger, posed, angles) @ np.array([slips[s] for s in finger.slips])
    return clamped(finger, posed, pull, torque)
