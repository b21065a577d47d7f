"""Clamp forces of very many load cases at once, of a finger whose tendon segments each cross one joint.

Everything that turns with a joint is a sum of 1, the cosine and the sine of its angle with fixed coefficients; through
several joints it is a sum of products of these. Coefficients are found once for a finger. A batch is then a few matrix
products, and a square root and a division for each segment: the length of a segment follows from such a sum by the law
of cosines, its moment arm from the sum's derivative (virtual work).

Cases lie along the last axis. Symbols: q angle, k coefficient, n cases of a chunk.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fingermodel.extensor import shares
from fingermodel.fingers import FingerValues, Joint, Topology
from fingermodel.hood.parts import ElasticHood
from fingermodel.rows import spread

Floats = NDArray[np.float64]

# Cases a pass: their intermediate values stay in the cache, and NumPy's time to begin an operation counts for little.
CHUNK = 8192
UNIT = np.eye(3)


def suits(topology: Topology) -> bool:
    """Whether `ManyCases` can take a finger: a chain of joints with four angles, segments across one joint each."""
    joints = topology.joints
    return (
        not isinstance(topology.hood, ElasticHood)
        and len(topology.rotations) == len(topology.reactions) == 4
        and all(joint.parent == i and joint.child == i + 1 for i, joint in enumerate(joints))
        and all(1 <= len(joint.rotations) <= 2 for joint in joints)
        and not any(s.rests_at for s in topology.segments)
        and all(any(_crosses(s.proximal_bone, s.distal_bone, joint) for joint in joints) for s in topology.segments)
    )


def _crosses(proximal: int, distal: int, joint: Joint) -> bool:
    return (proximal, distal) == (joint.parent, joint.child)


def many_cases(topology: Topology, values: FingerValues) -> ManyCases:
    """Coefficients of a finger that `suits`; those of the last few are kept."""
    arrays = [np.asarray(v, dtype=float) for v in values]
    return _known(topology, tuple((a.tobytes(), a.shape) for a in arrays))


@lru_cache(maxsize=16)
def _known(topology: Topology, numbers: tuple[tuple[bytes, tuple[int, ...]], ...]) -> ManyCases:
    return ManyCases(topology, FingerValues(*(np.frombuffer(text).reshape(shape) for text, shape in numbers)))


@dataclass(frozen=True, eq=False)
class _Crossing:
    """The segments that cross one joint.

    Attributes:
        turns: the joint's rotations among all.
        segments: among all in the order of the joints.
        flexion: in which any of them may rest on the bone, among all rotations; None where none does.
        forms: ((1 + rotations) segments, products) squared lengths [mm2], then moment arms times length [mm2]; where
            any may rest, for extended joints and for flexed ones.
    """

    turns: slice
    segments: slice
    flexion: int | None
    forms: Floats


class ManyCases:
    """Forces of a clamped finger for batches of postures and tensions.

    Args:
        topology: that `suits`.
        values: its numbers.
    """

    def __init__(self, topology: Topology, values: FingerValues) -> None:
        values = FingerValues(*(np.asarray(v, dtype=float) for v in values))
        self._suture = np.asarray(values.suture)
        self._crossings, order = _crossings(topology, values)
        self._shares = np.asarray(shares(topology, values))[order]
        # The last rotation always moves the load point alike, so its torque gives one component of the wrench by
        # itself: the first, in axes of the wrench that are turned for it.
        *motions, last = (motion[..., list(topology.reactions)] for motion in _motions(topology, values))
        self._last = float(np.linalg.norm(last))
        axes = np.linalg.qr(np.column_stack([last, np.eye(len(last))]))[0]
        axes[:, 0] = last / self._last
        # The others in the order in which cross products take them, x y z x y.
        self._motions = [np.ascontiguousarray((m @ axes[:, [1, 2, 3, 1, 2, 0]]).reshape(-1, 6).T) for m in motions]
        self._to_wrench = spread(topology.reactions, 6).T @ axes
        # Rows of memory that a chunk takes; see the methods.
        most = max(len(c.forms) + 2 * c.forms.shape[1] for c in self._crossings)
        self._rows = 12 + 4 + len(order) + 4 + max(most + 1, 4 + 18 + 9 + 27 + 7, 4 + 2 + 5 * 3)
        frames = [_frame(axis) for axis in np.asarray(values.axis)]
        self._to_frames = [frames[3] @ self._to_wrench[:3], *(frames[i] @ frames[i + 1].T for i in (2, 1, 0))]
        self._to_base = frames[0].T

    def operations(self) -> dict[str, int]:
        """Operations of the arithmetic of one case, by kind, as it is written here."""
        products = roots = 0
        plain = 5 * 4 + 4  # of the angles, and of the tip's force beside the bone's
        matrices = [self._shares, *self._motions, self._to_wrench, self._suture, *self._to_frames, self._to_base]
        for crossing in self._crossings:
            segments, rotations = crossing.segments.stop - crossing.segments.start, len(range(4)[crossing.turns])
            products += 9 * (rotations - 1) + (crossing.forms.shape[1] if crossing.flexion is not None else 0)
            plain += 2 * rotations * segments
            roots += segments
            matrices.append(crossing.forms)
        # Products of angles, three cross products, their combination, and four turns of the force.
        plain += products + 9 + 27 + 3 * 9 + 5 + 6 + 15 + 4 * 6
        return {
            "in matrix products": sum(2 * m.size for m in matrices),
            "plain": plain,
            "divisions": roots + 4 + 1 + 3,
            "square roots": roots,
            "tangents": 4,
        }

    def forces(self, posture: Floats, tension: Floats) -> tuple[Floats, Floats]:
        """Tip wrench (n, 6) [N, N mm] and bone force (n, 3) [N] of postures (n, 4) [rad], tensions (n, muscles) [N]."""
        n = len(posture)
        tip, bone, room = np.empty((n, 6)), np.empty((n, 3)), np.empty(self._rows * min(n, CHUNK))
        with np.errstate(all="ignore"):  # a posture that transmits no force has none that is finite
            for first in range(0, n, CHUNK):
                at = slice(first, min(first + CHUNK, n))
                new = _Room(room, at.stop - first)
                turned = _turned(posture[at], new)
                pull = np.matmul(self._shares, tension[at].T, out=new(len(self._shares)))
                wrench = self._wrench(turned, self._torque(turned, pull, new), new)
                np.matmul(wrench.T, self._to_wrench.T, out=tip[at])
                np.matmul(tension[at], self._suture, out=bone[at])
                bone[at] -= self._base_force(turned, wrench, new).T
        return tip, bone

    def _torque(self, turned: Floats, pull: Floats, new: _Room) -> Floats:
        """Torque about every rotation (4, n) [N mm] from the segments' tensions (segments, n)."""
        torque = new(4)
        for crossing in self._crossings:
            with new:
                products, *further = turned[crossing.turns]
                for one in further:
                    products = _products(one, products, new)
                if crossing.flexion is not None:
                    products = _parted(products, turned[crossing.flexion, 2], new)
                own = pull[crossing.segments]
                forms = np.matmul(crossing.forms, products, out=new(len(crossing.forms)))
                length, *arms = forms.reshape(1 + len(torque[crossing.turns]), *own.shape)
                np.sqrt(length, out=length)
                np.divide(own, length, out=length)
                for row, arm in zip(torque[crossing.turns], arms, strict=True):
                    np.add.reduce(np.multiply(arm, length, out=arm), axis=0, out=row)
        return torque

    def _wrench(self, turned: Floats, torque: Floats, new: _Room) -> Floats:
        """Solve Eq 2 for the wrench (4, n) in its turned axes."""
        out = new(4)
        np.divide(torque[3], self._last, out=out[0])
        with new:
            inner = turned[3]
            w = np.matmul(self._motions[2], inner, out=new(6))
            inner = _products(inner, turned[2], new)
            v = np.matmul(self._motions[1], inner, out=new(6))
            u = np.matmul(self._motions[0], _products(inner, turned[1], new), out=new(6))
            normal, part, rest = new(3), new(3), out[1:]
            _cross(v, w, normal, part)
            np.multiply(u[:3], normal, out=part)
            volume = np.add.reduce(part, axis=0, out=new(1)[0])
            for left, (a, b, c) in zip(torque, ((u, v, w), (v, w, u), (w, u, v)), strict=False):
                # What the first component leaves of this torque.
                a[5] *= out[0]
                np.subtract(left, a[5], out=left)
                if a is u:
                    np.multiply(normal, left, out=rest)
                else:
                    _cross(b, c, normal, part)
                    normal *= left
                    rest += normal
            rest /= volume
        return out

    def _base_force(self, turned: Floats, wrench: Floats, new: _Room) -> Floats:
        """Force at the tip (3, n) [N] in the first bone's axes: turned about one axis after the other."""
        force, across = wrench, new(2)
        for (_, cosine, sine), to_frame in zip(turned[::-1], self._to_frames, strict=True):
            force = np.matmul(to_frame, force, out=new(3))
            np.multiply(force[:2], sine, out=across)
            force[:2] *= cosine
            force[0] -= across[1]
            force[1] += across[0]
        return np.matmul(self._to_base, force, out=new(3))


