"""Blocks of a finger file for isometric equilibrium: wrapping surfaces, passive joint torques, heads of muscles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, PositiveFloat

from daq.documents import Document
from daq.errors import ModelError
from fingermodel.sourced import Sourced

if TYPE_CHECKING:
    from fingermodel.finger_files import FingerFile

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


def check_blocks(document: FingerFile, where: str) -> list[Sourced]:
    """Check the names in these blocks of a finger file; return the blocks that name a source.

    Raises:
        ModelError: a name that is not known, or one given twice.
    """
    surfaces, passive = list(document.surfaces or []), list(document.passive or [])
    bones = {s.name: s.bone for s in surfaces}
    joints = {j.name: j for j in document.joints}
    _once(where, "surface", [s.name for s in surfaces])
    for surface in surfaces:
        _known(where, f"surface {surface.name} is on", surface.bone, document.bones)
        if not any(surface.axis):
            raise ModelError(f"{where}: surface {surface.name} has an axis of no length", "a direction")
    for segment in document.segments:
        if segment.over is None:
            continue
        name, joint = f"{segment.joint}.{segment.slip}", joints[segment.joint]
        _known(where, f"segment {name} runs over", segment.over.surface, bones)
        if (segment.proximal_bone or joint.parent, segment.distal_bone or joint.child) != (joint.parent, joint.child):
            raise ModelError(f"{where}: segment {name} runs over a surface and several joints", "one joint")
        _known(where, f"the surface of {name} is on", bones[segment.over.surface], [joint.parent, joint.child])
    rotations = [r.name for j in document.joints for r in j.rotations]
    for block in passive:
        _known(where, "a passive torque acts on", block.rotation, rotations)
    _once(where, "passive torque on", [b.rotation for b in passive])
    _check_heads(where, document.heads or {}, document.muscles)
    held = [document.held] if document.held else []
    for posture in held:
        for name in posture.posture_deg:
            _known(where, "the posture held names", name, rotations)
    return [*surfaces, *passive, *held]


def _check_heads(where: str, heads: Mapping[str, Sequence[str]], muscles: Sequence[str]) -> None:
    for name, members in heads.items():
        if name in muscles or not members:
            raise ModelError(f"{where}: heads of {name!r}", "another name than a muscle's, with one head at least")
        for muscle in members:
            _known(where, f"a head of {name} is", muscle, muscles)
    _once(where, "head", [muscle for members in heads.values() for muscle in members])


def _known(where: str, what: str, name: str, known: Mapping[str, object] | Sequence[str]) -> None:
    if name not in known:
        raise ModelError(f"{where}: {what} {name!r}", f"one of {', '.join(known) or 'none, as there are none'}")


def _once(where: str, what: str, names: Sequence[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise ModelError(f"{where}: {what} {name!r}, {names.count(name)} times", "once")
