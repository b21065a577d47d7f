"""Fingers: a finger's numbers, the schema of its file (`finger/1`), and reading and writing it.

It imports `daq`'s documents, and the schemas of hood and muscle blocks; it knows no force.
"""

from __future__ import annotations

from fingermodel.fingers.finger import (
    COMPONENTS,
    PLANES,
    WRAPS,
    Array,
    Finger,
    FingerValues,
    FractionPrior,
    Hood,
    Joint,
    Plane,
    Segment,
    Topology,
    require_plane,
)

__all__ = [
    "COMPONENTS",
    "PLANES",
    "WRAPS",
    "Array",
    "Finger",
    "FingerValues",
    "FractionPrior",
    "Hood",
    "Joint",
    "Plane",
    "Segment",
    "Topology",
    "require_plane",
]
