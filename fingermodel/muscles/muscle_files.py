"""Muscle parameter sets as files: `data/muscles/NAME.yaml`, format `muscles/1`."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields
from functools import reduce
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PositiveFloat, model_validator

from daq.documents import Document, read_document, validated
from daq.errors import ModelError
from daq.locations import data_dir
from fingermodel.fingers import Finger
from fingermodel.fingers.sourced import Sourced
from fingermodel.muscles.hill import CURVES, AnyMuscle3E, HillValues, Thelen2003, max_speed, slack_length

Floats = NDArray[np.float64]
WANTED = "a muscles/1 file"


class _Value(Sourced):
    value: PositiveFloat


class _Fraction(Sourced):
    value: float = Field(ge=0, le=1)


class _Curves(Sourced):
    kind: Literal["thelen2003", "wu2008"]
    tendon_strain: PositiveFloat | None = None
    tendon_shape: PositiveFloat | None = None
    passive_shape: PositiveFloat | None = None
    passive_length_factor: float | None = Field(default=None, gt=1)
    passive_strain: PositiveFloat | None = None
    speed_slow: PositiveFloat = 2.0
    speed_fast: PositiveFloat = 8.0


class _Calibration(Sourced):
    posture_deg: dict[str, float]


class _Muscle(Sourced):
    name: str
    pcsa_cm2: PositiveFloat
    fibre_mm: PositiveFloat
    pennation_deg: float = Field(ge=0, lt=60)
    fast_fraction: float | None = Field(default=None, ge=0, le=1)
    """Where it is not that of all."""
    passive_share: float = Field(default=1.0, ge=0, le=1)
    """Part of the fibres that has a parallel element."""
    path: list[str] | None = Field(default=None, min_length=2)
    """Points from insertion to origin: their distance in the calibration's posture gives the tendon's slack length."""
    slack_mm: PositiveFloat | None = None
    """The tendon's slack length, where no path does."""

    @model_validator(mode="after")
    def _one_of_them(self) -> _Muscle:
        if (self.path is None) == (self.slack_mm is None):
            raise ValueError(f"{self.name} has both path and slack_mm, or neither; one of them is wanted")
        return self


class MuscleFile(Document):
    """The schema of a muscle file."""

    format: Literal["muscles/1"]
    id: str
    title: str
    sources: dict[str, str]
    specific_tension_N_per_cm2: _Value
    fast_fraction: _Fraction
    curves: _Curves
    calibration: _Calibration
    muscles: list[_Muscle]


@dataclass(frozen=True, eq=False)
class MuscleSet:
    """The muscles of a finger, in the order of its topology.

    Attributes:
        id: of the file.
        curves: static.
        values: (muscles,) each; the slack lengths are calibrated to the finger.
        max_speed_mm_s: (muscles,) greatest shortening speed of the fibres.
        calibration: (rotations,) posture of the calibration [rad].
        length_mm: (muscles,) of muscle and tendon together in that posture, as far as the finger's points go.
    """

    id: str
    curves: Thelen2003 | AnyMuscle3E
    values: HillValues
    max_speed_mm_s: Floats
    calibration: Floats
    length_mm: Floats


def muscle_set_names() -> list[str]:
    """Names of the shipped muscle sets."""
    return sorted(p.stem for p in (data_dir() / "muscles").glob("*.yaml"))


def read_muscles(name_or_path: str | os.PathLike[str], finger: Finger) -> MuscleSet:
    """Read the muscles of a finger by their name in `data/muscles`, or from a file.

    Raises:
        ModelError: no such file, one that does not meet the format, or one that does not go with the finger.
    """
    text = os.fspath(name_or_path)
    path = Path(text)
    if not path.is_file():
        path = data_dir() / "muscles" / f"{text}.yaml"
        if Path(text).name != text or not path.is_file():
            raise ModelError(f"no muscles {text!r}", f"a file, or one of {', '.join(muscle_set_names())}")
    raw = read_document(path, WANTED, ModelError)
    document = validated(MuscleFile, raw, path.name, WANTED, ModelError, "See docs/how-to/work-out-a-movement.md")
    return _build(document, finger, path.name)


