"""The bench's journal: what was acknowledged is there, in order, once, whatever was going on."""

from __future__ import annotations

import json
import shutil
import signal
import sqlite3
import subprocess
import sys
import threading
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daq.acquisition.blocks import Chunk
from daq.acquisition.records import StreamEvent
from daq.errors import JournalError
from daq.journal.check import check, recover
from daq.journal.export import export
from daq.journal.writer import Event, Journal, JournalReader
from daq.recordings.readings import open_readings
from server.commands import journal as commands
from tests.daq.journal_kills import kill_many
from tests.daq.journal_writer import made_chunk
from tests.daq.journals import COUNT, Interrupting, altered, fill, firsts, written


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "bench.journal"


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
        with pytest.raises(JournalError, match=f"disk full: .* expected more than {1 << 40} MiB of free space"):
            journal.append(stream, made_chunk(100, COUNT))
        journal.event(Event("note", 1.0, {"text": "disk full"}, stream))
        assert journal.events()[-1].value == {"text": "disk full"}
    with Journal.open(path, reserve_bytes=0) as journal:
        assert journal.space_left() > 0
        assert journal.append(stream, made_chunk(100, COUNT)) == 150


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
    commands.journal_check(path, None)
    assert "150 samples in 3 sound chunks" in capsys.readouterr().out
    commands.journal_recover(path, path.with_name("whole.journal"), None)
    assert "3 chunks recovered; no losses\n" in capsys.readouterr().out
    altered(path, "DELETE FROM chunks WHERE id = 2")
    with pytest.raises(JournalError, match="damaged; 1 fault, the first: 50 samples from 50 on are missing"):
        commands.journal_check(path, "-")
    answer = json.loads(capsys.readouterr().out)
    assert (answer["schema"], answer["ok"]) == ("fingertwin/journal-check/1", False)
    assert answer["faults"][0] == {
        "kind": "gap", "text": "50 samples from 50 on are missing", "stream": stream, "first_seq": 50, "n": 50,
    }  # fmt: skip
    out = path.with_name("out.journal")
    with pytest.raises(JournalError, match="1 loss: 50 readings are missing"):
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
