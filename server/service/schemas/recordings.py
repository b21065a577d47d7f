"""Forms of recordings that become a session."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from daq.uplink.wire import SESSION_ID
from daq.vocabulary import LARGEST_FACTOR
from server.service.figures.answer import Theme
from server.service.schemas.common import Form, Plain, Shown
from server.service.schemas.sessions import FolderFile, Name

_FILES = [{"name": "run1.csv", "base64": "dCBbc107RnggW05d"}]
Angle = Annotated[float, Field(ge=-360.0, le=360.0)]
Mass = Annotated[float, Field(ge=0.0, le=1e6)]


class Recordings(Form):
    """Recordings in the order in which they were made; beside them a saved mapping (.yaml) and a calibration (.cal)."""

    files: Annotated[list[FolderFile], Field(min_length=1, max_length=20, examples=[_FILES])]
    mapping: Annotated[
        Plain | None,
        Field(
            description="A lab-file-map/1: which channel is which, in which unit; by default the one among the files."
        ),
    ] = None

    @property
    def sent(self) -> list[tuple[str, str]]:
        """Name and content, base64, of each file."""
        return [(f.name, f.base64) for f in self.files]


class AskedLook(Recordings):
    """Recordings to look at."""

    theme: Theme = "light"


class AskedLaying(Recordings):
    """Recordings, and the notebook to be laid onto their plateaus."""

    notes: Annotated[
        str,
        Field(
            max_length=200_000,
            description="Typed or CSV; nothing where there is none.",
            examples=["FDP 950, hook, tip"],
        ),
    ] = ""
    finger: Annotated[str, Field(max_length=100, description="Of GET /api/v1/fingers, whose tendons it names.")] = (
        "an1979_middle"
    )
    theme: Theme = "light"


class SpecimenGiven(Form):
    """The cadaver finger, under a pseudonym."""

    id: Name
    species: Name = "human"
    digit: Name = "third"
    side: Literal["left", "right"]


class TensionEstimated(Form):
    """Friction to be estimated from the readings."""

    estimate: Literal["force_balance"]


class MountGiven(Form):
    """Mount of the cell at one location."""

    frame: Name | None = Field(None, description="The bone whose axes the readings end in.")
    rotation_deg: Annotated[
        list[Angle] | None,
        Field(min_length=3, max_length=3, description="Cell to mount, intrinsic x-y-z angles [deg]."),
    ] = None


class CellGiven(Form):
    """The load cell and its mounts."""

    model: Name | None = None
    rate_hz: Annotated[float | None, Field(gt=0.0, le=1e6)] = None
    mounts: dict[Literal["tip", "bone"], MountGiven] = Field(default_factory=dict)


class HeaderGiven(Form):
    """Data that no recording holds: specimen, finger, friction, cell."""

    specimen: SpecimenGiven
    finger: Annotated[str, Field(max_length=100)] = "an1979_middle"
    tension_factor: Annotated[float, Field(gt=0.0, le=LARGEST_FACTOR)] | TensionEstimated
    load_cell: CellGiven | None = None
    gravity_m_s2: Annotated[float | None, Field(ge=5.0, le=20.0)] = None


class ChoiceGiven(Form):
    """Meaning of a plateau."""

    kind: Literal["load", "tare", "skip"]
    masses_g: Annotated[dict[Name, Mass], Field(max_length=20)] = Field(default_factory=dict)
    posture: Annotated[str, Field(max_length=100)] = ""
    location: Literal["tip", "bone", ""] = ""
    role: Literal["identification", "validation"] = "identification"
    repeats: bool = Field(False, description="The load before once more.")
    direction: Literal["loading", "unloading"] = Field("loading", description="The last motion of the weights.")
    tapped: bool = Field(False, description="Whether the rig was tapped before the reading.")


class NewFromRecordings(Recordings):
    """A session of recordings: what each plateau is, and what no recording tells."""

    id: Annotated[str, Field(pattern=SESSION_ID)]
    header: HeaderGiven
    postures_deg: Annotated[dict[Name, dict[Name, Angle]], Field(max_length=100)]
    choices: Annotated[list[ChoiceGiven], Field(min_length=1, max_length=10_000)]


class ChannelShown(Shown):
    """A channel of a recording."""

    name: str
    unit: str | None = Field(description="As the file states it; null where it does not.")


class RecordingShown(Shown):
    """Contents of a recording."""

    name: str
    readings: int
    plateaus: int = Field(description="Candidates, before anybody has said what is what.")
    time_unit: str
    channels: list[ChannelShown]
    recording_notes: list[str]
    figure: dict[str, Any]


class LineProposed(Shown):
    """One line of a proposed mapping."""

    is_: str = Field(alias="is", description="t, Fx to Tz, or gauge1 to gauge6.")
    channel: str | None
    unit: str | None = Field(description="Null where it has to be asked for.")
    increment_s: float | str | None = Field(description="Of time that is counted: a step [s], or `file`.")
    sure: float = Field(description="A share: from 0, to be asked for, to 1.")
    why: str


class ProposalShown(Shown):
    """Proposed mapping of channels; nothing of it is used before a person has confirmed it."""

    mapping: dict[str, Any] | None = Field(description="As lab-file-map/1; null where the file tells nothing.")
    lines: list[LineProposed]
    doubts: list[str]
    saved: bool = Field(description="Whether it is a mapping that was sent.")


class LookedAt(Shown):
    """Contents of recordings."""

    schema_: str = Field(alias="schema", examples=["fingertwin/recordings/1"])
    recordings: list[RecordingShown]
    proposal: ProposalShown | None = Field(description="Null where every recording is a readings file.")
    units: dict[str, list[str]] = Field(description="Names that help to choose, by kind.")


class PlateauTaken(Shown):
    """A plateau and what it is taken for."""

    window_s: list[float]
    mean_N: list[float]
    change_N: float | None = Field(description="Against the tare before it; null of what is no load.")
    kind: Literal["load", "tare", "skip"]
    line: int | None = Field(description="Index into `lines`.")
    sure: float = Field(description="A share: from 0 to 1.")
    steady: bool | None = Field(description="Null where the noise leaves it open.")


class LineShown(Shown):
    """A line of the notebook, as it was understood."""

    line: int
    said: str
    kind: Literal["load", "tare", "skip"]
    masses_g: dict[str, float]
    posture: str
    location: str
    role: str
    repeats: bool
    direction: str
    tapped: bool


class Laid(Shown):
    """A notebook laid onto plateaus."""

    schema_: str = Field(alias="schema", examples=["fingertwin/recordings/1"])
    tendons: list[str]
    plateaus: list[PlateauTaken]
    lines: list[LineShown]
    lost: list[str] = Field(description="Lines that were found on no plateau.")
    laid_notes: list[str]
    figure: dict[str, Any]


class DraftFinding(Shown):
    """Finding of a check."""

    level: str
    where: str
    text: str


class SuspectShown(Shown):
    """A case whose reading looks like another load."""

    case: str
    words: str
    own: float = Field(description="Share of the reading that the entry leaves unexplained.")
    other: float = Field(description="Share that this leaves.")


class Drafted(Shown):
    """Draft of a session."""

    schema_: str = Field(alias="schema", examples=["fingertwin/recordings/1"])
    cases: int
    findings: list[DraftFinding]
    missing: list[str] = Field(description="What a diagnosis would lack.")
    suspects: list[SuspectShown]
    looked_at: str | None = Field(description="Why the model could not be held against it; null where it was.")
