"""Recovery of a damaged journal: every row that can still be read."""

from __future__ import annotations

import hashlib
import itertools
import sqlite3
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

from daq.errors import JournalError
from daq.journal.reader import CHUNK_COLUMNS, EVENT_COLUMNS, sound_chunk
from daq.journal.rows import (
    INSERT_CHUNK,
    INSERT_EVENT,
    INSERT_OUTBOX,
    INSERT_STREAM,
    INSERT_UNDECODED,
    Event,
    Stream,
    event_row,
    initialise,
)
from daq.journal.wal import log_file

Kind = Literal["file", "log", "version", "stream", "chunk", "undecoded", "event", "gap", "outbox"]
# Of a table that cannot be read: what was in it is gone. Of chunks, numbers of samples tell which are missing.
_UNREAD: dict[str, Kind] = {"streams": "stream", "undecoded": "undecoded", "events": "event"}
_STREAM_COLUMNS = "rowid, id, driver, settings, cell, started_utc, clock, crc"
_OUTBOX_COLUMNS = "id, stream, first_seq, sha256, state, tries"
# No row of a table that grows is shorter than this.
_SHORTEST_ROW_BYTES = 64
# What one page of a tree can hide, and more: after so many numbers without a row there is none.
_MOST_MISSES = 200_000


@dataclass(frozen=True)
class Fault:
    """Damage to a journal.

    Attributes:
        kind: what it is about.
        text: in one line.
        stream: where it lies.
        first_seq: first sample that is lost or in doubt.
        n: how many samples; None where nobody can tell, or none is lost.
    """

    kind: Kind
    text: str
    stream: str | None = None
    first_seq: int | None = None
    n: int | None = None

    @property
    def loses(self) -> bool:
        """Whether something is gone that a recovery cannot bring back."""
        return self.kind in ("gap", "stream", "undecoded", "event") or (self.kind == "log" and self.n is not None)


@dataclass(frozen=True)
class Report:
    """Sound contents of a journal, and its damage.

    Attributes:
        bench: name.
        epoch: of the journal.
        chunks: that are sound, of each stream.
        samples: in those, of each stream.
        undecoded_bytes: that made no reading, and are sound.
        events: that are sound.
        pending: chunks that wait to be sent.
        set_aside: chunks that the service refused.
        known_gaps: losses that an earlier recovery has noted.
        faults: none where all is as it was written.
    """

    bench: str
    epoch: str
    chunks: dict[str, int]
    samples: dict[str, int]
    undecoded_bytes: int
    events: int
    pending: int
    set_aside: int
    known_gaps: int
    faults: tuple[Fault, ...]

    @property
    def losses(self) -> list[Fault]:
        """Damage that a recovery cannot bring back."""
        return [fault for fault in self.faults if fault.loses]

    @property
    def missing(self) -> str:
        """Number of readings that are missing, in words; empty where none is."""
        counts = [f.n for f in self.losses if f.kind in ("gap", "log")]
        known = sum(n for n in counts if n is not None)
        if None not in counts:
            return f"{known} readings are missing" if known else ""
        return f"{known} readings and an unknown number of others are missing" if known else "readings are missing"


def gap(stream: str, first_seq: int, n: int | None) -> Fault:
    """Return the fault of samples that are missing; None where nobody can tell how many."""
    many = "an unknown number of" if n is None else str(n)
    return Fault("gap", f"{many} samples from {first_seq} on are missing", stream, first_seq, n)


