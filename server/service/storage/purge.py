"""Permanent removal of deleted sessions, old jobs and messages, with their disk space.

Revisions and frozen predictions stay, since models rest on them; so does the id of a session, which is not used twice.
"""

from __future__ import annotations

import datetime as dt
import sqlite3
from collections.abc import Mapping, Sequence
from contextlib import closing, nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import ColumnElement, Table, delete, exists, func, or_, select, text, tuple_, update
from sqlalchemy.exc import OperationalError

from daq.errors import LaterError
from server.service.settings import What
from server.service.storage.audit import record
from server.service.storage.database import Database
from server.service.storage.reserve import released
from server.service.storage.schema import chunks, edits, events, job_parts, jobs, messages, sessions, streams

ENDED = ("done", "failed", "cancelled")
# Rows, and pages of the file, that one transaction removes: benches wait for no more than that.
_CHUNKS, _ROWS, _PAGES = 32, 500, 2048


@dataclass(frozen=True)
class Purged:
    """Rows removed, or to be removed."""

    sessions: int = 0  # deleted ones whose content is gone
    chunks: int = 0  # of readings
    chunk_bytes: int = 0  # size of those chunks
    jobs: int = 0  # that had ended
    messages: int = 0  # of the live stream

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)


def purge(
    database: Database, what: What, older_days: float, session: str | None = None, *, dry_run: bool = False
) -> Purged:
    """Remove what is older than so many days.

    Args:
        database: that it is in.
        what: content of deleted sessions, jobs that have ended, or messages of all but running benches.
        older_days: since the deletion, the end, or the message.
        session: of this one only.
        dry_run: whether to count only.
    """
    until = (dt.datetime.now(dt.UTC) - dt.timedelta(days=older_days)).isoformat(timespec="milliseconds")
    if what == "deleted":
        names = _deleted(database, until, session)
        size = select(func.count(), func.coalesce(func.sum(func.length(chunks.c.payload)), 0))
        counts = [database.rows(size.where(chunks.c.session == name))[0] for name in names]
        if not dry_run:
            for name in names:
                erase(database, name)
            _note(database, what, older_days, names)
        return Purged(len(names), sum(int(c[0]) for c in counts), sum(int(c[1]) for c in counts))
    table, old = (jobs, _old_jobs(until)) if what == "jobs" else (messages, _old_messages(until))
    if session is not None:
        old &= table.c.session == session
    count = int(database.value(select(func.count()).select_from(table).where(old)))
    if not dry_run:
        if what == "jobs":
            ended = select(jobs.c.id).where(old)
            _remove(database, job_parts, job_parts.c.job.in_(ended))
        _remove(database, table, old)
        _note(database, what, older_days, [session] if count else [])
    return Purged(jobs=count) if what == "jobs" else Purged(messages=count)


def _note(database: Database, what: What, older_days: float, names: Sequence[str | None]) -> None:
    """Keep in the audit trail what was removed, where anything was; the trail itself is never shortened."""
    with database.writing() as connection:
        for name in names:
            record(connection, "purged", name, {"what": what, "older_days": older_days})


def retain(database: Database, days: Mapping[What, float]) -> None:
    """Remove what is kept for so many days only, and give the space back."""
    if not days:
        return
    with nullcontext() if database.file is None else released(database.file.parent):
        for what, most in days.items():
            purge(database, what, most)
        give_back(database)


def erase(database: Database, session: str) -> None:
    """Remove the content of a deleted session; its row, its revisions and frozen predictions stay."""
    deleted = (sessions.c.id == session) & sessions.c.deleted_utc.is_not(None)
    with database.writing() as connection:
        # First the document, which brings a deleted session back; last the specimen, by which a purge is gone on with.
        if not connection.execute(update(sessions).where(deleted).values(document=None)).rowcount:
            return
    for table in (chunks, events, streams, edits, messages):
        _remove(database, table, table.c.session == session)
    mine = jobs.c.session == session
    _remove(database, job_parts, job_parts.c.job.in_(select(jobs.c.id).where(mine & jobs.c.state.in_(ENDED))))
    _remove(database, jobs, mine & jobs.c.state.in_(ENDED))
    with database.writing() as connection:
        connection.execute(update(sessions).where(deleted).values(specimen=None))


