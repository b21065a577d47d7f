"""Damaged journals: what is wrong is found and told, and all that is sound is recovered; others are refused."""

from __future__ import annotations

import os
import shutil
import sqlite3
import struct
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from daq.errors import JournalError
from daq.journal.check import check, recover
from daq.journal.export import export
from daq.journal.replay import JournalReplay
from daq.journal.wal import chained, log_file, read_log
from daq.journal.writer import Journal, JournalReader
from tests.daq.journal_writer import made_chunk
from tests.daq.journals import COUNT, altered, fill, firsts, flip, kinds, torn_off, written


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "bench.journal"


def test_a_flipped_bit_in_any_chunk_is_found_and_costs_that_chunk(path: Path) -> None:
    stream = written(path, 6)
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for i in range(6):
        payload = made_chunk(i * COUNT, COUNT).to_bytes()
        # A payload lies in several pages; its raw bytes' first hundred in one of them.
        start = whole.index(payload[-150:-4])
        path.write_bytes(whole)
        flip(path, start + int(rng.integers(0, 150)), int(rng.integers(0, 8)))
        faults = check(path).faults
        assert [(f.kind, f.stream) for f in faults if f.kind == "chunk"] == [("chunk", stream)]
        with pytest.raises(JournalError, match=f"chunk {i * COUNT} of stream {stream} is damaged"):
            firsts(path, stream)
        out = path.with_name(f"out{i}.journal")
        report = recover(path, out)
        assert [(f.first_seq, f.n) for f in report.faults if f.kind == "gap"] == [(i * COUNT, COUNT if i < 5 else None)]
        assert firsts(out, stream) == [j * COUNT for j in range(6) if j != i]
        # What is lost is known there: it is sound, and says what is missing.
        again = check(out)
        assert (again.faults, again.known_gaps) == ((), 1)
        with JournalReader.open(out) as journal:
            assert [e.value["first_seq"] for e in journal.events(stream) if e.kind == "lost"] == [i * COUNT]
            assert journal.epoch != report.epoch


@pytest.mark.parametrize(
    ("statement", "kind"),
    [
        ("UPDATE chunks SET payload = (SELECT payload FROM chunks WHERE id = 2) WHERE id = 3", "chunk"),
        ("UPDATE chunks SET first_seq = 777 WHERE id = 3", "chunk"),
        ("UPDATE chunks SET payload = 'text' WHERE id = 3", "chunk"),
        ("DELETE FROM chunks WHERE id = 3", "gap"),
        ("DELETE FROM chunks WHERE id = 10", "gap"),
        ("DELETE FROM outbox WHERE id = 3", "outbox"),
        ("UPDATE outbox SET sha256 = 'f00d' WHERE id = 3", "outbox"),
        ("UPDATE events SET value = '{\"i\": 5}' WHERE id = 3", "event"),
        ("UPDATE events SET kind = x'00ff' WHERE id = 3", "event"),
        ("UPDATE streams SET settings = '{}'", "stream"),
    ],
)
def test_every_altered_row_is_found_and_the_rest_recovered(path: Path, statement: str, kind: str) -> None:
    stream = written(path)
    altered(path, statement)
    assert kind in kinds(path)
    if kind in ("chunk", "event", "stream"):
        with JournalReader.open(path) as journal, pytest.raises(JournalError, match="damaged"):
            _ = list(journal.read(stream)), journal.events(), journal.streams()
    out = path.with_name("out.journal")
    # Of the outbox, all is known by the chunks themselves.
    assert bool(recover(path, out).losses) is (kind != "outbox")
    wanted = [
        i * COUNT for i in range(10) if kind in ("outbox", "event", "stream") or i != (9 if "10" in statement else 2)
    ]
    assert firsts(out, stream) == wanted
    assert check(out).faults == ()
    with Journal.open(out, 0) as journal:
        assert [p.first_seq for p in journal.pending()] == wanted