class Salvage:
    """Reads row by row, past what cannot be read."""

    def __init__(self, connection: sqlite3.Connection, path: Path, faults: list[Fault]) -> None:
        self._connection = connection
        self._bytes = sum(file.stat().st_size for file in (path, log_file(path)) if file.is_file())
        self._faults = faults
        self._outbox = {row[0]: row[1:] for row in self._rows("outbox", _OUTBOX_COLUMNS) if isinstance(row[1], str)}
        self._pieces: dict[str, list[tuple[int, int, float]]] = {}
        self._pending = self._set_aside = 0
        self._events = self._undecoded_bytes = 0

    def report(self) -> Report:
        """Read all and say what is there."""
        streams = [row[1] for row in self._streams()]
        for _ in itertools.chain(self._chunks(), self._undecoded()):
            pass
        lost, noted = set(), 0
        for row in self._sound_events():
            event = Event.of_row(row)
            if event.kind == "lost" and event.stream:
                lost.add((event.stream, event.value.get("first_seq")))
            noted += event.kind == "warning" and event.value.get("code") == "lost"
        gaps = [g for g in self._gaps() if (g.stream, g.first_seq) not in lost]
        self._faults += gaps
        return self._said(streams, len(lost) + noted)

    def into(self, new: sqlite3.Connection) -> Report:
        """Write what is sound into a new journal."""
        meta = self._meta()
        initialise(new, meta.get("bench", ""), recovered_from=meta.get("epoch", ""))
        new.execute("BEGIN IMMEDIATE")
        streams = []
        for row in self._streams():
            new.execute(INSERT_STREAM, row[1:])
            streams.append(row[1])
        for at, stream, first_seq, count, crc, payload in self._chunks():
            if stream not in streams:  # its readings are sound, though nothing is known of it
                new.execute(INSERT_STREAM, Stream(stream, "lost", {}, {}, "", "lost").row())
                streams.append(stream)
                text = f"the description of stream {stream} (driver, settings, calibration) is lost"
                self._faults.append(Fault("stream", text, stream))
            row_id = new.execute(INSERT_CHUNK, (stream, first_seq, count, crc, payload)).lastrowid
            digest, state, tries = hashlib.sha256(payload).hexdigest(), "pending", 0
            waiting = self._outbox.get(at)
            if waiting and waiting[:3] == (stream, first_seq, digest) and waiting[3] in ("sent", "quarantined"):
                state, tries = waiting[3], waiting[4]
            new.execute(INSERT_OUTBOX, (row_id, stream, first_seq, digest, state, tries))
        for row in self._undecoded():
            new.execute(INSERT_UNDECODED, row[1:])
        for row in self._sound_events():
            new.execute(INSERT_EVENT, row)
        gaps = self._gaps()
        for fault in gaps:
            pieces = self._pieces.get(fault.stream or "", [])
            at_s = max((end_s for first, _, end_s in pieces if first < (fault.first_seq or 0)), default=0.0)
            value = {"first_seq": fault.first_seq, "n": fault.n, "reason": "not recovered"}
            new.execute(INSERT_EVENT, event_row(Event("lost", at_s, value, fault.stream)))
        for fault in self._faults:
            if fault.kind == "log" and fault.loses:  # nobody can tell of which stream
                new.execute(INSERT_EVENT, event_row(Event("warning", 0.0, {"code": "lost", "text": fault.text})))
        new.execute("COMMIT")
        self._faults += gaps
        return self._said(streams, 0)

    def _said(self, streams: list[str], known: int) -> Report:
        meta = self._meta()
        names = dict.fromkeys([*streams, *self._pieces])
        chunks = {s: len(self._pieces.get(s, [])) for s in names}
        samples = {s: sum(n for _, n, _ in self._pieces.get(s, [])) for s in names}
        faults = tuple(dict.fromkeys(self._faults))
        bench, epoch = meta.get("bench", ""), meta.get("epoch", "")
        waiting = (self._pending, self._set_aside)
        return Report(bench, epoch, chunks, samples, self._undecoded_bytes, self._events, *waiting, known, faults)

    def _streams(self) -> Iterator[tuple[Any, ...]]:
        for row in self._rows("streams", _STREAM_COLUMNS, "rowid"):
            try:
                Stream.of_row(row[1:])
            except (JournalError, ValueError, TypeError):
                self._faults.append(Fault("stream", f"the description of stream {row[1]} is damaged", str(row[1])))
            else:
                yield row

    def _chunks(self) -> Iterator[tuple[Any, ...]]:
        """Yield sound chunks (id, stream, first_seq, n, crc, payload)."""
        seen: set[tuple[str, int]] = set()
        for row in self._rows("chunks", CHUNK_COLUMNS):
            at, stream, first_seq, count = row[:4]
            waiting = self._outbox.get(at)
            try:
                chunk = sound_chunk(row)
            except JournalError as error:
                self._faults.append(Fault("chunk", error.found, str(stream)))
                continue
            if waiting is None or waiting[:2] != (stream, first_seq):
                self._faults.append(
                    Fault("outbox", f"chunk {first_seq} is not in the outbox", stream, first_seq, count)
                )
            elif waiting[2] != hashlib.sha256(row[5]).hexdigest():
                text = f"the outbox holds another SHA-256 of chunk {first_seq}"
                self._faults.append(Fault("outbox", text, stream, first_seq, count))
            elif waiting[3] not in ("pending", "sent", "quarantined"):
                text = f"chunk {first_seq} has the state {waiting[3]!r} in the outbox"
                self._faults.append(Fault("outbox", text, stream, first_seq, count))
            if (stream, first_seq) in seen:
                self._faults.append(Fault("chunk", f"chunk {first_seq} is there twice", stream))
                continue
            seen.add((stream, first_seq))
            self._pending += waiting is not None and waiting[3] == "pending"
            self._set_aside += waiting is not None and waiting[3] == "quarantined"
            end_s = float(chunk.t_s[-1]) if len(chunk) else 0.0
            self._pieces.setdefault(stream, []).append((first_seq, count, end_s))
            yield row

    def _undecoded(self) -> Iterator[tuple[Any, ...]]:
        """Yield sound chunks without samples (id, stream, first_seq, n, crc, payload)."""
        for row in self._rows("undecoded", CHUNK_COLUMNS):
            try:
                self._undecoded_bytes += len(sound_chunk(row).raw)
            except JournalError as error:
                self._faults.append(Fault("undecoded", f"bytes without a reading: {error.found}", str(row[1])))
            else:
                yield row

    def _sound_events(self) -> Iterator[tuple[Any, ...]]:
        before = 0
        for at, *row in self._rows("events", f"id, {EVENT_COLUMNS}"):
            if at > before + 1:  # none is ever deleted
                which = f"events {before + 1} to {at - 1} are" if at > before + 2 else f"event {before + 1} is"
                self._faults.append(Fault("event", f"{which} missing"))
            before = at
            try:
                Event.of_row(tuple(row))
            except (JournalError, ValueError, TypeError):
                self._faults.append(Fault("event", f"event {at} is damaged"))
            else:
                self._events += 1
                yield tuple(row)

    def _gaps(self) -> list[Fault]:
        """Return the samples that are missing: before, between and, as far as the outbox tells, after those present."""
        out = []
        known: dict[str, set[int]] = {}
        for stream, first_seq, *_ in self._outbox.values():
            known.setdefault(stream, set()).add(first_seq)
        for stream in dict.fromkeys([*self._pieces, *known]):
            pieces = sorted(self._pieces.get(stream, []))
            ends = [(0, 0, 0.0), *pieces]
            holes: list[tuple[int, int | None]] = [
                (first + n, after - first - n) for (first, n, _), (after, _, _) in pairwise(ends) if after != first + n
            ]
            last = ends[-1][0] + ends[-1][1]
            there = {first for first, _, _ in pieces}
            if any(first >= last and first not in there for first in known.get(stream, ())):
                holes.append((last, None))
            out += [gap(stream, first, n) for first, n in holes]
        return out

    def _meta(self) -> dict[str, str]:
        return {str(row[1]): str(row[2]) for row in self._rows("meta", "rowid, key, value", "rowid")}

    def _rows(self, table: str, columns: str, key: str = "id") -> Iterator[tuple[Any, ...]]:
        """Yield rows in order, past those that cannot be read."""
        query = f"SELECT {columns} FROM {table} WHERE {key} > ? ORDER BY {key}"  # noqa: S608 - our own names
        at, misses, highest = 0, 0, None
        while (highest is None or at <= highest) and misses < _MOST_MISSES:
            try:
                for row in self._connection.execute(query, (at,)):
                    if row[0] > at:  # a damaged tree may lead anywhere, also back
                        at, misses = row[0], 0
                        yield row
            except sqlite3.DatabaseError as error:
                if highest is None:
                    text = f"part of the table {table} cannot be read ({error})"
                    self._faults.append(Fault(_UNREAD.get(table, "file"), text))
                    highest = self._highest(table, key)
                at, misses = at + 1, misses + 1
            else:
                return

    def _highest(self, table: str, key: str) -> int:
        """Return a number that no row lies beyond."""
        # A chunk and its place in the outbox have one number.
        for name in ("chunks", "outbox") if table in ("chunks", "outbox") else (table,):
            with suppress(sqlite3.DatabaseError):
                found = self._connection.execute(f"SELECT max({key}) FROM {name}").fetchone()[0]  # noqa: S608
                return int(found or 0)
        return self._bytes // _SHORTEST_ROW_BYTES
