"""WebSocket `/live`: access, subscriptions, and messages.

Every text frame is a JSON array of messages; each message is an object with `kind`.

- `hello`, first: `version`, `latest` (number of the last kept message), `after` (from where it goes on), what was asked
  for, `heartbeat_s`, and `live`: the streams that have a trace. `another_database` says that `asked_after` was never
  given here: what the client knows is of another database, and must be read anew; only what comes is told.
- Kept messages, with `id`, `session`, `created_utc` and `body`: `session`, `event`, `case`, `job`, `revision`. Each
  comes once and in order: first those after `after`, then those that come. A client that connects again gives the last
  `id`.
- `trace`: `session`, and in `body` the `stream` and one list for each column, an entry an envelope: `from_s`, `to_s`,
  `count`, `least`, `most`, `latest`, `mean` (Fx Fy Fz [N], Tx Ty Tz [N mm], the cell's axes; null where unknown) and
  `overload`. With `recent` true it is the last minutes, once, at the beginning.
- `estimate`: `session`, and in `body` what hangs now, five times a second while it hangs.
- `bench`: `session`, and in `body` what a running bench waits for (`connected`, `step`, `todo`, `phase`, `reason`,
  `suggested`, `closed`, `keys`) when that changes, and once at the beginning; with `connected` false it has gone.
- `dropped`: so many traces and estimates (`count`, and `total`) were not sent, as the client took too long.
- `resume`: the client took too long even for kept messages; the service hangs up, and `after` is where to go on.
- `heartbeat`, every few seconds: `latest`, and in `live` how long each stream has been silent.

Closed with: 4422 bad parameters, 4404 no such session, 1008 the client sent something, 1011 the service failed,
1012 it stops, 1013 too slow or too many clients. Refused before that, with a problem as the HTTP answer: 401 and 403 by
`allow`, 403 for a page of another host.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable

from fastapi import APIRouter
from starlette.requests import HTTPConnection
from starlette.websockets import WebSocket

from daq.errors import InputError
from server.service.live.clients import BAD_PARAMETERS, NOT_FOUND, Subscription, short_reason
from server.service.live.connection import serve
from server.service.live.hub import LiveHub
from server.service.web.problems import ProblemError, shortened
from server.service.web.wire import wire_of

PARAMETERS = ("session", "after", "rate_hz", "traces")
LEAST_HZ, MOST_HZ, USUAL_HZ = 1.0, 60.0, 30.0
MOST_SESSIONS = 50

Allow = Callable[[WebSocket], Awaitable[None]]
Exists = Callable[[WebSocket, str], bool]


async def anyone(_: WebSocket) -> None:
    """Let everybody in."""


def live_router(
    hub_of: Callable[[WebSocket], LiveHub], allow: Allow = anyone, exists: Exists | None = None
) -> APIRouter:
    """Return the route.

    Args:
        hub_of: returns the hub of the application that a connection belongs to.
        allow: raises a ProblemError (401, 403) where a connection may not read.
        exists: whether there is a session of an id; called in a thread. None lets any id be watched.
    """
    router = APIRouter()

    @router.websocket("/live")
    async def live(websocket: WebSocket) -> None:
        hub = hub_of(websocket)
        try:
            await allow(websocket)
        except ProblemError as problem:
            hub.counters.refused += 1
            await refuse(websocket, problem)
            return
        await websocket.accept()
        try:
            subscription, after = asked_for(websocket)
        except InputError as error:
            hub.counters.refused += 1
            await websocket.close(BAD_PARAMETERS, short_reason(str(error)))
            return
        for session in sorted(subscription.sessions or ()):
            if exists is not None and not await asyncio.to_thread(exists, websocket, session):
                hub.counters.refused += 1
                await websocket.close(NOT_FOUND, short_reason(f"there is no session {session}"))
                return
        wire = wire_of(websocket.scope)
        await serve(hub, websocket, subscription, after, None if wire is None else wire.write)

    return router


def asked_for(connection: HTTPConnection) -> tuple[Subscription, int | None]:
    """Return what a client wants to hear, and the last kept message that it saw.

    Raises:
        InputError: it cannot be understood.
    """
    given = connection.query_params
    for name in given:
        if name not in PARAMETERS:
            raise InputError(f"parameter {shortened(name)!r}", f"of {' '.join(PARAMETERS)}")
        if name != "session" and len(given.getlist(name)) > 1:
            raise InputError(f"{name} is given twice", "once")
    sessions = frozenset(given.getlist("session"))
    if len(sessions) > MOST_SESSIONS or any(not 0 < len(s) <= 100 for s in sessions):
        raise InputError(f"{len(sessions)} sessions", f"at most {MOST_SESSIONS}, each 1 to 100 characters")
    traces = given.get("traces", "own")
    if traces not in ("own", "all", "none"):
        raise InputError(f"traces={shortened(traces)}", "own (of the sessions that are named), all or none")
    wanted = traces == "all" or (traces == "own" and bool(sessions))
    return Subscription(sessions or None, wanted, _rate(given.get("rate_hz"))), _number(given.get("after"))


def _rate(text: str | None) -> float:
    try:
        rate = USUAL_HZ if text is None else float(text)
    except ValueError:
        rate = math.nan
    if not LEAST_HZ <= rate <= MOST_HZ:
        raise InputError(f"rate_hz={shortened(text)}", f"{LEAST_HZ:g} to {MOST_HZ:g}")
    return rate


def _number(text: str | None) -> int | None:
    if text is None:
        return None
    if not (text.isascii() and text.isdecimal() and len(text) <= 18):
        raise InputError(f"after={shortened(text)}", "the id of the last message that was seen, 0 for all")
    return int(text)


async def refuse(websocket: WebSocket, problem: ProblemError) -> None:
    """Answer with a problem instead of opening a WebSocket; with a code where the server knows no better way."""
    if "websocket.http.response" in websocket.scope.get("extensions", {}):
        await websocket.send_denial_response(problem.answer())
    else:
        await websocket.close(4000 + problem.status, short_reason(str(problem)))
