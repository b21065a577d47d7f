"""The journal: what was acknowledged is there, after a kill, a full disk, an interruption; what is damaged is found."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sqlite3
import struct
import subprocess
import sys
import threading
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.acquire import StreamEvent
from daq.blocks import Chunk
from daq.errors import JournalError
from daq.journal.check import check, recover
from daq.journal.export import export
from daq.journal.wal import chained, log_file, read_log
from daq.journal.writer import Event, Journal, JournalReader
from daq.readings import open_readings
from server.commands import journal as commands
from tests.daq.journal_kills import kill_many
from tests.daq.journal_writer import made_chunk

COUNT = 50


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "bench.journal"


def written(path: Path, chunks: int = 10, samples: int = COUNT) -> str:
    """A closed journal with one stream; return its id."""
    with Journal.create(path, "bench 1", 0) as journal:
        return fill(journal, chunks, samples)


def fill(journal: Journal, chunks: int, samples: int = COUNT) -> str:
    stream = journal.add_stream("robotiq-ft300", {"port": "COM3"}, {"serial": "FTS-1"}, "counter")
    for i in range(chunks):
        journal.append(stream, made_chunk(i * samples, samples), [Event("mark", float(i), {"i": i})])
    return stream


def torn_off(path: Path) -> Path:
    """A copy of an open journal with its log, as a crash leaves it."""
    crashed = path.with_name("crashed.journal")
    shutil.copyfile(path, crashed)
    shutil.copyfile(log_file(path), log_file(crashed))
    shutil.copyfile(path.with_name(path.name + "-writer"), crashed.with_name(crashed.name + "-writer"))
    return crashed


def kinds(path: Path) -> set[str]:
    return {fault.kind for fault in check(path).faults}


def firsts(path: Path, stream: str) -> list[int]:
    with JournalReader.open(path) as journal:
        return [chunk.first_seq for chunk in journal.read(stream)]


def flip(path: Path, at: int, bit: int = 3) -> None:
    with path.open("r+b") as file:
        file.seek(at)
        octet = file.read(1)[0]
        file.seek(at)
        file.write(bytes([octet ^ 1 << bit]))


def altered(path: Path, statement: str, *values: Any) -> None:
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        assert connection.execute(statement, values).rowcount == 1


def test_what_is_appended_is_read_back(path: Path) -> None:
    stream = written(path, 4)
    with JournalReader.open(path) as journal:
        assert journal.bench == "bench 1"
        assert [(s.id, s.driver, s.settings, s.cell, s.clock) for s in journal.streams()] == [
            (stream, "robotiq-ft300", {"port": "COM3"}, {"serial": "FTS-1"}, "counter")
        ]
        chunks = list(journal.read(stream))
        assert [c.first_seq for c in chunks] == [0, 50, 100, 150]
        wanted = made_chunk(100, COUNT)
        assert np.array_equal(chunks[2].wrench, wanted.wrench)
        assert np.array_equal(chunks[2].overload, wanted.overload)
        assert (chunks[2].raw, chunks[2].reads, chunks[2].utc_s) == (wanted.raw, wanted.reads, wanted.utc_s)
        assert [e.value["i"] for e in journal.events(stream)] == [0, 1, 2, 3]
        # From a sample on: the chunk that holds it comes first.
        assert [[c.first_seq for c in journal.read(stream, seq)] for seq in (99, 100, 200)] == [
            [50, 100, 150],
            [100, 150],
            [],
        ]
    assert check(path).faults == ()


def test_the_same_again_is_accepted_and_anything_else_out_of_order_is_refused(path: Path) -> None:
    with Journal.create(path, "bench 1", 0) as journal:
        stream = fill(journal, 2)
        assert journal.append(stream, made_chunk(0, COUNT)) == 50
        assert journal.append(stream, made_chunk(50, COUNT)) == 100
        for chunk in (made_chunk(150, COUNT), made_chunk(50, COUNT - 1), made_chunk(20, COUNT)):
            with pytest.raises(JournalError, match="expected sample 100"):
                journal.append(stream, chunk)
        with pytest.raises(JournalError, match="no stream nowhere"):
            journal.append("nowhere", made_chunk(0, COUNT))
        assert journal.append(stream, made_chunk(100, 0)) == 100
        with pytest.raises(JournalError, match="expected a new stream"):
            journal.append(stream, made_chunk(100, COUNT))
    assert firsts(path, stream) == [0, 50, 100]
    assert check(path).faults == ()


def test_a_chunk_and_its_events_are_kept_together_or_not_at_all(path: Path) -> None:
    with Journal.create(path, "bench 1", 0) as journal:
        stream = fill(journal, 1)
        for event in (Event("Mark"), Event("mark", value={"x": float("nan")}), Event("mark", float("inf"))):
            with pytest.raises(JournalError):
                journal.append(stream, made_chunk(50, COUNT), [event])
        assert journal.next_seq(stream) == 50
        assert len(journal.events()) == 1
        assert len(journal.pending()) == 1


def test_outbox_goes_from_pending_to_sent_or_quarantined(path: Path) -> None:
    with Journal.create(path, "bench 1", 0) as journal:
        stream = fill(journal, 4)
        assert [p.first_seq for p in journal.pending(3)] == [0, 50, 100]
        first = journal.pending(1)[0]
        assert Chunk.from_bytes(first.payload).first_seq == 0
        journal.tried(stream, 0)
        assert [(p.first_seq, p.tries) for p in journal.pending(2)] == [(0, 1), (50, 0)]
        journal.acknowledged(stream, 0)
        journal.quarantined(stream, 100, "HTTP 400")
        with pytest.raises(JournalError, match="no chunk at sample 7"):
            journal.acknowledged(stream, 7)
        assert [p.first_seq for p in journal.pending()] == [50, 150]
        assert journal.events(stream)[-1].kind == "quarantined"
    with Journal.open(path, 0) as journal:
        assert [p.first_seq for p in journal.pending()] == [50, 150]
    assert firsts(path, stream) == [0, 50, 100, 150]


def test_what_was_set_aside_goes_into_the_outbox_again_in_its_place(path: Path) -> None:
    with Journal.create(path, "bench 1", 0) as journal:
        stream = fill(journal, 5)
        journal.acknowledged(stream, 0)
        for first in (50, 150):
            journal.quarantined(stream, first, "made up")
        assert journal.set_aside() == {(stream, 50), (stream, 150)}
        assert journal.requeue() == 2
        assert [p.first_seq for p in journal.pending()] == [50, 100, 150, 200]
        assert [e.value for e in journal.events() if e.kind == "requeued"] == [{"chunks": 2}]
        # Where there is nothing, nothing is said.
        assert journal.requeue() == 0
        assert [e.kind for e in journal.events()].count("requeued") == 1
    assert check(path).faults == ()


def test_events_from_a_number_on_are_the_last_of_all(path: Path) -> None:
    with Journal.create(path, "bench 1", 0) as journal:
        fill(journal, 4)
        journal.event(Event("note"))
        assert [journal.events_from(n) for n in range(7)] == [journal.events()[n:] for n in range(7)]


def test_a_transaction_within_another_is_a_part_of_it(path: Path) -> None:
    with Journal.create(path, "bench 1", 0) as journal:
        stream = fill(journal, 3)

        def acknowledge(*firsts: int) -> None:
            with journal.transaction():
                for first in firsts:
                    journal.acknowledged(stream, first)

        with pytest.raises(JournalError, match="no chunk at sample 7"):
            acknowledge(0, 7)
        assert len(journal.pending()) == 3
        with journal.transaction():
            acknowledge(0)
            journal.event(Event("note"))
            with JournalReader.open(path) as reader:
                assert len(reader.events()) == 3
        with JournalReader.open(path) as reader:
            assert len(reader.events()) == 4
        assert len(journal.pending()) == 2


def test_a_second_writer_is_refused_and_readers_are_not(path: Path) -> None:
    with Journal.create(path, "bench 1", 0) as journal:
        stream = fill(journal, 1)
        with pytest.raises(JournalError, match=r"being written by process \d+ on .*Stop that one first"):
            Journal.open(path)
        program = f"from daq.journal.writer import Journal\nJournal.open({str(path)!r})"
        answer = subprocess.run([sys.executable, "-c", program], check=False, capture_output=True, text=True)  # noqa: S603
        assert "being written by process" in answer.stderr
        with pytest.raises(JournalError, match="is being written"):
            recover(path, path.with_name("out.journal"))
        with JournalReader.open(path) as reader:
            journal.append(stream, made_chunk(50, COUNT))
            assert reader.next_seq(stream) == 100
        assert check(path).faults == ()
        assert journal.append(stream, made_chunk(100, COUNT)) == 150
    with pytest.raises(JournalError, match="is closed"):
        journal.append(stream, made_chunk(150, COUNT))
    with Journal.open(path, 0) as journal:
        assert journal.append(stream, made_chunk(150, COUNT)) == 200


def test_threads_share_a_writer(path: Path) -> None:
    with Journal.create(path, "bench 1", 0) as journal:
        stream = fill(journal, 20)

        def send() -> None:
            for i in range(20):
                journal.acknowledged(stream, i * COUNT)

        sender = threading.Thread(target=send)
        sender.start()
        for i in range(20, 40):
            journal.append(stream, made_chunk(i * 50, COUNT))
        sender.join()
        assert [p.first_seq for p in journal.pending()] == [i * 50 for i in range(20, 40)]


def test_the_epoch_changes_where_a_journal_was_put_back_or_copied(path: Path) -> None:
    stream = written(path)
    early = path.with_name("early")
    shutil.copyfile(path, early)
    with Journal.open(path, 0) as journal:
        epoch = journal.epoch
        journal.append(stream, made_chunk(500, COUNT))
    with Journal.open(path, 0) as journal:
        assert journal.epoch == epoch
        copy = path.with_name("copy.journal")
        journal.close(copy)
    with JournalReader.open(copy) as reader:
        assert reader.epoch == epoch
    with Journal.open(copy, 0) as journal:
        assert journal.epoch != epoch
    shutil.copyfile(early, path)
    with Journal.open(path, 0) as journal:
        assert journal.epoch != epoch


def test_closing_writes_a_whole_copy_and_never_over_another(path: Path) -> None:
    stream = written(path)
    copy = path.with_name("copy.journal")
    copy.write_text("mine")
    journal = Journal.open(path, 0)
    with pytest.raises(JournalError, match="exists"):
        journal.close(copy)
    assert copy.read_text() == "mine"
    copy.unlink()
    Journal.open(path, 0).close(copy)
    assert {p.name for p in path.parent.iterdir()} == {path.name, f"{path.name}-writer", f"{path.name}-mark", copy.name}
    assert check(copy).faults == ()
    assert firsts(copy, stream) == firsts(path, stream)


def test_killed_writers_lose_nothing_acknowledged(path: Path) -> None:
    acknowledged, kept = kill_many(path, 6, seed=1)
    assert 0 < acknowledged <= kept


@pytest.mark.skipif(sys.platform == "win32", reason="a process cannot be sent Ctrl-C alone there")
def test_ctrl_c_leaves_a_sound_journal(path: Path) -> None:
    Journal.create(path, "bench 1", 0).close()
    command = [sys.executable, "-m", "tests.daq.journal_writer", str(path), str(path.with_name("copy"))]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as child:  # noqa: S603
        assert child.stdout is not None
        stream = child.stdout.readline().strip()
        lines = [child.stdout.readline() for _ in range(5)]
        child.send_signal(signal.SIGINT)
        lines += child.stdout.read().splitlines()
    with Journal.open(path, 0) as journal:
        assert journal.next_seq(stream) >= int(lines[-1])
    assert check(path).faults == ()


def test_an_interrupted_append_can_be_made_again(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with Journal.create(path, "bench 1", 0) as journal:
        stream = fill(journal, 1)
        chunk = made_chunk(50, COUNT)
        for moment in ("INSERT INTO outbox", "COMMIT"):
            interrupted = Interrupting(journal._connection, moment)
            monkeypatch.setattr(journal, "_connection", interrupted)
            with pytest.raises(KeyboardInterrupt):
                journal.append(stream, chunk)
            monkeypatch.undo()
            assert journal.next_seq(stream) == (100 if moment == "COMMIT" else 50)
        assert journal.append(stream, chunk) == 100
        assert journal.append(stream, made_chunk(100, COUNT)) == 150
    assert check(path).faults == ()


class Interrupting:
    """A connection with a Ctrl-C just after one statement."""

    def __init__(self, connection: sqlite3.Connection, moment: str) -> None:
        self._connection, self._moment = connection, moment

    def execute(self, query: str, *values: Any) -> Any:
        answer = self._connection.execute(query, *values)
        if query.startswith(self._moment):
            raise KeyboardInterrupt
        return answer

    def __getattr__(self, name: str) -> Any:
        return getattr(self._connection, name)


def test_a_full_disk_loses_nothing_acknowledged(path: Path) -> None:
    with Journal.create(path, "bench 1", 0) as journal:
        stream = fill(journal, 5, 700)
        pages = journal._connection.execute("PRAGMA page_count").fetchone()[0]
        journal._connection.execute(f"PRAGMA max_page_count={pages + 20}")
        seq = 3500
        with pytest.raises(JournalError, match=r"^disk full: bench\.journal cannot grow"):  # noqa: PT012
            while True:
                seq = journal.append(stream, made_chunk(seq, 700))
        assert 3500 < seq < 3500 + 20 * 700
        assert journal.next_seq(stream) == seq
        journal._connection.execute(f"PRAGMA max_page_count={pages + 100}")
        assert journal.append(stream, made_chunk(seq, 700)) == seq + 700
    assert check(path).faults == ()
    assert firsts(path, stream) == list(range(0, seq + 700, 700))


def test_a_reserve_stops_chunks_and_still_takes_an_event(path: Path) -> None:
    stream = written(path, 2)
    with Journal.open(path, reserve_bytes=1 << 60) as journal:
        assert journal.space_left() < 0
        with pytest.raises(JournalError, match="disk full"):
            journal.append(stream, made_chunk(100, COUNT))
        journal.event(Event("note", 1.0, {"text": "disk full"}, stream))
        assert journal.events()[-1].value == {"text": "disk full"}
    with Journal.open(path, reserve_bytes=0) as journal:
        assert journal.space_left() > 0
        assert journal.append(stream, made_chunk(100, COUNT)) == 150


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
    recover(path, out)
    wanted = [
        i * COUNT for i in range(10) if kind in ("outbox", "event", "stream") or i != (9 if "10" in statement else 2)
    ]
    assert firsts(out, stream) == wanted
    assert check(out).faults == ()
    with Journal.open(out, 0) as journal:
        assert [p.first_seq for p in journal.pending()] == wanted


def without_samples(first_seq: int, raw: bytes) -> Chunk:
    none = made_chunk(first_seq, 0)
    return replace(none, raw=raw, reads=[(len(raw), 1.0)])


def test_bytes_that_made_no_reading_are_kept_in_order_and_end_no_stream(path: Path) -> None:
    with Journal.create(path, "bench 1", 0) as journal:
        stream = fill(journal, 1)
        for raw in (b"one", b"two"):
            journal.keep(stream, without_samples(COUNT, raw), [Event("undecoded", 1.0)])
        journal.keep(stream, made_chunk(COUNT, COUNT))
        journal.keep(stream, without_samples(2 * COUNT, b"three"))
        journal.keep(stream, None, [Event("note")])
        # They stay here: a service wants readings.
        assert [p.first_seq for p in journal.pending()] == [0, COUNT]
    out = path.with_name("out.journal")
    recover(path, out)
    for each in (path, out):
        with JournalReader.open(each) as reader:
            assert [(c.first_seq, c.raw) for c in reader.undecoded(stream)] == [
                (50, b"one"),
                (50, b"two"),
                (100, b"three"),
            ]
            assert [e.kind for e in reader.events(stream)] == ["mark", "undecoded", "undecoded", "note"]
        assert firsts(each, stream) == [0, COUNT]
        report = check(each)
        assert (report.faults, report.undecoded_bytes) == ((), 11)
    altered(path, "UPDATE undecoded SET payload = (SELECT payload FROM undecoded WHERE id = 1) WHERE id = 2")
    assert [f.text for f in check(path).faults] == [
        f"bytes without a reading: chunk 50 of stream {stream} is damaged (its checksum does not hold)"
    ]


def test_a_journal_from_before_such_bytes_were_kept_is_read_and_written_on(path: Path) -> None:
    stream = written(path, 2)
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("DROP TABLE undecoded")
    with JournalReader.open(path) as reader:
        assert list(reader.undecoded(stream)) == []
    assert check(path).faults == ()
    with Journal.open(path, 0) as journal:
        journal.keep(stream, without_samples(2 * COUNT, b"odd"))
    assert check(path).undecoded_bytes == 3


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
    [(None, "there is no"), (b"", "is no journal"), (b"Fx,Fy\n" * 500, "is damaged .file is not a database.")],
)
def test_what_is_no_journal_is_refused_in_one_line(path: Path, content: bytes | None, said: str) -> None:
    if content is not None:
        path.write_bytes(content)
    for use in (Journal.open, JournalReader.open, check, lambda p: recover(p, p.with_name("out.journal"))):
        with pytest.raises(JournalError, match=said):
            use(path)
    assert not path.with_name("out.journal").exists()


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


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_export_gives_readings_and_events(path: Path, ending: str) -> None:
    stream = written(path, 3)
    target = path.with_name(f"run.{ending}")
    with Journal.open(path, 0) as journal:
        journal.event(Event("note", 0.0, {"text": "of the bench"}))
        other = journal.add_stream("made", {}, {})
    with pytest.raises(JournalError, match="2 streams"):
        export(path, target)
    done = export(path, target, stream[:12])
    assert (done.samples, done.stream) == (150, stream)
    blocks = list(open_readings(target).blocks())
    wanted = np.concatenate([made_chunk(i * COUNT, COUNT).wrench for i in range(3)])
    assert np.concatenate([b.wrench for b in blocks]) == pytest.approx(wanted, abs=1e-9)
    events = json.loads(done.events.read_text(encoding="utf-8"))["events"]
    assert [e["kind"] for e in events] == ["mark"] * 3 + ["note"]
    with pytest.raises(JournalError, match="no streams called"):
        export(path, target, other + "0")


def test_commands_answer_in_text_and_json(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stream = written(path, 3)
    assert commands.journal_check(path, None) == 0
    assert "150 samples in 3 sound chunks" in capsys.readouterr().out
    altered(path, "DELETE FROM chunks WHERE id = 2")
    assert commands.journal_check(path, "-") == 2
    answer = json.loads(capsys.readouterr().out)
    assert (answer["schema"], answer["ok"]) == ("fingertwin/journal-check/1", False)
    assert answer["faults"][0] == {
        "kind": "gap", "text": "50 samples from 50 on are missing", "stream": stream, "first_seq": 50, "n": 50,
    }  # fmt: skip
    out = path.with_name("out.journal")
    commands.journal_recover(path, out, None)
    assert "2 chunks recovered; 1 loss\n" in capsys.readouterr().out
    commands.journal_export(out, path.with_name("run.csv"), None, "csv", "-")
    assert json.loads(capsys.readouterr().out)["samples"] == 100


def test_what_the_sampling_thread_says_is_kept_as_it_is(path: Path) -> None:
    said = [StreamEvent("stale", 1.5, 1.7e9, {"silent_s": 0.5}), StreamEvent("overrun", 2.0, 1.7e9 + 1)]
    with Journal.create(path, "bench 1", 0) as journal:
        stream = journal.add_stream("made", {}, {})
        journal.append(stream, made_chunk(0, COUNT), said[:1])
        journal.event(said[1], stream=stream)
        journal.event(Event("note", value={"text": "lights off"}))
        kept = journal.events(stream)
        assert [(e.kind, e.at_s, e.utc_s, e.value) for e in kept] == [(e.kind, e.at_s, e.utc_s, e.value) for e in said]
        assert [e.stream for e in journal.events()] == [stream, stream, None]
        assert journal.events()[-1].utc_s > 1.7e9
