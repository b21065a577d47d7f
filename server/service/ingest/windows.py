"""Windows of a session, reduced from the readings that are stored, as soon as they are all there."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from sqlalchemy import ColumnElement, Connection, Row, func, select

from daq.checks import RecordingScan
from daq.errors import OutsideError, ReadingsError
from daq.recordings.plateaus import Plateau
from daq.recordings.readings import ReadingBlock
from daq.recordings.windows import Span, gather, outside
from server.service.ingest.stored import (
    STORED,
    body_of_event,
    chunk_of,
    ends_of,
    event_of,
    in_stream,
    places_of,
    stream_row,
)
from server.service.storage.checksums import DamagedError
from server.service.storage.database import Database
from server.service.storage.schema import chunks, events
from server.service.web.workers import require_client

_MOST_CACHED, _MOST_SCANS = 20_000, 64
# So many windows are read in one pass over the whole stream, instead of by a look-up each.
_MANY = 16
_WHERE = "the stored readings"
_Key = tuple[str, str, Span]


@dataclass(frozen=True, eq=False)
class Reduced:
    """Reduction of a session's windows."""

    plateaus: dict[Span, Plateau] = field(default_factory=dict)  # those that could be reduced
    # Those whose readings are not all there yet, and what is missing.
    waiting: dict[Span, str] = field(default_factory=dict)
    failed: dict[Span, ReadingsError] = field(default_factory=dict)  # those that cannot be reduced, and why

    def take(self, window: Span, end: Plateau | ReadingsError | str) -> None:
        """Take what has become of a window; words say what is missing of it."""
        if isinstance(end, Plateau):
            self.plateaus[window] = end
        elif isinstance(end, ReadingsError):
            self.failed[window] = end
        else:
            self.waiting[window] = end


@dataclass(eq=False)
class _Scanned:
    """A stream as far as it was looked at."""

    scan: RecordingScan
    lock: threading.Lock = field(default_factory=threading.Lock)


