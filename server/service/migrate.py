"""Bring a database to the version of the schema that this software knows, in one transaction."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import resources
from typing import Any

from sqlalchemy import Connection, create_engine, event, inspect, text
from sqlalchemy.exc import DBAPIError
from sqlalchemy.pool import NullPool

from daq.errors import InputError
from server.service.database import Database

SCRIPTS = "server.service:migrations"
# Of PostgreSQL's advisory lock: two services that start on one database upgrade it one after the other.
LOCK = 0x66_74_77_69_6E
_WAIT_MS = 60_000


@cache
def known() -> tuple[str, ...]:
    """Versions of the schema that this software knows, oldest first."""
    # From the names of the steps: Alembic would have to be loaded at every start of the service.
    package, _, folder = SCRIPTS.partition(":")
    steps = (file.name for file in (resources.files(package) / folder / "versions").iterdir())
    return tuple(sorted(name.partition("_")[0] for name in steps if name[0].isdigit()))


def expected() -> str:
    """The version of the schema that this software works with."""
    return known()[-1]


def upgrade(database: Database, to: str = "head") -> str:
    """Bring a database to a version of the schema; return which it had, empty for a new one.

    Raises:
        InputError: it is of a newer version, holds something else, is damaged, or cannot be written.
    """
    with explained(database), _alone(database) as connection:
        found = version_of(connection)
        if found != (expected() if to == "head" else to):
            _run(connection, to)
        # What can only be read is known now, not when the first reading comes.
        connection.execute(text("UPDATE alembic_version SET version_num = version_num"))
    return found


def check(database: Database) -> str:
    """Return the version of a database that need not be the latest, empty for a new one.

    Raises:
        InputError: as of `upgrade`.
    """
    with explained(database), database.reading() as connection:
        return version_of(connection)


def version_of(connection: Connection) -> str:
    """Return the version that a database has, empty where it holds nothing.

    Raises:
        InputError: it is of a newer version, or holds something else.
    """
    tables = set(inspect(connection).get_table_names())
    if "alembic_version" not in tables:
        if tables:
            some = ", ".join(sorted(tables)[:3])
            raise InputError(f"the database holds something else ({some})", "an empty one, or one of fingertwin's")
        return ""
    found = connection.execute(text("SELECT version_num FROM alembic_version")).scalars().all()
    if not found:
        return ""
    for version in found:
        if version not in known():
            raise InputError(
                f"the database is of a newer version ({version})",
                f"{expected()} or older",
                "Use the newer fingertwin",
            )
    return str(found[0])


@contextmanager
def explained(database: Database) -> Iterator[None]:
    """Turn what a database's driver says into one line on what to do."""
    try:
        yield
    except DBAPIError as error:
        raise unusable(database, error) from error


def unusable(database: Database, error: DBAPIError) -> InputError:
    """What is wrong with a database that cannot be used."""
    said = " ".join(str(error.orig).split())
    file = database.file
    if file is None:
        where = database.url.render_as_string(hide_password=True)
        return InputError(
            f"the database {where} cannot be used ({said})",
            "a PostgreSQL server that answers, with a database that may be written",
            "Check its address, name and password",
        )
    if "not a database" in said:
        return InputError(f"{file} is no SQLite database", "one of fingertwin's", "Give another folder with --data")
    if "malformed" in said or "corrupt" in said:
        return InputError(f"{file} is damaged ({said})", "a sound database", "Restore a backup: fingertwin restore")
    if "locked" in said or "busy" in said:
        return InputError(f"{file} is in use ({said})", "nobody else who writes it", "End the other program")
    if "full" in said:
        return InputError(f"the disk of {file} is full", "space for the database", "Make room")
    if "readonly" in said or "unable to open" in said or "disk I/O" in said:
        return InputError(
            f"{file} cannot be written ({said})",
            "a folder on a disk that may be written",
            "Check its rights, or give another with --data",
        )
    return InputError(f"{file} cannot be used ({said})", "a database of fingertwin's")


@contextmanager
def _alone(database: Database) -> Iterator[Connection]:
    if database.dialect != "sqlite":
        with database.engine.begin() as connection:
            connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": LOCK})
            yield connection
        return
    engine = create_engine(database.url, connect_args={"isolation_level": None}, poolclass=NullPool)

    @event.listens_for(engine, "connect")
    def prepare(connection: Any, _: Any) -> None:
        # A table that is copied is dropped meanwhile; its rows' references are checked at the end.
        for pragma in (f"busy_timeout={_WAIT_MS}", "journal_mode=WAL", "synchronous=FULL", "foreign_keys=OFF"):
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
