"""What the benchmarks of the uplink share: devices and a receiver in processes of their own, watched from outside.

A device's Fx is the time since its first reading [s], so that whoever reads it can tell how old it is: all processes of
a machine share the monotonic clock.
"""

from __future__ import annotations

import multiprocessing
import os
import sqlite3
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import describe_machine
from tests.contracts.ingest import SmallReceiver

SETTINGS = {"counts_per_N": 1e6, "counts_per_Nmm": 1e3, "buffered": "yes"}
BLOCK_S = 2.0
CATCH_UP_S = 120.0


def stamped(rate_hz: float, seconds: float) -> Iterator[Any]:
    """Blocks of readings whose Fx is their time [s]; the other axes a slow wave."""
    from daq.recordings.readings import ReadingBlock

    n = int(BLOCK_S * rate_hz)
    for k in range(int(seconds / BLOCK_S) + 2):
        t_s = (k * n + np.arange(n)) / rate_hz
        wrench = np.outer(np.sin(t_s), np.arange(1.0, 7.0))
        wrench[:, 0] = t_s
        yield ReadingBlock(t_s, wrench)


def play(end: Connection, rate_hz: float, seconds: float) -> None:
    """A device's process: says where it listens and when its first reading was, and plays until it is told to end."""
    from daq.standins import stand_in
    from daq.standins.run import Player
    from daq.standins.wires import UdpWire

    first: list[float] = []

    def clock() -> float:
        now = time.monotonic()
        first.append(now) if not first else None
        return now

    wire = UdpWire()
    player = Player(stand_in("ati-netft")(), wire, stamped(rate_hz, seconds), clock=clock)
    end.send((wire.address, first[0]))
    player.run(end.poll)
    wire.close()


def receive(end: Connection, path: Path, sessions: int, port: int) -> None:
    """The receiver's process: the small one of the tests, on its file."""
    from tests.contracts.ingest import serving

    receiver = QuickReceiver(path)
    arrived = Arrivals()
    receiver.lives = arrived
    names = [receiver.new_session() for _ in range(sessions)]
    with serving(receiver.handle, port) as url:
        end.send((url, names))
        end.recv()
    end.send(arrived.seen)
    receiver.close()


class QuickReceiver(SmallReceiver):
    """The tests' receiver, but for one thing: it lists only what lies behind the whole part of a stream.

    Otherwise each answer would take the longer, the longer the stream is.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._whole: dict[tuple[str, str], int] = {}

    def _cursor(self, session: str, stream: str) -> dict[str, Any]:
        query = "SELECT next_seq, ended, epoch FROM streams WHERE session = ? AND id = ?"
        rows = self._rows(query, session, stream)
        if not rows:
            return super()._cursor(session, stream)  # which says so
        next_seq, ended, epoch = rows[0]
        whole, missing, at = self._whole.get((session, stream), 0), [], 0
        query = "SELECT first_seq, n FROM chunks WHERE session = ? AND stream = ? AND first_seq >= ? ORDER BY first_seq"
        for first, count in self._rows(query, session, stream, whole):
            if first == whole:
                whole += count
            at = max(at, whole)
            if first > at:
                missing.append([at, first])
            at = max(at, first + count)
        self._whole[session, stream] = whole
        return {"next_seq": next_seq, "missing": missing, "ended": bool(ended), "epoch": epoch}


class Arrivals(list[Any]):
    """What the receiver's live view shows, as far as it matters here: ages, not everything that ever came.

    Attributes:
        seen: (moment of arrival [monotonic s], Fx of the first and of the last reading, their number) of each envelope.
    """

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[tuple[float, float, float, int]] = []

    def append(self, post: Any) -> None:
        """Take what one post says."""
        now = time.monotonic()
        self.seen += [(now, e["least"][0], e["latest"][0], e["count"]) for e in post["envelopes"]]


@contextmanager
def started(target: Any, *given: Any) -> Iterator[tuple[SpawnProcess, Connection, Any]]:
    """A process, the way to it, and what it said first; whatever it is sent ends it."""
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=target, args=(theirs, *given), daemon=True)
    process.start()
    theirs.close()
    try:
        yield process, ours, ours.recv()
    finally:
        if process.is_alive():
            ours.close()
            process.join(2.0)
            process.kill()
        process.join(10.0)


@dataclass(frozen=True)
class Usage:
    """Of a process at a moment.

    Attributes:
        at_s: monotonic.
        used_s: processor time.
        mib: resident memory.
    """

    at_s: float
    used_s: float
    mib: float


def usage(pid: int) -> Usage:
    """How much a process has used by now (Linux)."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    ticks = int(fields[11]) + int(fields[12])
    return Usage(time.monotonic(), ticks / os.sysconf("SC_CLK_TCK"), pages * os.sysconf("SC_PAGE_SIZE") / 2**20)


