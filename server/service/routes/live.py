"""The live path: envelopes of readings come in by POST, and everything goes out by the WebSocket `/live`."""

from __future__ import annotations

from typing import Literal

from fastapi import APIRouter, Request
from pydantic import ConfigDict, Field
from starlette.responses import Response
from starlette.websockets import WebSocket

from server.service.live.bench_socket import take
from server.service.live.bodies import LiveMessage
from server.service.live.route import live_router, refuse
from server.service.schemas.common import Form, SessionId, Shown, documented
from server.service.services import of
from server.service.web.problems import ProblemError
from server.service.web.strict_requests import IngestRoute
from server.service.web.workers import run

router = APIRouter(route_class=IngestRoute, tags=["live"])


class BenchCommand(Form):
    """A command for a bench."""

    model_config = ConfigDict(json_schema_extra={"example": {"command": "tare", "text": ""}})

    command: str = Field(min_length=1, max_length=40, description="One that the bench lists in its `keys`.")
    text: str = Field(default="", max_length=500, description="What belongs to it: a reason, a note, a known weight.")


class Done(Shown):
    """Command that the bench has carried out; its results follow as events."""

    schema_: Literal["fingertwin/bench-command/1"] = Field(
        default="fingertwin/bench-command/1", serialization_alias="schema"
    )
    session: str
    command: str


@router.post("/sessions/{session}/live", status_code=204, responses=documented(Shown, status=422))
async def show(session: SessionId, body: LiveMessage, request: Request) -> Response:
    """Show what a load cell says now: envelopes of some hundredths of a second. Nothing of it is kept."""
    parts = of(request)
    if not parts.live.is_shown(session):
        await run("ingest", parts.sessions.version, session)
    parts.live.trace(session, body)
    return Response(status_code=204)


@router.post("/sessions/{session}/bench/commands", responses=documented(Done))
async def command(session: SessionId, body: BenchCommand, request: Request) -> Done:
    """Let the bench that logs a session carry out a command, as if its key were pressed there.

    `keys` of the live stream's `bench` messages says which there are. What the bench refuses is answered as 409, with
    its reason. A command that cannot be handed over at once is not kept.
    """
    parts = of(request)
    await run("ingest", parts.sessions.version, session)
    await parts.live.benches.ask(session, body.command, body.text)
    return Done(session=session, command=body.command)


@router.websocket("/sessions/{session}/live")
async def bench(websocket: WebSocket, session: str) -> None:
    """Take what a bench says through a WebSocket: the messages of the post, and what it waits for."""
    token = websocket.scope.get("state", {}).get("token")
    if token is not None and token.role != "write":
        await refuse(websocket, ProblemError(403, f"the token {token.id} may only read", "one that may write"))
        return
    await websocket.accept()
    await take(of(websocket).live, websocket, session, _exists)


def _exists(connection: WebSocket, session: str) -> bool:
    try:
        of(connection).sessions.version(session)
    except ProblemError:
        return False
    return True


# Who may listen was settled by the guard before the route is reached.
router.include_router(live_router(lambda connection: of(connection).live, exists=_exists))
