"""Jobs: refits, diagnoses and other work in the background of the service."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from fingertwin.client.errors import JobFailedError, ServiceError, ServiceUnreachableError
from fingertwin.client.exchange import AWAY, Body, Exchange, path_of, reading
from fingertwin.client.findings import Finding, Fit, Plan
from fingertwin.client.revisions import Revision

# Told how far something is, as a share from 0 to 1, and what is being done.
Progress = Callable[[float, str], object]
Result = TypeVar("Result")
# Makes a result of a job's id and of what the service says came of it.
Made = Callable[[Exchange, str, Body], Result]

_FIRST_PAUSE_S, _MOST_PAUSE_S, _LONGER = 0.1, 1.0, 1.3
# A job survives a restart of the service, and so does waiting for it.
_PATIENCE_S = 60.0


class Job(Generic[Result]):
    """Work in the background of the service; it goes on whether or not anybody waits for it."""

    def __init__(self, exchange: Exchange, body: Body, made: Made[Result]) -> None:
        self._exchange, self._made = exchange, made
        self._take(body)

    def __repr__(self) -> str:
        stage = f", {self.stage}" if self.stage else ""
        return f"<Job {self.id} {self.kind} {self.session or ''}: {self.state} {self.progress:.0%}{stage}>"

    @property
    def done(self) -> bool:
        """Whether it has ended, well or not; as of the last look."""
        return self.state not in ("queued", "running")

    def refresh(self) -> Job[Result]:
        """Look how far it is."""
        self._take(self._exchange.get(path_of("jobs", self.id)))
        return self

    def cancel(self) -> Job[Result]:
        """Cancel it.

        Raises:
            ServiceError: 409, it has ended.
        """
        self._take(self._exchange.post(path_of("jobs", self.id, "cancel"), {}))
        return self

    def result(self, progress: Progress | None = None, timeout_s: float | None = None) -> Result:
        """Wait for its end, and return what came of it.

        Args:
            progress: called with the share that is done (0 to 1) and what is being done, whenever they change.
            timeout_s: after which waiting is given up; the job goes on.

        Raises:
            JobFailedError: it failed or was cancelled.
            TimeoutError: it was not done in time.
            ServiceUnreachableError: nobody has answered for a minute.
        """
        end_s = None if timeout_s is None else time.monotonic() + timeout_s
        pause_s, told = _FIRST_PAUSE_S, (-1.0, "")
        while True:
            self._look(end_s)
            now = (self.progress, self.stage or self.state)
            if progress is not None and now != told:
                progress(*now)
                told = now
            if self.state == "done":
                return self._made(self._exchange, self.id, self._body["result"])
            if self.done:
                raise JobFailedError(self.id, self.kind, self.state, self._body.get("problem"))
            if end_s is not None and time.monotonic() >= end_s:
                raise TimeoutError(f"{self.kind} {self.id} is {self.state} ({self.progress:.0%}) after {timeout_s:g} s")
            left_s = pause_s if end_s is None else min(pause_s, max(end_s - time.monotonic(), 0.0))
            self._exchange.sleep(left_s)
            pause_s = min(pause_s * _LONGER, _MOST_PAUSE_S)

    def _look(self, end_s: float | None) -> None:
        """Look, with patience for a service that is away for a moment."""
        patience_s = time.monotonic() + _PATIENCE_S
        patience_s = patience_s if end_s is None else min(patience_s, end_s)
        while True:
            try:
                self.refresh()
            except (ServiceUnreachableError, ServiceError) as error:
                away = isinstance(error, ServiceUnreachableError) or error.status in AWAY
                if not away or time.monotonic() >= patience_s:
                    raise
                self._exchange.sleep(_MOST_PAUSE_S)
            else:
                return

    def _take(self, body: Body) -> None:
        with reading("a job"):
            self.id, self.kind, self.session = str(body["id"]), str(body["kind"]), body["session"]
            self.state, self.progress, self.stage = str(body["state"]), float(body["progress"]), str(body["stage"])
        self._body = body


def revision_of(exchange: Exchange, _: str, body: Body) -> Revision:
    """Return the revision that an addition made."""
    with reading("an addition"):
        name = body["model"]
    return Revision.read(exchange, name)


def fit_of(_: Exchange, __: str, body: Body) -> Fit:
    """Return what a refit came to."""
    return Fit.of(body)


def finding_of(exchange: Exchange, job: str, body: Body) -> Finding:
    """Return what a diagnosis found."""
    return Finding.of(exchange, job, body)


def plan_of(_: Exchange, __: str, body: Body) -> Plan:
    """Return which load cases to measure next."""
    return Plan.of(body)


def plain(_: Exchange, __: str, body: Body) -> Body:
    """Return a result as it is."""
    return body


_MADE: dict[str, Made[Any]] = {"refit": fit_of, "add": revision_of, "diagnose": finding_of, "next": plan_of}


def job_of(exchange: Exchange, body: Body) -> Job[Any]:
    """Return a job of any kind."""
    with reading("a job"):
        kind = body["kind"]
    return Job(exchange, body, _MADE.get(kind, plain))
