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
    assert "were committed and are missing" in answer.err
    assert "journal recover" in answer.err
    assert answer.err.count("\n") == 1


def test_a_recovery_counts_what_the_log_took_with_it_and_the_new_journal_remembers(crashed: tuple[Path, str]) -> None:
    path, stream = crashed
    log_file(path).unlink()
    missing = COUNT * CHUNKS - check(path).samples.get(stream, 0)
    new = path.with_name("new.journal")
    answer = run("journal", "recover", path, "--out", new)
    assert answer.code == 2
    assert f"{missing} readings" in answer.out
    assert answer.out.splitlines()[-1].endswith("recovered; 1 loss")
    assert f"1 loss: {missing} readings are missing. {new} has all that is sound." in answer.err
    assert (check(new).faults, check(new).known_gaps) == ((), 1)
    with JournalReader.open(new) as journal:
        [warning] = [e for e in journal.events() if e.kind == "warning"]
    assert warning.value["code"] == "lost"
    assert warning.value["text"].startswith(f"{missing} readings")


def test_nothing_is_made_of_a_journal_that_lost_readings_before_it_is_recovered(crashed: tuple[Path, str]) -> None:
    path, stream = crashed
    _cut(0.5)(log_file(path))
    missing = COUNT * CHUNKS - check(path).samples.get(stream, 0)
    out = path.with_name("run.csv")
    replayed = ("log", "--driver", "replay", "--port", path, "--set", "speed=0", "--out", path.with_name("again"))
    for command in (("journal", "export", path, "--out", out), replayed):
        answer = run(*command)
        assert answer.code == 2
        assert f"{missing} readings" in answer.err
        assert "journal recover" in answer.err
    assert not out.exists()
    assert not path.with_name("again").exists()
    recovered = path.with_name("recovered.journal")
    assert run("journal", "recover", path, "--out", recovered).code == 2
    assert run("journal", "export", recovered, "--out", out).code == 0
    assert len(out.read_text("utf-8").splitlines()) == COUNT * CHUNKS - missing + 1


def test_a_log_that_writes_on_and_a_requeue_end_with_what_is_missing(crashed: tuple[Path, str]) -> None:
    path, stream = crashed
    log_file(path).unlink()
    missing = COUNT * CHUNKS - check(path).samples.get(stream, 0)
    folder = path.with_name("log")
    folder.mkdir()
    for made, name in ((path, "journal.sqlite3"), (mark_file(path), "journal.sqlite3-mark")):
        shutil.copyfile(made, folder / name)
    recorded = path.with_name("run.csv")
    rows = [f"{k / 100},0,0,0,0,0,0" for k in range(50)]
    recorded.write_text("\n".join(["t_s,Fx_N,Fy_N,Fz_N,Tx_Nmm,Ty_Nmm,Tz_Nmm", *rows, ""]), "utf-8")
    logged = ("log", "--driver", "replay", "--port", recorded, "--set", "speed=0", "--out", folder)
    for command in (("journal", "requeue", path), logged):
        answer = run(*command)
        assert answer.code == 2
        assert f"{missing} readings" in answer.err.splitlines()[-1]
    assert "50 readings" in answer.out
    # Told once; from then on the journal itself says so.
    again = run(*logged)
    assert (again.code, again.err) == (0, "")
    assert check(folder / "journal.sqlite3").known_gaps == 1


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
