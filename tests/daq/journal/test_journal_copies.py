"""A closing copy holds what the journal does, or there is none; whatever happens to it, the journal stays as it was."""

from __future__ import annotations

import datetime as dt
import shutil
import sqlite3
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from daq.errors import InputError, JournalError
from daq.journal import copies, reader
from daq.journal.check import check
from daq.journal.copies import require_folder, write_copy
from daq.journal.reader import JournalReader
from daq.journal.wal import log_file
from daq.journal.writer import Event, Journal
from tests.daq.journal_writer import made_chunk

NOW = dt.datetime(2026, 11, 21, 9, 30, 5, tzinfo=dt.UTC)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    out = tmp_path / "other disk"
    out.mkdir()
    return out


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A closed journal with sent, waiting and refused chunks."""
    out = tmp_path / "monday" / "journal.sqlite3"
    with Journal.create(out, "monday", 0) as journal:
        stream = journal.add_stream("made", {}, {"serial": "1"})
        for i in range(6):
            journal.append(stream, made_chunk(i * 50, 50), [Event("mark", float(i), {"i": i})])
        journal.acknowledged(stream, 0)
        journal.quarantined(stream, 100, "made up")
    return out


def content(path: Path) -> list[Any]:
    with JournalReader.open(path) as journal:
        tables = ("streams", "chunks", "events", "outbox")
        return [journal._rows(f"SELECT * FROM {table} ORDER BY rowid") for table in tables]  # noqa: S608


def test_a_copy_holds_all_and_is_named_by_folder_and_time(path: Path, folder: Path) -> None:
    copy = write_copy(path, folder, NOW)
    assert copy == folder / "monday-20261121T093005Z.sqlite3"
    assert content(copy) == content(path)
    assert check(copy).faults == ()
    assert [p.name for p in folder.iterdir()] == [copy.name]
    # It can be gone on with, as a journal of its own.
    with JournalReader.open(path) as source:
        epoch = source.epoch
    with Journal.open(copy, 0) as journal:
        assert journal.epoch != epoch
        assert journal.next_seq(journal.streams()[0].id) == 300


def test_a_journal_that_was_left_by_a_crash_is_copied_with_its_log(path: Path, folder: Path, tmp_path: Path) -> None:
    crashed = tmp_path / "crashed" / "journal.sqlite3"
    crashed.parent.mkdir()
    with Journal.open(path, 0) as journal:
        journal.event(Event("note", 1.0, {"text": "not in the file yet"}))
        shutil.copyfile(path, crashed)
        shutil.copyfile(log_file(path), log_file(crashed))
    copy = write_copy(crashed, folder, NOW)
    with JournalReader.open(copy) as found:
        assert found.events()[-1].value == {"text": "not in the file yet"}


def test_another_file_of_that_name_stays(path: Path, folder: Path) -> None:
    first = write_copy(path, folder, NOW)
    before = first.read_bytes()
    with pytest.raises(JournalError, match=r"monday-20261121T093005Z\.sqlite3 exists"):
        write_copy(path, folder, NOW)
    assert first.read_bytes() == before
    assert len(list(folder.iterdir())) == 1
    assert write_copy(path, folder, NOW + dt.timedelta(seconds=1)) != first


def test_one_that_appears_meanwhile_stays_too(path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = folder / "monday-20261121T093005Z.sqlite3"

    def slow(copy: Path) -> Any:
        target.write_text("mine")
        return check(copy)

    monkeypatch.setattr(copies, "check", slow)
    with pytest.raises(JournalError, match="exists"):
        write_copy(path, folder, NOW)
    assert target.read_text() == "mine"
    assert len(list(folder.iterdir())) == 1


class FaultyDisk:
    """A connection whose copies find no room, or no leave, or are damaged on their way."""

    def __init__(self, connection: sqlite3.Connection, fault: str) -> None:
        self._connection, self._fault = connection, fault

    def execute(self, query: str, *values: Any) -> Any:
        if not query.startswith("VACUUM INTO"):
            return self._connection.execute(query, *values)
        [[target]] = values
        if self._fault == "damaged":
            self._connection.execute(query, *values)
            content = bytearray(Path(target).read_bytes())
            content[content.index(made_chunk(150, 50).to_bytes()[-150:-4]) + 20] ^= 8
            Path(target).write_bytes(content)
        elif self._fault == "full":
            Path(target).write_bytes(b"the beginning")
            error = sqlite3.OperationalError("database or disk is full")
            error.sqlite_errorcode = sqlite3.SQLITE_FULL
            raise error
        else:
            raise PermissionError(13, "Permission denied")
        return None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._connection, name)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("full", r"^disk full: monday-\w+\.sqlite3 cannot grow"),
        ("no leave", r"cannot be written \(Permission denied\)"),
        ("damaged", r"the copy is not as the journal \(.*chunk 150 .*\)"),
    ],
)
def test_where_it_cannot_be_written_as_it_should_be_there_is_none(
    path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch, fault: str, said: str
) -> None:
    before = content(path)
    connect = reader.connect_read
    faulty = lambda p, damaged=False: FaultyDisk(connect(p, damaged), fault)  # noqa: E731
    with monkeypatch.context() as patch:
        patch.setattr(reader, "connect_read", faulty)
        with pytest.raises(JournalError, match=said) as caught:
            write_copy(path, folder, NOW)
    assert "\n" not in str(caught.value)
    assert list(folder.iterdir()) == []
    assert content(path) == before
    assert check(path).faults == ()


def test_less_room_than_the_journal_takes_is_seen_before_anything_is_written(
    path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = path.stat().st_size - 1
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=free))
    with pytest.raises(JournalError, match=r"^disk full"):
        write_copy(path, folder, NOW)
    free += 1
    assert write_copy(path, folder, NOW).is_file()


def test_a_folder_that_is_absent_or_has_gone_is_never_made(path: Path, tmp_path: Path) -> None:
    share = tmp_path / "share"
    with pytest.raises(InputError, match=r"there is no folder .*share"):
        require_folder(share)
    share.mkdir()
    require_folder(share)
    assert list(share.iterdir()) == []
    share.rmdir()
    with pytest.raises(JournalError, match="share has gone"):
        write_copy(path, share, NOW)
    assert not share.exists()
