"""Forms of sessions, their load cases and edits."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from daq.uplink.wire import SESSION_ID
from server.service.schemas.common import Answered, Form, Plain, Shown, Vector, WarningOfCheck
from server.service.web.examples import EXAMPLES

Span = Annotated[tuple[float, float], Field(strict=False, description="[start, end] in s of the session's readings.")]
Name = Annotated[str, Field(min_length=1, max_length=100)]
Reason = Annotated[str, Field(min_length=1, max_length=2000)]
CASE, DOCUMENT = EXAMPLES["NewCase"]["case"], EXAMPLES["NewSession"]["document"]


class NewSession(Form):
    """A session to begin."""

    id: Annotated[str, Field(pattern=SESSION_ID, description="Its id from now on.", examples=["H01"])]
    document: Annotated[
        Plain | None,
        Field(
            description="A bench-session/1: specimen, finger, postures [deg], load cases with masses [g], and windows "
            "[s] or forces [N]. Readings follow as a stream. Left out where a bench sends its own record. "
            "A finger of one's own comes along as `finger_document`.",
            examples=[DOCUMENT],
        ),
    ] = None
    bench: Annotated[
        list[Name] | None,
        Field(description="Streams of the journal of the bench that begins it; null for no bench."),
    ] = None


class SessionShown(Answered):
    """A session."""

    id: str
    version: int = Field(description="Raised by every change.")
    source: str = Field(description="document, bench, or none where nothing is known yet.")
    closed: bool = Field(description="Whether predictions of validation cases may be seen.")
    created_utc: str
    specimen: str | None = None
    finger: str | None = None
    protocol: str | None = None
    stream: str | None = Field(None, description="Stream whose time windows are told in.")
    streams: list[Plain] = Field(default=[], description="Each stream with its description and cursor.")
    cases: dict[str, int] = Field(default={}, description="How many cases are in each state.")
    problem: str | None = Field(None, description="Why the session cannot be used, where it cannot.")
    warnings: list[WarningOfCheck] = Field(description="What the check found in it.")


class SessionImported(SessionShown):
    """A session whose folder was sent."""

    already_there: bool = Field(description="Whether the very same folder was kept before.")


class SessionDocument(Shown):
    """A bench-session/1."""

    format: str
    id: str


class SessionListed(Shown):
    """A session in the list."""

    id: str
    specimen: str | None
    source: str = Field(description="document, bench, or none where nothing is known yet.")
    version: int
    created_utc: str
    closed: bool = Field(description="Whether predictions of validation cases may be seen.")
    closed_utc: str | None = Field(
        description="When it was closed; null of a document, which is closed from its start."
    )
    streams: int


class SessionList(Answered):
    """Sessions in the order of their ids."""

    sessions: list[SessionListed]
    next: str | None = Field(description="To be given as `after` for more; null where there are no more.")


class CaseShown(Shown):
    """A load case: what hangs, how far it is, its force and prediction."""

    id: str
    role: str | None
    posture: str | None
    location: str | None
    masses_g: dict[str, float] | None = Field(description="Weight hung on each tendon [g].")
    state: Literal["measured", "waiting", "failed", "excluded"]
    why: str
    windows: dict[str, list[float]] = Field(description="unloaded_s, loaded_s, unloaded_after_s [s].")
    measured_N: Vector | None = Field(description="Force on the cell, mount axes, tare removed [N].")
    measured_sd_N: Vector | None = Field(description="Its standard uncertainty [N].")
    measured_Nmm: Vector | None = Field(description="Moment about the load point [N mm].")
    predicted_N: Vector | None = Field(description="By the session's own model; null where it may not be seen yet.")
    residual_N: Vector | None
    z: float | None = Field(description="Mahalanobis norm of the residual.")
    blinded: bool = Field(description="A validation case of a session that is not closed: no prediction is shown.")


class CaseRead(CaseShown, Answered):
    """One load case."""


class CaseList(Answered):
    """A session's load cases."""

    session: str
    version: int
    cases: list[CaseShown]


class StepShown(Shown):
    """A step of a protocol: a load case, or a known weight on the cell itself; or a load case that is proposed."""

    id: str
    text: str = Field(description="What is hung where.")
    state: Literal["done", "excluded", "open", "proposed"] = Field(
        description="proposed: somebody would like it measured; it goes as soon as it is, or is taken back."
    )
    why: str | None = Field(None, description="Of a proposed case: what it would tell.")
    edit: int | None = Field(None, description="Of a proposed case: number of the edit that proposed it.")
    posture: str | None = Field(None, description="Of a proposed case.")
    location: str | None = Field(None, description="Of a proposed case: tip or bone.")
    masses_g: dict[str, float] | None = Field(None, description="Of a proposed case: weight hung on each tendon [g].")


class Checklist(Answered):
    """The steps of a session in order; repeats stand at the end, and after them what is proposed."""

    session: str
    version: int
    steps: list[StepShown]


