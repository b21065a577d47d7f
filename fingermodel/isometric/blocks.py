"""Blocks of a finger file for isometric equilibrium: wrapping surfaces, passive joint torques, heads of muscles."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, PositiveFloat

from daq.documents import Document
from fingermodel.fingers.sourced import Sourced

Side = Literal["dorsal", "palmar", "radial", "ulnar"]


class Over(Document):
    """The surface that a piece of tendon runs over, and on which side of it."""

    surface: str
    side: Side


class SurfaceBlock(Sourced):
    """A cylinder on a bone."""

    name: str
    bone: str
    kind: Literal["cylinder"]
    centre: tuple[float, float, float]
    """A point of its axis, from the bone's own joint centre, in length units."""
    axis: tuple[float, float, float]
    radius: PositiveFloat
    """In length units."""


class LinearPassive(Sourced):
    """A torque that pulls an angle to its rest: -stiffness × (angle - rest)."""

    rotation: str
    kind: Literal["linear"]
    stiffness_Nmm_per_rad: float = Field(ge=0)
    rest_deg: float = 0.0


class ExponentialPassive(Sourced):
    """Exponentials less one: one resists extension below its angle (positive), the other flexion above its angle."""

    rotation: str
    kind: Literal["double_exponential"]
    extension_Nmm: float = Field(ge=0)
    extension_per_rad: PositiveFloat
    extension_from_deg: float
    flexion_Nmm: float = Field(ge=0)
    flexion_per_rad: PositiveFloat
    flexion_from_deg: float


class HeldPosture(Sourced):
    """The posture in which the finger is held unless another is asked for."""

    posture_deg: dict[str, float]


PassiveBlock = Annotated[LinearPassive | ExponentialPassive, Field(discriminator="kind")]
