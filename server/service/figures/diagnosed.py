"""The answer of a diagnosis that is done, of which figures and reports are drawn."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from typing import Any

from server.service.jobs.kinds import Job
from server.service.services import Services
from server.service.sessions.blinding import require_closed
from server.service.web.problems import ProblemError


def done_job(parts: Services, job: str, kinds: Collection[str], wanted: str) -> tuple[Job, dict[str, Any]]:
    """Return a job of some kinds that is done, and its result.

    Raises:
        ProblemError: 404 there is no such job, 409 it is not done or of another kind.
    """
    found = parts.jobs.get(job)
    if found.kind not in kinds:
        raise ProblemError(409, f"job {job} is a {found.kind}", wanted, "Name such a job, as GET /api/v1/jobs lists it")
    if found.state != "done" or found.result is None:
        raise ProblemError(
            409, f"job {job} is {found.state}", "a job that is done", "Wait until it is, or begin another"
        )
    return found, found.result


def diagnosed(
    parts: Services, job: str, session: str | None
) -> tuple[str, dict[str, Any], Sequence[Mapping[str, Any]] | None]:
    """Return the session of a diagnosis that is done, its answer, and the history of the model that it began with.

    Raises:
        ProblemError: 404 there is no such job or session, 409 the job is not done or of another kind.
    """
    found, result = done_job(parts, job, ("diagnose", "pooled"), "a diagnosis")
    if found.kind == "pooled":
        each = result.get("each") or {}
        if session not in each:
            raise ProblemError(
                404, f"job {job} has no session {session or '(none given)'}"[:300], f"session: one of {', '.join(each)}"
            )
        name, answer = session, each[session]
    else:
        name, answer = str(found.session), result
        if session not in (None, name):
            raise ProblemError(404, f"job {job} is of session {name}", f"session: {name}, or left out")
    require_closed(parts.measuring.of(str(name)))
    history = None
    with suppress(ProblemError):  # a finger has none
        history = parts.revisions.read(str(answer.get("model")))["history"] or None
    return str(name), answer, history
