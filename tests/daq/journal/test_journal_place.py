"""A journal whose files are deleted, renamed or replaced while it is written: all is in another, and said."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from daq.journal.check import check
from daq.journal.wal import log_file
from daq.journal.writer import Event, Journal, JournalReader
from tests.daq.journal_writer import made_chunk
from tests.daq.journals import COUNT, fill, firsts

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="nothing that is open can be deleted or moved there")


def _deleted(path: Path) -> None:
    path.unlink()


def _renamed(path: Path) -> None:
    path.rename(path.with_name("other.journal"))


def _moved(path: Path) -> None:
    path.parent.rename(path.parent.with_name("elsewhere"))


def _replaced(path: Path) -> None:
    other = path.with_name("new")
    Journal.create(other, "another", 0).close()
    other.replace(path)


def _without_log(path: Path) -> None:
    log_file(path).unlink()


def _without_index(path: Path) -> None:
    path.with_name(path.name + "-shm").unlink()


def _without_folder(path: Path) -> None:
    shutil.rmtree(path.parent)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "monday" / "bench.journal"


@pytest.mark.parametrize(
    ("lose", "said"),
    [
        (_deleted, "bench.journal was deleted or moved away"),
        (_renamed, "bench.journal was renamed to other.journal"),
        (_moved, "bench.journal was deleted or moved away"),
        (_without_folder, "bench.journal was deleted or moved away"),
        (_replaced, "bench.journal was replaced by another file"),
        (_without_log, "bench.journal-wal was deleted or moved away"),
        (_without_index, "bench.journal-shm was deleted or moved away"),
    ],
)
def test_all_is_in_another_file_before_it_is_acknowledged(path: Path, lose: Callable[[Path], None], said: str) -> None:
    beside = path.with_name("bench-2.journal")
    with Journal.create(path, "bench 1", 0) as journal:
        stream, epoch = fill(journal, 5), journal.epoch
        journal.acknowledged(stream, 0)
        lose(path)
        assert journal.append(stream, made_chunk(5 * COUNT, COUNT)) == 6 * COUNT
        code, alarm = journal.alarms.get_nowait()
        assert (code, journal.alarms.empty()) == ("displaced", True)
        assert alarm.startswith(said)
        assert journal.path == beside
        # Another process finds it there, with all that was ever acknowledged, sent or not, and the events.
        assert firsts(beside, stream) == [k * COUNT for k in range(6)]
        assert [p.first_seq for p in journal.pending()] == [k * COUNT for k in range(1, 6)]
        assert journal.epoch == epoch
        journal.event(Event("note"))
    assert [e.kind for e in JournalReader.open(beside).events()] == [*["mark"] * 5, "warning", "note"]
    assert check(beside).faults == ()
    assert journal.displaced is not None
    assert f"All {5 * COUNT} readings from before, and all since, are in {beside}" in str(journal.displaced)


def test_what_has_the_journal_under_another_name_is_whole_too(path: Path) -> None:
    with Journal.create(path, "bench 1", 0) as journal:
        stream = fill(journal, 5)
        _renamed(path)
        journal.append(stream, made_chunk(5 * COUNT, COUNT))
    other = path.with_name("other.journal")
    assert firsts(other, stream) == [k * COUNT for k in range(5)]
    with Journal.open(other, 0) as journal:
        # Whoever writes on there writes another one.
        assert journal.epoch != JournalReader.open(path.with_name("bench-2.journal")).epoch


def test_a_file_that_goes_after_the_last_reading_is_found_at_the_end(path: Path) -> None:
    with Journal.create(path, "bench 1", 0) as journal:
        stream = fill(journal, 3)
        _deleted(path)
    assert firsts(path.with_name("bench-2.journal"), stream) == [0, COUNT, 2 * COUNT]
    assert journal.displaced is not None


def test_what_was_overwritten_is_counted_and_what_follows_is_kept(path: Path) -> None:
    with Journal.create(path, "bench 1", 0) as journal:
        stream = fill(journal, 60, 700)
        # Most of it is in the file by now, and no longer in the log.
        path.write_bytes(b"nonsense" * 100)
        assert journal.append(stream, made_chunk(60 * 700, 700)) == 61 * 700
        journal.append(stream, made_chunk(61 * 700, 700))
    beside = path.with_name("bench-2.journal")
    assert journal.displaced is not None
    kept = firsts(beside, stream)
    assert kept[-2:] == [60 * 700, 61 * 700]
    assert f"{(len(kept) - 2) * 700} of {60 * 700} readings from before" in str(journal.displaced)
    report = check(beside)
    assert report.faults == ()
    assert report.known_gaps > 0


def test_within_a_transaction_it_is_looked_for_at_the_end(path: Path) -> None:
    with Journal.create(path, "bench 1", 0) as journal:
        stream = fill(journal, 1)
        with journal.transaction():
            for k in range(1, 40):  # more than SQLite holds back: the log grows meanwhile
                journal.append(stream, made_chunk(k * 700 - 650, 700))
            _deleted(path)
        assert journal.path == path.with_name("bench-2.journal")
    assert len(firsts(journal.path, stream)) == 40


def test_it_happens_again_and_nothing_is_lost(path: Path) -> None:
    with Journal.create(path, "bench 1", 0) as journal:
        stream = fill(journal, 2)
        for k in range(2, 5):
            _deleted(journal.path)
            journal.append(stream, made_chunk(k * COUNT, COUNT))
    assert firsts(journal.path, stream) == [k * COUNT for k in range(5)]
