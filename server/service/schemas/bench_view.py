"""Forms of how a bench stands, and of the finger as it is held there."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from server.service.schemas.common import Answered, Shown, Vector

Six = Annotated[list[float], Field(min_length=6, max_length=6)]
Matrix = Annotated[list[Vector], Field(min_length=3, max_length=3)]
Point = Annotated[list[float], Field(min_length=2, max_length=2)]
Line = list[Point]


class CellShown(Shown):
    """The load cell of a bench."""

    model: str | None
    serial: str | None
    calibration: str | None
    range: Six | None = Field(description="Full scale: Fx Fy Fz [N], Tx Ty Tz [N mm]; null where it is not known.")


class BenchStep(Shown):
    """A step of a bench's protocol with what hangs in it; all of that is null for a known weight on the cell itself."""

    id: str
    text: str = Field(description="What is hung where.")
    state: str = Field(description="done, excluded, skipped, open, or proposed by what would tell explanations apart.")
    role: str | None
    posture: str | None
    location: str | None
    masses_g: dict[str, float] | None = Field(description="Weight hung on each tendon [g].")
    repeat_of: str | None = None
    note: str | None = None
    when: str | None = Field(None, description="Of a known weight: before, during or after the cases.")


class TareShown(Shown):
    """The tare in force."""

    window_s: Annotated[list[float], Field(min_length=2, max_length=2, description="First and last time [s].")]
    mean: Six | None = Field(description="Fx Fy Fz [N], Tx Ty Tz [N mm] in the cell's axes; null until it has come.")
    sd: Six | None = Field(description="Standard uncertainty of the mean [N, N mm].")
    stale_after_s: float = Field(description="Older than this it is worth another [s].")


class DriftShown(Shown):
    """Drift of the zero between the last two tares of one setting."""

    over_s: float = Field(description="Time between the two [s].")
    change: Six = Field(description="Fx Fy Fz [N], Tx Ty Tz [N mm] in the cell's axes.")
    force_N: float
    moment_Nmm: float


class StreamShown(Shown):
    """History of the load cell's stream: gaps, losses, overloads."""

    id: str | None
    state: Literal["waiting", "streaming", "silent", "lost", "ended"] = Field(description="lost: the cable is out.")
    why: str
    since_s: float | None = Field(description="Time of the stream when that began [s].")
    gaps: int
    lost_samples: int = Field(description="Readings that nobody got, by the cell's count or by their times.")
    overloads: int = Field(description="How often the load was beyond the cell's range.")
    damaged: int = Field(description="Records that made no sense.")
    overloaded: bool = Field(description="Whether the load is beyond the cell's range now.")
    last_gap_s: float | None = None


class WarningShown(Shown):
    """Something that is wrong now."""

    code: str
    title: str
    text: str = Field(description="What was found.")
    to_do: str = Field(description="What to do about it, while the weight still hangs.")
    at_s: float


class BenchShown(Answered):
    """State of a bench."""

    session: str
    version: int = Field(description="Of the session: raised by every change.")
    begun: bool = Field(description="Whether a bench has sent its record; else the steps are the session's cases.")
    closed: bool
    problem: str | None = Field(description="Why the bench's record cannot be used, where it cannot.")
    has_readings: bool = Field(description="Whether the session has a stream of readings.")
    finger: str | None
    cell: CellShown
    steps: list[BenchStep] = Field(description="In order; what no protocol has stands at the end.")
    now: str | None = Field(description="Id of the present step.")
    phase: Literal["idle", "unloaded", "loaded"] = Field(description="Which plateau is looked for.")
    offered: bool = Field(description="Whether a plateau was found and waits to be confirmed.")
    todo: str | None = Field(description="What to do now.")
    place: dict[str, str] | None = Field(description="Posture and location that the bench is in.")
    tare: TareShown | None = Field(description="Null where none is in force.")
    drift: DriftShown | None = Field(description="Null where the last two tares are of different settings.")
    stream: StreamShown | None
    warnings: list[WarningShown] = Field(description="That stand now; each goes with its cause.")
    control: dict[str, Any] | None = Field(
        description="What the bench can be asked for, as the live stream's `bench` messages say; null without a bench."
    )


class JointDrawn(Shown):
    """A joint's centre on the paper."""

    joint: str
    at_mm: Point


class TendonDrawn(Shown):
    """A segment of a tendon on the paper."""

    tendon: str
    loaded: bool
    line_mm: Line


class StringDrawn(Shown):
    """Course of a loaded tendon to the edge of the drawing."""

    tendon: str
    mass_g: float
    line_mm: Line


class ViewDrawn(Shown):
    """The finger from one side, in mm on the paper."""

    paper: list[Vector] = Field(description="(2, 3): lays a vector of the drawing's axes on the paper; no unit.")
    bones_mm: list[Line] = Field(description="Closed outlines, schematic; the clamped bone first.")
    joints: list[JointDrawn]
    tendons: list[TendonDrawn]
    strings: list[StringDrawn]


class PlaceDrawn(Shown):
    """Possible position of the load cell, and the matrices of its forces in the drawing."""

    at_mm: Vector = Field(description="Where the force acts [mm].")
    from_mount: Matrix = Field(description="Takes a force in mount axes to the drawing's; no unit.")
    from_cell: Matrix = Field(description="Takes a force in the cell's own axes, tare removed, there; no unit.")


class FingerDrawn(Answered):
    """The finger as it is held at the bench. Axes of the first bone: x proximal, y dorsal, z radial [mm]."""

    session: str
    model: str
    posture: str
    angles_deg: dict[str, float]
    case: str | None
    role: str | None
    location: str | None
    masses_g: dict[str, float]
    weight_N: float = Field(description="Of all that hangs [N].")
    reach_mm: float = Field(description="Length of the stretched finger [mm].")
    stub_mm: float = Field(description="Length of the first bone that is drawn [mm].")
    views: dict[str, ViewDrawn] = Field(description="side: from the radial side; above: from the back of the hand.")
    places: dict[str, PlaceDrawn] = Field(description="tip and bone.")
    measured_N: Vector | None = Field(description="Force on the cell, mount axes, tare removed [N].")
    measured_sd_N: Vector | None = Field(description="Its standard uncertainty [N].")
    predicted_N: Vector | None = Field(description="In mount axes [N]; null where it may not be seen, or is not known.")
    note: str = Field(description="Why there is no prediction, where there is none.")
