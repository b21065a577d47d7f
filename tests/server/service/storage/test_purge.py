"""What is purged is gone and gives its space back; what models, benches and numbers rest on stays."""

from __future__ import annotations

import datetime as dt
import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from sqlalchemy import delete, func, insert, select, update

from daq.acquisition.blocks import Chunk
from server import cli
from server.service.operation.folder import held
from server.service.operation.migrate import upgrade
from server.service.operation.scrub import Scrub, damage_of
from server.service.storage import purge as purging
from server.service.storage.checksums import digest_of
from server.service.storage.database import Database
from server.service.storage.purge import Purged, give_back, purge, retain, reusable_bytes
from server.service.storage.reserve import FILE, RESERVE_BYTES, occupy, released
from server.service.storage.schema import (
    chunks,
    edits,
    events,
    heads,
    job_parts,
    jobs,
    messages,
    metadata,
    revisions,
    sessions,
    streams,
)
from tests.daq.faulty_disk import FULL, Disk, available, faulty
from tests.server.service.postgres import postgres_url
from tests.server.service.processes import Process

COUNT = 40


class Free(NamedTuple):
    free: int


def ago(days: float) -> str:
    return (dt.datetime.now(dt.UTC) - dt.timedelta(days=days)).isoformat(timespec="milliseconds")


def fill(database: Database) -> None:
    """Four sessions with the same content: one deleted long ago, one now, one that is there, one of a running bench."""
    upgrade(database)
    none = np.zeros(200, dtype=np.int64)
    with database.writing() as connection:

        def add(table: Any, **row: Any) -> None:
            connection.execute(insert(table).values(row))

        for name, deleted, document in (
            ("OLD", ago(40), {"a": 1}), ("NEW", ago(0.5), {"a": 1}), ("HERE", None, {"a": 1}), ("BENCH", None, None),
        ):  # fmt: skip
            add(sessions, id=name, created_utc=ago(50), deleted_utc=deleted, document=document, specimen="X")
            add(streams, session=name, id="s", number=0, description="{}", sha256=digest_of(b"{}"))
            for k in range(COUNT):
                t_s = k + np.arange(200) / 200
                body = Chunk(200 * k, t_s, np.ones((200, 6)), none, none > 0, b"", [], 0.0).to_bytes()
                place = {"first_seq": 200 * k, "n": 200, "first_s": t_s[0], "last_s": t_s[-1]}
                add(chunks, session=name, stream="s", sha256=digest_of(body), payload=body, **place)
            add(events, session=name, epoch="e", number=0, arrival=1, body="{}", sha256=digest_of(b"{}"))
            add(edits, session=name, created_utc=ago(45), kind="note", body={})
            add(messages, session=name, kind="case", created_utc=ago(45), body={"id": "c"})
            revision = {"document": {"id": name}, "provenance": {}, "parent": "", "created_utc": ago(44)}
            add(revisions, id=f"r-{name}", session=name, specimen="X", **revision)
            add(heads, specimen="X", revision=f"r-{name}", created_utc=ago(44), why="")
            for number, state in enumerate(("done", "queued")):
                at = {"created_utc": ago(44), "finished_utc": ago(44) if state == "done" else None}
                key = {"id": f"{name}-{state}", "number": 10 * ord(name[0]) + number}
                add(jobs, **key, kind="fit", session=name, request={}, state=state, timeout_s=1.0, **at)
                add(job_parts, job=f"{name}-{state}", part="p", result={})
        add(messages, session=None, kind="job", created_utc=ago(45), body={"last": True})


@pytest.fixture(params=["sqlite", "postgresql"])
def database(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Database]:
    made = Database(f"sqlite:///{tmp_path / 'fingertwin.db'}" if request.param == "sqlite" else postgres_url())
    fill(made)
    yield made
    made.close()


def counts(database: Database) -> dict[str, dict[str, int]]:
    """Rows of each table by session."""
    out: dict[str, dict[str, int]] = {}
    with database.reading() as connection:
        for table in metadata.sorted_tables:
            if "session" in table.c:
                query = select(table.c.session, func.count()).group_by(table.c.session)
                out[table.name] = {str(s): n for s, n in connection.execute(query)}
        out["sessions"] = {s: 1 for (s,) in connection.execute(select(sessions.c.id))}
    return out


