"""The schema's versions: the steps lead from the first to what the code works with, and lose nothing."""

from __future__ import annotations

import importlib.resources
import multiprocessing
import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Boolean, Column, Connection, Float, Integer, LargeBinary, MetaData, insert, inspect, select, text
from sqlalchemy.types import JSON

from daq.errors import InputError
from server.service.operation import migrate
from server.service.operation.migrate import check, expected, known, upgrade
from server.service.storage.checksums import Sealed
from server.service.storage.database import Database
from server.service.storage.schema import metadata
from tests.server.service.postgres import postgres_url


@pytest.fixture(params=["sqlite", "postgresql"])
def database(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Database]:
    url = f"sqlite:///{tmp_path / 'a.db'}" if request.param == "sqlite" else postgres_url()
    made = Database(url)
    yield made
    made.close()


def shape(connection: Connection) -> dict[str, Any]:
    """Everything that a database says of its tables."""
    found = inspect(connection)
    return {
        name: {
            "columns": {c["name"]: (str(c["type"]), c["nullable"], c["default"]) for c in found.get_columns(name)},
            "key": found.get_pk_constraint(name),
            "foreign": sorted(found.get_foreign_keys(name), key=str),
            "unique": sorted(found.get_unique_constraints(name), key=str),
            "indexes": sorted(found.get_indexes(name), key=str),
        }
        for name in found.get_table_names()
        if name != "alembic_version"
    }


def test_the_steps_lead_to_the_schema_that_the_code_works_with(database: Database, tmp_path: Path) -> None:
    upgrade(database)
    fresh = Database(f"sqlite:///{tmp_path / 'b.db'}" if database.dialect == "sqlite" else postgres_url())
    metadata.create_all(fresh.engine)
    with database.reading() as connection, fresh.reading() as other:
        assert compare_metadata(MigrationContext.configure(connection), metadata) == []
        assert shape(connection) == shape(other)
    fresh.close()


def value_of(column: Column[Any]) -> Any:
    if column.foreign_keys:
        return "one" if not isinstance(column.type, Integer) else 1
    kinds: list[tuple[Any, Any]] = [
        ((JSON, Sealed), {"a": [1.5, None, "ü"]}), (LargeBinary, b"\0\xff"), (Boolean, True), (Float, 1.25),
        (Integer, 7),
    ]  # fmt: skip
    return next((value for kind, value in kinds if isinstance(column.type, kind)), "one")


def test_a_database_of_the_first_version_keeps_its_rows(database: Database) -> None:
    first = known()[0]
    assert upgrade(database, first) == ""
    then = MetaData()
    with database.writing() as connection:
        then.reflect(connection)
        # In the order of their references; a table's columns as they were then, and as they are today.
        old = {
            t.name: [t.c[c.name] for c in then.tables[t.name].c]
            for t in metadata.sorted_tables
            if t.name in then.tables
        }
        for name, columns in old.items():
            row = {column.name: value_of(column) for column in columns}
            connection.execute(insert(then.tables[name]).values(row))
        before = {
            name: connection.execute(select(*(then.tables[name].c[c.name] for c in columns))).all()
            for name, columns in old.items()
        }
    assert set(before) >= {"sessions", "chunks", "events", "edits", "revisions", "jobs", "tokens"}
    assert upgrade(database) == first
    assert check(database) == expected()
    with database.reading() as connection:
        after = {name: connection.execute(select(*columns)).all() for name, columns in old.items()}
    assert after == before
    assert {len(rows) for rows in after.values()} == {1}


def test_an_upgrade_that_has_nothing_to_do_changes_nothing(database: Database) -> None:
    upgrade(database)
    with database.reading() as connection:
        before = shape(connection)
    assert upgrade(database) == expected()
    with database.reading() as connection:
        assert shape(connection) == before


def test_a_newer_database_is_left_alone(database: Database) -> None:
    upgrade(database)
    with database.writing() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    for attempt in (upgrade, check):
        with pytest.raises(InputError, match=r"newer version \(9999\); expected .* Use the newer fingertwin"):
            attempt(database)


def test_a_database_of_something_else_is_left_alone(database: Database) -> None:
    with database.writing() as connection:
        connection.execute(text("CREATE TABLE recipes (name TEXT)"))
    with pytest.raises(InputError, match=r"something else \(recipes\)"):
        upgrade(database)
    with database.reading() as connection:
        assert inspect(connection).get_table_names() == ["recipes"]


@pytest.mark.parametrize("lost", ["DROP TABLE tokens", "ALTER TABLE frozen DROP COLUMN document"])
def test_a_database_without_its_tables_is_refused(database: Database, lost: str) -> None:
    upgrade(database)
    with database.writing() as connection:
        connection.execute(text(lost))
    for attempt in (upgrade, check):
        with pytest.raises(InputError, match=r"lacks the (table tokens|columns of frozen: document); .* Restore"):
            attempt(database)