class _Room:
    """Memory for what is computed of a chunk: to ask for it anew each time would cost more than to compute with it.

    What is taken within a `with` is free again after it.
    """

    def __init__(self, memory: Floats, cases: int) -> None:
        self._memory, self._cases, self._taken, self._marks = memory, cases, 0, list[int]()

    def __call__(self, rows: int) -> Floats:
        """Take some rows (rows, n)."""
        first, self._taken = self._taken, self._taken + rows * self._cases
        return self._memory[first : self._taken].reshape(rows, self._cases)

    def __enter__(self) -> None:
        self._marks.append(self._taken)

    def __exit__(self, *_: object) -> None:
        self._taken = self._marks.pop()


def _turned(posture: Floats, new: _Room) -> Floats:
    """1, cosine and sine of every angle: (4, 3, n) of postures (n, 4) [rad]."""
    # By the tangent of half the angle: cosine and sine by themselves would be a quarter of the whole time.
    out, tangent = new(12).reshape(4, 3, -1), new(4)
    one, cosine, sine = (out[:, i] for i in range(3))
    one[:] = 1.0
    np.tan(np.multiply(posture.T, 0.5, out=tangent), out=tangent)
    np.multiply(tangent, tangent, out=sine)
    sine += 1.0
    np.divide(2.0, sine, out=cosine)
    np.multiply(tangent, cosine, out=sine)
    cosine -= 1.0
    return out


