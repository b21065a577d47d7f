"""Rows of a journal: its tables, and one row of each, with the checksum that ties its columns together."""

from __future__ import annotations

import datetime as dt
import json
import re
import sqlite3
import time
import uuid
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from daq.errors import JournalError
from daq.quoting import quoted

APPLICATION_ID = 0x46544A4C
VERSION = 1
# Chunks are some 70 kB: fewer, larger pages make fewer frames of each.
PAGE_BYTES = 16384
# The payload comes last, so that the other columns are read without it.
SCHEMA = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE streams (
    id TEXT PRIMARY KEY, driver TEXT NOT NULL, settings TEXT NOT NULL, cell TEXT NOT NULL,
    started_utc TEXT NOT NULL, clock TEXT NOT NULL, crc INTEGER NOT NULL);
CREATE TABLE chunks (
    id INTEGER PRIMARY KEY, stream TEXT NOT NULL REFERENCES streams, first_seq INTEGER NOT NULL,
    n INTEGER NOT NULL, crc INTEGER NOT NULL, payload BLOB NOT NULL, UNIQUE (stream, first_seq));
CREATE TABLE events (
    id INTEGER PRIMARY KEY, stream TEXT, at_s REAL NOT NULL, utc_s REAL NOT NULL, kind TEXT NOT NULL,
    value TEXT NOT NULL, crc INTEGER NOT NULL);
CREATE TABLE outbox (
    id INTEGER PRIMARY KEY, stream TEXT NOT NULL, first_seq INTEGER NOT NULL, sha256 TEXT NOT NULL,
    state TEXT NOT NULL DEFAULT 'pending' CHECK (state IN ('pending', 'sent', 'quarantined')),
    tries INTEGER NOT NULL DEFAULT 0);
CREATE INDEX outbox_pending ON outbox (id) WHERE state = 'pending';
"""
# Chunks without samples, of which many may stand before one sample. Journals of the first days have no such table.
UNDECODED = """TABLE IF NOT EXISTS undecoded (
    id INTEGER PRIMARY KEY, stream TEXT NOT NULL, first_seq INTEGER NOT NULL, n INTEGER NOT NULL, crc INTEGER NOT NULL,
    payload BLOB NOT NULL)"""
INSERT_STREAM = "INSERT INTO streams VALUES (?, ?, ?, ?, ?, ?, ?)"
# Rows that were ever written: none is ever deleted.
ROWS = (
    "SELECT (SELECT ifnull(max(id), 0) FROM chunks) + (SELECT ifnull(max(id), 0) FROM events) "
    "+ (SELECT ifnull(max(id), 0) FROM undecoded)"
)
SAMPLES = "SELECT ifnull(sum(n), 0) FROM chunks"
# Samples that no chunk holds before one that is there: stream, the first of them, how many.
HOLES = (
    "SELECT stream, past, first_seq - past FROM (SELECT stream, first_seq, "
    "ifnull(lag(first_seq + n) OVER (PARTITION BY stream ORDER BY first_seq), 0) AS past FROM chunks) "
    "WHERE first_seq > past ORDER BY stream, past"
)
INSERT_CHUNK = "INSERT INTO chunks (stream, first_seq, n, crc, payload) VALUES (?, ?, ?, ?, ?)"
INSERT_UNDECODED = "INSERT INTO undecoded (stream, first_seq, n, crc, payload) VALUES (?, ?, ?, ?, ?)"
INSERT_EVENT = "INSERT INTO events (stream, at_s, utc_s, kind, value, crc) VALUES (?, ?, ?, ?, ?, ?)"
INSERT_OUTBOX = "INSERT INTO outbox (id, stream, first_seq, sha256, state, tries) VALUES (?, ?, ?, ?, ?, ?)"


def as_utc(utc_s: float) -> str:
    """Write seconds since 1970 as a date and time in UTC."""
    return dt.datetime.fromtimestamp(utc_s, tz=dt.UTC).isoformat(timespec="milliseconds")


def now_utc() -> str:
    """Return the wall clock's date and time in UTC."""
    return as_utc(time.time())


def checksum(*values: object) -> int:
    """Return CRC-32 of a row's values."""
    return zlib.crc32(json.dumps(values, ensure_ascii=True).encode("ascii"))


def chunk_checksum(stream: str, first_seq: int, count: int, payload: bytes) -> int:
    """Return the CRC-32 of a chunk's key and its payload's checksum, so that a payload under another key is found."""
    return zlib.crc32(f"{stream} {first_seq} {count} ".encode() + payload[-4:])


def as_json(value: Mapping[str, Any], what: str) -> str:
    """Return a value as JSON.

    Raises:
        JournalError: it cannot be written as such.
    """
    try:
        return json.dumps(value, allow_nan=False, sort_keys=True)
    except (TypeError, ValueError) as error:
        raise JournalError(f"{what} cannot be kept ({error})", "finite numbers, texts, lists") from error


@dataclass(frozen=True)
class Stream:
    """One run of one load cell.

    Attributes:
        id: unlike any other stream's, of any bench.
        driver: name of the driver.
        settings: given to the driver.
        cell: model, serial number and calibration of the load cell, as far as known.
        started_utc: wall clock at time 0.
        clock: what tells the time of a sample.
    """

    id: str
    driver: str
    settings: Mapping[str, Any]
    cell: Mapping[str, Any]
    started_utc: str
    clock: str

    def row(self) -> tuple[Any, ...]:
        """Return the row as it is kept."""
        values = (
            self.id, self.driver, as_json(self.settings, "a setting"), as_json(self.cell, "the load cell"),
            self.started_utc, self.clock,
        )  # fmt: skip
        return (*values, checksum(*values))

    @classmethod
    def of_row(cls, row: tuple[Any, ...]) -> Stream:
        """Make a stream of its row.

        Raises:
            JournalError: its checksum does not hold.
        """
        if checksum(*map(_plain, row[:-1])) != row[-1]:
            raise JournalError(f"the description of stream {row[0]} is damaged", "what was written", "Recover the rest")
        return cls(row[0], row[1], json.loads(row[2]), json.loads(row[3]), row[4], row[5])


