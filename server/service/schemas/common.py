"""Forms that several parts of the interface share."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import Header, Path, Query
from pydantic import BaseModel, ConfigDict, Field

from server.service.web.problems import problems

SessionId = Annotated[str, Path(max_length=100, description="Id of the session.", examples=["DEV-01"])]
CaseId = Annotated[str, Path(max_length=100, description="Id of the load case.", examples=["c001"])]
RevisionId = Annotated[str, Path(max_length=200, description="Id of the revision.")]
Posture = Annotated[
    str | None, Query(max_length=200, description="A posture of the session; by default that of the case.")
]
InCase = Annotated[
    str | None,
    Query(alias="case", max_length=100, description="A load case, taken or planned; else the finger alone."),
]
Limit = Annotated[int, Query(ge=1, le=1000, description="How many at most.")]
ModelName = Annotated[
    str | None,
    Query(
        max_length=200,
        description="A revision's id, a finger's name, or `in_force` for the revision that stands for the specimen; "
        "`JOB/nothing` or `JOB/EFFECT` for the refit of a search; by default the session's own finger.",
        examples=["an1979_middle"],
    ),
]
Matched = Annotated[str | None, Header(alias="If-None-Match", max_length=200)]


class Form(BaseModel):
    """A body that is sent: unknown keys are refused, numbers are finite, and no text stands for a number."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)


class Shown(BaseModel):
    """A body that is answered; it may come to have more keys."""

    model_config = ConfigDict(extra="allow")


class Answered(Shown):
    """A whole answer, which says what form it has."""

    schema_: str = Field(alias="schema", pattern=r"^fingertwin/[a-z-]+/[0-9]+$", description="Its form, and version.")


class WarningOfCheck(Shown):
    """An error or a warning of the check."""

    level: Literal["error", "warning"] = Field(description="error: do not use what it concerns; warning: look at it.")
    code: str = Field(description="For scripts.")
    place: str
    words: str


class ErrorsInPlane(Shown):
    """Errors of predicted against measured forces over some load cases in one plane (Synek et al. 2019, Eqs 6, 7)."""

    cases: int = Field(description="How many load cases.")
    components: int = Field(description="Scalar force components, two or three a case.")
    rmse_N: float | None = Field(description="Root mean square over the components [N].")
    rmse_rel_pct: float | None = Field(description="Of the mean measured norm [%].")
    magnitude_error_N: float | None = Field(description="Mean error of the magnitude [N].")
    magnitude_error_pct: float | None = Field(description="Relative to each measured magnitude [%].")
    direction_error_deg: float | None = Field(description="Mean unsigned angle [deg].")
    direction_cases: int = Field(description="Cases whose force stands out from its uncertainty.")


class Errors(Shown):
    """Errors in the sagittal plane, as published, and in space."""

    sagittal: ErrorsInPlane
    space: ErrorsInPlane


Summary = dict[str, Errors]
Vector = Annotated[list[float | None], Field(min_length=3, max_length=3)]
Plain = dict[str, Any]


# What any address may answer when it refuses.
_REFUSALS = problems(400, 401, 403, 404, 405, 409, 411, 413, 414, 415, 421, 422, 429, 500, 503)


def documented(model: type[BaseModel], *, status: int = 200) -> dict[int | str, dict[str, Any]]:
    """Return the documentation of an answer and of all refusals, for a route's `responses`."""
    return {status: {"model": model}, **_REFUSALS}
