"""A bench's journal: all that its load cells said, and what happened, in one file that survives a pulled plug.

What `append` returned for is on the disk. Each transaction holds a chunk, its events and its place in the outbox, so
that after a crash there is a consistent prefix. One connection writes and empties the write-ahead log: SQLite before
3.51.3 can lose data where two do.
"""

from __future__ import annotations

import hashlib
import shutil
import sqlite3
import uuid
from collections.abc import Iterable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any, Self

from daq.acquisition.blocks import Chunk
from daq.errors import JournalError
from daq.files import replacing
from daq.journal.lock import WriterLock
from daq.journal.reader import JournalReader, connect_read
from daq.journal.rows import (
    INSERT_CHUNK,
    INSERT_EVENT,
    INSERT_OUTBOX,
    INSERT_STREAM,
    INSERT_UNDECODED,
    Event,
    Happening,
    Stream,
    chunk_checksum,
    disk_full,
    event_row,
    initialise,
    now_utc,
    require_journal,
    said,
)
from daq.journal.wal import require_sound_log
from daq.journal.writing import Pending, Writer, connect_write, locked

# Enough for what is in the write-ahead log, and for the last events.
RESERVE_BYTES = 64 << 20
_ID = "(SELECT id FROM chunks WHERE stream = ? AND first_seq = ?)"
_KEPT = f"SELECT sha256 FROM outbox WHERE id = {_ID}"  # noqa: S608 - constants


