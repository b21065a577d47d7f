"""Length and moment arms of a resting tendon as formulas of the joint angles, for OpenSim's `FunctionBasedPath`.

A point turned about axes is a sum of products of cosines and sines of the angles, and so are a squared length and the
moments of a line about axes. An angle that the tendon does not feel where it rests stands as `min(q, 0)` (dorsal) or
`max(q, 0)` (palmar) in its line, with another number where it comes to rest there, and as itself in the axes that it
turns about.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fingermodel.fingers import Finger, Segment

Floats = NDArray[np.float64]
# Names of cosines and sines that are multiplied, to the factor before them.
Sum = dict[tuple[str, ...], float]
Vector = tuple[Sum, Sum, Sum]
_ROUNDING = 1e-14


@dataclass(frozen=True)
class PathFormulas:
    """Of one segment, in terms of q1, q2, … [rad].

    Attributes:
        rotations: names of the angles, in the order of q1, q2, ….
        length: formula [m]. A line that rests on a joint with several axes has no length of which all its moment arms
            were the slopes; about flexion they are.
        moment_arms: formula of the moment arm about each angle [m], flexion positive.
    """

    rotations: tuple[str, ...]
    length: str
    moment_arms: tuple[str, ...]


@dataclass(frozen=True)
class _Turn:
    joint: int
    axis: Floats
    number: int
    wrap: str
    rests_at: float

    @property
    def felt(self) -> str:
        """The angle as the line of the tendon feels it."""
        short = {"landsmeer1_dorsal": "min(q{}, {:.17g})", "landsmeer1_palmar": "max(q{}, {:.17g})"}
        return short.get(self.wrap, "q{}").format(self.number, self.rests_at)


def path_formulas(finger: Finger, index: int, metres: float) -> PathFormulas:
    """Write one segment's length and moment arms as formulas; `metres` is our unit of length."""
    turns, names, squared, arms = _sums(finger, index, metres)
    resting = [t for t in turns if t.felt != f"q{t.number}"]
    known = [f"line = sqrt({_text(squared)})", *(d for t in turns for d in _definitions(t))]
    grown = "".join(f" - (q{t.number} - {t.felt})*({_text(arms[t.number - 1])})/line" for t in resting)
    formulas = tuple("; ".join([f"({_text(arm)})/line", *known]) for arm in arms)
    return PathFormulas(tuple(names), "; ".join([f"line{grown}", *known]), formulas)


def formula_arms(finger: Finger, postures: Floats) -> Floats:
    """Moment arms [mm] in postures (n, rotations) [rad], without compiling: (n, rotations, segments)."""
    topology = finger.topology
    out = np.zeros((*postures.shape, len(topology.segments)))
    for index in range(len(topology.segments)):
        turns, names, squared, arms = _sums(finger, index, 1.0)
        factors: dict[str, Floats] = {}
        for turn, name in zip(turns, names, strict=True):
            angle = postures[:, topology.rotations.index(name)]
            short = {"landsmeer1_dorsal": np.minimum, "landsmeer1_palmar": np.maximum}.get(turn.wrap)
            felt = angle if short is None else short(angle, turn.rests_at)
            factors |= {f"c{turn.number}": np.cos(angle), f"s{turn.number}": np.sin(angle)}
            factors |= {f"d{turn.number}": np.cos(felt), f"t{turn.number}": np.sin(felt)}
        line = np.sqrt(_value(squared, factors, len(postures)))
        for name, arm in zip(names, arms, strict=True):
            out[:, topology.rotations.index(name), index] = _value(arm, factors, len(postures)) / line
    return out


def _value(one: Sum, factors: Mapping[str, Floats], count: int) -> Floats:
    """A sum's value for every posture (count,)."""
    out = np.zeros(count)
    for names, factor in one.items():
        out += factor * np.prod([factors[name] for name in names], axis=0)
    return out


