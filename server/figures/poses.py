"""Positions of a finger's bones in a posture, in the frame of the first bone [mm]."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fingermodel.fingers import Finger, FingerValues

Floats = NDArray[np.float64]

_TIP = 1.65  # the clamp holds the pulp at half of the distal phalanx: Synek et al. 2019, 19.0 mm over 11.5 mm
_STUB = 0.85  # how much of the metacarpal is drawn, against the first phalanx


@dataclass(frozen=True)
class FingerPose:
    """A finger in one posture, in the first bone's frame."""

    origins: Floats  # (bones, 3) where each bone's own frame stands [mm]
    rotations: Floats  # (bones, 3, 3) take a vector's components in a bone to the first bone
    load_point: Floats  # (3,) [mm]
    posture: Floats  # (rotations,) [rad]

    @property
    def tip_rotation(self) -> Floats:
        """(3, 3) from the most distal bone to the first one."""
        rotation: Floats = self.rotations[-1]
        return rotation

    def place(self, bone: int, point: ArrayLike) -> Floats:
        """Return a bone's point in the first bone's frame."""
        placed: Floats = self.origins[bone] + self.rotations[bone] @ np.asarray(point)
        return placed


def finger_pose(finger: Finger, values: FingerValues, posture: Floats) -> FingerPose:
    """Compute where every bone stands in a posture (rotations,) [rad]."""
    topology = finger.topology
    count = len(topology.bones)
    origins, rotations = np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1))
    turns = iter(zip(np.asarray(values.axis), posture, strict=True))
    for joint, centre in zip(topology.joints, np.asarray(values.centre), strict=True):
        rotation = np.eye(3)
        for _ in joint.rotations:
            rotation = rotation @ _rotation(*next(turns))
        origins[joint.child] = origins[joint.parent] + rotations[joint.parent] @ centre
        rotations[joint.child] = rotations[joint.parent] @ rotation
    last = topology.joints[-1].child
    load_point = origins[last] + rotations[last] @ np.asarray(values.load_point)
    return FingerPose(origins, rotations, load_point, np.asarray(posture, dtype=float))


def _rotation(axis: Floats, angle: float) -> Floats:
    """Return the rotation by an angle [rad] about a unit axis (Rodrigues)."""
    x, y, z = axis
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * across + (1.0 - np.cos(angle)) * across @ across)


def reach_mm(values: FingerValues) -> float:
    """Return the length of the stretched finger from the first joint to the load point [mm]."""
    lengths = np.linalg.norm(np.asarray(values.centre)[1:], axis=1)
    return float(lengths.sum() + np.linalg.norm(values.load_point))


def stub_mm(values: FingerValues) -> float:
    """Return the length of metacarpal that is drawn [mm]."""
    return _STUB * bone_lengths(values)[0]


def bone_lengths(values: FingerValues) -> list[float]:
    """Return the length of every bone beyond the first, the last one to its tip [mm]."""
    lengths = [float(np.linalg.norm(c)) for c in np.asarray(values.centre)[1:]]
    return [*lengths, _TIP * float(np.linalg.norm(values.load_point))]