@pytest.mark.parametrize("first", [0, 3])
def test_nothing_is_made_of_a_journal_whose_readings_have_a_hole_before_it_is_recovered(path: Path, first: int) -> None:
    stream = written(path)
    for number in (first, first + 1):
        altered(path, "DELETE FROM chunks WHERE first_seq = ?", number * COUNT)
    readings, recovered = path.with_name("out.csv"), path.with_name("out.journal")
    said = f"{2 * COUNT} samples from {first * COUNT} on are missing; expected a journal with all its readings"
    for use in (lambda: export(path, readings), lambda: JournalReplay(path)):
        with pytest.raises(JournalError, match=said):
            use()
    assert not readings.exists()
    # A recovery notes what is lost; what it noted is refused no more.
    recover(path, recovered)
    assert export(recovered, readings).samples == 8 * COUNT
    altered(recovered, "UPDATE events SET value = 'nothing' WHERE kind = 'lost' AND stream = ?", stream)
    with pytest.raises(JournalError, match=said):
        export(recovered, readings)


@pytest.mark.parametrize(("gone", "said"), [((1,), "event 1 is missing"), ((3, 4), "events 3 to 4 are missing")])
def test_an_event_that_is_gone_is_found(path: Path, gone: tuple[int, ...], said: str) -> None:
    written(path)
    for number in gone:
        altered(path, "DELETE FROM events WHERE id = ?", number)
    [fault] = check(path).faults
    assert (fault.kind, fault.text, fault.loses) == ("event", said, True)


def test_a_chunk_under_another_stream_is_damaged(path: Path) -> None:
    written(path, 3)
    with Journal.open(path, 0) as journal:
        other = journal.add_stream("made", {}, {})
    altered(path, "UPDATE chunks SET stream = ? WHERE first_seq = 0", other)
    with pytest.raises(JournalError, match=f"chunk 0 of stream {other} is damaged"):
        firsts(path, other)
    assert "chunk" in kinds(path)


def test_a_commit_is_on_the_disk_and_readers_leave_the_log_alone(path: Path) -> None:
    with Journal.create(path, "bench 1", 0) as journal:
        asked = {p: journal._connection.execute(f"PRAGMA {p}").fetchone()[0] for p in ("synchronous", "journal_mode")}
        assert asked == {"synchronous": 2, "journal_mode": "wal"}
        fill(journal, 5)
        before = log_file(path).read_bytes()
        with JournalReader.open(path) as reader:
            assert len(reader.streams()) == 1
        assert len(before) > 5 * len(made_chunk(0, COUNT).to_bytes())
        assert log_file(path).read_bytes() == before


def test_a_journal_in_a_write_protected_folder_is_read(path: Path) -> None:
    stream = written(path, 3)
    path.parent.chmod(0o555)
    try:
        if os.access(path.parent, os.W_OK):
            pytest.skip("this user may write everywhere")
        assert firsts(path, stream) == [0, 50, 100]
        assert check(path).faults == ()
        with pytest.raises(JournalError, match="rights"):
            Journal.open(path)
    finally:
        path.parent.chmod(0o755)


def test_recovery_keeps_what_was_sent(path: Path) -> None:
    stream = written(path)
    with Journal.open(path, 0) as journal:
        journal.acknowledged(stream, 0)
        journal.quarantined(stream, 50, "HTTP 400")
    out = path.with_name("out.journal")
    assert recover(path, out).pending == 8
    with Journal.open(out, 0) as journal:
        assert [p.first_seq for p in journal.pending()] == [i * COUNT for i in range(2, 10)]
    with pytest.raises(JournalError, match="exists"):
        recover(path, out)


@pytest.mark.parametrize("kept", [0.95, 0.6, 0.3])
def test_a_truncated_file_is_found_and_its_sound_chunks_recovered(path: Path, kept: float) -> None:
    stream = written(path, 20, 700)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * kept)])
    assert "file" in kinds(path)
    with pytest.raises(JournalError, match=r"damaged.*journal recover"):
        Journal.open(path)
    out = path.with_name("out.journal")
    report = recover(path, out)
    got = firsts(out, stream)
    assert got == list(range(0, 700 * len(got), 700))
    assert len(got) >= int(20 * kept) - 3
    assert any(f.kind == "gap" for f in report.faults) or len(got) == 20
    assert check(out).faults == ()


