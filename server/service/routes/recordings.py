"""Recordings that become a session: look, lay, draft, and keep."""

from __future__ import annotations

from fastapi import APIRouter, Request

from server.service.answers import JsonAnswer
from server.service.routes.sessions import imported
from server.service.schemas.common import documented
from server.service.schemas.recordings import AskedLaying, AskedLook, Drafted, Laid, LookedAt, NewFromRecordings
from server.service.schemas.sessions import SessionImported
from server.service.services import of
from server.service.uploads.new_sessions import draft, keep, lay, look
from server.service.web.strict_requests import StrictRoute
from server.service.web.workers import run

router = APIRouter(route_class=StrictRoute, tags=["sessions"])


@router.post("/recordings/look", responses=documented(LookedAt))
async def look_at(body: AskedLook, request: Request) -> JsonAnswer:
    """Look at a lab's recordings: channels, traces, plateaus, and which channel is which; nothing is kept."""
    return JsonAnswer(await run("apart", look, body.sent, body.mapping, body.theme))


@router.post("/recordings/lay", responses=documented(Laid))
async def lay_notebook(body: AskedLaying, request: Request) -> JsonAnswer:
    """Lay a notebook onto the plateaus of recordings, in order, with how sure each is; nothing is kept."""
    return JsonAnswer(await run("apart", lay, body.sent, body.mapping, body.notes, body.finger, body.theme))


@router.post("/recordings/draft", responses=documented(Drafted))
async def draft_session(body: NewFromRecordings, request: Request) -> JsonAnswer:
    """Say what a session of recordings would lack, and which case looks like another load; nothing is kept."""
    return JsonAnswer(await run("apart", draft, body))


@router.post(
    "/imports/recordings",
    status_code=201,
    responses=documented(SessionImported, status=201) | {200: {"model": SessionImported}},
)
async def keep_recordings(body: NewFromRecordings, request: Request) -> JsonAnswer:
    """Make a session of recordings and keep it with its readings; the very same again is a success (200)."""
    return await imported(of(request), keep, body)
