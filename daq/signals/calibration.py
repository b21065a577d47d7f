"""Bring a wrench from the axes of the load cell to those of its mount.

At `tip` the mount's axes are those of the distal phalanx, at `bone` those of the metacarpal: x proximal, y dorsal,
z radial, right-hand-equivalent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.sessions.models import Mount

Floats = NDArray[np.float64]

# A left hand's (proximal, dorsal, proximal × dorsal) looks like a right hand's in a mirror across z: forces are
# vectors and change in z, torques are pseudovectors and change in x and y.
MIRROR = np.array([1.0, 1.0, -1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True, eq=False)
class MountTransform:
    """Transform of readings to wrenches in mount axes: F' = R F, T' = R (T − d × F), then the mirror of a left hand.

    d leads from the cell's origin to the load point, in the cell's axes.

    Attributes:
        matrix: (6, 6) that takes a wrench of the cell to one of the mount.
    """

    matrix: Floats

    def apply(self, wrench: Floats) -> Floats:
        """Transform wrenches (n, 6) or (6,) [N, N mm]."""
        return wrench @ self.matrix.T

    def apply_covariance(self, covariance: Floats) -> Floats:
        """Transform the covariance (6, 6) of a wrench."""
        return self.matrix @ covariance @ self.matrix.T


def mount_transform(mount: Mount | None, side: str) -> MountTransform:
    """Return the transform of a mount.

    Without a rotation the readings are in right-hand-equivalent mount axes already, whatever the side: then only the
    offset moves the torque. With one, the cell's axes are taken to (proximal, dorsal, proximal × dorsal) and a left
    hand is mirrored.

    Args:
        mount: as the session describes it; None is no rotation and no offset.
        side: left or right.
    """
    if mount is None:
        return MountTransform(np.eye(6))
    rotation = mount_rotation(mount)
    turn = np.eye(3) if rotation is None else rotation
    offset = np.zeros(3) if mount.offset_mm is None else np.array(mount.offset_mm)
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = turn
    matrix[3:, 3:] = turn
    matrix[3:, :3] = -turn @ cross_matrix(offset)
    if rotation is not None and side == "left":
        matrix = MIRROR[:, None] * matrix
    return MountTransform(matrix)


def mount_taking_up(mount: Mount | None, side: str, turned: Floats, away_mm: Floats) -> Mount:
    """Return the mount with which readings are right that come out turned, and about another point.

    With the mount as described, a wrench F, T about the load point comes out as F' = Q F, T' = Q (T − o × F).
    Readings of a left hand without a rotation are in place already; a rotation would mirror them, so that none is
    returned for them.

    Args:
        mount: as the session describes it; None is no rotation and no offset.
        side: left or right.
        turned: (3, 3) Q, in mount axes.
        away_mm: (3,) o, from the load point to the point that the torque is about, in mount axes.
    """
    known = mount or Mount()
    to_mount = mount_transform(known, side).matrix[:3, :3]
    offset = np.array(known.offset_mm or (0.0, 0.0, 0.0)) - to_mount.T @ turned @ away_mm
    angles = None
    if mount_rotation(known) is not None or side != "left":
        # What is stated is the rotation that a mirror across z may follow.
        mirror = np.diag([1.0, 1.0, np.linalg.det(to_mount)])
        angles = xyz_angles_deg(mirror @ turned.T @ to_mount)
    x, y, z = offset.tolist()
    return Mount(frame=known.frame, rotation_deg=angles, offset_mm=(x, y, z) if offset.any() else None)


def mount_rotation(mount: Mount) -> Floats | None:
    """Return the rotation (3, 3) from cell to mount, None where the mount states none."""
    if mount.rotation is not None:
        return np.array(mount.rotation)
    if mount.rotation_deg is not None:
        return intrinsic_xyz(mount.rotation_deg)
    return None


def intrinsic_xyz(angles_deg: Sequence[float]) -> Floats:
    """Return R = Rx Ry Rz (3, 3) of intrinsic x-y-z angles [deg]."""
    a, b, c = np.deg2rad(np.asarray(angles_deg, dtype=float))
    rx = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    ry = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    rz = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    out: Floats = rx @ ry @ rz
    return out


def xyz_angles_deg(rotation: Floats) -> tuple[float, float, float]:
    """Return the intrinsic x-y-z angles [deg] of a rotation R = Rx Ry Rz (3, 3)."""
    a = np.arctan2(-rotation[1, 2], rotation[2, 2])
    # Where y turns by a quarter, only the sum of the other two counts: what x leaves is read, whatever it took.
    left = intrinsic_xyz((float(np.rad2deg(a)), 0.0, 0.0)).T @ rotation
    b, c = np.arctan2(left[0, 2], left[2, 2]), np.arctan2(left[1, 0], left[1, 1])
    x, y, z = np.rad2deg([a, b, c]).tolist()
    return x, y, z


def cross_matrix(d: Floats) -> Floats:
    """Return the matrix (3, 3) of d ×."""
    x, y, z = d
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
