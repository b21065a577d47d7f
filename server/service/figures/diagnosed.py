"""The figures of a diagnosis that is done, with their captions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from server.application.diagnosis_report import diagnosis_sections
from server.figures.report import Picture
from server.service.services import Services
from server.service.sessions.blinding import require_closed
from server.service.web.problems import ProblemError

if TYPE_CHECKING:
    import plotly.graph_objects as go

Drawing = tuple["go.Figure | None", str]

DIAGNOSIS = (
    "sensitivity",
    "residual_map",
    "missing_torque",
    "ranking",
    "size",
    "confounding",
    "revisions",
    "held_out",
    "own_curve",
)


def diagnosed(
    parts: Services, job: str, session: str | None
) -> tuple[str, dict[str, Any], Sequence[Mapping[str, Any]] | None]:
    """Return the session of a diagnosis that is done, its answer, and the history of the model that it began with.

    Raises:
        ProblemError: 404 there is no such job or session, 409 the job is not done or of another kind.
    """
    found = parts.jobs.get(job)
    if found.kind not in ("diagnose", "pooled"):
        raise ProblemError(409, f"job {job} is a {found.kind}", "a diagnosis")
    if found.state != "done" or found.result is None:
        raise ProblemError(409, f"job {job} is {found.state}", "a job that is done")
    if found.kind == "pooled":
        each = found.result.get("each") or {}
        if session not in each:
            raise ProblemError(
                404, f"job {job} has no session {session or '(none given)'}"[:300], f"session: one of {', '.join(each)}"
            )
        name, answer = session, each[session]
    else:
        name, answer = str(found.session), found.result
        if session not in (None, name):
            raise ProblemError(404, f"job {job} is of session {name}", f"session: {name}, or left out")
    require_closed(parts.measuring.of(str(name)))
    history = None
    with suppress(ProblemError):  # a finger has none
        history = parts.revisions.read(str(answer.get("model")))["history"] or None
    return str(name), answer, history


def diagnosis_drawings(answer: dict[str, Any], history: Any) -> dict[str, Drawing]:
    """Return every figure of a diagnosis with its caption; None with a sentence where there is nothing to draw."""
    sections = diagnosis_sections(answer, history, {})
    places = [p for s in sections for p in s.parts if isinstance(p, Picture) or str(p).startswith("No figure: ")]
    return {
        name: (p.figure, p.caption) if isinstance(p, Picture) else (None, str(p))
        for name, p in zip(DIAGNOSIS, places, strict=True)
    }