def _build(document: MuscleFile, finger: Finger, where: str) -> MuscleSet:
    topology = finger.topology
    by_name = {m.name: m for m in document.muscles}
    missing = [name for name in topology.muscles if name not in by_name]
    if missing:
        raise ModelError(
            f"{where} has no {', '.join(missing)}",
            f"the muscles of {finger.id}: {', '.join(topology.muscles)}",
        )
    blocks = [document.specific_tension_N_per_cm2, document.fast_fraction, document.curves, document.calibration]
    for block in (*blocks, *document.muscles):
        if block.source not in document.sources:
            raise ModelError(f"{where}: source {block.source!r} is not listed", f"{sorted(document.sources)}")
    angles = document.calibration.posture_deg
    if set(angles) != set(topology.rotations):
        raise ModelError(f"{where}: calibration of {', '.join(angles)}", f"angles of {', '.join(topology.rotations)}")
    posture = np.deg2rad([angles[name] for name in topology.rotations])
    chosen = [by_name[name] for name in topology.muscles]
    curves = _curves(document.curves, where)
    fibre = np.array([m.fibre_mm for m in chosen])
    force = document.specific_tension_N_per_cm2.value * np.array([m.pcsa_cm2 for m in chosen])
    share = np.array([m.passive_share for m in chosen])
    pennation = np.deg2rad([m.pennation_deg for m in chosen])
    places = _points(finger, posture)
    length = np.array([_path_length(places, m, curves, finger.id, where) for m in chosen])
    slack = slack_length(curves, fibre * np.cos(pennation), length)
    short = [name for name, s in zip(topology.muscles, slack, strict=True) if s <= 0.0]
    if short:
        raise ModelError(
            f"{where}: the path of {', '.join(short)} is shorter than its fibres",
            "a path with room for a tendon",
            "Give slack_mm in its place",
        )
    fast = [document.fast_fraction.value if m.fast_fraction is None else m.fast_fraction for m in chosen]
    speed = max_speed(fibre, np.array(fast), document.curves.speed_slow, document.curves.speed_fast)
    values = HillValues(force, fibre, pennation, slack, share)
    return MuscleSet(document.id, curves, values, speed, posture, length)


def _curves(block: _Curves, where: str) -> Thelen2003 | AnyMuscle3E:
    of_all = {*Sourced.model_fields, "kind", "speed_slow", "speed_fast"}
    given: dict[str, Any] = block.model_dump(exclude_none=True, exclude=of_all)
    if "passive_length_factor" in given:
        given["passive_length"] = given.pop("passive_length_factor")
    known = CURVES[block.kind]
    own = {f.name for f in fields(known)}
    if unknown := sorted(set(given) - own):
        names = ", ".join(unknown).replace("passive_length", "passive_length_factor")
        raise ModelError(f"{where}: curves of kind {block.kind} have no {names}", "numbers of that kind's curves")
    return known(**given)


def _points(finger: Finger, posture: Floats) -> dict[str, Floats]:
    """Where every end of every segment is in a posture [mm], in the first bone's frame, as JOINT.SLIP.distal."""
    from scipy.spatial.transform import Rotation

    topology, values = finger.topology, finger.values
    rotation, origin = [np.eye(3)], [np.zeros(3)]
    turns = Rotation.from_rotvec(posture[:, None] * np.asarray(values.axis)).as_matrix()
    first = 0
    # Not by `joint_poses`: outside a compiled program its many small steps would take seconds.
    for joint, centre in zip(topology.joints, values.centre, strict=True):
        last = first + len(joint.rotations)
        origin.append(origin[-1] + rotation[-1] @ np.asarray(centre))
        rotation.append(reduce(np.matmul, turns[first:last], rotation[-1]))
        first = last
    places: dict[str, Floats] = {}
    for i, segment in enumerate(topology.segments):
        for end, bone, points in (
            ("proximal", segment.proximal_bone, values.proximal_point),
            ("distal", segment.distal_bone, values.distal_point),
        ):
            places[f"{segment.name}.{end}"] = origin[bone] + rotation[bone] @ np.asarray(points[i])
    return places


def _path_length(
    places: dict[str, Floats], muscle: _Muscle, curves: Thelen2003 | AnyMuscle3E, finger: str, where: str
) -> float:
    """Length of muscle and tendon in the calibration's posture [mm]: from point to point, or from the slack length."""
    if muscle.path is None:
        assert muscle.slack_mm is not None  # noqa: S101 - the schema has looked
        along = muscle.fibre_mm * float(np.cos(np.deg2rad(muscle.pennation_deg)))
        return along + muscle.slack_mm * (1.0 + curves.tendon_strain)
    for name in muscle.path:
        if name not in places:
            raise ModelError(f"{where}: no point {name!r}", f"JOINT.SLIP.proximal or .distal of a segment of {finger}")
    line = np.diff([places[name] for name in muscle.path], axis=0)
    return float(np.linalg.norm(line, axis=1).sum())
