"""One client's connection: greeted, told what it missed, shown the last minutes, and then whatever is due."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, MutableMapping
from importlib.metadata import version
from typing import Any, Protocol

from starlette.websockets import WebSocketDisconnect, WebSocketDisconnected

from server.service.answers import dumps
from server.service.live.clients import FAILED, POLICY, RESTART, TRY_AGAIN, Client, Frame, Kept, Subscription, array
from server.service.live.groups import encoded_trace
from server.service.live.hub import HEARTBEAT_S, LiveHub
from server.service.live.traces import Rows

MOST_CLIENTS = 100
# Kept messages that are read at once for a client that missed them.
PAGE = 500
_LOG = logging.getLogger(__name__)

Write = Callable[[bytes], bool]


class Socket(Protocol):
    """An accepted WebSocket."""

    async def send_text(self, data: str) -> None:
        """Send a frame."""

    async def receive(self) -> MutableMapping[str, Any]:
        """Return what the client sent, or that it went."""

    async def close(self, code: int = 1000, reason: str | None = None) -> None:
        """Hang up."""


async def serve(
    hub: LiveHub, socket: Socket, subscription: Subscription, after: int | None, write: Write | None = None
) -> None:
    """Tell a client what it wants to hear until it goes, or until the hub closes.

    Args:
        hub: that hands on.
        socket: accepted.
        subscription: what the client wants to hear.
        after: number of the last kept message that it saw; None where it wants only what comes.
        write: writes a whole frame to the socket at once, False where it would have to wait; None where none can be.
    """
    if hub.closed or hub.clients >= MOST_CLIENTS:
        hub.counters.refused += 1
        reason = "the service stops" if hub.closed else f"{MOST_CLIENTS} clients are connected: try again later"
        await socket.close(RESTART if hub.closed else TRY_AGAIN, reason)
        return

    def write_now(frame: Frame) -> bool:
        done = write is not None and write(frame.wire)
        if done:
            hub.counters.sent(frame.text)
        return done

    client = Client(subscription, 0, write_now)
    telling = asyncio.create_task(_tell(hub, socket, client, after))
    hearing = asyncio.create_task(_hear(socket, client))
    hub.connect(client, telling)
    both = {telling, hearing}
    try:
        await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
    finally:
        hub.leave(client)
        for task in both:
            task.cancel()
        ended, _ = await asyncio.wait(both)
        for task in ended:
            if not task.cancelled() and (error := task.exception()) is not None:
                _LOG.warning("a live client was given up: %s: %s", type(error).__name__, error)


async def _hear(socket: Socket, client: Client) -> None:
    while (await socket.receive())["type"] != "websocket.disconnect":
        client.close(POLICY, "nothing is expected from a client")


async def _tell(hub: LiveHub, socket: Socket, client: Client, after: int | None) -> None:
    async def send(text: str) -> None:
        await socket.send_text(text)
        hub.counters.sent(text)

    try:
        hub.catch_up()
        # A number that was never given here is another database's.
        known = after is None or after <= hub.last
        client.after = after if after is not None and known else hub.last
        await send(array([_hello(hub, client, after, known)]))
        while client.after < hub.last and client.closing is None:
            missed, client.after = await asyncio.to_thread(_missed, hub, client, hub.last)
            if missed:
                await send(missed)
        # Nothing can be told between the last look and joining.
        past = hub.join(client)
        benches = hub.benches.shown(client.subscription.sessions)
        if benches:
            await send(array([dumps(b) for b in benches]))
        if past:
            await send(await asyncio.to_thread(_shown, past))
        while True:
            while (text := client.take()) is not None:
                await send(text)
            if client.closing is not None:
                await socket.close(*client.closing)
                return
            await client.wait()
    except (WebSocketDisconnect, WebSocketDisconnected):
        pass  # it went
    except Exception as error:
        _LOG.warning("a live client was given up: %s: %s", type(error).__name__, error)
        await socket.close(FAILED, "the service could not read its messages: try again")


def _hello(hub: LiveHub, client: Client, after: int | None, known: bool) -> bytes:
    wanted = client.subscription
    return dumps(
        {
            "kind": "hello",
            "version": version("fingertwin"),
            "latest": hub.last,
            "after": client.after,
            "another_database": not known,
            "asked_after": after,
            "sessions": None if wanted.sessions is None else sorted(wanted.sessions),
            "traces": wanted.traces,
            "rate_hz": wanted.rate_hz,
            "heartbeat_s": HEARTBEAT_S,
            "live": hub.live(wanted),
        }
    )


def _missed(hub: LiveHub, client: Client, upto: int) -> tuple[str, int]:
    """Return a page of kept messages as a frame, empty where none is wanted, and how far it goes."""
    sessions = client.subscription.sessions
    only = next(iter(sessions)) if sessions is not None and len(sessions) == 1 else None
    stored = hub.messages.after(client.after, only, PAGE)
    found = [Kept.of(m) for m in stored if m.id is not None and m.id <= upto and client.subscription.wants(m.session)]
    reached = upto if len(stored) < PAGE or stored[-1].id is None else min(stored[-1].id, upto)
    return (array([k.text for k in found]) if found else ""), reached


def _shown(past: list[tuple[str, str, Rows]]) -> str:
    return array([encoded_trace(session, stream, rows, recent=True) for session, stream, rows in past])
