"""Copies of the service's database: made while it runs, proved before they count, and put back when it is needed."""

from __future__ import annotations

import datetime as dt
import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import text

from daq.errors import InputError
from daq.export.tables import sha256_of
from server.service.operation.folder import HeldError, folder_of, held, made, sqlite_of
from server.service.operation.migrate import check, expected, upgrade
from server.service.operation.scrub import damage_of, named
from server.service.settings import Settings
from server.service.storage.audit import record
from server.service.storage.database import Database
from server.service.storage.files import BESIDE, beside, settle

_WAIT_S = 60.0


@dataclass(frozen=True)
class Copy:
    """A database's file."""

    file: Path  # where it is
    size_bytes: int  # of the file
    revision: str  # version of its schema
    sessions: int  # how many it holds, deleted ones included

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self) | {"file": str(self.file)}


def backup(settings: Settings, target: Path) -> Copy:
    """Copy the database of a service, which may run meanwhile, into a new file.

    Raises:
        InputError: it is no SQLite database, the file exists or cannot be written, or the copy is not sound.
    """
    source = sqlite_file(settings, "pg_dump --format=custom --file=FILE DATABASE")
    if not source.is_file():
        raise InputError(f"there is no database in {source.parent}", "the service's folder", "Give it with --data")
    if target.exists():
        raise InputError(f"{target} exists", "a new file", "A backup overwrites nothing: give another name")
    with _written_beside(target) as temporary:
        copy(source, temporary)
        made_of = prove(temporary)
        if target.exists():
            raise InputError(f"{target} exists by now", "a new file", "A backup overwrites nothing: give another name")
        temporary.replace(target)
        settle(target.parent)
    return Copy(target, made_of.size_bytes, made_of.revision, made_of.sessions)


def restore(settings: Settings, source: Path, *, force: bool = False) -> tuple[Copy, Path | None]:
    """Put a backup in the database's place; return it, and where the former database is kept.

    Args:
        settings: say where the database is.
        source: the backup; it stays as it is.
        force: put it in the place of a database that is there; that one is kept under another name.

    Raises:
        InputError: a service runs there, the backup is not sound, or there is a database and `force` is not given.
    """
    target = sqlite_file(settings, "pg_restore --clean --if-exists --dbname=DATABASE FILE")
    if not source.is_file():
        raise InputError(f"there is no file {source}", "a backup of fingertwin backup")
    folder = made(target.parent)
    target = folder / target.name
    with _not_running(settings), _written_beside(target) as temporary:
        copy(source, temporary, "ro")
        given = prove(temporary)
        with closing(Database(f"sqlite:///{temporary}")) as database:
            upgrade(database)
            with database.writing() as connection:
                told = {"backup": source.name, "sha256": sha256_of(source), "revision": given.revision}
                record(connection, "restored", None, told | {"sessions": given.sessions})
        found = prove(temporary)
        aside = _set_aside(target, force)
        temporary.replace(target)
        settle(folder)
    return Copy(target, found.size_bytes, found.revision, found.sessions), aside


def sqlite_file(settings: Settings, instead: str) -> Path:
    """Return the file of the database.

    Args:
        settings: say which database.
        instead: command for PostgreSQL.

    Raises:
        InputError: it is a database of PostgreSQL.
    """
    file = sqlite_of(settings)
    if file is None:
        raise InputError(
            "the database is PostgreSQL's", "SQLite in a file", f"PostgreSQL has its own command for it: {instead}"
        )
    return file


def copy(source: Path, target: Path, mode: str = "rw") -> None:
    """Copy a database as it is at one moment, whoever writes to it meanwhile.

    Args:
        source: its file.
        target: the new one.
        mode: `ro` leaves the source as it is to the byte; `rw` tidies it up where nobody else has it open.

    Raises:
        InputError: it cannot be read, or the copy not written.
    """
    try:
        with (
            closing(_open(source, mode)) as from_there,
            closing(sqlite3.connect(target, timeout=_WAIT_S, isolation_level=None)) as to,
        ):
            # In one step: a step after which others have written would begin anew.
            from_there.backup(to, pages=-1)
            # One file, that needs nothing beside it.
            to.execute("PRAGMA journal_mode=DELETE")
    except sqlite3.Error as error:
        raise InputError(
            f"{source} cannot be copied to {target.parent} ({error})",
            "a database of SQLite, and a folder with space that may be written",
            "Check both",
        ) from error


