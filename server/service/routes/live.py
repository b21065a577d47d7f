"""The live path: envelopes of readings come in by POST, and everything goes out by the WebSocket `/live`."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.concurrency import run_in_threadpool
from starlette.responses import Response
from starlette.websockets import WebSocket

from server.service.live.bodies import LiveMessage
from server.service.live.route import live_router
from server.service.problems import ProblemError
from server.service.schemas.common import SessionId, Shown, documented
from server.service.services import of
from server.service.strict import StrictRoute

router = APIRouter(route_class=StrictRoute, tags=["live"])


@router.post("/sessions/{session}/live", status_code=204, responses=documented(Shown, status=422))
async def show(session: SessionId, body: LiveMessage, request: Request) -> Response:
    """Show what a load cell says now: envelopes of some hundredths of a second. Nothing of it is kept."""
    parts = of(request)
    if not parts.live.is_shown(session):
        await run_in_threadpool(parts.sessions.version, session)
    parts.live.trace(session, body)
    return Response(status_code=204)


def _exists(connection: WebSocket, session: str) -> bool:
    try:
        of(connection).sessions.version(session)
    except ProblemError:
        return False
    return True


# Who may listen was settled by the guard before the route is reached.
router.include_router(live_router(lambda connection: of(connection).live, exists=_exists))
