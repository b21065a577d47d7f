"""Recorded movements as files, format `motion/1`: joint angles and a tip force over time, and their derivatives.

Angles become a spline or a polynomial, so that rates and accelerations come from one curve. The tip force needs no
derivative and may rise within a sample, so it has a monotone curve, or straight lines, between its samples.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from daq.documents import Document, read_document, validated
from daq.errors import ModelError
from daq.locations import data_dir
from fingermodel.dynamics.inverse import Movement
from fingermodel.fingers import Topology
from fingermodel.fingers.sourced import Sourced

Floats = NDArray[np.float64]
WANTED = "a motion/1 file"
_Vector = tuple[float, float, float]
_AXES = ("Fx_N", "Fy_N", "Fz_N")


class _Spline(Document):
    kind: Literal["spline"]
    degree: Literal[3, 5] = 3


class _Polynomial(Document):
    kind: Literal["polynomial"]
    degree: Annotated[int, Field(ge=1, le=12)]


class _Between(Document):
    kind: Literal["monotone", "linear"]


class _Angles(Sourced):
    unit: Literal["rad", "deg"]
    curve: Annotated[_Spline | _Polynomial, Field(discriminator="kind")]
    times_s: list[float]
    rotations: dict[str, list[float] | float]
    """Flexion positive; a single number holds all the time."""


class _TipForce(Sourced):
    curve: _Between = _Between(kind="monotone")
    times_s: list[float]
    components: dict[Literal["Fx_N", "Fy_N", "Fz_N"], list[float]]
    """On the finger, in the axes of the first bone; what is not given is zero."""


class _SourcedVector(Sourced):
    vector: _Vector


class _Span(Sourced):
    vector: tuple[float, float]


class MotionFile(Document):
    """The schema of a motion file."""

    format: Literal["motion/1"]
    id: str
    title: str
    sources: dict[str, str]
    angles: _Angles
    tip_force: _TipForce | None = None
    gravity_mm_s2: _SourcedVector | None = None
    span_s: _Span | None = None


@dataclass(frozen=True, eq=False)
class Motion:
    """A recorded movement.

    Attributes:
        id: name.
        title: what it is.
        span_s: first and last time at which it is known.
        gravity_mm_s2: (3,) in the axes of the first bone; zero where the file is silent.
        document: the file's contents.
    """

    id: str
    title: str
    span_s: tuple[float, float]
    gravity_mm_s2: Floats
    document: MotionFile

    def times(self, steps: int) -> Floats:
        """So many instants, evenly from the first to the last."""
        return np.linspace(*self.span_s, steps)

    def sample(self, topology: Topology, times_s: Floats, *, curve: tuple[str, int] | None = None) -> Movement:
        """Posture, rates, accelerations and tip force of a finger at the given times (n,).

        Args:
            topology: of the finger; every rotation must be in the file.
            times_s: within the span.
            curve: `("spline", 3)`, `("polynomial", 4)`, …: through the angles, in place of the file's own.

        Raises:
            ModelError: a rotation that the file or the finger lacks, or a time outside the span.
        """
        self._require(topology, times_s)
        angles = self.document.angles
        samples = np.asarray(angles.times_s)
        kind, degree = curve or (angles.curve.kind, angles.curve.degree)
        per_unit = math.pi / 180.0 if angles.unit == "deg" else 1.0
        columns = []
        for name in topology.rotations:
            value = angles.rotations[name]
            if isinstance(value, list):
                columns.append(per_unit * _derivatives(samples, np.asarray(value), times_s, kind, degree))
            else:
                columns.append(per_unit * np.array([[value], [0.0], [0.0]]) * np.ones_like(times_s))
        posture, rate, acceleration = np.stack(columns, axis=-1)
        return Movement(posture, rate, acceleration, self._tip_force(times_s))  # type: ignore[arg-type]

    def _require(self, topology: Topology, times_s: Floats) -> None:
        given = set(self.document.angles.rotations)
        missing = [name for name in topology.rotations if name not in given]
        if missing:
            raise ModelError(
                f"motion {self.id} has no angles of {', '.join(missing)}",
                f"angles of {', '.join(topology.rotations)}",
                "Give a number that holds all the time where a joint stands still",
            )
        unknown = sorted(given - set(topology.rotations))
        if unknown:
            raise ModelError(
                f"motion {self.id} has angles of {', '.join(unknown)}",
                f"those of the finger: {', '.join(topology.rotations)}",
            )
        low, high = self.span_s
        if len(times_s) and (times_s.min() < low - 1e-12 or times_s.max() > high + 1e-12):
            raise ModelError(f"times from {times_s.min():g} to {times_s.max():g} s", f"between {low:g} and {high:g} s")

    def _tip_force(self, times_s: Floats) -> Floats:
        out = np.zeros((len(times_s), 3))
        block = self.document.tip_force
        if block is None:
            return out
        samples = np.asarray(block.times_s)
        for name, column in block.components.items():
            values = np.asarray(column)
            if block.curve.kind == "linear" or len(samples) < 3:
                force = np.interp(times_s, samples, values)
            else:
                from scipy.interpolate import PchipInterpolator

                held = np.clip(times_s, samples[0], samples[-1])
                force = PchipInterpolator(samples, values)(held)
            # Before the first sample and after the last one nothing was measured.
            out[:, _AXES.index(name)] = np.where((times_s < samples[0]) | (times_s > samples[-1]), 0.0, force)
        return out


def motion_names() -> list[str]:
    """Names of the shipped movements."""
    return sorted(p.stem for p in (data_dir() / "motions").glob("*.yaml"))


def read_motion(name_or_path: str | os.PathLike[str]) -> Motion:
    """Read a movement by its name in `data/motions`, or from a file.

    Raises:
        ModelError: no such movement, or a file that does not meet the format.
    """
    text = os.fspath(name_or_path)
    path = Path(text)
    if not path.is_file():
        path = data_dir() / "motions" / f"{text}.yaml"
        if Path(text).name != text or not path.is_file():
            raise ModelError(f"no motion {text!r}", f"a file, or one of {', '.join(motion_names())}")
    return motion_from_dict(read_document(path, WANTED, ModelError), path.name)


def motion_from_dict(raw: Any, where: str) -> Motion:
    """Build a movement from the contents of a motion file; `where` names it in errors.

    Raises:
        ModelError: it does not meet the format.
    """
    document = validated(MotionFile, raw, where, WANTED, ModelError, "See docs/how-to/work-out-a-movement.md")
    _check(document, where)
    times = document.angles.times_s
    span = document.span_s.vector if document.span_s else (times[0], times[-1])
    gravity = document.gravity_mm_s2.vector if document.gravity_mm_s2 else (0.0, 0.0, 0.0)
    return Motion(document.id, document.title, span, np.array(gravity), document)


def _check(document: MotionFile, where: str) -> None:
    def need(ok: bool, found: str, expected: str) -> None:
        if not ok:
            raise ModelError(f"{where}: {found}", expected)

    angles, force = document.angles, document.tip_force
    columns = {name: v for name, v in angles.rotations.items() if isinstance(v, list)}
    _increasing(angles.times_s, "angles.times_s", where)
    for name, column in columns.items():
        found = f"{len(column)} angles of {name} at {len(angles.times_s)} times"
        need(len(column) == len(angles.times_s), found, "as many angles as times")
    least = angles.curve.degree + 1
    found = f"{len(angles.times_s)} times for a curve of degree {angles.curve.degree}"
    need(len(angles.times_s) >= least or not columns, found, f"at least {least}")
    most = 2.0 * math.pi if angles.unit == "rad" else 360.0
    for name, value in angles.rotations.items():
        size = float(np.max(np.abs(value)))
        need(size <= most, f"an angle of {name} of {size:g} {angles.unit}", f"at most a turn; unit is {angles.unit}")
    if force is not None:
        _increasing(force.times_s, "tip_force.times_s", where)
        for axis, column in force.components.items():
            found = f"{len(column)} values of {axis} at {len(force.times_s)} times"
            need(len(column) == len(force.times_s), found, "as many values as times")
    if document.span_s is not None:
        low, high = document.span_s.vector
        first, last = angles.times_s[0], angles.times_s[-1]
        need(first <= low < high <= last, f"span_s from {low:g} to {high:g} s", f"within {first:g} to {last:g} s")
    blocks = [b for b in (angles, force, document.gravity_mm_s2, document.span_s) if b is not None]
    for block in blocks:
        need(block.source in document.sources, f"source {block.source!r} is not listed", f"{sorted(document.sources)}")


def _increasing(times: list[float], name: str, where: str) -> None:
    if len(times) < 2:
        raise ModelError(f"{where}: {len(times)} times in {name}", "at least two")
    for i, (a, b) in enumerate(pairwise(times)):
        if b <= a:
            raise ModelError(f"{where}: {name} goes from {a:g} to {b:g} s at entry {i + 2}", "increasing times")


def _derivatives(samples: Floats, values: Floats, times: Floats, kind: str, degree: int) -> Floats:
    """(3, n) angle, rate and acceleration of the curve through the samples."""
    if kind == "polynomial":
        fitted = np.polynomial.Polynomial.fit(samples, values, degree)
        return np.stack([fitted(times), fitted.deriv(1)(times), fitted.deriv(2)(times)])
    from scipy.interpolate import make_interp_spline

    spline = make_interp_spline(samples, values, k=degree)
    return np.stack([spline(times), spline(times, 1), spline(times, 2)])
