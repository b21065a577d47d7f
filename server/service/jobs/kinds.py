"""A job as it is kept, and the kinds of jobs there are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Row

from server.service.storage.messages import Telling

SCHEMA = "fingertwin/job/1"
QUEUED, RUNNING, DONE, FAILED, CANCELLED = STATES = ("queued", "running", "done", "failed", "cancelled")


@dataclass(frozen=True)
class Job:
    """Work in the background."""

    id: str  # of the job
    kind: str  # such as `refit`
    session: str | None  # that it is about, None for what concerns several or none
    request: dict[str, Any]  # plain data that it was asked for with
    state: str  # one of STATES
    progress: float  # share that is done, 0 to 1
    stage: str  # what is being done, in a few words
    attempts: int  # how often the service stopped unasked while it ran
    timeout_s: float  # after which it is given up
    created_utc: str
    started_utc: str | None
    finished_utc: str | None
    result: dict[str, Any] | None = None  # plain data, once it is done; left out of lists
    problem: dict[str, Any] | None = None  # of a failure, as `application/problem+json`

    @classmethod
    def of_row(cls, row: Row[Any]) -> Job:
        """Make it of a row of the table, with or without its result."""
        return cls(**{name: value for name, value in row._mapping.items() if name != "number"})

    @property
    def finished(self) -> bool:
        """True if nothing will change any more."""
        return self.state not in (QUEUED, RUNNING)

    def as_dict(self) -> dict[str, Any]:
        """Return the job as the answer's plain data."""
        return {"schema": SCHEMA} | dict(vars(self))

    def as_message(self) -> dict[str, Any]:
        """Return the job as a message, without request and result, which may be large."""
        names = ("id", "kind", "session", "state", "progress", "stage", "created_utc", "started_utc", "finished_utc")
        return {name: getattr(self, name) for name in (*names, "problem")}


@dataclass(frozen=True)
class TaskKind:
    """One kind of job."""

    kind: str  # its name
    # Makes of the request what the worker is given, when the job starts; may raise InputError.
    build: Callable[[dict[str, Any]], Any]
    run: str  # dotted name of the function `(payload, tell)` that a worker calls
    # Takes the worker's result, within the transaction in which the job becomes done, and returns what is kept as the
    # job's result; by default all of it.
    keep: Callable[[Telling, Job, Any], dict[str, Any]] = lambda telling, job, result: result