class Windows:
    """Reduces windows, scans streams, and remembers both: readings that are stored never change.

    Args:
        database: that holds the readings.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self._known: OrderedDict[_Key, Plateau | ReadingsError] = OrderedDict()
        self._scans: OrderedDict[tuple[str, str, bytes], _Scanned] = OrderedDict()
        self._lock = threading.Lock()

    def reduce(self, session: str, stream: str | None, windows: Mapping[Span, str]) -> Reduced:
        """Reduce windows of a stream.

        Args:
            session: that the stream belongs to.
            stream: None where the session has none: all windows wait.
            windows: [start, end] in s, and a name for messages.
        """
        out = Reduced()
        new = []
        for window in windows:
            with self._lock:
                found = self._known.get((session, stream or "", window))
            if found is None:
                new.append(window)
            else:
                out.take(window, found)
        if new:
            with self._database.reading() as connection:
                state = None if stream is None else stream_row(connection, session, stream)
                if stream is None or state is None:
                    return replace(out, waiting=dict.fromkeys(new, "no readings are there yet"))
                whole = state.held == state.next_seq and (state.ended or _log_ended(connection, session, state))
                if whole and self._together(connection, session, stream, {w: windows[w] for w in new}, out):
                    return out
                for window in new:
                    out.take(window, self._end(connection, (session, stream, window), windows[window], whole))
        return out

    def one(self, session: str, stream: str | None, window: Span) -> Plateau | None:
        """Reduce a window where all its readings are there."""
        return self.reduce(session, stream, {window: "window"}).plateaus.get(window)

    def scan(self, session: str, stream: str, begun: RecordingScan) -> RecordingScan:
        """Look at a stream as a whole, at each of its readings once.

        Args:
            session: that the stream belongs to.
            stream: of readings; those behind a hole, or behind a damaged chunk, are not looked at yet.
            begun: a scan to begin with, where none is known.
        """
        key = session, stream, b"" if begun.range is None else begun.range.tobytes()
        with self._lock:
            known = self._scans.setdefault(key, _Scanned(begun))
            self._scans.move_to_end(key)
            while len(self._scans) > _MOST_SCANS:
                self._scans.popitem(last=False)
        with known.lock:
            with self._database.reading() as connection, suppress(DamagedError):
                to_come = in_stream(session, stream) & (chunks.c.first_seq >= known.scan.rows)
                for first_seq, block in _stored(connection, to_come):
                    if first_seq != known.scan.rows:
                        break
                    known.scan.take(block)
            return known.scan.so_far()

    def _together(
        self, connection: Connection, session: str, stream: str, windows: Mapping[Span, str], out: Reduced
    ) -> bool:
        """Reduce many windows of a whole stream in one pass; False where there are few, or one has a fault."""
        if len(windows) < _MANY:
            return False
        around = min(start for start, _ in windows), max(end for _, end in windows)
        try:
            found = gather(blocks_of(connection, session, stream, around), windows, _WHERE).plateaus
        except ReadingsError:
            return False  # one by one, each is told what is wrong with it
        out.plateaus.update(found)
        self._remember({(session, stream, window): plateau for window, plateau in found.items()})
        return True

    def _end(self, connection: Connection, key: _Key, name: str, whole: bool) -> Plateau | ReadingsError | str:
        """Return what becomes of one window: reduced, failed, or in words what is missing of it."""
        session, stream, window = key
        if lacks := _lacking(connection, session, stream, window, whole):
            return lacks
        found: Plateau | ReadingsError
        try:
            found = gather(blocks_of(connection, session, stream, window), {window: name}, _WHERE).plateaus[window]
        except OutsideError:
            # Only the chunks near the window were read; the message tells of the whole recording.
            span = select(func.min(chunks.c.first_s), func.max(chunks.c.last_s)).where(in_stream(session, stream))
            first_s, last_s = connection.execute(span).one()
            # Not remembered: a log that has ended may be gone on with, and another case may have the same window.
            return outside(window, name, first_s, last_s, _WHERE)
        except ReadingsError as error:
            # Without what it was raised in: it is kept.
            found = error.with_traceback(None)
        self._remember({key: found})
        return found

    def _remember(self, found: Mapping[_Key, Plateau | ReadingsError]) -> None:
        with self._lock:
            self._known.update(found)
            while len(self._known) > _MOST_CACHED:
                self._known.popitem(last=False)


def _log_ended(connection: Connection, session: str, stream: Row[Any]) -> bool:
    """Return whether the last that is known of a stream is that its log has ended, with what is there."""
    of_it = (events.c.session == session) & events.c.body.contains(stream.id, autoescape=True)
    for row in connection.execute(select(events).where(of_it).order_by(events.c.arrival.desc())):
        last = event_of(body_of_event(row))
        if last.stream == stream.id:
            return last.kind == "ended" and last.value.get("samples") == stream.next_seq
    return False


def _lacking(connection: Connection, session: str, stream: str, window: Span, whole: bool) -> str:
    """Describe the missing part of a window; empty where it can be reduced."""
    if whole:
        return ""
    mine = in_stream(session, stream)
    last_s = connection.execute(select(func.max(chunks.c.last_s)).where(mine)).scalar()
    if last_s is None or last_s <= window[1]:
        return f"readings until {window[1]:g} s are to come" + ("" if last_s is None else f" (now at {last_s:.1f} s)")
    rows = places_of(connection, mine, ends_of(connection, mine, window))
    if rows and rows[0].first_seq > 0 and rows[0].first_s > window[0]:
        return f"readings before {rows[0].first_s:.2f} s are missing"
    for before, row in pairwise(rows):
        if row.first_seq != before.first_seq + before.n:
            return f"readings from {before.last_s:.2f} to {row.first_s:.2f} s are missing"
    if not rows or rows[-1].last_s <= window[1]:
        return f"readings until {window[1]:g} s are missing"
    return ""


def blocks_of(connection: Connection, session: str, stream: str, window: Span | None = None) -> Iterator[ReadingBlock]:
    """Return a stream's readings in order, or those of the chunks about a window.

    Raises:
        DamagedError: a chunk is not as it was sent.
    """
    mine = in_stream(session, stream)
    if window is not None:
        mine &= chunks.c.first_seq.between(*ends_of(connection, mine, window))
    return (block for _, block in _stored(connection, mine))


def _stored(connection: Connection, where: ColumnElement[bool]) -> Iterator[tuple[int, ReadingBlock]]:
    """Yield the number of each chunk's first reading, and its readings."""
    query = select(*STORED).where(where).order_by(chunks.c.first_seq)
    with connection.execute(query.execution_options(yield_per=16)) as rows:
        for chunk in map(chunk_of, rows):
            require_client()
            if len(chunk):
                # A reading beyond the range is flagged also where the device has no status of its own.
                status = np.where(chunk.overload & (chunk.status == 0), 1, chunk.status)
                yield chunk.first_seq, ReadingBlock(chunk.t_s, chunk.wrench, status)
