"""Mass and moments of inertia of a finger's segments: from a finger file, or from dimensions (Wu et al. 2008, Eqs 1–2).

A segment is soft tissue around a bone around a canal, each an elliptic cylinder about the same centre. The tissue
leaves out the bone and the canal is empty: of the combinations that the paper's wording allows, only this one gives its
Table 1b.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import PositiveFloat

from daq.documents import Document, read_document, validated
from daq.errors import ModelError
from daq.locations import data_dir
from fingermodel.fingers import Finger
from fingermodel.fingers.sourced import Sourced

WANTED = "a segments/1 file"
# A force of 1 N moves 1 t by 1 mm/s²: with masses in tonnes, mm and N fit together.
TONNE_PER_KG = 1e-3


class BodyInertia(NamedTuple):
    """Mass of one segment and its moments of inertia.

    Attributes:
        mass_kg: of the segment.
        moments_kg_mm2: (3,) about the centre of mass, along the bone's axes x, y, z.
    """

    mass_kg: float
    moments_kg_mm2: NDArray[np.float64]


class ChainInertia(NamedTuple):
    """Inertia of every moving bone, joints proximal to distal, in the units of the model.

    Attributes:
        mass: (joints,) [t], so that mass times mm/s² is N.
        centre: (joints, 3) centre of mass from the bone's own joint centre [mm].
        moments: (joints, 3) about the centre of mass along the bone's axes [t mm²], so that times rad/s² it is N mm.
    """

    mass: NDArray[np.float64]
    centre: NDArray[np.float64]
    moments: NDArray[np.float64]


@dataclass(frozen=True)
class EllipticCylinder:
    """A cylinder along x with half width along z, half depth along y, and length, all in mm."""

    half_width_mm: float
    half_depth_mm: float
    length_mm: float

    def inertia(self, density_kg_per_m3: float) -> BodyInertia:
        """Mass and moments about its centre at a density."""
        z, y, length = self.half_width_mm, self.half_depth_mm, self.length_mm
        mass = density_kg_per_m3 * 1e-9 * math.pi * z * y * length
        moments = mass * np.array([(y * y + z * z) / 4, z * z / 4 + length**2 / 12, y * y / 4 + length**2 / 12])
        return BodyInertia(mass, moments)


@dataclass(frozen=True)
class SegmentShape:
    """Tissue, bone and canal of one segment, with the densities of tissue and bone [kg/m³]."""

    bone: str
    tissue: EllipticCylinder
    cortex: EllipticCylinder
    canal: EllipticCylinder
    tissue_density: float
    bone_density: float

    def inertia(self) -> BodyInertia:
        """Superpose them: tissue without the bone's room, bone without the canal's."""
        parts = (
            self.tissue.inertia(self.tissue_density),
            self.cortex.inertia(self.bone_density - self.tissue_density),
            self.canal.inertia(-self.bone_density),
        )
        moments: NDArray[np.float64] = np.sum([p.moments_kg_mm2 for p in parts], axis=0)
        return BodyInertia(sum(p.mass_kg for p in parts), moments)


_Cylinder = tuple[PositiveFloat, PositiveFloat, PositiveFloat]


class _Density(Sourced):
    tissue: PositiveFloat
    bone: PositiveFloat


class _Segment(Sourced):
    bone: str
    cylinder_bone: _Cylinder
    canal: _Cylinder
    tissue: _Cylinder


class _SegmentsFile(Document):
    format: Literal["segments/1"]
    id: str
    title: str
    sources: dict[str, str]
    density_kg_per_m3: _Density
    segments: list[_Segment]


def read_segments(name_or_path: str) -> tuple[SegmentShape, ...]:
    """Read the shapes of a finger's segments by the name in `data/segments`, or from a file.

    Raises:
        ModelError: no such file, or one that does not meet the format.
    """
    path = Path(name_or_path)
    if not path.is_file():
        path = data_dir() / "segments" / f"{name_or_path}.yaml"
    if not path.is_file():
        known = sorted(p.stem for p in (data_dir() / "segments").glob("*.yaml"))
        raise ModelError(f"no segments {name_or_path!r}", f"a file, or one of {', '.join(known)}")
    raw = read_document(path, WANTED, ModelError)
    document = validated(_SegmentsFile, raw, path.name, WANTED, ModelError, "See data/README.md")
    density = document.density_kg_per_m3
    return tuple(
        SegmentShape(
            s.bone,
            EllipticCylinder(*s.tissue),
            EllipticCylinder(*s.cylinder_bone),
            EllipticCylinder(*s.canal),
            density.tissue,
            density.bone,
        )
        for s in document.segments
    )


def chain_inertia(finger: Finger) -> ChainInertia:
    """Inertia of a finger's moving bones, as its file has it.

    Raises:
        ModelError: the file says nothing of a moving bone's inertia.
    """
    blocks = {block["bone"]: block for block in finger.document.get("inertia") or ()}
    moving = [finger.topology.bones[joint.child] for joint in finger.topology.joints]
    missing = [bone for bone in moving if bone not in blocks]
    if missing:
        raise ModelError(
            f"finger {finger.id} has no inertia of {', '.join(missing)}",
            f"mass, centre and moments of {', '.join(moving)}",
            "Add an inertia block to the finger file, see docs/how-to/describe-a-finger.md",
        )
    return ChainInertia(
        TONNE_PER_KG * np.array([blocks[bone]["mass_kg"] for bone in moving], dtype=float),
        np.array([blocks[bone]["centre_mm"] for bone in moving], dtype=float),
        TONNE_PER_KG * np.array([blocks[bone]["principal_kg_mm2"] for bone in moving], dtype=float),
    )
