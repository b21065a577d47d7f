"""Forms of jobs."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from server.service.schemas.common import Answered, Plain, Shown
from server.service.web.problems import Problem

State = Literal["queued", "running", "done", "failed", "cancelled"]


class JobShown(Shown):
    """Work in the background: how far it is, and what came of it."""

    schema_: Literal["fingertwin/job/1"] = Field(alias="schema")
    id: str
    kind: str = Field(description="Such as refit, add, diagnose, next, pooled, population or reproduce.")
    session: str | None = Field(description="That it is about; null for what concerns several or none.")
    request: Plain = Field(description="What it was asked for with.")
    state: State
    progress: float = Field(ge=0.0, le=1.0, description="Share that is done.")
    stage: str = Field(description="What is being done.")
    attempts: int = Field(
        ge=0, description="How often the service stopped unasked while it ran; the third time fails it."
    )
    timeout_s: float = Field(gt=0.0, description="After which it is given up [s].")
    created_utc: str
    started_utc: str | None
    finished_utc: str | None
    result: Plain | None = Field(description="Once it is done; null in lists.")
    problem: Problem | None = Field(description="Why it failed.")


class JobList(Answered):
    """Some jobs, newest first."""

    jobs: list[JobShown]
    next: str | None = Field(description="To be given as `after` for more.")