class Journal(Writer):
    """A journal and its only writer; threads may share it.

    Args:
        connection: that writes.
        path: of the journal.
        lock: that keeps others from writing.
        reserve_bytes: of the disk, that chunks leave free.
    """

    def __init__(self, connection: sqlite3.Connection, path: Path, lock: WriterLock, reserve_bytes: int) -> None:
        super().__init__(connection, path, lock)
        self._reserve_bytes = reserve_bytes

    @classmethod
    def create(cls, path: str | Path, bench: str, reserve_bytes: int = RESERVE_BYTES) -> Self:
        """Make a new journal and open it.

        Raises:
            JournalError: something of that name exists, or it cannot be made.
        """
        file = Path(path)
        file.parent.mkdir(parents=True, exist_ok=True)
        lock = locked(file)
        try:
            if file.exists():
                raise JournalError(f"{file.name} exists", "a new name", "Open it, or choose another")
            try:
                with replacing(file) as temporary, closing(sqlite3.connect(temporary, isolation_level=None)) as new:
                    lock.note(initialise(new, bench), 0)
            except sqlite3.Error as error:
                raise said(error, file) from error
        finally:
            lock.close()
        return cls.open(file, reserve_bytes)

    @classmethod
    def open(cls, path: str | Path, reserve_bytes: int = RESERVE_BYTES) -> Self:
        """Open as the writer.

        Raises:
            JournalError: it is absent, no journal, newer, damaged, or another process writes it.
        """
        file = Path(path)
        with closing(connect_read(file)) as connection:
            require_journal(connection, file)
        lock = locked(file)
        journal: Self | None = None
        try:
            # Writing would bury what a damaged log still holds.
            require_sound_log(file)
            journal = cls(connect_write(file), file, lock, reserve_bytes)
            journal.settle()
        except BaseException as error:
            if journal is not None:
                journal._connection.close()
                journal._marks.close()
            lock.close()
            if isinstance(error, sqlite3.Error):
                raise said(error, file) from error
            raise
        return journal

    def add_stream(
        self, driver: str, settings: Mapping[str, Any], cell: Mapping[str, Any], clock: str = "arrival"
    ) -> str:
        """Begin a stream; return its id.

        Args:
            driver: name of the driver.
            settings: given to it.
            cell: model, serial number and calibration of the load cell.
            clock: what tells the time of a sample.
        """
        stream = Stream(uuid.uuid4().hex, driver, dict(settings), dict(cell), now_utc(), clock)
        row = stream.row()
        with self.transaction() as connection:
            connection.execute(INSERT_STREAM, row)
        return stream.id

    def append(self, stream: str, chunk: Chunk, events: Iterable[Happening] = ()) -> int:
        """Keep a chunk and the events that go with it; both are on the disk on return. Return the next number.

        The same chunk again is a success and changes nothing. A chunk without samples (the last bytes that were read)
        ends its stream.

        Raises:
            JournalError: it does not follow the last one, or it cannot be kept; all before it is.
        """
        payload = chunk.to_bytes()
        digest = hashlib.sha256(payload).hexdigest()
        rows = [event_row(event, stream) for event in events]
        with self._lock:
            if chunk.first_seq != self._end(stream):
                return self._again(stream, chunk, digest)
            self._require_room(payload)
            key = (stream, chunk.first_seq, len(chunk))
            try:
                with self.transaction() as connection:
                    at = connection.execute(INSERT_CHUNK, (*key, chunk_checksum(*key, payload), payload)).lastrowid
                    connection.execute(INSERT_OUTBOX, (at, stream, chunk.first_seq, digest, "pending", 0))
                    self.counted(len(chunk))
                    if rows:
                        connection.executemany(INSERT_EVENT, rows)
            except BaseException:
                self._ends.pop(stream)  # to be asked for again: this may have been interrupted after it was kept
                raise
            self._ends[stream] = chunk.next_seq if len(chunk) else None
        return chunk.next_seq

    def keep(self, stream: str, chunk: Chunk | None, events: Iterable[Happening] = ()) -> None:
        """Keep what a load cell said: readings, or bytes that made none, with their events; or events alone.

        Args:
            stream: its id.
            chunk: with samples, or with bytes that made none, which end no stream; None where there is none.
            events: of the stream.

        Raises:
            JournalError: it does not follow the last one, or it cannot be kept; all before it is.
        """
        if chunk is None or len(chunk):
            if chunk is None:
                self.event(*events, stream=stream)
            else:
                self.append(stream, chunk, events)
            return
        payload = chunk.to_bytes()
        key, rows = (stream, chunk.first_seq, 0), [event_row(event, stream) for event in events]
        self._require_room(payload)
        with self.transaction() as connection:
            connection.execute(INSERT_UNDECODED, (*key, chunk_checksum(*key, payload), payload))
            connection.executemany(INSERT_EVENT, rows)

    def _require_room(self, payload: bytes) -> None:
        if self.space_left() < len(payload):
            raise disk_full(self.path, self._reserve_bytes)

    def event(self, *events: Happening, stream: str | None = None) -> None:
        """Keep events, also where the disk is too full for chunks; they are on the disk on return.

        Args:
            events: of the stream that they name, or else of `stream`; of the bench where both are None.
            stream: its id.
        """
        rows = [event_row(event, stream) for event in events]
        with self.transaction() as connection:
            connection.executemany(INSERT_EVENT, rows)

    def space_left(self) -> int:
        """Return bytes that chunks may still take; watch it, and stop before it is nothing."""
        self.stay()  # the folder may have gone too
        return shutil.disk_usage(self.path.parent).free - self._reserve_bytes

    def pending(self, limit: int = 100) -> list[Pending]:
        """Return the rows that wait to be sent, the oldest first."""
        rows = self._rows(
            "SELECT c.stream, c.first_seq, c.n, o.sha256, o.tries, c.payload FROM outbox o "
            "JOIN chunks c ON c.id = o.id WHERE o.state = 'pending' ORDER BY o.id LIMIT ?",
            limit,
        )
        return [Pending(*row) for row in rows]

    def tried(self, stream: str, first_seq: int) -> None:
        """Count an attempt to send that had no answer."""
        self._mark(stream, first_seq, "state")

    def acknowledged(self, stream: str, first_seq: int) -> None:
        """Note that the service has stored a chunk."""
        self._mark(stream, first_seq, "'sent'")

    def quarantined(self, stream: str, first_seq: int, reason: str) -> None:
        """Set a chunk aside that the service refused, and say so in an event; it stays here."""
        event = Event("quarantined", 0.0, {"first_seq": first_seq, "reason": reason}, stream)
        self._mark(stream, first_seq, "'quarantined'", event)

    def requeue(self) -> int:
        """Put all that was set aside into the outbox again, and say so in an event; return how many chunks.

        It is for a service that was mended: what it refuses once more is set aside once more.
        """
        with self.transaction() as connection:
            count = connection.execute("UPDATE outbox SET state = 'pending' WHERE state = 'quarantined'").rowcount
            if count:
                connection.execute(INSERT_EVENT, event_row(Event("requeued", 0.0, {"chunks": count})))
        return count

    def close(self, copy: str | Path | None = None) -> None:
        """Close; with `copy`, write a compact copy first, whose name appears when it is complete.

        Raises:
            JournalError: the copy exists already or cannot be written, or the journal's files have gone and cannot be
                written anew; the journal is closed all the same.
        """
        with self._lock:
            try:
                self.stay()
                if copy is not None:
                    self.copy_to(Path(copy))
            finally:
                self.leave()

    def _end(self, stream: str) -> int | None:
        if stream not in self._ends:
            last = "SELECT first_seq + n, n FROM chunks WHERE stream = ? ORDER BY first_seq DESC LIMIT 1"
            rows, described = self._rows(last, stream), self._rows("SELECT * FROM streams WHERE id = ?", stream)
            if not described:
                raise JournalError(f"there is no stream {stream}", "one that add_stream began")
            self._described[stream] = described[0]
            self._ends[stream] = (rows[0][0] if rows[0][1] else None) if rows else 0
        return self._ends[stream]

    def _again(self, stream: str, chunk: Chunk, digest: str) -> int:
        kept = self._rows(_KEPT, stream, chunk.first_seq)
        if kept and kept[0][0] == digest:
            return chunk.next_seq
        end = self._end(stream)
        expected = "a new stream: an empty chunk ended this one" if end is None else f"sample {end}"
        found = "another chunk than the one that is kept" if kept else "a chunk"
        raise JournalError(f"stream {stream}: {found} at sample {chunk.first_seq}", expected)

    def _mark(self, stream: str, first_seq: int, state: str, event: Event | None = None) -> None:
        row = event_row(event) if event else None
        with self.transaction() as connection:
            update = f"UPDATE outbox SET state = {state}, tries = tries + 1 WHERE id = {_ID}"  # noqa: S608 - constants
            if connection.execute(update, (stream, first_seq)).rowcount != 1:
                raise JournalError(f"stream {stream} has no chunk at sample {first_seq}", "one that waits to be sent")
            if row:
                connection.execute(INSERT_EVENT, row)


__all__ = ["Event", "Journal", "JournalReader", "Pending", "Stream"]