def _parted(products: Floats, sine: Floats, new: _Room) -> Floats:
    """The same products (2 k, n) for extended joints, then for flexed ones, and zero for the others."""
    out, extended = new(2 * len(products)), new(1)
    extended[:] = sine < 0.0
    np.multiply(products, extended, out=out[: len(products)])
    np.subtract(products, out[: len(products)], out=out[len(products) :])
    return out


def _products(a: Floats, b: Floats, new: _Room) -> Floats:
    """Every product of rows (j, n) with rows (k, n): (j k, n)."""
    out = new(len(a) * len(b))
    np.multiply(a[:, None], b, out=out.reshape(len(a), len(b), -1))
    return out


def _cross(a: Floats, b: Floats, out: Floats, part: Floats) -> None:
    """Cross product (3, n) of vectors given as x y z x y."""
    np.multiply(a[1:4], b[2:5], out=out)
    np.multiply(a[2:5], b[1:4], out=part)
    out -= part


def _carried(vectors: Floats, axis: Floats) -> Floats:
    """Coefficients (3, …, 3) of 1, cosine and sine: vectors (…, 3) in the axes of the bone that turns about an axis."""
    along = (vectors @ axis)[..., None] * axis
    return np.stack([along, vectors - along, np.cross(vectors, axis)])