def reusable_bytes(database: Database) -> int | None:
    """Return bytes of the database's file that hold nothing; None for PostgreSQL, which keeps house itself."""
    if database.dialect != "sqlite":
        return None
    free, size = (int(database.value(text(f"PRAGMA {p}"))) for p in ("freelist_count", "page_size"))
    return free * size


def give_back(database: Database, *, alone: bool = False) -> bool:
    """Give the disk what a database's file does not use; return whether that could be done.

    Args:
        database: of SQLite, or of PostgreSQL, where nothing has to be done.
        alone: whether nobody else uses it: then a file of an earlier version, which cannot shrink, is made anew.

    Raises:
        LaterError: there is no space for a new file.
        OperationalError: the file cannot be written, such as on a full disk.
    """
    if database.file is None:
        return True
    try:
        return _give_back(database.file, alone)
    except sqlite3.Error as error:
        raise OperationalError("give back", None, error) from error


def _give_back(file: Path, alone: bool) -> bool:
    # Stepped through to its end, which only the driver itself does.
    with closing(sqlite3.connect(file, timeout=60.0, isolation_level=None)) as connection:
        bit_by_bit = connection.execute("PRAGMA auto_vacuum").fetchone()[0] == 2
        if not bit_by_bit and alone:
            try:
                connection.execute("PRAGMA auto_vacuum=INCREMENTAL")
                connection.execute("VACUUM")
            except sqlite3.Error as error:
                raise LaterError(
                    f"{file} cannot be made smaller ({error})", "as much free space as it has content", "Make room"
                ) from error
        elif bit_by_bit:
            while connection.execute("PRAGMA freelist_count").fetchone()[0]:
                # Within a transaction: without one, the driver passes over a full disk, and this would never end.
                with connection:
                    connection.execute("BEGIN IMMEDIATE")
                    connection.execute(f"PRAGMA incremental_vacuum({_PAGES})").fetchall()
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
        return bit_by_bit or alone


def _deleted(database: Database, until: str, session: str | None) -> list[str]:
    """Return sessions that were deleted before a time and still have content."""
    held = (exists().where(t.c.session == sessions.c.id) for t in (chunks, streams, events, edits))
    query = select(sessions.c.id).where(
        sessions.c.deleted_utc <= until, sessions.c.arriving.is_(None), or_(sessions.c.specimen.is_not(None), *held)
    )
    return [row.id for row in database.rows(query if session is None else query.where(sessions.c.id == session))]


def _old_jobs(until: str) -> ColumnElement[bool]:
    return jobs.c.state.in_(ENDED) & (jobs.c.finished_utc <= until)


def _old_messages(until: str) -> ColumnElement[bool]:
    """Select messages except the last, whose number must stay taken, and those that follow a running bench."""
    running = select(sessions.c.id).where(
        sessions.c.document.is_(None), sessions.c.closed_utc.is_(None), sessions.c.deleted_utc.is_(None)
    )
    last = select(func.max(messages.c.id)).scalar_subquery()
    free = or_(messages.c.session.is_(None), messages.c.session.not_in(running))
    return (messages.c.created_utc <= until) & (messages.c.id < last) & free


def _remove(database: Database, table: Table, which: ColumnElement[bool]) -> None:
    key = table.primary_key.columns
    query = select(*key).where(which).limit(_CHUNKS if table is chunks else _ROWS)
    while found := [tuple(row) for row in database.rows(query)]:
        with database.writing() as connection:
            connection.execute(delete(table).where(tuple_(*key).in_(found)))
