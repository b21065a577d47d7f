"""Reading a journal, also while it is written: read-only, every checksum verified."""

from __future__ import annotations

import errno
import sqlite3
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from daq.acquisition.blocks import Chunk
from daq.errors import JournalError
from daq.files import replacing
from daq.journal.rows import UNDECODED, Event, Stream, chunk_checksum, disk_full, require_journal, said

# What SQLite says where it cannot write beside a journal.
_PROTECTED = (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY)
CHUNK_COLUMNS = "id, stream, first_seq, n, crc, payload"
EVENT_COLUMNS = "stream, at_s, utc_s, kind, value, crc"


class JournalReader:
    """A journal as it stands; threads may share it."""

    def __init__(self, connection: sqlite3.Connection, path: Path) -> None:
        self.path = path
        self._connection = connection
        self._lock = threading.RLock()

    @classmethod
    def open(cls, path: str | Path) -> Self:
        """Open for reading only.

        Raises:
            JournalError: it is absent, no journal, or of a newer version.
        """
        file = Path(path)
        connection = connect_read(file)
        try:
            require_journal(connection, file)
        except BaseException:
            connection.close()
            raise
        return cls(connection, file)

    @property
    def bench(self) -> str:
        """Name of the bench."""
        return self.meta("bench") or ""

    @property
    def epoch(self) -> str:
        """Random name, another one once the journal was restored, recovered or copied and written on."""
        return self.meta("epoch") or ""

    def meta(self, key: str) -> str | None:
        """Return the journal's own description."""
        rows = self._rows("SELECT value FROM meta WHERE key = ?", key)
        return str(rows[0][0]) if rows else None

    def streams(self) -> list[Stream]:
        """Return all streams in the order in which they began.

        Raises:
            JournalError: a description is damaged.
        """
        return [Stream.of_row(row) for row in self._rows("SELECT * FROM streams ORDER BY rowid")]

    def next_seq(self, stream: str) -> int:
        """Number of the first sample that is not kept yet."""
        rows = self._rows("SELECT first_seq + n FROM chunks WHERE stream = ? ORDER BY first_seq DESC LIMIT 1", stream)
        return int(rows[0][0]) if rows else 0

    def read(self, stream: str, from_seq: int = 0) -> Iterator[Chunk]:
        """Yield chunks from the one that holds sample `from_seq` on; what a recovery lost is a jump in `first_seq`.

        Raises:
            JournalError: a chunk is damaged.
        """
        # Each chunk is a query of its own: a reader that takes its time must not keep the log from being emptied.
        query = f"SELECT {CHUNK_COLUMNS} FROM chunks WHERE stream = ? AND first_seq "  # noqa: S608 - no user's text
        row = self._rows(query + "<= ? ORDER BY first_seq DESC LIMIT 1", stream, from_seq)
        if not row or row[0][2] + row[0][3] <= from_seq:
            row = self._rows(query + "> ? ORDER BY first_seq LIMIT 1", stream, from_seq - 1)
        while row:
            yield sound_chunk(row[0])
            row = self._rows(query + "> ? ORDER BY first_seq LIMIT 1", stream, row[0][2])

    def undecoded(self, stream: str) -> Iterator[Chunk]:
        """Yield chunks without samples, in order: bytes that made no reading; `first_seq` is that of the next one.

        Raises:
            JournalError: a chunk is damaged.
        """
        query = f"SELECT {CHUNK_COLUMNS} FROM undecoded WHERE stream = ? AND id > ? ORDER BY id LIMIT 1"  # noqa: S608
        row = self._rows(query, stream, 0)
        while row:
            yield sound_chunk(row[0])
            row = self._rows(query, stream, row[0][0])

    def events(self, stream: str | None = None) -> list[Event]:
        """Return events of a stream, or of all streams and the bench, in the order of writing.

        Raises:
            JournalError: one is damaged.
        """
        query = f"SELECT {EVENT_COLUMNS} FROM events WHERE ? IS NULL OR stream = ? ORDER BY id"  # noqa: S608
        return [Event.of_row(row) for row in self._rows(query, stream, stream)]

    def events_from(self, number: int) -> list[Event]:
        """Return events of all streams and the bench, from this number on; 0 is the first that was written.

        Raises:
            JournalError: one is damaged.
        """
        query = f"SELECT {EVENT_COLUMNS} FROM events ORDER BY id LIMIT -1 OFFSET ?"  # noqa: S608
        return [Event.of_row(row) for row in self._rows(query, number)]

    def set_aside(self) -> set[tuple[str, int]]:
        """Return chunks (stream, first_seq) that the service refused."""
        return set(self._rows("SELECT stream, first_seq FROM outbox WHERE state = 'quarantined'"))

    def counts(self) -> tuple[int, int, int]:
        """Return chunks, samples in them, and events."""
        rows = self._rows("SELECT count(*), ifnull(sum(n), 0), (SELECT count(*) FROM events) FROM chunks")
        return (int(rows[0][0]), int(rows[0][1]), int(rows[0][2]))

    def copy_to(self, target: Path, proof: Callable[[Path], None] | None = None) -> None:
        """Write a compact copy, whose name appears when it is complete.

        Args:
            target: its file.
            proof: is shown the copy before it has that name, and raises where it is not as it should be.

        Raises:
            JournalError: it exists already, cannot be written, or the proof failed; nothing is left of it then.
        """
        try:
            _require_new(target)
            with replacing(target) as temporary:
                with self._lock:
                    self._connection.execute("VACUUM INTO ?", (str(temporary),))
                if proof is not None:
                    proof(temporary)
                _require_new(target)  # it took a while
        except sqlite3.Error as error:
            raise said(error, target) from error
        except OSError as error:
            if error.errno == errno.ENOSPC:
                raise disk_full(target) from error
            raise JournalError(
                f"{target.name} cannot be written ({error.strerror})", "a folder with room", "Check path and rights"
            ) from error

    def close(self) -> None:
        """Let go of the file."""
        self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _rows(self, query: str, *values: Any) -> list[tuple[Any, ...]]:
        with self._lock:
            try:
                return self._connection.execute(query, values).fetchall()
            except sqlite3.ProgrammingError as error:
                raise JournalError(f"{self.path.name} is closed", "an open journal") from error
            except sqlite3.DatabaseError as error:
                raise said(error, self.path) from error


