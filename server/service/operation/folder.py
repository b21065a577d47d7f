"""The service's data folder: made where it is absent, and held by one service at a time."""

from __future__ import annotations

import sqlite3
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import text

from daq.errors import LATER, InputError, JournalError, LaterError
from daq.journal.lock import InUseError, WriterLock
from daq.private import close_to_others
from server.service.operation.migrate import LOCK, explained
from server.service.settings import DATABASE_FILE, Settings
from server.service.storage.database import Database

_LOCK = "service"
# What SQLite says of a disk that knows no locks, which stays so.
_NO_LOCKS = (sqlite3.SQLITE_IOERR_LOCK, sqlite3.SQLITE_IOERR_RDLOCK, sqlite3.SQLITE_IOERR_CHECKRESERVEDLOCK)


class HeldError(InputError):
    """A service runs on this data."""


def made(folder: Path) -> Path:
    """Make a folder where it is absent, and return it in full.

    Raises:
        InputError: it cannot be made or written to.
    """
    trial = folder / f".{uuid.uuid4().hex[:12]}.trial"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        close_to_others(folder)
        trial.touch()
        trial.unlink()
    except OSError as error:
        raise (LaterError if error.errno in LATER else InputError)(
            f"the data folder {folder} cannot be written ({error.strerror or error})",
            "a folder that may be written",
            "Check its rights and its disk, or give another with --data",
        ) from error
    return folder.resolve()


def sqlite_of(settings: Settings) -> Path | None:
    """Return the file of the database; None where it is PostgreSQL's.

    Raises:
        InputError: it is a database of another kind, or none in a file.
    """
    if settings.database_url is None:
        return settings.data / DATABASE_FILE
    database = Database(settings.database_url)
    database.close()
    if database.dialect != "sqlite":
        return None
    if database.file is None or str(database.file) == ":memory:":
        raise InputError("a database in memory", "one in a file", "Nothing of it would be left after a restart")
    return database.file


def folder_of(settings: Settings) -> Path:
    """Return the folder that is locked: of the database's file, or of the data."""
    file = sqlite_of(settings)
    return settings.data if file is None else file.parent


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Keep other services away from a folder while the block runs; the process's end, too, lets it go.

    Raises:
        HeldError: a service runs on it.
        InputError: it cannot be locked.
    """
    try:
        lock = WriterLock(folder / _LOCK)
    except InUseError as error:
        raise HeldError(
            f"a service runs on the data in {folder}", "a folder of its own for each", "End it, or give another --data"
        ) from error
    except JournalError as error:
        code = getattr(error.__cause__, "sqlite_errorcode", 0)
        later = code not in _NO_LOCKS and code & 0xFF in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR)
        raise (LaterError if later else InputError)(
            f"the data folder {folder} cannot be locked ({error.__cause__})",
            "a disk with space that lets a file be locked",
            "Make room, or give another --data",
        ) from error
    try:
        yield
    finally:
        lock.close()


@contextmanager
def alone(database: Database) -> Iterator[None]:
    """Keep other services away from a database of PostgreSQL while the block runs; SQLite's has its folder's lock.

    Raises:
        HeldError: a service runs on it.
        InputError: it does not answer.
    """
    if database.dialect == "sqlite":
        yield
        return
    # Of this connection, for as long as it is open.
    connection = database.engine.connect().execution_options(isolation_level="AUTOCOMMIT")
    try:
        with explained(database):
            # Another key than the migrations' own.
            free = connection.execute(text("SELECT pg_try_advisory_lock(:key)"), {"key": LOCK + 1}).scalar()
        if not free:
            where = database.url.render_as_string(hide_password=True)
            raise HeldError(f"a service runs on the database {where}", "a database of its own for each", "End it")
        yield
    finally:
        connection.invalidate()
        connection.close()