@dataclass(frozen=True)
class Event:
    """Event of a bench: gap, overload, stale, reconnect, tare, mark, loaded, unloaded, note, exclusion, and so on.

    Attributes:
        kind: small letters and underscores.
        at_s: since the stream began [s].
        value: what else is to be said.
        stream: where it happened; None where it is the bench's.
        utc_s: wall clock [s since 1970], for people; set when it is written.
    """

    kind: str
    at_s: float = 0.0
    value: Mapping[str, Any] = field(default_factory=dict)
    stream: str | None = None
    utc_s: float = 0.0

    @classmethod
    def of_row(cls, row: tuple[Any, ...]) -> Event:
        """Make an event of its row.

        Raises:
            JournalError: its checksum does not hold.
        """
        if checksum(*map(_plain, row[:-1])) != row[-1]:
            raise JournalError("an event is damaged (its checksum does not hold)", "what was written", "Recover it")
        return cls(row[3], row[1], json.loads(row[4]), row[0], row[2])


class Happening(Protocol):
    """An event, or what the sampling thread makes of one."""

    @property
    def kind(self) -> str: ...  # noqa: D102 - as of Event
    @property
    def at_s(self) -> float: ...  # noqa: D102
    @property
    def utc_s(self) -> float: ...  # noqa: D102
    @property
    def value(self) -> Mapping[str, Any]: ...  # noqa: D102


def event_row(event: Happening, stream: str | None = None) -> tuple[Any, ...]:
    """Return an event as it is kept; one that names no stream gets this one.

    Raises:
        JournalError: its kind, time or value cannot be kept.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", event.kind):
        raise JournalError(f"an event of kind {event.kind!r}", "small letters and underscores")
    at_s, utc_s = float(event.at_s), float(event.utc_s) or time.time()
    as_json({"at_s": at_s, "utc_s": utc_s}, f"the time of a {event.kind}")
    value = as_json(event.value, f"the value of a {event.kind}")
    values = (getattr(event, "stream", None) or stream, at_s, utc_s, event.kind, value)
    return (*values, checksum(*values))


def _plain(value: object) -> object:
    # A flipped bit may make a text into a blob, which JSON does not know.
    return value.hex() + "?" if isinstance(value, bytes) else value


def initialise(connection: sqlite3.Connection, bench: str, **meta: str) -> str:
    """Make the tables of a new journal; return its epoch."""
    epoch = uuid.uuid4().hex
    connection.execute(f"PRAGMA page_size={PAGE_BYTES}")
    connection.execute(f"PRAGMA application_id={APPLICATION_ID}")
    connection.execute(f"PRAGMA user_version={VERSION}")
    connection.execute("BEGIN IMMEDIATE")
    for statement in (*SCHEMA.split(";"), f"CREATE {UNDECODED}"):
        connection.execute(statement)
    entries = {"bench": bench, "created_utc": now_utc(), "epoch": epoch} | meta
    connection.executemany("INSERT INTO meta VALUES (?, ?)", entries.items())
    connection.execute("COMMIT")
    return epoch


def require_journal(connection: sqlite3.Connection, path: Path) -> None:
    """Check what the file says that it is.

    Raises:
        JournalError: it is no journal, or of a newer version.
    """
    try:
        application = connection.execute("PRAGMA application_id").fetchone()[0]
        version = connection.execute("PRAGMA user_version").fetchone()[0]
    except sqlite3.DatabaseError as error:
        raise said(error, path) from error
    if application != APPLICATION_ID:
        raise JournalError(f"{path.name} is no journal", "a journal that fingertwin wrote", "Give another file")
    if version > VERSION:
        raise JournalError(f"{path.name} is of version {version}", f"{VERSION} at most", "Use the newer fingertwin")


def said(error: sqlite3.Error, path: Path) -> JournalError:
    """Return SQLite's message in one line."""
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    if code == sqlite3.SQLITE_FULL:
        return disk_full(path)
    if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
        return JournalError(f"{path.name} is locked by another program", "no other writer", "Close that program")
    if code == sqlite3.SQLITE_NOTADB:
        return JournalError(
            f"{path.name} is no journal, or its first bytes are damaged",
            "a journal that fingertwin wrote",
            "Give another file, or the journal's copy",
        )
    if code == sqlite3.SQLITE_CORRUPT:
        return JournalError(
            f"{path.name} is damaged ({error})",
            "a sound journal",
            f"Run fingertwin journal recover {quoted(path)} --out NEW",
        )
    return JournalError(
        f"{path.name} cannot be read or written ({error})", "a local disk", "Check the path, its rights and the disk"
    )


def disk_full(path: Path, reserve_bytes: int = 0) -> JournalError:
    """Return the error that nothing more can be kept; so much of the disk is left free on purpose."""
    return JournalError(
        f"disk full: {path.name} cannot grow",
        f"more than {reserve_bytes / (1 << 20):.0f} MiB of free space, which it leaves"
        if reserve_bytes
        else "free space",
        "Free some and go on; all that was acknowledged is kept",
    )