def test_a_log_that_ends_early_gives_a_consistent_prefix(path: Path) -> None:
    with Journal.create(path, "bench 1", 0) as journal:
        stream = fill(journal, 10, 700)
        crashed = torn_off(path)
        whole = log_file(crashed).read_bytes()
    lengths = set()
    for kept in np.linspace(0, len(whole), 23).astype(int):
        log_file(crashed).write_bytes(whole[:kept])
        shutil.copyfile(path.with_name(path.name + "-writer"), crashed.with_name(crashed.name + "-writer"))
        report = check(crashed)
        assert report.faults == ()
        got = firsts(crashed, stream) if report.chunks else []
        assert got == list(range(0, 700 * len(got), 700))
        assert report.events == len(got)
        lengths.add(len(got))
    assert max(lengths) == 10
    assert len(lengths) > 5


def test_a_damaged_log_is_found_and_only_the_damaged_chunk_is_lost(path: Path) -> None:
    with Journal.create(path, "bench 1", 0) as journal:
        stream = fill(journal, 10, 700)
        crashed = torn_off(path)
    log = read_log(crashed)
    assert log is not None
    assert (log.first_bad, log.hidden) == (len(log.current), 0)
    start = log.data.index(made_chunk(2100, 700).raw[5000:5100])
    flip(log_file(crashed), start)
    # SQLite would go on from the third chunk as if there had never been more.
    assert firsts(crashed, stream) == [0, 700, 1400]
    assert "log" in kinds(crashed)
    with pytest.raises(JournalError, match=r"-wal is damaged: behind its frame .* lie 7 transactions; .* recover"):
        Journal.open(crashed)
    out = path.with_name("out.journal")
    report = recover(crashed, out)
    assert [(f.first_seq, f.n) for f in report.faults if f.kind == "gap"] == [(2100, 700)]
    assert firsts(out, stream) == [i * 700 for i in range(10) if i != 3]
    assert {p.name for p in path.parent.iterdir() if p.is_dir()} == set()


@pytest.mark.parametrize("at", [0, 9, 17, 25])
def test_a_damaged_head_of_a_log_hides_nothing(path: Path, at: int) -> None:
    with Journal.create(path, "bench 1", 0) as journal:
        stream = fill(journal, 5, 700)
        crashed = torn_off(path)
    flip(log_file(crashed), at)
    assert "log" in kinds(crashed)
    out = path.with_name("out.journal")
    recover(crashed, out)
    assert firsts(out, stream) == [0, 700, 1400, 2100, 2800]


def test_checksum_of_the_log_is_the_one_that_sqlite_defines() -> None:
    data = np.random.default_rng(0).bytes(4104)
    for order in "<>":
        first, second = 7, 2**32 - 9
        for a, b in struct.iter_unpack(order + "II", data):
            first = (first + a + second) & 0xFFFFFFFF
            second = (second + b + first) & 0xFFFFFFFF
        assert chained(data, order, (7, 2**32 - 9)) == (first, second)


@pytest.mark.parametrize(
    ("content", "said"),
    [(None, "there is no"), (b"", "is no journal"), (b"Fx,Fy\n" * 500, "is no journal, or its first")],
)
def test_what_is_no_journal_is_refused_in_one_line(path: Path, content: bytes | None, said: str) -> None:
    if content is not None:
        path.write_bytes(content)
    for use in (Journal.open, JournalReader.open, check, lambda p: recover(p, p.with_name("out.journal"))):
        with pytest.raises(JournalError, match=said):
            use(path)
    assert not path.with_name("out.journal").exists()


def test_a_folder_is_no_journal(path: Path) -> None:
    for use in (JournalReader.open, check):
        with pytest.raises(JournalError, match="is a folder; expected a journal"):
            use(path.parent)


def test_a_newer_journal_and_one_that_exists_are_refused(path: Path) -> None:
    written(path, 1)
    with pytest.raises(JournalError, match="exists"):
        Journal.create(path, "bench 1")
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        connection.execute("PRAGMA user_version=2")
    assert kinds(path) == {"version"}
    for use in (Journal.open, JournalReader.open, lambda p: recover(p, p.with_name("out.journal"))):
        with pytest.raises(JournalError, match="version 2; expected 1 at most"):
            use(path)
