"""The schema of a finger file: its blocks, fields and units."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, PositiveFloat

from daq.documents import Document
from fingermodel.fingers.sourced import Sourced
from fingermodel.hood.files import ElasticHoodBlock, Fraction
from fingermodel.isometric.blocks import HeldPosture, Over, PassiveBlock, SurfaceBlock

Vector = tuple[float, float, float]


class _Length(Sourced):
    value_mm: float = Field(gt=0)


class _Rotation(Document):
    name: str
    axis: Vector
    flexion: bool = False


class _Joint(Sourced):
    name: str
    parent: str
    child: str
    centre: Vector
    """Joint centre from the parent bone's own joint centre, in length units."""
    distal_origin: float
    """How far the joint centre lies proximal of the origin in which this joint's distal points are printed."""
    rotations: list[_Rotation]


class _Segment(Sourced):
    slip: str
    joint: str
    proximal: Vector
    distal: Vector
    wrap: Literal["straight", "landsmeer1_dorsal", "landsmeer1_palmar"] = "straight"
    rests_at_deg: float | None = Field(default=None, ge=-180, le=180)
    """Flexion at which the line comes to rest on the bone; 0 by default, as in Landsmeer's first model."""
    proximal_bone: str | None = None
    distal_bone: str | None = None
    over: Over | None = None


class _Hood(Document):
    kind: Literal["winslow_rhombus"]
    radial: list[str]
    ulnar: list[str]
    extensors: list[str]
    partial: list[str] = Field(default_factory=list)
    central_slip: str
    radial_band: str
    ulnar_band: str
    terminal_slip: str
    fractions: dict[str, Fraction]


class _LoadPoint(Sourced):
    offset_mm: Vector
    """From the last joint's centre, in mm."""


class _Body(Sourced):
    bone: str
    mass_kg: float = Field(gt=0)
    centre_mm: Vector
    """Centre of mass from the bone's own joint centre."""
    principal_kg_mm2: tuple[PositiveFloat, PositiveFloat, PositiveFloat]
    """Moments of inertia about the centre of mass, along the bone's axes."""


class FingerFile(Document):
    """The schema of a finger file."""

    format: Literal["finger/1"]
    id: str
    title: str
    sources: dict[str, str]
    length_unit: _Length
    prior_width: float = Field(default=1.0, gt=0)
    bones: list[str]
    joints: list[_Joint]
    muscles: list[str]
    segments: list[_Segment]
    hood: Annotated[_Hood | ElasticHoodBlock, Field(discriminator="kind")] | None = None
    reactions: list[Literal["Fx", "Fy", "Fz", "Tx", "Ty", "Tz"]]
    load_point: _LoadPoint
    judged_in: Literal["sagittal", "space"] = "space"
    inertia: list[_Body] | None = None
    surfaces: list[SurfaceBlock] | None = None
    passive: list[PassiveBlock] | None = None
    heads: dict[str, list[str]] | None = None
    held: HeldPosture | None = None