def _sums(finger: Finger, index: int, metres: float) -> tuple[list[_Turn], list[str], Sum, list[Sum]]:
    """A segment's turns and their names, its squared length, and its moment arms times its length."""
    topology, values = finger.topology, finger.values
    segment = topology.segments[index]
    crossed = [i for i, j in enumerate(topology.joints) if segment.proximal_bone < j.child <= segment.distal_bone]
    centres = {i: np.asarray(values.centre)[i] * metres for i in crossed}
    turns, names = _turns(finger, crossed, segment)
    anchor = np.asarray(values.distal_point)[index] * metres
    proximal = np.asarray(values.proximal_point)[index] * metres
    # Everything in the distal bone's frame.
    line = _plus(_carried(_constant(proximal), crossed, turns, centres, felt=True), _constant(-anchor))
    squared = _added(_times(x, x) for x in line)
    arms = []
    for at, turn in enumerate(turns):
        beyond = [j for j in crossed if j > turn.joint]
        lever = _scaled(_carried(_constant(np.zeros(3)), beyond, turns, centres, felt=False), -1.0)
        axis = _constant(turn.axis)
        for later in turns[at + 1 :]:
            axis = _turned(axis, later.axis, f"c{later.number}", f"s{later.number}")
        moment = _cross(_plus(lever, _constant(anchor)), line)
        arms.append(_added(_times(a, b) for a, b in zip(axis, moment, strict=True)))
    return turns, names, squared, arms


def _turns(finger: Finger, crossed: Sequence[int], segment: Segment) -> tuple[list[_Turn], list[str]]:
    topology, axes = finger.topology, np.asarray(finger.values.axis)
    turns: list[_Turn] = []
    names: list[str] = []
    for joint in crossed:
        first = sum(len(j.rotations) for j in topology.joints[:joint])
        for i, name in enumerate(topology.joints[joint].rotations):
            names.append(name)
            felt = segment.wrap if i == topology.joints[joint].flexion else "straight"
            turns.append(_Turn(joint, axes[first + i], len(names), felt, segment.rests_at))
    return turns, names


def _definitions(turn: _Turn) -> list[str]:
    n = turn.number
    own = [f"c{n} = cos(q{n})", f"s{n} = sin(q{n})"]
    return own if turn.felt == f"q{n}" else [*own, f"d{n} = cos({turn.felt})", f"t{n} = sin({turn.felt})"]


def _carried(
    point: Vector, joints: Sequence[int], turns: Sequence[_Turn], centres: dict[int, Floats], felt: bool
) -> Vector:
    """A point of the first joint's parent bone, as the last joint's child sees it."""
    for joint in joints:
        point = _plus(point, _constant(-centres[joint]))
        for turn in turns:
            if turn.joint == joint:
                cosine, sine = ("d", "t") if felt and turn.felt != f"q{turn.number}" else ("c", "s")
                point = _turned(point, turn.axis, f"{cosine}{turn.number}", f"{sine}{turn.number}")
    return point


def _turned(vector: Vector, axis: Floats, cosine: str, sine: str) -> Vector:
    """Turn back about an axis (Rodrigues)."""
    c: Sum = {(cosine,): 1.0}
    s: Sum = {(sine,): -1.0}
    rest: Sum = {(): 1.0, (cosine,): -1.0}
    unit = _constant(axis)
    along = _times(_added(_times(a, b) for a, b in zip(unit, vector, strict=True)), rest)
    around = _cross(unit, vector)
    parts = [
        _added((_times(v, c), _times(a, s), _times(u, along))) for v, a, u in zip(vector, around, unit, strict=True)
    ]
    return (parts[0], parts[1], parts[2])


def _constant(vector: Floats) -> Vector:
    parts: list[Sum] = [{(): float(v)} if v != 0.0 else {} for v in vector]
    return (parts[0], parts[1], parts[2])


def _plus(a: Vector, b: Vector) -> Vector:
    return (_added((a[0], b[0])), _added((a[1], b[1])), _added((a[2], b[2])))


def _scaled(vector: Vector, factor: float) -> Vector:
    x, y, z = ({k: v * factor for k, v in part.items()} for part in vector)
    return (x, y, z)


def _cross(a: Vector, b: Vector) -> Vector:
    def part(i: int, j: int) -> Sum:
        return _added((_times(a[i], b[j]), _times(_scaled(a, -1.0)[j], b[i])))

    return (part(1, 2), part(2, 0), part(0, 1))


def _added(sums: Iterable[Sum]) -> Sum:
    out: Sum = {}
    for one in sums:
        for key, factor in one.items():
            out[key] = out.get(key, 0.0) + factor
    return {key: factor for key, factor in out.items() if factor != 0.0}


def _times(a: Sum, b: Sum) -> Sum:
    return _added({tuple(sorted(k + m)): x * y} for k, x in a.items() for m, y in b.items())


def _text(one: Sum) -> str:
    # What is left of terms that cancel is rounding.
    least = _ROUNDING * max((abs(factor) for factor in one.values()), default=0.0)
    terms = [(key, factor) for key, factor in sorted(one.items()) if abs(factor) > least]
    return " + ".join("*".join((f"({factor!r})", *key)) for key, factor in terms) or "0"
