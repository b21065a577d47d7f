"""Sessions, their load cases, and edits with an undo."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query, Request, Response
from sqlalchemy import select

from daq.errors import InputError
from daq.sessions.amendments import amendment, amendments_of, block_of, case_of, exchanged
from daq.sessions.models import Amendment
from server.service.answers import JsonAnswer, page_of
from server.service.models.case_updates import case_bodies
from server.service.schemas.common import CaseId, Limit, SessionId, Shown, documented
from server.service.schemas.sessions import (
    Amended,
    AmendedBlocks,
    CaseList,
    CaseRead,
    Checklist,
    Edited,
    EditList,
    Exclusion,
    Folder,
    NewCase,
    NewSession,
    Nothing,
    Proposal,
    SessionDocument,
    SessionImported,
    SessionList,
    SessionShown,
    Windows,
)
from server.service.services import Services, of
from server.service.sessions.planned import planned_steps
from server.service.sessions.records import EditKind, steps_of, undone_edits
from server.service.sessions.sizes import require_case_id
from server.service.storage.schema import streams
from server.service.uploads.importing import import_example, import_folder
from server.service.web.problems import ProblemError
from server.service.web.strict_requests import ReadingRoute, StrictRoute
from server.service.web.workers import run

kept = APIRouter(route_class=ReadingRoute, prefix="/sessions", tags=["sessions"])
imports = APIRouter(route_class=StrictRoute, prefix="/imports", tags=["sessions"])

EditNumber = Annotated[int, Path(ge=1, le=1 << 53, description="Number of the edit.")]
ExampleName = Annotated[str, Path(max_length=100, description="Name of the shipped session.", examples=["DEV-02"])]
ProposedId = Annotated[str, Path(max_length=100, description="Id of the proposed load case.", examples=["next-1"])]


@kept.post("", status_code=201, responses=documented(SessionShown, status=201) | {200: {"model": SessionShown}})
def create(body: NewSession, request: Request) -> JsonAnswer:
    """Begin a session: with its document, or empty where a bench will send its record.

    The very same session again is a success (200). One that was deleted is brought back by its own document. A bench is
    refused where another bench, or a document, has the id (409).
    """
    parts = of(request)
    new = parts.sessions.create(body.id, body.document, bench=body.bench) == "new"
    headers = {"Location": f"/api/v1/sessions/{body.id}"}
    return JsonAnswer(shown_session(parts, body.id), 201 if new else 200, headers)


@kept.get("", responses=documented(SessionList))
def listed(
    request: Request,
    specimen: Annotated[str | None, Query(max_length=200, description="Of this specimen only.")] = None,
    limit: Limit = 100,
    after: Annotated[str, Query(max_length=200, description="Ids after this one.")] = "",
) -> JsonAnswer:
    """List sessions in the order of their ids."""
    rows = of(request).sessions.listed(specimen, limit, after)
    return page_of("sessions", rows, limit)


@kept.get("/{session}", responses=documented(SessionShown))
def read(session: SessionId, request: Request) -> JsonAnswer:
    """Return a session: where it comes from, its streams, and how far its cases are."""
    return JsonAnswer(shown_session(of(request), session))


@kept.get("/{session}/document", responses=documented(SessionDocument))
def document(session: SessionId, request: Request) -> JsonAnswer:
    """Return the session as bench-session/1, edits included."""
    return JsonAnswer(of(request).sessions.read(session).require_document())


@kept.delete("/{session}", status_code=204, responses=documented(Shown, status=422))
def delete(session: SessionId, request: Request) -> Response:
    """Hide a session that no bench holds. What it holds is kept until a purge; its own document brings it back."""
    parts = of(request)
    parts.live.benches.require_free(session)
    parts.sessions.delete(session)
    return Response(status_code=204)


@kept.post("/{session}/close", responses=documented(SessionShown))
def close(session: SessionId, request: Request) -> JsonAnswer:
    """Close a session: predictions of its validation cases may be seen from here on."""
    parts = of(request)
    parts.sessions.close(session)
    return JsonAnswer(shown_session(parts, session))


@kept.get("/{session}/cases", responses=documented(CaseList))
def cases(session: SessionId, request: Request) -> JsonAnswer:
    """Return the load cases: what hangs, how far each is, its force, and its prediction where that may be seen."""
    parts = of(request)
    measured = parts.measuring.of(session)
    bodies = case_bodies(measured, parts.models)
    head = {"schema": "fingertwin/cases/1", "session": session, "version": measured.record.version}
    return JsonAnswer(head | {"cases": bodies})


@kept.get("/{session}/checklist", responses=documented(Checklist))
def checklist(session: SessionId, request: Request) -> JsonAnswer:
    """Return the steps of the protocol that a bench follows; of a document, its cases; and then what is proposed."""
    record = of(request).sessions.read(session)
    steps = [*steps_of(record), *planned_steps(record)]
    return JsonAnswer(
        {"schema": "fingertwin/checklist/1", "session": session, "version": record.version, "steps": steps}
    )


@kept.post("/{session}/planned", status_code=201, responses=documented(Edited, status=201))
def propose(session: SessionId, body: Proposal, request: Request) -> JsonAnswer:
    """Propose a load case to be measured next; it stands on the checklist as proposed until it is measured."""
    parts = of(request)
    return _edit_answer(parts, session, parts.sessions.propose(session, body.model_dump()), status=201)


@kept.delete("/{session}/planned/{planned}", responses=documented(Edited))
def withdraw(session: SessionId, planned: ProposedId, request: Request) -> JsonAnswer:
    """Take a proposed load case back; that can be undone too."""
    parts = of(request)
    return _edit_answer(parts, session, parts.sessions.withdraw(session, planned))


_IMPORTED = documented(SessionImported, status=201) | {200: {"model": SessionImported}}


@imports.post("", status_code=201, responses=_IMPORTED)
async def import_session(body: Folder, request: Request) -> JsonAnswer:
    """Take in a session's folder with its readings, as the command line has it; nothing is kept of one that is unsound.

    The very same folder again is a success (200).
    """
    return await imported(of(request), import_folder, [(f.name, f.base64) for f in body.files], body.id)


@imports.post(
    "/examples/{name}", status_code=201, responses=documented(SessionShown, status=201) | {200: {"model": SessionShown}}
)
async def import_shipped(name: ExampleName, request: Request) -> JsonAnswer:
    """Take in a session that comes with the software, with its readings; once more is a success (200)."""
    return await imported(of(request), import_example, name)


async def imported(parts: Services, take_in: Callable[..., tuple[str, bool]], *given: Any) -> JsonAnswer:
    """Take in a session in a thread and answer with it; of one that is there already with 200."""
    name, new = await run("apart", take_in, parts, *given)
    answer = await run("readers", shown_session, parts, name) | {"already_there": not new}
    return JsonAnswer(answer, 201 if new else 200, {"Location": f"/api/v1/sessions/{name}"})


@kept.get("/{session}/cases/{case}", responses=documented(CaseRead))
def one_case(session: SessionId, case: CaseId, request: Request) -> JsonAnswer:
    """Return one load case."""
    return JsonAnswer({"schema": "fingertwin/case/1"} | _case(of(request), session, case))


@kept.post("/{session}/cases", status_code=201, responses=documented(Edited, status=201))
def add_case(session: SessionId, body: NewCase, request: Request) -> JsonAnswer:
    """Add a load case; its force is computed as soon as the readings of its windows are there."""
    name = body.case.get("id")
    require_case_id(name)
    return _edited(of(request), session, "case", str(name), body.case, status=201)


@kept.put("/{session}/cases/{case}/windows", responses=documented(Edited))
def move_windows(session: SessionId, case: CaseId, body: Windows, request: Request) -> JsonAnswer:
    """Move the windows of a load case; its force is computed anew, and the edit can be undone."""
    given = body.model_dump(exclude_unset=True)
    if not given:
        raise ProblemError(422, "no window", "unloaded_s, loaded_s or unloaded_after_s")
    return _edited(of(request), session, "windows", case, given)


@kept.post("/{session}/cases/{case}/exclude", responses=documented(Edited))
def exclude(session: SessionId, case: CaseId, body: Exclusion, request: Request) -> JsonAnswer:
    """Leave a load case out, for a reason; of a bench that is running, that is done at the bench."""
    return _edited(of(request), session, "exclude", case, {"reason": body.reason})


@kept.post("/{session}/cases/{case}/include", responses=documented(Edited))
def include(session: SessionId, case: CaseId, body: Nothing, request: Request) -> JsonAnswer:
    """Take a load case in again."""
    return _edited(of(request), session, "include", case, {})


@kept.post("/{session}/cases/{case}/amend", responses=documented(Edited))
def amend(session: SessionId, case: CaseId, body: Amended, request: Request) -> JsonAnswer:
    """Say what a load case really was; its entry is kept, everything heeds the amendment, and it can be undone."""
    parts = of(request)
    known = parts.sessions.read(session).session()
    if body.exchanged_with is not None:
        if (body.masses_g, body.posture, body.location) != (None, None, None):
            raise ProblemError(422, "exchanged_with beside another change", "one of them", "Amend in two steps")
        made = list(exchanged(known, case, body.exchanged_with, body.why))
    else:
        here = case_of(known.amended, case)
        gone = dict.fromkeys(here.masses_g, 0.0) if body.masses_g is not None else {}
        masses_g = gone | (body.masses_g or {})
        made = [amendment(known, case, body.why, masses_g=masses_g, posture=body.posture, location=body.location)]
    return _edited(parts, session, "amend", case, _kept(made))


@kept.post("/{session}/amend", responses=documented(Edited))
def amend_blocks(session: SessionId, body: AmendedBlocks, request: Request) -> JsonAnswer:
    """Say what load cases of a block, entered wrongly alike, really were; all of it is one edit that can be undone."""
    parts = of(request)
    known, made = parts.sessions.read(session).session(), list[Amendment]()
    for one in body.amend:
        cases = block_of(known, one.cases)
        really = one.model_dump(exclude={"cases"})
        made += amendments_of(known, cases, body.why, **really)
    return _edited(parts, session, "amend", made[0].case, _kept(made))


def _kept(made: Sequence[Amendment]) -> dict[str, Any]:
    """Amendments as an edit keeps them; when they were made, the edit says itself."""
    return {"amendments": [a.model_dump(mode="json", exclude_none=True, exclude={"at"}) for a in made]}


@kept.get("/{session}/edits", responses=documented(EditList))
def edit_list(session: SessionId, request: Request) -> JsonAnswer:
    """Return every change that was made after the bench, with those that are taken back."""
    record = of(request).sessions.read(session)
    undone = undone_edits(record.edits)
    rows = [e.as_dict() | {"in_force": e.number not in undone} for e in record.edits]
    return JsonAnswer({"schema": "fingertwin/edits/1", "session": session, "version": record.version, "edits": rows})


@kept.post("/{session}/edits/{edit}/undo", responses=documented(Edited))
def undo(session: SessionId, edit: EditNumber, body: Nothing, request: Request) -> JsonAnswer:
    """Take an edit back; an undo is an edit too, and can be taken back."""
    parts = of(request)
    case = next((e.case for e in parts.sessions.read(session).edits if e.number == edit), None)
    return _edited(parts, session, "undo", case, {}, undoes=edit)


router = APIRouter()
router.include_router(kept)
router.include_router(imports)


def _edited(
    parts: Services,
    session: str,
    kind: EditKind,
    case: str | None,
    body: dict[str, Any],
    *,
    undoes: int | None = None,
    status: int = 200,
) -> JsonAnswer:
    number = parts.sessions.edit(session, kind, case, body, undoes=undoes)
    try:
        shown = None if case is None else _case(parts, session, case)
    except ProblemError:
        shown = None  # an undone case is there no more
    return _edit_answer(parts, session, number, shown, status)


def _edit_answer(
    parts: Services, session: str, number: int, case: dict[str, Any] | None = None, status: int = 200
) -> JsonAnswer:
    head = {"schema": "fingertwin/edit/1", "session": session, "version": parts.sessions.version(session)}
    return JsonAnswer(head | {"edit": number, "case": case}, status)


def _case(parts: Services, session: str, case: str) -> dict[str, Any]:
    bodies = case_bodies(parts.measuring.of(session), parts.models)
    found = next((b for b in bodies if b["id"] == case), None)
    if found is None:
        raise ProblemError(404, f"session {session} has no load case {case[:100]}", f"one of GET …/{session}/cases")
    return found


def shown_session(parts: Services, session: str) -> dict[str, Any]:
    """Return a session as it is answered: where it comes from, its streams, and how far its cases are.

    Raises:
        ProblemError: 404 there is none.
    """
    measured = parts.measuring.of(session)
    record = measured.record
    rows = parts.database.rows(select(streams).where(streams.c.session == session).order_by(streams.c.number))
    try:
        record.session()
        problem = None if measured.problem is None else str(measured.problem)
    except InputError as error:
        problem = str(error) if record.cases or record.problem else None
    known = record.document or {}
    states = [s.state for s in measured.states.values()]
    return {
        "schema": "fingertwin/session/1",
        "id": session,
        **{name: getattr(record, name) for name in ("version", "source", "closed", "created_utc")},
        "specimen": (known.get("specimen") or {}).get("id"),
        **{name: known.get(name) for name in ("finger", "protocol")},
        "stream": record.stream or (rows[0].id if rows else None),
        "streams": [{n: getattr(r, n) for n in ("id", "next_seq", "held", "ended", "epoch")} for r in rows],
        "cases": {s: states.count(s) for s in dict.fromkeys(states)},
        "problem": problem,
        "warnings": [f.as_warning() for f in measured.findings],
    }
