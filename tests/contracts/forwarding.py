"""A journal, its uplink and a receiver, and a wire between them on which whatever is wanted goes wrong."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from email.utils import format_datetime
from pathlib import Path
from typing import Any, ClassVar

import httpx

from daq.acquisition.blocks import Chunk
from daq.journal.writer import Event, Journal
from daq.uplink.thread import Uplink
from tests.contracts.ingest import URL, SmallReceiver, made


class KilledError(BaseException):
    """The bench's process ends here."""


class Wire:
    """A way to a receiver on which the next exchanges go wrong as they are told to.

    Attributes:
        faults: of the next exchanges, the first first.
        late: requests that got lost on the way and arrive another time.
    """

    def __init__(self, receiver: SmallReceiver) -> None:
        self.receiver = receiver
        self.faults: list[str] = []
        self.late: list[httpx.Request] = []
        self.refused: set[tuple[str, int]] = set()
        self.log: list[str] = []
        self.wall_s = 1.8e9

    def client(self) -> httpx.Client:
        return httpx.Client(base_url=URL, transport=httpx.MockTransport(self.handle))

    def handle(self, request: httpx.Request) -> httpx.Response:
        fault = self.faults.pop(0) if self.faults else ""
        self.log.append(f"{request.method} {'/'.join(request.url.path.split('/')[-2:])} {fault}".strip())
        if fault in self.ANSWERS:
            return self.ANSWERS[fault](self)
        if fault == "lost":
            raise httpx.ConnectError("no route")
        if fault == "late":
            self.late.append(request)
            raise httpx.ReadTimeout("no answer")
        if fault == "refused" and "/chunks/" in request.url.path:
            *_, stream, _, first = request.url.path.split("/")
            self.refused.add((stream, int(first)))
            return httpx.Response(422, json={"detail": "made up"})
        answer = self.receiver.handle(request)
        match fault:
            case "twice":
                return self.receiver.handle(request)
            case "unheard":
                raise httpx.ReadError("the connection was lost")
            case "500 after":
                return httpx.Response(500, text="after the commit")
            case "killed":
                raise KilledError
            case "receiver killed":
                self.receiver.restart()
                raise httpx.RemoteProtocolError("the connection was closed")
        return answer

    def arrive(self) -> None:
        """Bring what got lost on the way, the last first."""
        while self.late:
            self.receiver.handle(self.late.pop())

    def _dated(self) -> httpx.Response:
        now = datetime.fromtimestamp(self.wall_s, tz=UTC)
        until = datetime.fromtimestamp(self.wall_s + 20.0, tz=UTC)
        headers = {"Retry-After": format_datetime(until, usegmt=True), "Date": format_datetime(now, usegmt=True)}
        return httpx.Response(503, headers=headers)

    ANSWERS: ClassVar[dict[str, Callable[[Any], httpx.Response]]] = {
        "429": lambda _: httpx.Response(429, headers={"Retry-After": "7"}),
        "503": _dated,
        "408": lambda _: httpx.Response(408),
        "425": lambda _: httpx.Response(425),
        "500": lambda _: httpx.Response(500),
        "302": lambda _: httpx.Response(302, headers={"Location": "http://elsewhere/login"}),
        "login page": lambda _: httpx.Response(200, text="<html>Please log in</html>"),
    }


FAULTS = sorted([*Wire.ANSWERS, "lost", "late", "twice", "unheard", "500 after", "killed", "receiver killed"])


class Bench:
    """A journal with its uplink, whose time passes only when it waits."""

    def __init__(self, folder: Path) -> None:
        self.receiver = SmallReceiver(folder / "service.db")
        self.session = self.receiver.new_session()
        self.wire = Wire(self.receiver)
        self.path = folder / "bench.journal"
        self.now_s = 0.0
        Journal.create(self.path, "bench", 0).close()
        self.open()

    def open(self) -> None:
        self.journal = Journal.open(self.path, 0)
        self.uplink = Uplink(
            self.journal,
            URL,
            self.session,
            client=self.wire.client(),
            clock=lambda: self.now_s,
            wall=lambda: self.wire.wall_s - 1e6,
            chance=lambda: 0.5,
        )

    def kill(self) -> None:
        """End as a killed process does: nothing is said to anyone."""
        self.uplink.stop()
        self.journal._connection.close()
        self.journal._writer_lock.close()

    def step(self) -> float:
        """Make a step of the uplink, and open all again where that killed it."""
        try:
            wait_s = self.uplink.step()
        except KilledError:
            self.kill()
            self.open()
            return 0.0
        self.now_s += wait_s
        return wait_s

    def until(self, condition: Callable[[], object], fault: str | None = "", steps: int = 200) -> None:
        """Step until something is so, each time with a fault; with None, with those that are set already."""
        for _ in range(steps):
            if condition():
                return
            if fault is not None:
                self.wire.faults = [fault]
            self.step()
        raise AssertionError(f"never so: {self.uplink.status()}")

    def settle(self, steps: int = 2000) -> None:
        """Let the uplink come to rest."""
        quiet = 0
        for _ in range(steps):
            self.step()
            quiet = quiet + 1 if self.uplink.status().caught_up and not self.uplink.status().problem else 0
            # Events are looked for less often than chunks.
            if quiet > 8:
                return
        raise AssertionError(f"not at rest: {self.uplink.status()}")

    def outbox(self, state: str) -> set[tuple[str, int]]:
        rows = self.journal._rows("SELECT stream, first_seq FROM outbox WHERE state = ?", state)
        return {(stream, first) for stream, first in rows}

    def at_receiver(self, stream: str) -> list[Chunk]:
        return [Chunk.from_bytes(p) for p in self.receiver.stored(self.session, stream)]

    def close(self) -> None:
        self.uplink.stop()
        self.journal.close()
        self.receiver.close()


def fill(bench: Bench, chunks: int, count: int = 40) -> str:
    stream = bench.journal.add_stream("made", {"rate_hz": 1000.0}, {"serial": "1"})
    for i in range(chunks):
        bench.journal.append(stream, made(i * count, count), [Event("mark", float(i), {"i": i})])
    return stream


def joined(chunks: list[Chunk]) -> list[tuple[Any, ...]]:
    """What some chunks say, however they are parted: each sample, each read, and the bytes."""
    samples = [
        (c.first_seq + i, c.t_s[i], *c.wrench[i], int(c.status[i]), bool(c.overload[i]))
        for c in chunks
        for i in range(len(c))
    ]
    reads = [tuple(r) for c in chunks for r in c.reads]
    raw = b"".join(c.raw for c in chunks)
    return [*samples, *reads, (raw, sum(c.rejected for c in chunks), sum(c.skipped for c in chunks))]
