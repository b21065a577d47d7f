"""Backup and restore: a copy is whole whoever writes meanwhile, and nothing is ever overwritten."""

from __future__ import annotations

import hashlib
import json
import sqlite3
import threading
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy import func, insert, select

from daq.errors import InputError
from server import cli
from server.service.operation import backup as module
from server.service.operation.backup import backup, restore
from server.service.operation.folder import held
from server.service.operation.migrate import expected, upgrade
from server.service.settings import DATABASE_FILE, Settings
from server.service.storage.audit import entries, faults_of
from server.service.storage.checksums import digest_of
from server.service.storage.database import Database, now_utc
from server.service.storage.schema import events, sessions


def service(folder: Path, count: int) -> Settings:
    """A service's data with so many sessions."""
    folder.mkdir(exist_ok=True)
    settings = Settings(data=folder)
    database = Database(settings.url)
    upgrade(database)
    with database.writing() as connection:
        for number in range(count):
            connection.execute(insert(sessions).values(id=f"S{number}", created_utc=now_utc()))
    database.close()
    return settings


def count_of(file: Path) -> int:
    with closing(sqlite3.connect(file)) as connection:
        return int(connection.execute("SELECT count(*) FROM sessions").fetchone()[0])


def names(folder: Path) -> set[str]:
    return {f.name for f in folder.iterdir()} - {"service-writer"}


def test_a_backup_that_is_restored_elsewhere_holds_the_same(tmp_path: Path) -> None:
    settings = service(tmp_path / "data", 5)
    made = backup(settings, tmp_path / "b.db")
    assert (made.sessions, made.revision, made.size_bytes) == (5, expected(), (tmp_path / "b.db").stat().st_size)
    before = (tmp_path / "b.db").read_bytes()
    done, aside = restore(Settings(data=tmp_path / "new"), tmp_path / "b.db")
    assert (done.sessions, aside, count_of(tmp_path / "new" / DATABASE_FILE)) == (5, None, 5)
    # That it was restored is the last entry of its trail, which goes on from the backup's.
    database = Database(Settings(data=tmp_path / "new").url)
    last = list(entries(database))[-1]
    assert (last.what, last.about, faults_of(database)) == ("restored", None, [])
    assert last.details["sha256"] == hashlib.sha256(before).hexdigest()
    database.close()
    # The backup is one file, and stays as it was.
    assert (tmp_path / "b.db").read_bytes() == before
    assert names(tmp_path) == {"data", "b.db", "new"}
    assert names(tmp_path / "new") == names(tmp_path / "data") == {DATABASE_FILE}


def test_a_backup_of_a_service_that_writes_is_a_state_that_was(tmp_path: Path) -> None:
    settings = service(tmp_path / "data", 1)
    database, ended, begun = Database(settings.url), threading.Event(), threading.Event()

    def write() -> None:
        number = 0
        while not ended.is_set():
            number += 1
            with database.writing() as connection:
                # Two rows belong together, and so do they in every copy.
                for half in (2 * number, 2 * number + 1):
                    row = {
                        "session": "S0",
                        "epoch": "e",
                        "number": half,
                        "arrival": half,
                        "sha256": digest_of(b"x" * 500),
                        "body": "x" * 500,
                    }
                    connection.execute(insert(events).values(row))
            begun.set()

    writer = threading.Thread(target=write)
    with held(settings.data):
        writer.start()
        begun.wait(30)
        copies = [backup(settings, tmp_path / f"{n}.db").file for n in range(3)]
        ended.set()
        writer.join()
    database.close()
    counts = []
    for file in copies:
        copy = Database(f"sqlite:///{file}")
        with copy.reading() as connection:
            counts.append(connection.execute(select(func.count()).select_from(events)).scalar_one())
        copy.close()
    assert all(count and count % 2 == 0 for count in counts)
    assert counts == sorted(counts)


def test_a_backup_overwrites_nothing(tmp_path: Path) -> None:
    settings = service(tmp_path / "data", 1)
    (tmp_path / "b.db").write_text("mine")
    with pytest.raises(InputError, match=r"b\.db exists; expected a new file"):
        backup(settings, tmp_path / "b.db")
    assert (tmp_path / "b.db").read_text() == "mine"