def _slope(coefficients: Floats, axis: int) -> Floats:
    """Coefficients of the derivative with respect to the angle whose 1, cosine and sine lie along an axis."""
    _, cosine, sine = np.moveaxis(coefficients, axis, 0)
    return np.stack([np.zeros_like(sine), sine, -cosine], axis=axis)


def _unturned(coefficients: Floats, axis: int) -> Floats:
    """The same with the angle at 0 whose 1, cosine and sine lie along an axis."""
    one, cosine, _ = np.moveaxis(coefficients, axis, 0)
    return np.stack([one + cosine, np.zeros_like(one), np.zeros_like(one)], axis=axis)


def _frame(axis: Floats) -> Floats:
    """Right-handed axes (3, 3), in rows, the last along a unit vector."""
    aside = np.cross(axis, UNIT[np.argmin(np.abs(axis))])
    aside /= np.linalg.norm(aside)
    return np.array([aside, np.cross(axis, aside), axis])


def _crossings(topology: Topology, values: FingerValues) -> tuple[list[_Crossing], list[int]]:
    """What crosses each joint, and the order in which segments are taken."""
    crossings, order, first = list[_Crossing](), list[int](), 0
    axes = np.asarray(values.axis)
    for joint, centre in zip(topology.joints, values.centre, strict=True):
        last = first + len(joint.rotations)
        own = [i for i, s in enumerate(topology.segments) if s.distal_bone == joint.child]
        # An anchor, and a point that is carried through the joint: (products of both rotations, segments, 3).
        anchor, point = values.distal_point[own], values.proximal_point[own] - centre
        carried = point
        for axis in axes[first:last]:
            carried = _carried(carried, axis)
        # The line's square is |point|2 + |anchor|2 - 2 `towards`, and the moment arm times its length a slope of that.
        towards = np.sum(carried * anchor, axis=-1)
        squared = -2.0 * towards
        squared[(0,) * (last - first)] += np.sum(point**2 + anchor**2, axis=-1)
        # The last rotation's cosine and sine lie along the first axis.
        rows = np.array([squared, *(_slope(towards, last - 1 - i) for i in range(first, last))])
        wraps = [topology.segments[i].wrap for i in own]
        flexion = None
        if joint.flexion >= 0 and any(wrap != "straight" for wrap in wraps):
            flexion = first + joint.flexion
            resting = [_unturned(row, last - 1 - flexion) for row in rows]
            if joint.flexion == 1:
                # The line keeps to the bone, but the axis of the rotation before turns with it as ever.
                pull = np.cross(anchor, _carried(point, axes[first]))
                resting[1] = np.tensordot(_carried(axes[first], axes[flexion]), pull, (1, 2))
            extended, flexed = (
                np.where(np.array(wraps) == f"landsmeer1_{side}", resting, rows) for side in ("palmar", "dorsal")
            )
            rows = np.stack([extended, flexed], axis=1)
        forms = np.moveaxis(rows, -1, 1).reshape(len(rows) * len(own), rows[0, ..., 0].size)
        crossings.append(_Crossing(slice(first, last), slice(len(order), len(order) + len(own)), flexion, forms))
        order += own
        first = last
    return crossings, order


def _motions(topology: Topology, values: FingerValues) -> list[Floats]:
    """Motion of the load point (…, 6) [mm/rad, rad/rad] for each rotation: products of those beyond it, last first."""
    begins = np.cumsum([0, *(len(joint.rotations) for joint in topology.joints)]).tolist()
    out, axes = [], np.asarray(values.axis)
    for k, axis in enumerate(axes):
        spin, move = axis, np.zeros(3)
        for i in range(k + 1, len(axes)):
            if i in begins:
                move = move + np.cross(spin, values.centre[begins.index(i)])
            spin, move = _carried(spin, axes[i]), _carried(move, axes[i])
        out.append(np.concatenate([move + np.cross(spin, values.load_point), spin], axis=-1))
    return out
