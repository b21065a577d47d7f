"""Bring a database to the version of the schema that this software knows, in one transaction."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, create_engine, event, inspect, text
from sqlalchemy.exc import DBAPIError, NoSuchTableError
from sqlalchemy.pool import NullPool

from daq.errors import LATER, InputError, LaterError
from server.service.storage.database import Database
from server.service.storage.files import beside, settle
from server.service.storage.schema import metadata

SCRIPTS = "server.service:migrations"
# Of PostgreSQL's advisory lock: two services that start on one database upgrade it one after the other.
LOCK = 0x66_74_77_69_6E
_WAIT_MS = 60_000
_OURS = "one of fingertwin's"
_RESTORE = "Restore a backup: fingertwin restore"
_UNWRITABLE = ("a folder on a disk that may be written", "Check its rights, or give another with --data")
# By words of what SQLite says, the first that fit: whether it may pass, what is found, what is expected, what to do.
# A folder that cannot be written stays so; a full disk, no free descriptor or a lost mount do not.
_FAULTS: tuple[tuple[tuple[str, ...], type[InputError], str, str, str], ...] = (
    (("not a database",), InputError, "is no SQLite database", _OURS, "Give another folder with --data"),
    (("malformed", "corrupt"), InputError, "is damaged ({said})", "a sound database", _RESTORE),
    (("locked", "busy"), LaterError, "is in use ({said})", "nobody else who writes it", "End the other program"),
    (("no such",), InputError, "lacks what its version has ({said})", "all of its tables", _RESTORE),
    (("disk I/O",), LaterError, "cannot be written ({said})", *_UNWRITABLE),
    (("readonly", "unable to open"), InputError, "cannot be written ({said})", *_UNWRITABLE),
    (("",), InputError, "cannot be used ({said})", "a database of fingertwin's", ""),
)


@cache
def known() -> tuple[str, ...]:
    """Return versions of the schema that this software knows, oldest first."""
    # From the names of the steps: Alembic would have to be loaded at every start of the service.
    package, _, folder = SCRIPTS.partition(":")
    steps = (file.name for file in (resources.files(package) / folder / "versions").iterdir())
    return tuple(sorted(name.partition("_")[0] for name in steps if name[0].isdigit()))


def expected() -> str:
    """Return the version of the schema that this software works with."""
    return known()[-1]


def upgrade(database: Database, to: str = "head") -> str:
    """Bring a database to a version of the schema; return which it had, empty for a new one.

    Raises:
        InputError: it is of a version that is not known, holds something else or nothing, is damaged, or cannot be
            written.
    """
    with explained(database):
        try:
            if _is_absent(database.file) and _begun(database, to):
                return ""
        except OSError as error:
            raise (LaterError if error.errno in LATER else InputError)(
                f"{database.file} cannot be made ({error.strerror or error})",
                "a folder with space that may be written",
                "Make room, or give another with --data",
            ) from error
    with explained(database), _alone(database) as connection:
        found = version_of(connection)
        if not found and database.file is not None:
            raise _empty(database.file)
        if found != (expected() if to == "head" else to):
            _run(connection, to)
        if to == "head":
            _require_tables(connection)
        # What can only be read is known now, not when the first reading comes.
        connection.execute(text("UPDATE alembic_version SET version_num = version_num"))
    return found


def check(database: Database) -> str:
    """Return the version of a database that need not be the latest, empty where there is none yet.

    Raises:
        InputError: as of `upgrade`.
    """
    if _is_absent(database.file):
        return ""
    with explained(database), database.reading() as connection:
        found = version_of(connection)
        if not found and database.file is not None:
            raise _empty(database.file)
        if found == expected():
            _require_tables(connection)
        return found


def version_of(connection: Connection) -> str:
    """Return the version that a database has, empty where it holds nothing.

    Raises:
        InputError: it is of a version that is not known, or holds something else.
    """
    tables = set(inspect(connection).get_table_names())
    if "alembic_version" not in tables:
        if tables:
            some = ", ".join(sorted(tables)[:3])
            raise InputError(f"the database holds something else ({some})", "an empty one, or one of fingertwin's")
        return ""
    found = connection.execute(text("SELECT version_num FROM alembic_version")).scalars().all()
    version = str(found[0]) if len(found) == 1 else ""
    if version not in known():
        newer = "a newer version" if version > expected() else "an unknown version"
        raise InputError(
            f"the database is of {newer} ({version or 'none is written down'})",
            f"{expected()} or older",
            "Use the newer fingertwin" if version > expected() else _RESTORE,
        )
    return version


def _is_absent(file: Path | None) -> bool:
    """Return whether there is no file of SQLite's where there is to be one.

    Raises:
        InputError: only the log of one is there.
    """
    if file is None or file.exists() or str(file).startswith(("file:", ":memory:")):
        return False
    log = file.with_name(f"{file.name}-wal")
    if log.exists():
        raise InputError(f"{file} is not there, but its log {log.name} is", "both", "Restore a backup")
    return True


def _begun(database: Database, to: str) -> bool:
    """Make a new file of SQLite's under another name, and give it its own when it is whole; False where one has come.

    So an empty file is never a database that is being made, but one that was lost.
    """
    file = database.file
    if file is None or not file.parent.is_dir():
        return False
    with beside(file) as temporary:
        with _alone(Database(f"sqlite:///{temporary}")) as connection:
            _run(connection, to)
        with _alone(Database(f"sqlite:///{temporary}"), "DELETE"):
            pass
        try:
            # Unlike a replacement, it fails where somebody else was first.
            os.link(temporary, file)
        except FileExistsError:
            return False
        except OSError:
            temporary.rename(file)
        settle(file.parent)
    return True


def _empty(file: Path) -> InputError:
    return InputError(
        f"{file} holds nothing", "a database of fingertwin's", "Restore a backup, or remove the file to begin anew"
    )


def _require_tables(connection: Connection) -> None:
    """Refuse a database that lacks tables or columns of its version."""
    found = inspect(connection)
    there = {t: {c["name"] for c in columns} for (_, t), columns in found.get_multi_columns().items()}
    for table in metadata.sorted_tables:
        lacks = {c.name for c in table.columns} - there.get(table.name, set())
        if lacks:
            what = f"columns of {table.name}: {', '.join(sorted(lacks))}" if table.name in there else table.name
            raise InputError(
                f"the database lacks the {'' if table.name in there else 'table '}{what}",
                f"all of version {expected()}",
                _RESTORE,
            )


@contextmanager
def explained(database: Database) -> Iterator[None]:
    """Turn what a database's driver says into one line on what to do."""
    try:
        yield
    except DBAPIError as error:
        raise unusable(database, error) from error
    except NoSuchTableError as error:
        raise InputError(f"the database lacks the table {error}", "all of its version", _RESTORE) from error


