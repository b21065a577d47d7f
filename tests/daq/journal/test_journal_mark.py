"""A write-ahead log that is lost, cut or spoilt beside a killed writer's journal is never called sound."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from daq.journal.check import check, recover
from daq.journal.mark import mark_file, read_mark
from daq.journal.reader import JournalReader
from daq.journal.wal import log_file
from daq.journal.writer import Journal
from tests.daq.journals import COUNT, fill, torn_off
from tests.server.command_line import run

CHUNKS = 40


@pytest.fixture
def crashed(tmp_path: Path) -> tuple[Path, str]:
    """A journal as a killed writer leaves it, with its mark; and its stream."""
    path = tmp_path / "bench.journal"
    with Journal.create(path, "bench 1", 0) as journal:
        stream = fill(journal, CHUNKS)
        left = torn_off(path)
        shutil.copyfile(mark_file(path), mark_file(left))
    return left, stream


def _gone(log: Path) -> None:
    log.unlink()


def _empty(log: Path) -> None:
    log.write_bytes(b"")


def _zeroed(log: Path) -> None:
    log.write_bytes(bytes(log.stat().st_size))


def _random(log: Path) -> None:
    log.write_bytes(np.random.default_rng(5).bytes(log.stat().st_size))


def _cut(share: float) -> Callable[[Path], None]:
    def cut(log: Path) -> None:
        log.write_bytes(log.read_bytes()[: int(share * log.stat().st_size)])

    return cut


@pytest.mark.parametrize(
    "damage",
    [_gone, _empty, _zeroed, _random, *(_cut(k / 8.0) for k in range(8))],
    ids=["gone", "empty", "zeroed", "random", *(f"cut at {k}/8" for k in range(8))],
)
def test_what_was_committed_and_is_gone_is_counted(crashed: tuple[Path, str], damage: Callable[[Path], None]) -> None:
    path, stream = crashed
    damage(log_file(path))
    report = check(path)
    missing = COUNT * CHUNKS - report.samples.get(stream, 0)
    assert missing > 0
    assert report.faults
    behind = [f.text for f in report.faults if "were committed and are missing" in f.text]
    # Where the log still holds what is damaged, the rows themselves tell; else their number does.
    assert behind or any(f.kind == "log" for f in report.faults)
    if behind:
        assert behind[0].startswith(f"{missing} readings")
    recovered = recover(path, path.with_name("recovered.journal"))
    assert recovered.faults


def test_a_killed_writers_journal_that_lost_nothing_is_sound(crashed: tuple[Path, str]) -> None:
    path, stream = crashed
    report = check(path)
    assert report.faults == ()
    assert report.samples[stream] == COUNT * CHUNKS
    mark = read_mark(path)
    assert mark is not None
    assert mark.samples == COUNT * CHUNKS


def test_the_command_line_says_how_many_are_missing(crashed: tuple[Path, str]) -> None:
    path, _ = crashed
    log_file(path).unlink()
    answer = run("journal", "check", path)
    assert answer.code == 2
    assert "readings" in answer.out + answer.err
    assert "were committed and are missing" in answer.out + answer.err


def test_a_recovery_counts_what_the_log_took_with_it_and_the_new_journal_remembers(crashed: tuple[Path, str]) -> None:
    path, stream = crashed
    log_file(path).unlink()
    missing = COUNT * CHUNKS - check(path).samples.get(stream, 0)
    new = path.with_name("new.journal")
    answer = run("journal", "recover", path, "--out", new)
    assert answer.code == 0
    assert f"{missing} readings" in answer.out
    assert answer.out.splitlines()[-1].endswith("; 1 loss")
    assert check(new).faults == ()
    with JournalReader.open(new) as journal:
        [warning] = [e for e in journal.events() if e.kind == "warning"]
    assert warning.value["code"] == "lost"
    assert warning.value["text"].startswith(f"{missing} readings")


def test_whoever_writes_on_is_told_and_begins_anew(crashed: tuple[Path, str]) -> None:
    path, _ = crashed
    with JournalReader.open(path) as before:
        epoch = before.epoch
    _cut(0.5)(log_file(path))
    with Journal.open(path, 0) as journal:
        assert journal.epoch != epoch
        [warning] = [e for e in journal.events() if e.kind == "warning"]
        assert warning.value["code"] == "lost"
    assert check(path).faults == ()


def test_a_torn_mark_leaves_the_one_before(crashed: tuple[Path, str]) -> None:
    path, _ = crashed
    whole = read_mark(path)
    assert whole is not None
    file = mark_file(path)
    data = bytearray(file.read_bytes())
    data[(whole.turn % 2) * 4096 + 20] ^= 1
    file.write_bytes(data)
    before = read_mark(path)
    assert before is not None
    assert before.turn == whole.turn - 1
    assert check(path).faults == ()
    file.write_bytes(b"nonsense")
    assert read_mark(path) is None
    assert check(path).faults == ()
