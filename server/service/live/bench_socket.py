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
from server.service.live.clients import BAD_PARAMETERS, NOT_FOUND, RESTART
from server.service.live.hub import HEARTBEAT_S, TRUSTED_S, LiveHub
from server.service.live.route import Exists


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
    try:
        with suppress(WebSocketDisconnect, WebSocketDisconnected):
            await _hear(hub, socket, bench, exists)
    finally:
        asking.cancel()
        hub.benches.leave(bench)


async def _hear(hub: LiveHub, socket: WebSocket, bench: Bench, exists: Exists) -> None:
    trusted_until_s = 0.0
    while True:
        text = await socket.receive_text()
        if time.monotonic() > trusted_until_s:
            if not await asyncio.to_thread(exists, socket, bench.session):
                await socket.close(NOT_FOUND, f"there is no session {bench.session}"[:120])
                return
            trusted_until_s = time.monotonic() + TRUSTED_S
        try:
            message = BenchMessage.model_validate_json(text)
        except ValidationError as error:
            await socket.close(BAD_PARAMETERS, f"a message with {error.error_count()} faults")
            return
        hub.trace(bench.session, message)
        if message.bench is not None:
            hub.benches.show(bench, message.bench)
        for answer in message.answers:
            hub.benches.answered(bench, answer)


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
