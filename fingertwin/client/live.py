"""What happens in the service, as it happens: messages of its WebSocket, resumed after every interruption."""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from urllib.parse import urlencode

from fingertwin.client.errors import ServiceError, ServiceUnreachableError
from fingertwin.client.exchange import AWAY, Body, Exchange, path_of, reading

if TYPE_CHECKING:
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import ClientConnection

# Closed with one of these, the service will not take the same connection again.
_REFUSED = {4422: 422, 4404: 404, 1008: 403}
_CONNECT_S, _CLOSE_S = 5.0, 1.0
# Between attempts to connect [s], and how long they go on without success.
_FIRST_PAUSE_S, _MOST_PAUSE_S, _PATIENCE_S = 0.25, 5.0, 60.0
# Without a heartbeat for so many of its periods, the connection is dead.
_MISSED_BEATS = 3
_USUAL_BEAT_S = 5.0
# Between the service and the client, and of no use to anybody else.
_INTERNAL = ("heartbeat", "resume")
_NEEDED = {"hello": ("after", "heartbeat_s")}
_MOST_BYTES = 64 << 20
# A lost connection is told by what it raises. Of a ping that failed with it, the library would print a traceback.
_QUIET = logging.getLogger(__name__)
_QUIET.addHandler(logging.NullHandler())


@dataclass(frozen=True, eq=False)
class Message:
    """Something that happened.

    Attributes:
        kind: hello (once connected), session, event, case, job, revision, trace, estimate or dropped.
        session: id of the session that it is about; None for what concerns several or none.
        id: number of a message that is kept; None for others. `live(after=…)` goes on after it.
        body: what happened.
        created_utc: when; None for messages that are not kept.
    """

    kind: str
    session: str | None
    id: int | None
    body: Body = field(repr=False)
    created_utc: str | None = None

    @classmethod
    def of(cls, told: Body) -> Message:
        """Of plain data."""
        body = told.get("body")
        rest = {k: v for k, v in told.items() if k not in ("kind", "session", "id")}
        return cls(
            told["kind"],
            told.get("session"),
            told.get("id"),
            body if isinstance(body, dict) else rest,
            told.get("created_utc"),
        )


def messages(
    exchange: Exchange, sessions: Sequence[str] = (), after: int | None = None
) -> Generator[Message, None, None]:
    """Yield messages; kept ones come each once and in order, also across interruptions.

    Args:
        exchange: with the service.
        sessions: that they are about; none of them means all, without traces.
        after: id of the last message that was seen; by default only what comes.

    Raises:
        ServiceError: the service refuses the connection.
        ServiceUnreachableError: nobody has answered for a minute.
    """
    from websockets.exceptions import ConnectionClosed as Closed

    heard_s = time.monotonic()
    while True:
        with _connected(exchange, sessions, after, heard_s + _PATIENCE_S) as socket:
            beat_s = _USUAL_BEAT_S
            try:
                while True:
                    frame = _frame(socket.recv(timeout=_MISSED_BEATS * beat_s))
                    heard_s = time.monotonic()
                    for told in frame:
                        after = told.get("id", after)
                        if told["kind"] == "hello":
                            after, beat_s = told["after"], float(told["heartbeat_s"])
                        if told["kind"] not in _INTERNAL:
                            yield Message.of(told)
            except Closed as error:
                _require_resumable(error)
                if time.monotonic() >= heard_s + _PATIENCE_S:
                    raise ServiceUnreachableError.of(exchange.url, error) from error
            except OSError:
                pass  # a dead connection; a new one goes on where this one was
        exchange.sleep(_FIRST_PAUSE_S)


def _frame(data: str | bytes) -> list[Body]:
    with reading("a live frame"):
        frame = json.loads(data)
        if not isinstance(frame, list):
            raise ValueError("no list of messages")
        lacking = [key for told in frame for key in _NEEDED.get(told["kind"], ()) if key not in told]
        if lacking:
            raise KeyError(lacking[0])
        return frame


@contextmanager
def _connected(
    exchange: Exchange, sessions: Sequence[str], after: int | None, until_s: float
) -> Iterator[ClientConnection]:
    """Connect, with patience for a service that is away for a moment."""
    from websockets.exceptions import InvalidHandshake, InvalidStatus
    from websockets.sync.client import connect

    query = [("session", name) for name in sessions] + ([] if after is None else [("after", str(after))])
    address = f"ws{exchange.url.removeprefix('http')}{path_of('live')}"
    pause_s = _FIRST_PAUSE_S
    while True:
        with ExitStack() as stack:
            try:
                connection = connect(
                    f"{address}?{urlencode(query)}" if query else address,
                    additional_headers=exchange.headers,
                    open_timeout=_CONNECT_S,
                    close_timeout=_CLOSE_S,
                    max_size=_MOST_BYTES,
                    logger=_QUIET,
                    proxy=None,
                )
                socket = stack.enter_context(connection)
            except InvalidStatus as error:
                if error.response.status_code not in AWAY or time.monotonic() >= until_s:
                    raise _refusal(error.response.status_code, error.response.body) from error
            except (OSError, InvalidHandshake) as error:
                if time.monotonic() >= until_s:
                    raise ServiceUnreachableError.of(exchange.url, error) from error
            else:
                yield socket
                return
        exchange.sleep(pause_s)
        pause_s = min(2.0 * pause_s, _MOST_PAUSE_S)


def _refusal(status: int, body: bytes | bytearray | None) -> ServiceError:
    try:
        problem = json.loads(body or b"")
    except ValueError:
        problem = None
    if isinstance(problem, dict):
        return ServiceError.of_problem(problem, status)
    return ServiceError(status, f"the live connection was answered with {status}", "the model service")


def _require_resumable(error: ConnectionClosed) -> None:
    code, reason = (0, "") if error.rcvd is None else (error.rcvd.code, error.rcvd.reason)
    if code in _REFUSED:
        raise ServiceError(_REFUSED[code], reason or f"the service closed the connection with {code}") from error
