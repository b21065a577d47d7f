"""Forms of refits, additions, diagnoses, next load cases and revisions."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from server.service.schemas.common import Answered, Form, Plain, Shown, Summary

Names = Annotated[list[Annotated[str, Field(min_length=1, max_length=200)]], Field(max_length=40)]
Model = Annotated[
    str | None,
    Field(
        max_length=200,
        description="A revision's id, a finger's name, or `in_force`; by default the session's own finger.",
        examples=["in_force"],
    ),
]
Timeout = Annotated[float | None, Field(gt=0, le=86400, description="After which the job is given up [s].")]


class AskedFit(Form):
    """A refit: parameters from the identification cases; validation cases are never fitted."""

    method: Annotated[
        Literal["map", "slsqp"],
        Field(description="map: all parameters at once with priors; slsqp: the three published problems of Eq 5."),
    ] = "map"
    model: Model = None
    plane: Annotated[
        Literal["sagittal", "space"] | None,
        Field(description="Force components to fit; by default what the finger's axes can predict."),
    ] = None
    timeout_s: Timeout = None


class AskedAddition(Form):
    """Effects to add to a session's model, and others to take out; then a refit."""

    add: Names = Field(default_factory=list, description="Candidates.", examples=[["hanger_mass"]])
    without: Names = Field(default_factory=list, description="Effects to take out.")
    model: Model = None
    timeout_s: Timeout = None


class AskedDiagnosis(Form):
    """Request to find where a model fails and which effect is missing."""

    model: Model = None
    thorough: Annotated[
        bool, Field(description="More starts and pairs, and every single to its end; may take a minute.")
    ] = False
    effects: Names = Field(default_factory=list, description="Users' own effects that take part.")
    timeout_s: Timeout = None


class AskedPooled(AskedDiagnosis):
    """A diagnosis of several sessions: each by itself, and what they share."""

    sessions: Annotated[
        list[Annotated[str, Field(max_length=100)]], Field(min_length=2, max_length=20, examples=[["DEV-02", "DEV-03"]])
    ]


class AskedNext(AskedDiagnosis):
    """The load cases that would best tell the remaining explanations apart."""

    freeze: Annotated[
        bool, Field(description="Keep what the explanations say of them; a later diagnosis scores it.")
    ] = False


def _plain_refit() -> list[list[str]]:
    return [[]]


class AskedPopulation(Form):
    """Specimens × bootstrap × effects: how sure values and errors are, over specimens."""

    sessions: Annotated[
        list[Annotated[str, Field(max_length=100)]], Field(min_length=1, max_length=200, examples=[["DEV-02"]])
    ]
    effects: list[Names] = Field(
        default_factory=_plain_refit,
        min_length=1,
        max_length=50,
        description="Sets to add; [] is a refit without.",
        examples=[[[]]],
    )
    bootstrap: Annotated[int, Field(ge=1, le=10_000, description="Replicates of each session.")] = 20
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0
    model: Model = None
    timeout_s: Timeout = None


class Restored(Form):
    """Why an older revision is put in force again."""

    why: Annotated[str, Field(min_length=1, max_length=2000, examples=["the suture had slipped in the last session"])]


class RevisionShown(Shown):
    """A state of a specimen's model."""

    id: str
    specimen: str
    session: str
    parent: str
    created_utc: str
    method: str | None
    outcome: str | None
    added: list[str] = Field(description="Effects added in this step.")
    removed: list[str] = Field(description="Effects taken out in this step.")
    effects: list[str] = Field(description="Effects that the model holds.")
    evidence: Plain | None = Field(description="What spoke for the step.")
    before: Summary | None = Field(description="Errors before the fit.")
    after: Summary | None = Field(description="And after it.")
    history: list[Plain] = Field(description="Every step up to here, oldest first.")
    in_force: bool


class RevisionRead(RevisionShown, Answered):
    """One state of a specimen's model."""


class RevisionWhole(RevisionRead):
    """A revision with its document, as `fingertwin refit --out` writes it, and with what it came from."""

    document: dict[str, Any]
    provenance: dict[str, Any] = Field(description="Readings, corrections, model, job and software.")


class RevisionDocument(Shown):
    """A revision as a file."""

    format: str


class RevisionList(Answered):
    """Revisions, oldest first."""

    revisions: list[RevisionShown]
    next: str | None = Field(description="To be given as `after` for more.")


class Specimen(Shown):
    """A specimen with the revision that stands for it, and those that did before."""

    id: str
    revision: str
    steps: list[Plain]


class SpecimenList(Answered):
    """Specimens that have a revision."""

    specimens: list[Specimen]
