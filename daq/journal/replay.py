"""Replay of a journal: the bytes that a device sent, read by read, through the same decoder and the same clock."""

from __future__ import annotations

import heapq
import shutil
import tempfile
import time
import weakref
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from daq.acquisition.blocks import Chunk
from daq.drivers import driver
from daq.drivers.base import Decoder, LoadCell, Transport
from daq.errors import DriverError, LinkLostError
from daq.journal.check import require_complete
from daq.journal.reader import JournalReader
from daq.journal.rows import Stream
from daq.quoting import quoted

_MAGIC = b"SQLite format 3\x00"


def is_journal(path: str | Path) -> bool:
    """Return whether a file is a database such as a journal is."""
    try:
        with Path(path).open("rb") as file:
            return file.read(len(_MAGIC)) == _MAGIC
    except OSError:
        return False


class JournalFeed:
    """A transport that plays what was read from a device, as it was read.

    Attributes:
        arrival_s: when the last read arrived at the time [s].
    """

    def __init__(
        self,
        path: Path,
        stream: str,
        speed: float,
        clock: Callable[[], float] = time.monotonic,
        wait: Callable[[float], None] = time.sleep,
    ) -> None:
        """Play one stream.

        Args:
            path: of the journal.
            stream: its id.
            speed: times real time; 0 is as fast as it is read.
            clock: monotonic seconds.
            wait: sleeps.
        """
        self.arrival_s = 0.0
        self._speed, self._clock, self._wait = speed, clock, wait
        with JournalReader.open(path) as journal:
            self._broken_s = [e.at_s for e in journal.events(stream) if e.kind == "reconnected"]
        self._reads = _reads(path, stream)
        self._next: tuple[float, bytes] | None = None
        self._began: tuple[float, float] | None = None

    def write(self, data: bytes) -> None:
        """Ignore what is written: a journal hears nothing."""

    def read(self, timeout_s: float) -> bytes:
        """Return the next read when its time has come.

        Raises:
            LinkLostError: the connection was lost here, at the time.
            EOFError: the stream is over.
        """
        if self._next is None:
            self._next = next(self._reads, None)
            if self._next is None:
                raise EOFError
        arrival_s, data = self._next
        if self._broken_s and arrival_s >= self._broken_s[0]:
            self._broken_s.pop(0)
            raise LinkLostError("the connection was lost here when this was recorded")
        if self._speed:
            if self._began is None:
                self._began = (self._clock(), arrival_s)
            ahead = (arrival_s - self._began[1]) / self._speed - (self._clock() - self._began[0])
            if ahead > timeout_s:
                self._wait(timeout_s)
                return b""
            if ahead > 0.0:
                self._wait(ahead)
        self._next, self.arrival_s = None, arrival_s
        return data

    def close(self) -> None:
        """Close nothing: the stream goes on after a reconnection."""


def _reads(path: Path, stream: str) -> Iterator[tuple[float, bytes]]:
    """Yield (arrival [s], bytes) of every read."""
    with JournalReader.open(path) as journal:
        kinds = (journal.read(stream), journal.undecoded(stream))
        yield from heapq.merge(*(_reads_of(chunks) for chunks in kinds), key=lambda read: read[0])


def _reads_of(chunks: Iterable[Chunk]) -> Iterator[tuple[float, bytes]]:
    for chunk in chunks:
        at = 0
        for size, arrival_s in chunk.reads:
            yield arrival_s, chunk.raw[at : at + size]
            at += size


class JournalReplay(LoadCell):
    """A journalled stream as if it were read now, by the driver that read it.

    Args:
        path: of the journal.
        stream: its id, or the beginning of it; may be left out where there is one.
        speed: times real time; 0 is as fast as it goes.

    Raises:
        JournalError: there is no such journal, or none that is sound and complete.
        DriverError: there is no such stream, or its driver is gone.
    """

    name = "replay"
    title = "A journal's stream, byte for byte"
    link = "file"
    example = "fingertwin log --driver replay --port LOG/journal.sqlite3 --out DIR"
    source = "the journal"

    def __init__(self, path: str | Path, stream: str | None = None, speed: float = 1.0) -> None:
        super().__init__()
        if not 0.0 <= speed < 1e9:
            raise DriverError(f"replay: speed is {speed:g}", "0 (as fast as it goes) or more")
        self._path, self._speed = Path(path), speed
        require_complete(self._path)
        with JournalReader.open(self._path) as journal:
            known = journal.streams()
        streams = [s for s in known if s.id.startswith(stream or "")]
        if len(streams) != 1:
            ids = " ".join(s.id[:12] for s in streams or known) or "(it has none)"
            found = f"{len(streams)} streams" + (f" called {stream}" if stream else "") + f" in {self._path.name}"
            one = f"fingertwin log --driver replay --port {quoted(path)} --set stream=ID --out DIR"
            raise DriverError(found, "one", f"Play one with {one}; ID is one of {ids}")
        self.stream: Stream = streams[0]
        folder = tempfile.mkdtemp()
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        self._original = _recorded_by(self.stream, Path(folder))
        self.clock, self.checksum = self._original.clock, self._original.checksum
        self.held_back = self._original.held_back
        self.values = {"driver": self.stream.driver, **self._original.values}
        self._feed: JournalFeed | None = None

    @property
    def rate_hz(self) -> float | None:
        """Sampling rate of the device [Hz]."""
        return self._original.rate_hz

    def decoder(self) -> Decoder:
        """Return a fresh decoder of the device."""
        return self._original.decoder()

    def start(self, transport: Transport) -> None:
        """Start nothing: a journal plays when it is read."""

    def own_transport(self, port: str) -> Transport:
        """Open the stream; after a connection that was lost, go on with it."""
        if self._feed is None:
            self._feed = JournalFeed(self._path, self.stream.id, self._speed)
        return self._feed


def _recorded_by(stream: Stream, folder: Path) -> LoadCell:
    """Return the driver that read a stream, with its settings; a calibration file is written into a folder."""
    settings: dict[str, Any] = dict(stream.settings)
    name = str(settings.pop("driver")) if stream.driver == "replay" and "driver" in settings else stream.driver
    text = stream.cell.get("calibration_text")
    if text is None or "calibration" not in settings:
        return driver(name)(settings)
    # The file may have changed since, or be on another machine: what was used is in the journal.
    path = folder / Path(str(settings["calibration"])).name
    path.write_text(str(text), encoding="utf-8")
    return driver(name)({**settings, "calibration": str(path)})