def _require_new(target: Path) -> None:
    if target.exists():
        raise JournalError(f"{target.name} exists", "a new name for the copy", "Choose another")


def sound_chunk(row: tuple[Any, ...]) -> Chunk:
    """Unpack a row of chunks (id, stream, first_seq, n, crc, payload).

    Raises:
        JournalError: a checksum does not hold.
    """
    _, stream, first_seq, count, crc, payload = row
    where = f"chunk {first_seq} of stream {stream}"
    if isinstance(payload, bytes) and isinstance(stream, str):
        try:
            chunk = Chunk.from_bytes(payload)
        except JournalError as error:
            raise JournalError(error.found.replace("a chunk", where), error.expected, error.remedy) from None
        key = chunk_checksum(stream, first_seq, count, payload)
        if key == crc and (chunk.first_seq, len(chunk)) == (first_seq, count):
            return chunk
    raise JournalError(f"{where} is damaged (its checksum does not hold)", "what was written", "Recover the rest")


def connect_read(path: Path, damaged: bool = False) -> sqlite3.Connection:
    """Connect for reading only, also to what nothing can be written beside.

    Args:
        path: of the journal.
        damaged: whether to read it though it is shorter than it says.

    Raises:
        JournalError: it is absent or cannot be read.
    """
    if not path.is_file():
        found = f"{path} is a folder" if path.is_dir() else f"there is no {path}"
        raise JournalError(found, "a journal", "Check the path")
    address = path.resolve().as_uri() + "?mode=ro"
    log = path.with_name(path.name + "-wal")
    # Without a log nothing is being written, and a folder that is write-protected holds up no reader.
    ways = [address] if log.is_file() and log.stat().st_size else [address, address + "&immutable=1"]
    for way in ways:
        try:
            connection = sqlite3.connect(way, uri=True, isolation_level=None, check_same_thread=False)
        except sqlite3.Error as error:
            raise said(error, path) from error
        try:
            connection.execute("PRAGMA trusted_schema=OFF")
            if damaged:
                connection.execute("PRAGMA writable_schema=ON")
            connection.execute("PRAGMA user_version")
            with suppress(sqlite3.DatabaseError):
                if not connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'undecoded'").fetchone():
                    connection.execute(f"CREATE TEMP {UNDECODED}")
        except sqlite3.DatabaseError as error:
            connection.close()
            if way is not ways[-1] and error.sqlite_errorcode & 0xFF in _PROTECTED:
                continue
            raise said(error, path) from error
        except BaseException:
            connection.close()
            raise
        return connection
    raise AssertionError("one way was the last")
