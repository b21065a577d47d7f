"""Cell, journal, run and view together: what ends a log, and what is kept whatever happens."""

from __future__ import annotations

import io
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from daq.acquisition.acquire import Acquisition
from daq.acquisition.blocks import Chunk
from daq.bench.result import write_bench_session
from daq.bench.run import BenchRun
from daq.drivers.recorded import Feed, Replay
from daq.errors import JournalError
from daq.journal.writer import Journal
from daq.recordings.readings import ReadingBlock
from daq.standins.simulated import LoadStep, readings
from server.bench.keys import KeyInput, Pressed
from server.bench.loop import BenchLoop, from_keys
from server.bench.meter import StreamMeter
from server.bench.view import LineView
from tests.daq.bench_plays import (
    QUIET,
    REST,
    predicted,
    setup,
    truth,
)


class Paced:
    """Presses lines when the run's time has come, and what they need is there: a busy machine may be late with it."""

    def __init__(self, run: BenchRun, lines: list[tuple[float, str]]) -> None:
        self._run, self._lines = run, lines

    def __call__(self) -> list[Pressed]:
        status = self._run.status()
        if not self._lines or status.now_s < self._lines[0][0]:
            return []
        command, _, argument = self._lines[0][1].partition(" ")
        if (command == "loaded" and status.tare_age_s is None) or (command, status.phase, status.offer) == WAITS:
            return []
        del self._lines[0]
        return [Pressed(command, argument)]


WAITS = ("confirm", "loaded", None)
SPEED = 10.0
# What rests on the cell from when on, and what is pressed when.
LOADS = [LoadStep(0.0, REST), LoadStep(9.0, REST + truth("tip", {"FDP": 950}))]
LINES = [(0.3, "next"), (0.4, "tare"), (0.5, "confirm"), (9.5, "loaded"), (12.5, "confirm"), (12.6, "quit")]


def looped(folder: Path, view: Any, lines: list[tuple[float, str]], end_s: float = 30.0) -> tuple[BenchRun, Journal]:
    blocks: list[ReadingBlock] = list(readings(QUIET, LOADS, end_s, 1))
    journal = Journal.create(folder / "bench.ftj", "bench 1", reserve_bytes=0)
    stream = journal.add_stream("replay", {}, {"serial": "FT1"}, "recording")
    run = BenchRun(setup(), predicted, stream)
    meter = StreamMeter(run.full_scale)
    acquisition = Acquisition(Replay(), lambda: Feed(blocks, SPEED), chunk_s=0.02)
    acquisition.start()
    BenchLoop(acquisition, journal, stream, run, meter, view, Paced(run, lines), ends_when_closed=True).go_on()
    assert meter.samples == journal.next_seq(stream)
    return run, journal


def test_cell_journal_run_and_view_make_a_session_together(tmp_path: Path) -> None:
    out = io.StringIO()
    run, journal = looped(tmp_path, LineView(out), list(LINES))
    text = out.getvalue()
    assert "refused: there is no plateau to confirm (settling)" in text
    assert [k for k in ("case taken", "measured", "ended") if k in text] == ["case taken", "measured", "ended"]
    session = write_bench_session(journal, tmp_path / "S1")
    assert [c.id for c in session.cases] == ["c001"]
    shown = run.results()[0].force_N
    assert shown == pytest.approx(truth("tip", {"FDP": 950})[:3], abs=0.02)
    kinds = [e.kind for e in journal.events()]
    assert kinds.index("started") < kinds.index("case_taken") < kinds.index("ended")
    # What was written lies on the disk in the order in which it was decided.
    assert [k for k in kinds if k in ("bench_started", "tare", "case_taken")] == ["bench_started", "tare", "case_taken"]
    journal.close()


def test_a_full_disk_stops_cleanly_and_keeps_what_was_acknowledged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    append = Journal.append
    kept: list[int] = []

    def full(self: Journal, stream: str, chunk: Chunk, events: Any = ()) -> int:
        if len(kept) == 5:
            raise JournalError("disk full: bench.ftj cannot grow", "free space")
        kept.append(len(chunk))
        return append(self, stream, chunk, events)

    monkeypatch.setattr(Journal, "append", full)
    journal = Journal.create(tmp_path / "bench.ftj", "b", reserve_bytes=0)
    stream = journal.add_stream("replay", {}, {}, "recording")
    run = BenchRun(setup(), predicted, stream)
    meter = StreamMeter()
    acquisition = Acquisition(Replay(), lambda: Feed(list(readings(QUIET, LOADS, 30.0, 1)), SPEED), chunk_s=0.02)
    acquisition.start()
    with pytest.raises(JournalError, match="disk full"):
        BenchLoop(acquisition, journal, stream, run, meter, LineView(io.StringIO()), list).go_on()
    assert meter.samples == sum(kept) == journal.next_seq(stream)
    assert "acquisition" not in {t.name for t in threading.enumerate()}
    journal.close()


def test_a_command_that_cannot_be_kept_ends_the_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keep = Journal.event

    def event(self: Journal, *events: Any, stream: str | None = None) -> None:
        if any(e.kind == "note" for e in events):
            raise JournalError("bench.ftj cannot be written", "a local disk")
        keep(self, *events, stream=stream)

    monkeypatch.setattr(Journal, "event", event)
    with pytest.raises(JournalError, match="cannot be written"):
        looped(tmp_path, LineView(io.StringIO()), [(0.5, "note x")])
    assert "acquisition" not in {t.name for t in threading.enumerate()}


def test_little_room_on_the_disk_is_said_once_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Journal, "space_left", lambda self: 900_000_000)
    monkeypatch.setattr("server.bench.loop.SPACE_S", 0.05)
    out = io.StringIO()
    _, journal = looped(tmp_path, LineView(out), [(6.0, "close")])
    assert [e.value["text"] for e in journal.events() if e.kind == "warning"] == [
        "0.9 GB left; then logging stops cleanly"
    ]
    assert out.getvalue().count("0.9 GB left") == 1
    journal.close()


def test_a_silent_cell_holds_up_no_key(tmp_path: Path) -> None:
    class Silent(Feed):
        def read(self, timeout_s: float) -> bytes:
            time.sleep(timeout_s)
            return b""

    journal = Journal.create(tmp_path / "bench.ftj", "b", reserve_bytes=0)
    stream = journal.add_stream("replay", {}, {}, "recording")
    run = BenchRun(setup(), predicted, stream)
    keys = KeyInput()
    typed = iter(["kho", "t\n", "qn"])
    acquisition = Acquisition(Replay(), lambda: Silent([], 1.0))
    pressed = from_keys(keys, lambda: next(typed, ""), run)
    acquisition.start()
    began = time.monotonic()
    BenchLoop(acquisition, journal, stream, run, StreamMeter(), LineView(io.StringIO()), pressed).go_on()
    assert time.monotonic() - began < 5.0
    assert [e.value["text"] for e in journal.events() if e.kind == "note"] == ["hot"]
    journal.close()


def test_closing_ends_a_log_that_nobody_looks_at(tmp_path: Path) -> None:
    run, journal = looped(tmp_path, LineView(io.StringIO()), [(0.5, "close")])
    assert run.record.closed
    assert [e.kind for e in journal.events()][-1] == "ended"
    journal.close()
