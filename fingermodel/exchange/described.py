"""A finger as other software describes it: bodies, hinges, tendon paths and wraps; and a finger that was read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fingermodel.fingers import Finger

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Hinge:
    """A rotation about an axis (3,) in the parent body's axes at zero angles."""

    name: str
    axis: Floats


@dataclass(frozen=True)
class Link:
    """How a body hangs on its parent.

    Attributes:
        body: its name.
        parent: name of the body that carries it.
        joint: name of the joint.
        hinges: from parent to body; none where they are welded.
        turn: (3, 3) takes the body's components to the parent's at zero angles.
        in_parent: (3,) joint centre in the parent [mm].
        in_body: (3,) the same point in the body [mm].
    """

    body: str
    parent: str
    joint: str
    hinges: tuple[Hinge, ...]
    turn: Floats
    in_parent: Floats
    in_body: Floats


@dataclass(frozen=True)
class Point:
    """A point (3,) of a body [mm]."""

    body: str
    place: Floats


@dataclass(frozen=True)
class Cylinder:
    """A wrapping cylinder on a body.

    Attributes:
        body: that carries it.
        place: (3,) a point of its axis [mm].
        axis: (3,) unit vector, body's axes.
        radius: [mm].
        side: (3,) from the axis to where a path has to pass, body's axes; None where the shorter way is taken.
    """

    body: str
    place: Floats
    axis: Floats
    radius: float
    side: Floats | None = None


@dataclass(frozen=True)
class Obstacle:
    """A wrapping shape that is no cylinder, or a place that no cylinder tells, in words."""

    what: str


@dataclass(frozen=True)
class Piece:
    """A stretch of tendon between two points, in the order of the file, with what it may wrap on.

    `wrap` is Landsmeer's rule where the file states it otherwise than by a shape, `rests_at` its angle [rad].
    """

    slip: str
    ends: tuple[Point, Point]
    on: tuple[Cylinder | Obstacle, ...] = ()
    wrap: str = "straight"
    rests_at: float = 0.0


@dataclass(frozen=True)
class Described:
    """What a file says of a finger.

    Attributes:
        name: of the model.
        base: name of the body that does not move.
        links: parents before children.
        pieces: of the tendons.
        load_point: where the clamp holds the last bone; None where the file does not say.
        about: what fingertwin wrote into it; empty where another program made the file.
        notes: what was left out, one line each.
    """

    name: str
    base: str
    links: tuple[Link, ...]
    pieces: tuple[Piece, ...]
    load_point: Point | None
    about: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class EngineCheck:
    """Moment arms held against an engine's.

    Attributes:
        engine: its name and version.
        worst_mm: greatest error of each tendon's moment arms [mm].
        postures: how many were compared, drawn at random and along each angle.
        between: of which angles, in words.
    """

    engine: str
    worst_mm: Mapping[str, float]
    postures: int
    between: str


@dataclass(frozen=True)
class Imported:
    """A finger that was read.

    Attributes:
        document: contents of its finger file.
        finger: that they make.
        notes: what the reader should know, one line each.
        read: what was read of the file, in words.
        ours: fingertwin had written the file.
        check: its moment arms against the engine's; None where the engine is not installed.
    """

    document: dict[str, Any]
    finger: Finger
    notes: tuple[str, ...]
    read: str = ""
    ours: bool = False
    check: EngineCheck | None = None