class NewCase(Form):
    """A load case to add, as in bench-session/1; a repeat is added too, none is replaced."""

    case: Annotated[Plain, Field(examples=[CASE])]


class Proposal(Form):
    """A load case that is to be measured next."""

    posture: Annotated[Name, Field(description="Of the session or its protocol.", examples=["hook"])]
    location: Annotated[Literal["tip", "bone"], Field(description="Where the cell is.")]
    masses_g: Annotated[
        dict[Annotated[str, Field(max_length=20)], Annotated[float, Field(ge=0.0, le=1e6, strict=False)]],
        Field(max_length=20, description="Weight to hang on each tendon [g].", examples=[{"FDS": 475.0}]),
    ]
    why: Annotated[Reason | None, Field(description="What it would tell.", examples=["parts two explanations"])] = None


class FolderFile(Form):
    """A file of a session's folder."""

    name: Annotated[str, Field(min_length=1, max_length=100, description="Without its folder.")]
    base64: Annotated[str, Field(description="Its bytes; readings may be packed with gzip, whatever their name.")]


class Folder(Form):
    """A session's folder, as the command line has it: `session.yaml`, its readings, its finger where that is a file."""

    files: Annotated[
        list[FolderFile],
        Field(
            min_length=1,
            max_length=50,
            examples=[[{"name": "session.yaml", "base64": "Zm9ybWF0OiBiZW5jaC1zZXNzaW9uLzEK"}]],
        ),
    ]
    id: Annotated[str | None, Field(pattern=SESSION_ID, description="Its id; by default as it says.")] = None


class Windows(Form):
    """Other windows of a case; null takes one away."""

    unloaded_s: Span | None = None
    loaded_s: Span | None = None
    unloaded_after_s: Span | None = None


class Exclusion(Form):
    """Why a case is left out."""

    reason: Reason


class Amended(Form):
    """Amendment of a load case that was entered wrongly; the entry is kept."""

    masses_g: dict[Annotated[str, Field(max_length=40)], Annotated[float, Field(ge=0.0, le=1e6)]] | None = Field(
        None, max_length=40, description="Everything that hung [g].", examples=[{"FDS": 950.0}]
    )
    posture: Annotated[str, Field(max_length=200)] | None = Field(None, description="The posture that was really set.")
    location: Literal["tip", "bone"] | None = Field(None, description="Where the cell really was.")
    exchanged_with: Annotated[str, Field(max_length=100)] | None = Field(
        None, description="Another case, entered in this one's place; nothing else then."
    )
    why: Reason


class AmendedBlock(Form):
    """One change of all load cases of a block in which it is a change."""

    cases: Annotated[str, Field(max_length=200)] = Field(
        description="A case's id, a posture, tip, bone, all, c017.. (from it on), or several joined by commas.",
        examples=["hook,bone"],
    )
    tendons: dict[Annotated[str, Field(max_length=40)], Annotated[str, Field(max_length=40)]] = Field(
        default_factory=dict,
        max_length=40,
        description="The tendon that bore the weight, by the one that was entered.",
        examples=[{"FDP": "FDS", "FDS": "FDP"}],
    )
    weights_g: dict[Annotated[float, Field(gt=0.0, lt=1e6, strict=False)], Annotated[float, Field(gt=0.0, lt=1e6)]] = (
        Field(
            default_factory=dict,
            max_length=40,
            description="What a weight really weighs [g], by what was entered wherever it hung.",
            examples=[{"484": 550.0}],
        )
    )
    masses_g: dict[Annotated[str, Field(max_length=40)], Annotated[float, Field(ge=0.0, le=1e6)]] = Field(
        default_factory=dict,
        max_length=40,
        description="What hung on a tendon [g], 0 for nothing; other tendons keep what was entered.",
        examples=[{"FDP": 950.0, "FDS": 0.0}],
    )
    posture: Annotated[str, Field(max_length=200)] | None = Field(None, description="The posture that was really set.")
    location: Literal["tip", "bone"] | None = Field(None, description="Where the cell really was.")


class AmendedBlocks(Form):
    """Amendments of many load cases that were entered wrongly alike; they are one edit."""

    amend: Annotated[list[AmendedBlock], Field(min_length=1, max_length=40)]
    why: Reason


class Nothing(Form):
    """An empty object: nothing has to be said."""


class EditShown(Shown):
    """A change of a session; it can be taken back."""

    number: int
    created_utc: str
    author: str | None = Field(description="Name of the token that asked for it; `local` for whoever needs none.")
    kind: str
    case: str | None
    body: dict[str, Any]
    undoes: int | None
    in_force: bool


class EditList(Answered):
    """A session's edits, oldest first."""

    session: str
    version: int
    edits: list[EditShown]


class Edited(Answered):
    """Result of an edit."""

    session: str
    version: int
    edit: int = Field(description="Its number, by which it can be undone.")
    case: CaseShown | None
