"""The finger in plain NumPy: the rival that a good programmer would write without a compiler.

Cases lie along the last axis, so that every operation runs over contiguous numbers, and a batch is worked off in chunks
that stay in the cache. Joints must form a chain and segments must cross one joint, as in the shipped fingers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fingermodel.fingers import FingerValues, Topology
from tests.fingermodel.mujoco_finger import sharing

Floats = NDArray[np.float64]

# Cases a pass; measured best on a core with 1 MiB of second-level and 32 MiB of third-level cache.
CHUNK = 8192


class _Segments(NamedTuple):
    """The segments that cross one joint: their numbers, and which of them rest on the bone in flexion, in extension."""

    members: NDArray[np.intp]
    dorsal: NDArray[np.bool_]
    palmar: NDArray[np.bool_]


class NumpyFinger:
    """Forces of a clamped finger for batches of postures and tensions."""

    def __init__(self, topology: Topology, values: FingerValues) -> None:
        self.topology = topology
        self.rows = list(topology.reactions)
        self.axis = np.asarray(values.axis)
        self.centre = np.asarray(values.centre)
        self.load_point = np.asarray(values.load_point)
        self.suture = np.asarray(values.suture)
        self.proximal = np.asarray(values.proximal_point)
        self.distal = np.asarray(values.distal_point)
        self.sharing = sharing(topology, values)
        self.segments = [_segments_of(topology, joint.name) for joint in topology.joints]

    def forces(self, posture: Floats, tension: Floats) -> tuple[Floats, Floats]:
        """Tip wrench (n, 6) and bone force (n, 3) of postures (n, rotations) [rad] and tensions (n, muscles) [N]."""
        n = len(posture)
        tip, bone = np.empty((n, 6)), np.empty((n, 3))
        for first in range(0, n, CHUNK):
            at = slice(first, first + CHUNK)
            wrench, force = self._chunk(np.ascontiguousarray(posture[at].T), np.ascontiguousarray(tension[at].T))
            tip[at], bone[at] = wrench.T, force.T
        return tip, bone

    def _chunk(self, posture: Floats, tension: Floats) -> tuple[Floats, Floats]:
        cosine, sine = np.cos(posture), np.sin(posture)
        torque = self.torques(cosine, sine, self.sharing @ tension)
        jacobian = self.jacobian(cosine, sine)
        wrench = np.zeros((6, posture.shape[1]))
        wrench[self.rows] = solve([[jacobian[r][k] for r in self.rows] for k in range(len(posture))], torque)
        force = wrench[:3, None]
        for i in reversed(range(len(posture))):
            force = _rotate(force, self.axis[i], cosine[i], sine[i])
        return wrench, self.suture.T @ tension - force[:, 0]

    def torques(self, cosine: Floats, sine: Floats, segment_tension: Floats) -> Floats:
        """Torque about every rotation (rotations, n) [N mm] of postures (rotations, n) and tensions (segments, n)."""
        out, first = np.empty_like(cosine), 0
        for number, (joint, segments) in enumerate(zip(self.topology.joints, self.segments, strict=True)):
            last = first + len(joint.rotations)
            point = (self.proximal[segments.members] - self.centre[number]).T[:, :, None]
            for i in range(first, last):
                felt = _felt(segments, cosine[i], sine[i]) if i - first == joint.flexion else (cosine[i], sine[i])
                point = _rotate(point, self.axis[i], felt[0], -felt[1])
            anchor = self.distal[segments.members].T
            line = point - anchor[:, :, None]
            # anchor × direction: the anchor's own part of the line has no moment about itself.
            pull = segment_tension[segments.members] / np.sqrt((line**2).sum(axis=0))
            x, y, z = point * pull
            moment = [
                anchor[1] @ z - anchor[2] @ y,
                anchor[2] @ x - anchor[0] @ z,
                anchor[0] @ y - anchor[1] @ x,
            ]
            for i in range(first, last):
                axis = self.axis[i][:, None, None]
                for k in range(i + 1, last):
                    axis = _rotate(axis, self.axis[k], cosine[k], -sine[k])
                out[i] = sum(axis[c, 0] * moment[c] for c in range(3))
            first = last
        return out

    def jacobian(self, cosine: Floats, sine: Floats) -> list[list[Floats]]:
        """Components (6) of the load point's motion for each rotation, (n,) each, in the most distal bone's axes."""
        rotations, carried, index = len(cosine), np.zeros((3, 0, 1)), 0
        for number, joint in enumerate(self.topology.joints):
            carried = np.concatenate([carried, _like(self.centre[number], carried)], axis=1)
            for i in range(index, index + len(joint.rotations)):
                carried = np.concatenate([carried, _like(self.axis[i], carried)], axis=1)
                carried = _rotate(carried, self.axis[i], cosine[i], -sine[i])
            index += len(joint.rotations)
        levers: list[Floats] = []
        spins: list[Floats] = []
        lever, column = self.load_point[:, None], carried.shape[1]
        for joint in reversed(self.topology.joints):
            count = len(joint.rotations)
            spins[:0] = [carried[:, k] for k in range(column - count, column)]
            levers[:0] = [lever] * count
            lever = lever + carried[:, column - count - 1]
            column -= count + 1
        moves = [cross(spin, lever) for spin, lever in zip(spins, levers, strict=True)]
        return [[moves[k][c] for k in range(rotations)] for c in range(3)] + [
            [spins[k][c] for k in range(rotations)] for c in range(3)
        ]


def cross(a: Floats, b: Floats) -> list[Floats]:
    """Cross product over the first axis."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def solve(rows: list[list[Floats]], right: Floats) -> Floats:
    """Solve small systems (4, 4, n) x = (4, n), given as rows, by the adjugate: NumPy's own calls LAPACK one by one."""
    if len(rows) != 4:
        matrix = np.moveaxis(np.array(rows), -1, 0)
        answer: Floats = np.linalg.solve(matrix, right.T[..., None])[..., 0].T
        return answer
    a, b, c, d = rows
    pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
    s0, s1, s2, s3, s4, s5 = (a[i] * b[j] - a[j] * b[i] for i, j in pairs)
    c0, c1, c2, c3, c4, c5 = (c[i] * d[j] - c[j] * d[i] for i, j in pairs)
    determinant = s0 * c5 - s1 * c4 + s2 * c3 + s3 * c2 - s4 * c1 + s5 * c0
    adjugate = [
        [
            b[1] * c5 - b[2] * c4 + b[3] * c3,
            a[2] * c4 - a[1] * c5 - a[3] * c3,
            d[1] * s5 - d[2] * s4 + d[3] * s3,
            c[2] * s4 - c[1] * s5 - c[3] * s3,
        ],
        [
            b[2] * c2 - b[0] * c5 - b[3] * c1,
            a[0] * c5 - a[2] * c2 + a[3] * c1,
            d[2] * s2 - d[0] * s5 - d[3] * s1,
            c[0] * s5 - c[2] * s2 + c[3] * s1,
        ],
        [
            b[0] * c4 - b[1] * c2 + b[3] * c0,
            a[1] * c2 - a[0] * c4 - a[3] * c0,
            d[0] * s4 - d[1] * s2 + d[3] * s0,
            c[1] * s2 - c[0] * s4 - c[3] * s0,
        ],
        [
            b[1] * c1 - b[0] * c3 - b[2] * c0,
            a[0] * c3 - a[1] * c1 + a[2] * c0,
            d[1] * s1 - d[0] * s3 - d[2] * s0,
            c[0] * s3 - c[1] * s1 + c[2] * s0,
        ],
    ]
    return np.array([sum(x * t for x, t in zip(row, right, strict=True)) for row in adjugate]) / determinant