def prove(file: Path) -> Copy:
    """Read a whole database and return what it holds.

    Raises:
        InputError: it is damaged, of a newer version, or not fingertwin's.
    """
    try:
        with closing(_open(file)) as connection:
            faults = [str(row[0]) for row in connection.execute("PRAGMA integrity_check(5)")]
            faults = [] if faults == ["ok"] else faults
            if not faults and connection.execute("SELECT 1 FROM sqlite_master LIMIT 1").fetchone() is None:
                raise InputError("the copy holds nothing", "a database of fingertwin's")
            if not faults and connection.execute("PRAGMA foreign_key_check").fetchone() is not None:
                faults = ["rows that refer to others which are not there"]
    except sqlite3.Error as error:
        raise InputError(f"the copy cannot be read ({error})", "a database of SQLite", "Take another backup") from error
    if faults:
        raise InputError(f"the copy is damaged ({faults[0]})", "a sound database", "Take another backup")
    with closing(Database(f"sqlite:///{file}")) as database:
        revision = check(database)
        # Before it is brought up to date, it may have no checksums.
        damaged = damage_of(database) if revision == expected() else ()
        if damaged:
            raise InputError(
                named(damaged),
                "rows whose checksums hold",
                "Restore an earlier backup, or delete their sessions and remove them: fingertwin purge deleted",
            )
        sessions = int(database.value(text("SELECT count(*) FROM sessions")))
    with closing(_open(file)) as connection:
        connection.execute("PRAGMA journal_mode=DELETE")
    return Copy(file, file.stat().st_size, revision, sessions)


@contextmanager
def _not_running(settings: Settings) -> Iterator[None]:
    try:
        with held(folder_of(settings)):
            yield
    except HeldError as error:
        raise InputError(error.found, "one that is stopped", "End it, then restore") from error


@contextmanager
def _written_beside(target: Path) -> Iterator[Path]:
    """Yield a temporary name in the folder of a file, which is made where it is absent."""
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with beside(target) as temporary:
            yield temporary
    except OSError as error:
        raise InputError(
            f"{target} cannot be written ({error.strerror or error})", "a folder with space that may be written"
        ) from error


def _set_aside(target: Path, force: bool) -> Path | None:
    """Keep a database under another name as well; return it, None where there is none."""
    log = target.with_name(f"{target.name}-wal")
    if not target.exists() and not log.exists():
        return None
    if not force:
        raise InputError(
            f"there is a database in {target.parent}", "none, or --force", "With --force it is kept under another name"
        )
    at = dt.datetime.now(dt.UTC).strftime("%Y%m%dT%H%M%S%f")
    aside = target.with_name(f"{target.stem}-before-restore-{at}{target.suffix}")
    try:
        # What is in its log goes into its file, and the log goes: where nobody else has it open.
        with closing(_open(target)) as connection:
            connection.execute("PRAGMA busy_timeout=1000")
            connection.execute("PRAGMA journal_mode=DELETE")
    except sqlite3.Error as error:
        if getattr(error, "sqlite_errorcode", 0) & 0xFF in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
            raise _in_use(target) from error
        # Not to be read: what is left of it is kept as it is.
        for ending in ("", *BESIDE):
            file = target.with_name(target.name + ending)
            if file.exists():
                file.rename(aside.with_name(aside.name + ending))
        return aside
    if log.exists():
        raise _in_use(target)
    try:
        # Under both names until the backup takes its place: at no moment is there none.
        os.link(target, aside)
    except OSError:
        target.rename(aside)
    return aside


def _in_use(target: Path) -> InputError:
    return InputError(f"{target} is in use", "nobody who has it open", "End the other program, then restore")


def _open(file: Path, mode: str = "rw") -> sqlite3.Connection:
    """Open a database that is there."""
    return sqlite3.connect(f"{file.resolve().as_uri()}?mode={mode}", timeout=_WAIT_S, isolation_level=None, uri=True)