def test_the_content_of_a_session_deleted_long_ago_is_removed_and_its_revision_stays(database: Database) -> None:
    before = counts(database)
    told = purge(database, "deleted", 30, dry_run=True)
    assert counts(database) == before
    assert (told.sessions, told.chunks) == (1, COUNT)
    assert told.chunk_bytes > COUNT * 200 * 8 * 7
    assert purge(database, "deleted", 30) == told
    after = counts(database)
    for table in ("chunks", "streams", "events", "edits", "messages"):
        assert after[table] == {s: n for s, n in before[table].items() if s != "OLD"}
    # A job that has not ended is somebody's.
    assert after["jobs"] == before["jobs"] | {"OLD": 1}
    assert (after["revisions"], after["sessions"]) == (before["revisions"], before["sessions"])
    assert damage_of(database) == []
    assert purge(database, "deleted", 30) == Purged()
    assert purge(database, "deleted", 0, "HERE") == Purged()
    assert purge(database, "deleted", 0).sessions == 1


def test_a_purge_removes_nothing_of_a_session_that_was_brought_back_meanwhile(
    database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = counts(database)
    monkeypatch.setattr(purging, "_deleted", lambda *_: ["HERE"])
    purge(database, "deleted", 30)
    assert counts(database) == before


def test_a_purge_that_was_killed_goes_on_with_a_session_whose_document_is_gone(database: Database) -> None:
    with database.writing() as connection:
        connection.execute(update(sessions).where(sessions.c.id == "OLD").values(document=None))
        for table in (chunks, streams, events, edits):
            connection.execute(delete(table).where(table.c.session == "OLD"))
    assert purge(database, "deleted", 30).sessions == 1
    assert counts(database)["messages"].get("OLD") is None
    assert purge(database, "deleted", 30) == Purged()


def test_ended_jobs_are_removed_with_their_parts(database: Database) -> None:
    assert purge(database, "jobs", 30, "NEW").jobs == 1
    assert purge(database, "jobs", 50).jobs == 0
    assert purge(database, "jobs", 30).jobs == 3
    with database.reading() as connection:
        assert set(connection.execute(select(jobs.c.state)).scalars()) == {"queued"}
        assert all(job.endswith("queued") for job in connection.execute(select(job_parts.c.job)).scalars())


def test_messages_of_running_benches_and_the_last_number_stay(database: Database) -> None:
    assert purge(database, "messages", 30).messages == 3
    with database.reading() as connection:
        left = connection.execute(select(messages.c.session, messages.c.id).order_by(messages.c.id)).all()
        assert [row.session for row in left] == ["BENCH", None]


def test_what_is_purged_gives_its_space_back_bit_by_bit(database: Database) -> None:
    if database.file is None:
        assert give_back(database)
        assert reusable_bytes(database) is None
        return
    with closing(sqlite3.connect(database.file)) as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    before = database.file.stat().st_size
    gone = purge(database, "deleted", 0).chunk_bytes
    assert (reusable_bytes(database) or 0) > 0.8 * gone
    assert give_back(database)
    assert reusable_bytes(database) == 0
    assert database.file.stat().st_size < before - 0.8 * gone
    assert damage_of(database) == []


def test_a_file_that_cannot_shrink_is_made_anew_where_nobody_else_has_it(tmp_path: Path) -> None:
    file = tmp_path / "fingertwin.db"
    database = Database(f"sqlite:///{file}")
    fill(database)
    with closing(sqlite3.connect(file, isolation_level=None)) as connection:
        connection.execute("PRAGMA auto_vacuum=NONE")
        connection.execute("VACUUM")
    purge(database, "deleted", 0)
    assert not give_back(database)
    assert reusable_bytes(database)
    database.close()
    assert give_back(database, alone=True)
    assert reusable_bytes(database) == 0
    database.close()


def test_the_look_at_everything_removes_first_what_is_kept_no_longer(tmp_path: Path) -> None:
    database = Database(f"sqlite:///{tmp_path / 'fingertwin.db'}")
    fill(database)
    retain(database, {})
    assert counts(database)["chunks"]["OLD"] == COUNT
    scrub = Scrub(database)
    assert scrub.look()
    assert scrub.deleted_bytes
    retain(database, {"deleted": 30, "jobs": 30})
    assert scrub.look()
    assert "OLD" not in counts(database)["chunks"]
    assert reusable_bytes(database) == 0
    database.close()


def test_the_command_says_what_it_removes_also_while_a_service_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    database = Database(f"sqlite:///{tmp_path / 'fingertwin.db'}")
    fill(database)

    def run(*words: str) -> str:
        monkeypatch.setattr("sys.argv", ["fingertwin", "purge", *words, "--data", str(tmp_path)])
        with pytest.raises(SystemExit) as caught:
            cli.main()
        assert caught.value.code == 0
        return capsys.readouterr().out

    assert "1 deleted sessions with" in (said := run("deleted", "--dry-run"))
    assert "would be removed" in said
    with held(tmp_path):
        body = json.loads(run("deleted", "--older-than", "0", "--session", "OLD", "--json", "-"))
    assert (body["schema"], body["sessions"], body["given_back"]) == ("fingertwin/purge/1", 1, True)
    # That of the session which is gone went with it.
    assert "3 jobs are removed" in run("jobs", "--older-than", "1")
    database.close()


@pytest.mark.parametrize("days", ["-3", "nan", "1e300"])
def test_days_that_are_none_are_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, days: str
) -> None:
    monkeypatch.setattr("sys.argv", ["fingertwin", "purge", "jobs", "--older-than", days, "--data", str(tmp_path)])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    said = capsys.readouterr().err
    assert caught.value.code not in (0, None)
    assert said.count("\n") == 1
    assert "expected 0 to 100000 days. Give how many days ago, such as 30." in said


