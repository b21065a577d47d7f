"""A bench's own WebSocket: envelopes and what it waits for come in, commands go out."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress

from pydantic import ValidationError
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketDisconnected

from server.service.answers import dumps
from server.service.live.benches import Bench
from server.service.live.bodies import BenchMessage
from server.service.live.clients import BAD_PARAMETERS, NOT_FOUND, RESTART, short_reason
from server.service.live.hub import HEARTBEAT_S, TRUSTED_S, LiveHub
from server.service.live.route import Exists
from server.service.web.wire import wire_of


async def take(hub: LiveHub, socket: WebSocket, session: str, exists: Exists) -> None:
    """Take what a bench says until it goes.

    Args:
        hub: that hands it on.
        socket: accepted.
        session: that the bench logs.
        exists: whether there is a session of an id; called in a thread.
    """
    if hub.closed:
        await socket.close(RESTART, "the service stops")
        return
    bench = hub.benches.connect(session)
    asking = asyncio.create_task(_ask(socket, bench))
    hearing = _Hearing(hub, socket, bench, exists)
    wire = wire_of(socket.scope)
    if wire is not None:
        wire.listen(hearing.at_once)
    try:
        with suppress(WebSocketDisconnect, WebSocketDisconnected):
            await hearing.hear()
    finally:
        asking.cancel()
        hub.benches.leave(bench)


class _Hearing:
    """Hears one bench."""

    def __init__(self, hub: LiveHub, socket: WebSocket, bench: Bench, exists: Exists) -> None:
        self._hub, self._socket, self._bench, self._exists = hub, socket, bench, exists
        self._trusted_until_s = 0.0
        self._idle = False

    async def hear(self) -> None:
        """Take messages that wait to be received, until the bench goes or says what cannot be understood."""
        while True:
            self._idle = True
            try:
                message = await self._socket.receive()
            finally:
                self._idle = False
            if message["type"] == "websocket.disconnect":
                return
            text = message.get("text")
            if text is None:
                await self._socket.close(BAD_PARAMETERS, "a message that is no text")
                return
            if time.monotonic() > self._trusted_until_s:
                if not await asyncio.to_thread(self._exists, self._socket, self._bench.session):
                    await self._socket.close(NOT_FOUND, short_reason(f"there is no session {self._bench.session}"))
                    return
                self._trusted_until_s = time.monotonic() + TRUSTED_S
            try:
                self._take(text)
            except ValidationError as error:
                await self._socket.close(BAD_PARAMETERS, f"a message with {error.error_count()} faults")
                return

    def at_once(self, text: str) -> bool:
        """Take a message as it comes; return False where it has to wait for another, or for what must be asked."""
        if not self._idle or time.monotonic() > self._trusted_until_s:
            return False
        try:
            self._take(text)
        except ValidationError:
            return False
        return True

    def _take(self, text: str) -> None:
        message = BenchMessage.model_validate_json(text)
        self._hub.trace(self._bench.session, message)
        if message.bench is not None:
            self._hub.benches.show(self._bench, message.bench)
        for answer in message.answers:
            self._hub.benches.answered(self._bench, answer)


async def _ask(socket: WebSocket, bench: Bench) -> None:
    """Hand on commands; between them something empty, so that a token that is no longer valid is noticed."""
    with suppress(WebSocketDisconnect, WebSocketDisconnected):
        while True:
            try:
                async with asyncio.timeout(HEARTBEAT_S):
                    command = await bench.outgoing.get()
            except TimeoutError:
                command = {}
            await socket.send_text(dumps(command).decode())