def test_a_copy_that_is_not_sound_is_no_backup(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = service(tmp_path / "data", 400)
    copy = module.copy

    def spoilt(source: Path, target: Path, mode: str = "rw") -> None:
        copy(source, target, mode)
        data = bytearray(target.read_bytes())
        data[8192:] = bytes(len(data) - 8192)
        target.write_bytes(data)

    monkeypatch.setattr(module, "copy", spoilt)
    with pytest.raises(InputError, match=r"damaged|cannot be read"):
        backup(settings, tmp_path / "b.db")
    assert names(tmp_path) == {"data"}


def test_restore_keeps_the_former_database_under_another_name(tmp_path: Path) -> None:
    settings, other = service(tmp_path / "data", 3), service(tmp_path / "other", 7)
    backup(other, tmp_path / "b.db")
    with pytest.raises(InputError, match=r"there is a database in .* --force"):
        restore(settings, tmp_path / "b.db")
    assert count_of(settings.data / DATABASE_FILE) == 3
    done, aside = restore(settings, tmp_path / "b.db", force=True)
    assert aside is not None
    assert (done.sessions, count_of(done.file), count_of(aside)) == (7, 7, 3)
    again = restore(settings, aside, force=True)
    assert (count_of(again[0].file), len(names(settings.data))) == (3, 3)


def test_what_a_killed_service_had_committed_is_kept_too(tmp_path: Path) -> None:
    settings, other = service(tmp_path / "data", 1), service(tmp_path / "other", 7)
    backup(other, tmp_path / "b.db")
    # Committed to the log, and never written into the file, as after a kill.
    with closing(sqlite3.connect(settings.data / DATABASE_FILE, isolation_level=None)) as connection:
        connection.execute("INSERT INTO sessions (id, created_utc, version) VALUES ('late', '', 0)")
        for ending in ("", "-wal"):
            file = tmp_path / f"killed{ending}"
            file.write_bytes((settings.data / f"{DATABASE_FILE}{ending}").read_bytes())
    for ending in ("", "-wal"):
        (tmp_path / f"killed{ending}").replace(settings.data / f"{DATABASE_FILE}{ending}")
    _, aside = restore(settings, tmp_path / "b.db", force=True)
    assert aside is not None
    assert count_of(aside) == 2
    assert count_of(settings.data / DATABASE_FILE) == 7


def test_a_former_database_that_cannot_be_read_is_kept_as_it_is(tmp_path: Path) -> None:
    settings = service(tmp_path / "data", 3)
    backup(settings, tmp_path / "b.db")
    (settings.data / DATABASE_FILE).write_bytes(b"ruined" * 1000)
    _, aside = restore(settings, tmp_path / "b.db", force=True)
    assert aside is not None
    assert aside.read_bytes() == b"ruined" * 1000
    assert count_of(settings.data / DATABASE_FILE) == 3


def test_restore_refuses_while_a_service_runs(tmp_path: Path) -> None:
    settings = service(tmp_path / "data", 3)
    backup(settings, tmp_path / "b.db")
    with held(settings.data), pytest.raises(InputError, match=r"a service runs on .* End it, then restore"):
        restore(settings, tmp_path / "b.db", force=True)
    assert names(settings.data) == {DATABASE_FILE}


def test_restore_refuses_while_somebody_else_has_the_database_open(tmp_path: Path) -> None:
    settings = service(tmp_path / "data", 3)
    backup(settings, tmp_path / "b.db")
    with closing(sqlite3.connect(settings.data / DATABASE_FILE)) as other:
        other.execute("SELECT count(*) FROM sessions").fetchone()
        with pytest.raises(InputError, match="in use"):
            restore(settings, tmp_path / "b.db", force=True)
    assert names(settings.data) == {DATABASE_FILE}


def test_what_is_no_backup_changes_nothing(tmp_path: Path) -> None:
    settings = service(tmp_path / "data", 3)
    (tmp_path / "text.db").write_text("hello" * 1000)
    (tmp_path / "empty.db").touch()
    with closing(sqlite3.connect(tmp_path / "recipes.db")) as connection:
        connection.execute("CREATE TABLE recipes (name TEXT)")
    backup(settings, tmp_path / "newer.db")
    with closing(sqlite3.connect(tmp_path / "newer.db")) as connection, connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
    before = (settings.data / DATABASE_FILE).read_bytes()
    for name, said in [
        ("text.db", "cannot be"), ("empty.db", "holds nothing"), ("recipes.db", "something else"),
        ("newer.db", "newer version"), ("absent.db", "there is no file"),
    ]:  # fmt: skip
        with pytest.raises(InputError, match=said):
            restore(settings, tmp_path / name, force=True)
        assert names(settings.data) == {DATABASE_FILE}
        assert (settings.data / DATABASE_FILE).read_bytes() == before


def test_for_postgresql_its_own_commands_are_named(tmp_path: Path) -> None:
    settings = Settings(data=tmp_path, database_url="postgresql+psycopg://a@b/c")
    with pytest.raises(InputError, match="pg_dump"):
        backup(settings, tmp_path / "b.db")
    with pytest.raises(InputError, match="pg_restore"):
        restore(settings, tmp_path / "b.db")


def test_the_commands_say_what_they_did(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    service(tmp_path / "data", 2)
    data = ["--data", str(tmp_path / "data")]
    for words in (["backup", str(tmp_path / "b.db")], ["restore", str(tmp_path / "b.db"), "--force"]):
        monkeypatch.setattr("sys.argv", ["fingertwin", *words, *data, "--json", "-"])
        with pytest.raises(SystemExit) as caught:
            cli.main()
        assert caught.value.code == 0
        body = json.loads(capsys.readouterr().out)
        assert body["schema"] == f"fingertwin/{words[0]}/1"
        assert body["sessions"] == 2
    assert Path(body["former"]).exists()