def test_an_older_database_without_its_tables_is_refused_and_left_alone(database: Database) -> None:
    upgrade(database, known()[0])
    with database.writing() as connection:
        connection.execute(text("DROP TABLE messages"))
    with pytest.raises(InputError, match=r"lacks|cannot be used"):
        upgrade(database)
    assert check(database) == known()[0]


@pytest.mark.parametrize("versions", [[], ["0000"], ["0001", "0002"]])
def test_a_database_of_an_unknown_version_is_refused(database: Database, versions: list[str]) -> None:
    upgrade(database)
    with database.writing() as connection:
        connection.execute(text("DELETE FROM alembic_version"))
        for version in versions:
            connection.execute(text(f"INSERT INTO alembic_version VALUES ('{version}')"))  # noqa: S608
    for attempt in (upgrade, check):
        with pytest.raises(InputError, match="of an unknown version"):
            attempt(database)


def test_an_empty_file_is_refused_and_a_missing_one_begun_whole(tmp_path: Path) -> None:
    file = tmp_path / "a.db"
    database = Database(f"sqlite:///{file}")
    assert check(database) == ""
    assert not file.exists()
    for pragma in ("user_version=0", "journal_mode=WAL"):
        with closing(sqlite3.connect(file)) as connection:
            connection.execute(f"PRAGMA {pragma}")
        for attempt in (upgrade, check):
            with pytest.raises(InputError, match=r"a\.db holds nothing; .* Restore a backup, or remove the file"):
                attempt(database)
        database.close()
    file.unlink()
    (tmp_path / "a.db-wal").write_bytes(b"")
    with pytest.raises(InputError, match=r"not there, but its log"):
        upgrade(database)
    (tmp_path / "a.db-wal").unlink()
    assert upgrade(database) == ""
    database.close()
    assert {f.name for f in tmp_path.iterdir()} == {"a.db"}


def upgraded(url: str) -> str:
    database = Database(url)
    try:
        return upgrade(database)
    finally:
        database.close()


def test_processes_that_start_at_once_upgrade_one_after_the_other(database: Database) -> None:
    with multiprocessing.get_context("spawn").Pool(3) as pool:
        url = database.url.render_as_string(hide_password=False)
        found = pool.map(upgraded, [url] * 3, chunksize=1)
    assert sorted(found) == ["", expected(), expected()]


def test_what_cannot_be_used_is_told_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "text.db").write_bytes(b"no database at all" * 1000)
    (tmp_path / "folder.db").mkdir()
    sound = Database(f"sqlite:///{tmp_path / 'sound.db'}")
    upgrade(sound)
    sound.close()
    data = bytearray((tmp_path / "sound.db").read_bytes())
    data[100:4096] = os.urandom(3996)
    (tmp_path / "damaged.db").write_bytes(data)
    for name, said in [
        ("text.db", "is no SQLite database; expected"),
        ("folder.db", "cannot be written"),
        ("absent/a.db", "cannot be written"),
        ("damaged.db", "damaged .* Restore a backup"),
        (f"file:{tmp_path}/sound.db?mode=ro&uri=true", r"cannot be written \(attempt to write a readonly database"),
    ]:
        url = f"sqlite:///{name if name.startswith('file:') else tmp_path / name}"
        with pytest.raises(InputError, match=said) as caught:
            upgrade(Database(url))
        assert "\n" not in str(caught.value)
    assert (tmp_path / "text.db").read_bytes() == b"no database at all" * 1000


def test_a_server_that_does_not_answer_is_told_without_its_password() -> None:
    with pytest.raises(InputError, match="cannot be used") as caught:
        upgrade(Database("postgresql+psycopg://anna:secret@127.0.0.1:1/lab"))
    assert "secret" not in str(caught.value)


def test_a_broken_step_leaves_the_database_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    database = Database(f"sqlite:///{tmp_path / 'a.db'}")

    def fails(connection: Connection, to: str) -> None:
        connection.execute(text("CREATE TABLE half (a TEXT)"))
        raise RuntimeError("power cut")

    monkeypatch.setattr("server.service.operation.migrate._run", fails)
    with pytest.raises(RuntimeError, match="power cut"):
        upgrade(database)
    database.close()
    with closing(sqlite3.connect(tmp_path / "a.db")) as connection:
        assert connection.execute("SELECT * FROM sqlite_master").fetchall() == []


def test_the_steps_are_in_the_package() -> None:
    versions = importlib.resources.files("server.service.migrations") / "versions"
    assert (versions / "0001_first.py").is_file()
    script = ScriptDirectory.from_config(migrate._config())
    assert known() == tuple(s.revision for s in reversed(list(script.walk_revisions())))