@pytest.mark.skipif(not available(), reason="SQLite's way to the disk cannot be taken over here")
@pytest.mark.parametrize("what", ["deleted", "jobs", "messages"])
def test_on_a_full_disk_the_command_says_in_one_line_what_room_it_needs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    database = Database(f"sqlite:///{tmp_path / 'fingertwin.db'}")
    fill(database)
    for each in ("deleted", "jobs", "messages"):
        purge(database, each, 0)
    database.close()
    monkeypatch.setattr("sys.argv", ["fingertwin", "purge", what, "--older-than", "0", "--data", str(tmp_path)])
    full = Disk(tmp_path.resolve(), fails="write", code=FULL)
    with held(tmp_path), faulty(full), pytest.raises(SystemExit) as caught:
        cli.main()
    said = capsys.readouterr().err
    assert caught.value.code == cli.AGAIN_LATER
    assert said.count("\n") == 1
    assert "MB of free space, also for a purge. Move other files off this disk" in said
    # Once there is room, it goes on.
    with pytest.raises(SystemExit) as caught:
        cli.main()
    assert caught.value.code == 0


class FullWhileReserved(Disk):
    """A disk that has no space but for what the reserve holds."""

    def refuses(self, operation: str) -> bool:
        return (self.folder / FILE).exists() and super().refuses(operation)


@pytest.mark.skipif(not available(), reason="SQLite's way to the disk cannot be taken over here")
@pytest.mark.parametrize("by", ["command", "service"])
def test_on_a_full_disk_a_purge_uses_the_reserve_and_makes_it_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, by: str
) -> None:
    database = Database(f"sqlite:///{tmp_path / 'fingertwin.db'}")
    fill(database)
    database.close()
    occupy(tmp_path)
    with faulty(FullWhileReserved(tmp_path.resolve(), fails="write", code=FULL)):
        if by == "service":
            retain(database, {"deleted": 30})
            database.close()
        else:
            monkeypatch.setattr("sys.argv", ["fingertwin", "purge", "deleted", "--data", str(tmp_path)])
            with pytest.raises(SystemExit) as caught:
                cli.main()
            assert caught.value.code == 0
    assert "OLD" not in counts(database)["chunks"]
    assert (tmp_path / FILE).stat().st_size == RESERVE_BYTES
    database.close()


def test_a_reserve_is_made_by_a_service_alone_and_where_there_is_plenty_of_space(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with released(tmp_path):
        pass
    assert not (tmp_path / FILE).exists()
    monkeypatch.setattr("shutil.disk_usage", lambda _: Free(2 * RESERVE_BYTES))
    occupy(tmp_path)
    assert not (tmp_path / FILE).exists()
    monkeypatch.undo()
    process = Process(["-m", "server.cli", "serve", "--data", str(tmp_path), "--port", "0"])
    process.address()
    process.close()
    assert (tmp_path / FILE).stat().st_size == RESERVE_BYTES
