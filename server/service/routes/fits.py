"""Refits, additions, diagnoses and next load cases, as jobs; revisions of each specimen's model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from fastapi import APIRouter, Query, Request

from fingermodel.diagnosis.several_sessions.independence import require_apart
from server.service.answers import JsonAnswer, page_of
from server.service.schemas.common import Form, Limit, RevisionId, SessionId, documented
from server.service.schemas.fits import (
    AskedAddition,
    AskedDiagnosis,
    AskedFit,
    AskedNext,
    AskedPooled,
    AskedPopulation,
    Restored,
    RevisionDocument,
    RevisionList,
    RevisionRead,
    RevisionWhole,
    SpecimenList,
)
from server.service.schemas.jobs import JobList, JobShown
from server.service.services import Services, of
from server.service.sessions.blinding import require_closed
from server.service.web.problems import ProblemError
from server.service.web.strict_requests import StrictRoute

router = APIRouter(route_class=StrictRoute, tags=["twin"])

After = Annotated[str, Query(max_length=200, description="Those after this one.")]
OlderThan = Annotated[str | None, Query(max_length=200, description="Those older than this job.")]
_ACCEPTED = documented(JobShown, status=202)


@router.post("/sessions/{session}/fits", status_code=202, responses=_ACCEPTED)
def fit(session: SessionId, body: AskedFit, request: Request) -> JsonAnswer:
    """Refit a model to a session's identification cases; the revision comes into force when it is done."""
    return _submitted(request, "refit", session, body)


@router.get("/sessions/{session}/fits", responses=documented(JobList))
def fits(session: SessionId, request: Request, limit: Limit = 100, after: OlderThan = None) -> JsonAnswer:
    """Return a session's refits and additions, newest first."""
    return _listed(of(request), session, ("refit", "add"), limit, after)


@router.post("/sessions/{session}/revisions", status_code=202, responses=_ACCEPTED)
def add(session: SessionId, body: AskedAddition, request: Request) -> JsonAnswer:
    """Add effects to a session's model or take some out, refit, and keep the revision."""
    if not body.add and not body.without:
        raise ProblemError(422, "no effect to add or to take out", "add or without, with names of GET /api/v1/effects")
    return _submitted(request, "add", session, body, body.add)


@router.get("/sessions/{session}/revisions", responses=documented(RevisionList))
def session_revisions(session: SessionId, request: Request, limit: Limit = 100, after: After = "") -> JsonAnswer:
    """Return the revisions that were fitted to a session, oldest first."""
    parts = of(request)
    parts.sessions.version(session)
    rows = parts.revisions.listed(session=session, limit=limit, after=after)
    return page_of("revisions", rows, limit)


@router.post("/sessions/{session}/diagnoses", status_code=202, responses=_ACCEPTED)
def diagnose(session: SessionId, body: AskedDiagnosis, request: Request) -> JsonAnswer:
    """Show where a session's model fails and which physical effect is missing, or say that the data cannot tell."""
    return _submitted(request, "diagnose", session, body, body.effects)


@router.get("/sessions/{session}/diagnoses", responses=documented(JobList))
def diagnoses(session: SessionId, request: Request, limit: Limit = 100, after: OlderThan = None) -> JsonAnswer:
    """Return a session's diagnoses, newest first."""
    return _listed(of(request), session, ("diagnose",), limit, after)


@router.post("/sessions/{session}/next", status_code=202, responses=_ACCEPTED)
def next_cases(session: SessionId, body: AskedNext, request: Request) -> JsonAnswer:
    """Rank the load cases that would best tell the remaining explanations apart; freeze what they predict."""
    return _submitted(request, "next", session, body, body.effects)


@router.get("/sessions/{session}/next", responses=documented(JobList))
def next_list(session: SessionId, request: Request, limit: Limit = 100, after: OlderThan = None) -> JsonAnswer:
    """Return what was worked out about next load cases, newest first."""
    return _listed(of(request), session, ("next",), limit, after)


@router.post("/diagnoses", status_code=202, responses=_ACCEPTED)
def diagnose_pooled(body: AskedPooled, request: Request) -> JsonAnswer:
    """Diagnose several sessions: each by itself, and what they share (a rig's fault shows across specimens)."""
    return _submitted(request, "pooled", None, body, body.effects)


@router.post("/populations", status_code=202, responses=_ACCEPTED)
def population(body: AskedPopulation, request: Request) -> JsonAnswer:
    """Refit (specimens × bootstrap × effects); an interrupted run goes on where it was."""
    return _submitted(request, "population", None, body, [n for names in body.effects for n in names])


@router.get("/revisions", responses=documented(RevisionList))
def revisions(
    request: Request,
    specimen: Annotated[str | None, Query(max_length=200)] = None,
    limit: Limit = 100,
    after: After = "",
) -> JsonAnswer:
    """List revisions, oldest first."""
    rows = of(request).revisions.listed(specimen, None, limit, after)
    return page_of("revisions", rows, limit)


@router.get("/revisions/{revision}", responses=documented(RevisionWhole))
def revision(revision: RevisionId, request: Request) -> JsonAnswer:
    """Return a revision: what was added and why, errors before and after, its document, and what it came from."""
    return JsonAnswer({"schema": "fingertwin/revision/1"} | of(request).revisions.read(revision))


@router.get("/revisions/{revision}/document", responses=documented(RevisionDocument))
def revision_document(revision: RevisionId, request: Request) -> JsonAnswer:
    """Return a revision as a file that `fingertwin compare --model` takes."""
    found = of(request).revisions.read(revision)["document"]
    return JsonAnswer(found, headers={"Content-Disposition": 'attachment; filename="revision.json"'})


@router.post("/revisions/{revision}/restore", responses=documented(RevisionRead))
def restore(revision: RevisionId, body: Restored, request: Request) -> JsonAnswer:
    """Put an older revision in force again; nothing is overwritten by it."""
    return JsonAnswer({"schema": "fingertwin/revision/1"} | of(request).revisions.restore(revision, body.why))


@router.get("/specimens", responses=documented(SpecimenList))
def specimens(request: Request) -> JsonAnswer:
    """List specimens with the revision that stands for each, and those that did before."""
    return JsonAnswer({"schema": "fingertwin/specimens/1", "specimens": of(request).revisions.specimens()})


def _submitted(request: Request, kind: str, session: str | None, body: Form, used: Sequence[str] = ()) -> JsonAnswer:
    """Queue a job whose sessions and effects can be used; whatever would fail at once is refused now."""
    parts, given = of(request), body.model_dump()
    timeout_s = given.pop("timeout_s")
    parts.effects.named(used)
    asked_of = given.get("sessions", [session])
    if len(set(asked_of)) < len(asked_of):
        raise ProblemError(422, "a session twice", "each session once")
    recorded = []
    for name in asked_of:
        measured = parts.measuring.of(name)
        recorded.append(measured.require())
        require_closed(measured)
        parts.models.model(given["model"], measured)
    require_apart(recorded)
    asked = given if session is None else given | {"session": session}
    job = parts.jobs.submit(kind, session, asked, timeout_s)
    return JsonAnswer(job.as_dict(), 202, {"Location": f"/api/v1/jobs/{job.id}"})


def _listed(parts: Services, session: str, kinds: tuple[str, ...], limit: int, after: str | None) -> JsonAnswer:
    parts.sessions.version(session)
    rows = [j.as_dict() for j in parts.jobs.list(session, None, limit, after, kinds)]
    return page_of("jobs", rows, limit)