def share(course: list[Usage]) -> float:
    """Share of one core between the first and the last look [%]."""
    return 100.0 * (course[-1].used_s - course[0].used_s) / (course[-1].at_s - course[0].at_s)


@dataclass(frozen=True)
class Compared:
    """A journal and what arrived of it.

    Attributes:
        kept: samples in the journal.
        arrived: samples at the receiver.
        lost: samples that never arrived.
        doubled: samples that arrived twice.
        different: chunks that are not byte for byte as they were kept.
        events_lost: events of the journal that never arrived.
        events_doubled: events that arrived twice.
    """

    kept: int
    arrived: int
    lost: int
    doubled: int
    different: int
    events_lost: int
    events_doubled: int

    @property
    def sound(self) -> bool:
        """Whether all is there once and as it was."""
        return self.kept == self.arrived and not (
            self.lost or self.doubled or self.different or self.events_lost or self.events_doubled
        )


def compared(journal: Path, received: Path, session: str) -> Compared:
    """Compare a journal with the receiver's file, sample by sample and byte by byte."""
    from daq.acquisition.blocks import Chunk
    from daq.journal.reader import JournalReader
    from daq.uplink.events import encoded

    kept = arrived = lost = doubled = different = 0
    with closing(sqlite3.connect(received)) as there, JournalReader.open(journal) as here:
        for stream in here.streams():
            bodies: dict[int, bytes] = {}
            count = np.zeros(here.next_seq(stream.id), dtype=np.int64)
            query = "SELECT payload FROM chunks WHERE session = ? AND stream = ? ORDER BY first_seq"
            for (payload,) in there.execute(query, (session, stream.id)):
                chunk = Chunk.from_bytes(payload)
                bodies[chunk.first_seq] = payload
                count[chunk.first_seq : chunk.next_seq] += 1
                arrived += len(chunk)
            for chunk in here.read(stream.id):
                kept += len(chunk)
                different += bodies.get(chunk.first_seq) != chunk.to_bytes()
            lost += int((count == 0).sum())
            doubled += int((count > 1).sum())
        said = Counter(encoded(event).decode() for event in here.events())
        query = "SELECT body FROM events WHERE session = ?"
        heard = Counter(row[0] for row in there.execute(query, (session,)))
    events = ((said - heard).total(), (heard - said).total())
    return Compared(kept, arrived, lost, doubled, different, *events)


def caught_up(journal: Path, url: str, session: str) -> float:
    """Send what a log left, as the next one would; return how long it took [s], infinity where it did not end."""
    from daq.journal.writer import Journal
    from daq.uplink.thread import Uplink

    began = time.monotonic()
    with closing(Journal.open(journal)) as kept:
        uplink = Uplink(kept, url, session)
        uplink.start()
        done = uplink.flush(CATCH_UP_S)
        uplink.stop()
    return time.monotonic() - began if done else float("inf")


def waiting(journal: Path) -> int:
    """Readings of a journal that are not acknowledged."""
    with closing(sqlite3.connect(journal.resolve().as_uri() + "?mode=ro", uri=True)) as connection:
        query = "SELECT ifnull(sum(c.n), 0) FROM chunks c JOIN outbox o ON o.id = c.id WHERE o.state != 'sent'"
        return int(connection.execute(query).fetchone()[0])


def surroundings() -> str:
    """Machine and load, for a result file."""
    load = ", ".join(f"{x:.1f}" for x in os.getloadavg())
    machine = describe_machine().replace(", of which one is used", "")
    return f"{machine}. Load average of the last 1, 5 and 15 minutes before: {load}."