def unusable(database: Database, error: DBAPIError) -> InputError:
    """Return the fault of a database that cannot be used."""
    said = " ".join(str(error.orig).split())
    file = database.file
    if file is None:
        where = database.url.render_as_string(hide_password=True)
        never = any(words in said for words in ("authentication failed", "does not exist", "permission denied"))
        return (InputError if never else LaterError)(
            f"the database {where} cannot be used ({said})",
            "a PostgreSQL server that answers, with a database that may be written",
            "Check its address, name and password",
        )
    if "full" in said:
        # A purge writes, too; what the log holds may need as much room again in the file.
        log = file.with_name(f"{file.name}-wal")
        least_MB = 4 + (log.stat().st_size if log.exists() else 0) // 1_000_000
        return LaterError(
            f"the disk of {file} is full",
            f"{least_MB} MB of free space, also for a purge",
            "Move other files off this disk, such as backups and former databases, and try again",
        )
    _, kind, found, expected, remedy = next(f for f in _FAULTS if any(words in said for words in f[0]))
    return kind(f"{file} {found.format(said=said)}", expected, remedy)


@contextmanager
def _alone(database: Database, log: str = "WAL") -> Iterator[Connection]:
    if database.dialect != "sqlite":
        with database.engine.begin() as connection:
            connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": LOCK})
            yield connection
        return
    engine = create_engine(database.url, connect_args={"isolation_level": None}, poolclass=NullPool)

    @event.listens_for(engine, "connect")
    def prepare(connection: Any, _: Any) -> None:
        # A table that is copied is dropped meanwhile; its rows' references are checked at the end.
        # Of a new file: what is deleted can be given back to the disk bit by bit.
        first = ("auto_vacuum=INCREMENTAL", f"busy_timeout={_WAIT_MS}", f"journal_mode={log}")
        for pragma in (*first, "synchronous=FULL", "foreign_keys=OFF"):
            connection.execute(f"PRAGMA {pragma}")

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        connection.exec_driver_sql("BEGIN IMMEDIATE")

    with engine.begin() as connection:
        yield connection
        broken = connection.exec_driver_sql("PRAGMA foreign_key_check").first()
        if broken is not None:
            raise RuntimeError(f"a migration has broken a reference of {broken[0]}")


def _run(connection: Connection, to: str) -> None:
    from alembic import command

    config = _config()
    config.attributes["connection"] = connection
    command.upgrade(config, to)


def _config() -> Any:
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", SCRIPTS)
    return config