def _segments_of(topology: Topology, joint: str) -> _Segments:
    index = np.array([i for i, s in enumerate(topology.segments) if s.joint == joint])
    wraps = [topology.segments[i].wrap for i in index]
    dorsal, palmar = (np.array([[w == f"landsmeer1_{side}"] for w in wraps]) for side in ("dorsal", "palmar"))
    return _Segments(index, dorsal, palmar)


def _felt(segments: _Segments, cosine: Floats, sine: Floats) -> tuple[Floats, Floats]:
    """Flexion as each segment feels it, (segments, n): none where it rests on the bone."""
    if not (segments.dorsal.any() or segments.palmar.any()):
        return cosine, sine
    resting = np.where(sine >= 0.0, segments.dorsal, segments.palmar)
    return np.where(resting, 1.0, cosine), np.where(resting, 0.0, sine)


def _rotate(vectors: Floats, axis: Floats, cosine: Floats, sine: Floats) -> Floats:
    """Rotate vectors (3, m, n or 1) about an axis (3,) by angles (n,) or (m, n)."""
    along = np.tensordot(axis, vectors, 1) * axis[:, None, None]
    rotated: Floats = along + (vectors - along) * cosine + np.array(cross(axis, vectors)) * sine
    return rotated


def _like(vector: Floats, carried: Floats) -> Floats:
    return np.broadcast_to(vector[:, None, None], (3, 1, carried.shape[2]))
