"""File replay and the simulated cell: readings that exist already, streamed as a device would.

A row goes over the "wire" as 72 little-endian bytes with a checksum of their own, so that a log of a replay is a log
like any other: raw bytes, decoded again to the same numbers.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.drivers.base import LoadCell, Samples, Setting, Transport, samples
from daq.drivers.frames import FrameStream
from daq.errors import DriverError, ReadingsError
from daq.recordings.readings import ReadingBlock, open_readings
from daq.recordings.windows import require_increasing
from daq.sessions import read_session, session_names

HEADER = b"FTRW"
# Header, check of the eight words after it, time, six components, status.
ROW = np.dtype([("header", "S4"), ("check", "<u4"), ("t_s", "<f8"), ("wrench", "<f8", (6,)), ("status", "<i8")])
# Odd numbers: each word's weight in the check (a multiplicative hash, quick over a million rows).
_WEIGHTS = np.array([0x9E3779B97F4A7C15 * (2 * k + 1) % 2**64 | 1 for k in range(8)], dtype=np.uint64)
# A stream hands rows on in portions of so many seconds.
PORTION_S = 0.02
# Of a replay as fast as it goes.
PORTION_ROWS = 4096


def rows_of(block: ReadingBlock) -> bytes:
    """Write readings as rows of the wire."""
    table = np.zeros(len(block), dtype=ROW)
    table["header"], table["t_s"], table["wrench"] = HEADER, block.t_s, block.wrench
    if block.status is not None:
        table["status"] = block.status
    table["check"] = _check(table.view("<u8").reshape(len(block), 9))
    return table.tobytes()


def _check(words: NDArray[np.uint64]) -> NDArray[np.uint32]:
    """Return the check of rows as words (n, 9), the first of which holds it."""
    mixed = (words[:, 1:] * _WEIGHTS).sum(axis=1, dtype=np.uint64)
    return (mixed >> np.uint64(32)).astype(np.uint32)


def _valid(frames: NDArray[np.uint8]) -> NDArray[np.bool_]:
    rows = np.ascontiguousarray(frames)
    return np.asarray(_check(rows.view("<u8").reshape(len(rows), 9)) == rows.view(ROW).reshape(-1)["check"])


class RowDecoder:
    """Rows of the wire back to readings; the time is the recording's own."""

    def __init__(self) -> None:
        self._stream = FrameStream(ROW.itemsize, HEADER, _valid)

    def feed(self, data: bytes) -> Samples:
        """Take bytes and return the readings that they complete."""
        found = self._stream.feed(data)
        table = np.ascontiguousarray(found.frames).view(ROW).reshape(-1)
        return samples(
            table["wrench"].astype(np.float64),
            table["status"].astype(np.int64),
            # A status that is not 0 may say anything; only what the device called an overload is one.
            device_s=table["t_s"].astype(np.float64),
            rejected=found.rejected,
            skipped=found.skipped,
        )


def _rising(blocks: Iterable[ReadingBlock], file: str) -> Iterator[ReadingBlock]:
    """Pass readings on as long as their time rises.

    Raises:
        ReadingsError: it does not go on; all before that has been passed on.
    """
    rows, last_s = 0, -np.inf
    for block in blocks:
        if not len(block):
            continue
        sound = int(np.argmin(np.append(np.diff(block.t_s, prepend=last_s) > 0.0, False)))
        if sound < len(block):
            if sound:
                status = None if block.status is None else block.status[:sound]
                yield ReadingBlock(block.t_s[:sound], block.wrench[:sound], status)
            require_increasing(block.t_s, last_s, rows, file)
        yield block
        rows, last_s = rows + len(block), float(block.t_s[-1])


class Feed:
    """A transport that plays readings: in their own time, faster, or as fast as they are read."""

    def __init__(
        self,
        blocks: Iterable[ReadingBlock],
        speed: float,
        clock: Callable[[], float] = time.monotonic,
        wait: Callable[[float], None] = time.sleep,
    ) -> None:
        """Play blocks of readings.

        Args:
            blocks: in order of time.
            speed: times real time; 0 is as fast as it goes.
            clock: monotonic seconds.
            wait: sleeps.
        """
        self._portions = self._cut(blocks, speed)
        self._speed, self._clock, self._wait = speed, clock, wait
        self._began: float | None = None
        self._next: tuple[float, bytes] | None = None
        self._first_s: float | None = None

    @staticmethod
    def _cut(blocks: Iterable[ReadingBlock], speed: float) -> Iterator[tuple[float, bytes]]:
        for block in blocks:
            if speed:
                edges = np.flatnonzero(np.diff(np.floor(block.t_s / (PORTION_S * speed)))) + 1
            else:
                edges = np.arange(PORTION_ROWS, len(block), PORTION_ROWS)
            for a, b in zip([0, *edges], [*edges, len(block)], strict=True):
                status = None if block.status is None else block.status[a:b]
                yield float(block.t_s[b - 1]), rows_of(ReadingBlock(block.t_s[a:b], block.wrench[a:b], status))

    def write(self, data: bytes) -> None:
        """Ignore what is written: a recording hears nothing."""

    def read(self, timeout_s: float) -> bytes:
        """Return the next portion when its time has come.

        Raises:
            EOFError: the recording is over.
        """
        if self._next is None:
            self._next = next(self._portions, None)
            if self._next is None:
                raise EOFError
        at, data = self._next
        if self._speed:
            if self._began is None or self._first_s is None:
                self._began, self._first_s = self._clock(), at
            ahead = (at - self._first_s) / self._speed - (self._clock() - self._began)
            if ahead > timeout_s:
                self._wait(timeout_s)
                return b""
            if ahead > 0.0:
                self._wait(ahead)
        self._next = None
        return data

    def close(self) -> None:
        """Close nothing: nothing is held open."""


class Replay(LoadCell):
    """A recorded session, or a readings file, as if it were read now."""

    name = "replay"
    title = "A recording: a session's readings, or a readings file"
    link = "file"
    settings = (Setting("speed", "times real time; 0 is as fast as it goes", 1.0),)
    example = "fingertwin log --driver replay --port readings.csv.gz --protocol levels --out DIR"
    source = "readings files of bench-session/1"
    checksum = True
    clock = "recording"

    @property
    def rate_hz(self) -> float | None:
        """The recording's own times count."""
        return None

    def decoder(self) -> RowDecoder:
        """Return a fresh decoder."""
        return RowDecoder()

    def start(self, transport: Transport) -> None:
        """Start nothing: a recording plays when it is read."""

    def own_transport(self, port: str) -> Transport:
        """Open a readings file, or a session: its folder, or a shipped one by name."""
        path = Path(port)
        shipped = not path.exists() and port in session_names()
        if shipped or path.is_dir() or path.name == "session.yaml":
            session = read_session(path)
            if session.readings_path is None:
                raise DriverError(f"session {session.id} has no readings", "a session with raw readings to replay")
            path = session.readings_path
        if self.number("speed") < 0.0:
            raise DriverError(f"{self.name}: speed is {self.number('speed'):g}", "0 or more")
        try:
            return Feed(_rising(open_readings(path).blocks(), path.name), self.number("speed"))
        except ReadingsError as error:
            raise DriverError(error.found, error.expected, error.remedy) from error
