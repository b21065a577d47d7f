"""Sockets without a network, and a hub on a database in a folder."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Coroutine, MutableMapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import numpy as np

from server.service.live.clients import Subscription
from server.service.live.connection import serve
from server.service.live.hub import LiveHub
from server.service.storage.database import Database
from server.service.storage.messages import Messages
from server.service.storage.schema import metadata

PATIENCE_S = 20.0
Told = dict[str, Any]


class FakeSocket:
    """Takes frames as fast as its gate is open."""

    def __init__(self) -> None:
        self.frames: list[list[Told]] = []
        self.closed: tuple[int, str | None] | None = None
        self.gate = asyncio.Event()
        self.gate.set()
        self.blocked = asyncio.Event()
        self._news = asyncio.Condition()
        self._incoming: asyncio.Queue[MutableMapping[str, Any]] = asyncio.Queue()

    async def send_text(self, data: str) -> None:
        if not self.gate.is_set():
            self.blocked.set()
        await self.gate.wait()
        async with self._news:
            self.frames.append(json.loads(data))
            self._news.notify_all()

    async def receive(self) -> MutableMapping[str, Any]:
        return await self._incoming.get()

    async def close(self, code: int = 1000, reason: str | None = None) -> None:
        async with self._news:
            self.closed = (code, reason)
            self._news.notify_all()

    def go(self) -> None:
        self._incoming.put_nowait({"type": "websocket.disconnect"})

    def say(self, text: str) -> None:
        self._incoming.put_nowait({"type": "websocket.receive", "text": text})

    def told(self, kind: str = "") -> list[Told]:
        return [m for frame in self.frames for m in frame if kind in ("", m["kind"])]

    def ids(self) -> list[int]:
        return [m["id"] for m in self.told() if "id" in m]

    async def until(self, met: Callable[[], object]) -> None:
        async with asyncio.timeout(PATIENCE_S), self._news:
            await self._news.wait_for(met)


class Served:
    """Connections to one hub."""

    def __init__(self, hub: LiveHub) -> None:
        self.hub = hub
        self._tasks: list[asyncio.Task[None]] = []

    async def connect(self, *sessions: str, after: int | None = None, rate_hz: float = 60.0) -> FakeSocket:
        """Connect, and wait until the client hears what is published."""
        heard = self._hearing()
        socket = self.begin(*sessions, after=after, rate_hz=rate_hz)
        async with asyncio.timeout(PATIENCE_S):
            while self._hearing() == heard:
                await asyncio.sleep(0)
        await socket.until(lambda: socket.told("hello"))
        return socket

    def begin(self, *sessions: str, after: int | None = None, rate_hz: float = 60.0) -> FakeSocket:
        """Connect."""
        socket, wanted = FakeSocket(), Subscription(frozenset(sessions) or None, bool(sessions), rate_hz)
        self._tasks.append(asyncio.create_task(serve(self.hub, socket, wanted, after)))
        return socket

    async def shown(self, envelopes: int) -> None:
        """Wait until the hub has taken so many envelopes."""
        async with asyncio.timeout(PATIENCE_S):
            while self.hub.counters.envelopes < envelopes:
                await asyncio.sleep(0.001)

    def _hearing(self) -> int:
        return self.hub._groups.clients

    async def gone(self) -> None:
        await asyncio.gather(*self._tasks)


def messages_in(folder: Path) -> Messages:
    database = Database(f"sqlite:///{folder / 'service.db'}")
    metadata.create_all(database.engine)
    return Messages(database)


def keep(messages: Messages, kind: str, session: str | None = "S", /, **body: Any) -> None:
    with messages.writing() as telling:
        telling.tell(kind, session, body)


@asynccontextmanager
async def hub_of(messages: Messages, **options: Any) -> AsyncIterator[Served]:
    hub = LiveHub(messages, **options)
    hub.start(asyncio.get_running_loop())
    served = Served(hub)
    try:
        yield served
    finally:
        await hub.close()
        await served.gone()


def posted(
    from_s: float, value: float = 0.0, stream: str = "a", dropped: int = 0, span_s: float = 0.02
) -> dict[str, Any]:
    """One envelope, as a bench posts it."""
    six = (value * np.arange(1.0, 7.0)).tolist()
    envelope = {
        "stream": stream, "from_s": from_s, "to_s": from_s + span_s, "count": 140, "latest": six, "least": six,
        "most": six, "mean": six, "overload": False,
    }  # fmt: skip
    return {"dropped": dropped, "envelopes": [envelope]}


Play = Callable[[Served, Messages], Coroutine[Any, Any, None]]


def played(folder: Path, play: Play, **options: Any) -> None:
    """Serve a hub on a database in a folder, and play something with it."""
    messages = messages_in(folder)

    async def run() -> None:
        async with hub_of(messages, **options) as served:
            await play(served, messages)

    asyncio.run(run())
