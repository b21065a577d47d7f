"""The bench's terminal: what is drawn, what keys do, what a pipe gets; and the loop that ties it all together."""

from __future__ import annotations

import io
import os
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from daq.acquire import Acquisition, Record, StreamEvent
from daq.bench.result import write_bench_session
from daq.bench.run import BenchRun
from daq.blocks import Chunk
from daq.drivers.recorded import Feed, Replay
from daq.errors import JournalError, SessionError
from daq.journal.rows import Event
from daq.journal.writer import Journal
from daq.readings import ReadingBlock
from daq.simulated import LoadStep, readings
from server.bench.keys import ESCAPE, KEYS, KeyInput, Pressed, terminal_keys, typed_lines
from server.bench.loop import BenchLoop, from_keys, from_lines
from server.bench.meter import POINTS, StreamMeter
from server.bench.view import LineView, LiveView, bar, line_of, render, sparkline
from tests.daq.bench_plays import (
    QUIET,
    REST,
    Bench,
    case,
    chunks,
    hung,
    load,
    predicted,
    setup,
    tared,
    truth,
    wait,
    whole,
)

RANGE = np.array([25.0, 25.0, 35.0, 250.0, 250.0, 250.0])


def steady(seconds: float, wrench: Any = REST, start_s: float = 0.0, first: int = 0) -> list[Chunk]:
    return list(chunks(QUIET, [LoadStep(0.0, np.asarray(wrench, float))], seconds, 1, start_s, first))


def metered(played: list[Chunk], *events: StreamEvent) -> StreamMeter:
    meter = StreamMeter(RANGE)
    for chunk in played:
        meter.take(Record(chunk, ()))
    meter.take(Record(None, events))
    return meter


def drawn(bench: Bench, meter: StreamMeter, width: int = 160, **more: Any) -> str:
    out = io.StringIO()
    console = Console(file=out, width=width, highlight=False)
    console.print(render(bench.run.status(), meter, width=width, **more))
    return out.getvalue()


def event(kind: Any, **value: Any) -> StreamEvent:
    return StreamEvent(kind, 1.0, 0.0, value)


def test_traces_come_with_value_unit_and_share_of_the_range() -> None:
    text = drawn(Bench(BenchRun(setup())), metered(steady(30.0, [5.0, -12.5, 0.0, 0.0, 225.0, 0.0])))
    rows = {line.split()[0]: line for line in text.splitlines() if line.split()[:1]}
    assert "+4.9" in rows["Fx"] or "+5.0" in rows["Fx"]
    assert (" N " in rows["Fx"], "N mm" in rows["Tx"]) == (True, True)
    assert "50 %" in rows["Fy"]
    assert "#####....." in rows["Fy"]
    assert "90 %" in rows["Ty"]
    assert "rate 100.0 Hz" in text
    assert "no tare" in text


def test_a_cell_of_unknown_range_has_no_saturation_bar() -> None:
    meter = StreamMeter(None)
    for chunk in steady(1.0):
        meter.take(Record(chunk, ()))
    text = drawn(Bench(BenchRun(setup())), meter)
    assert text.count("range not known") == 6
    assert "#" not in text


def test_what_happens_to_the_stream_is_counted_and_said() -> None:
    meter = metered(
        steady(1.0),
        event("gap", lost_samples=7, counted=True),
        event("overrun", lost_samples=3),
        event("overload", status=1),
        event("damaged", rejected=2, skipped_bytes=9),
        event("disconnected", why="the cable was pulled"),
    )
    text = drawn(Bench(BenchRun(setup())), meter, space_left=1_500_000_000)
    for said in ("gaps 2 (10 lost)", "overloads 1", "damaged 2", "lost the cable was pulled", "disk 1.5 GB left"):
        assert said in text
    meter.take(Record(None, (event("reconnected"),)))
    meter.take(Record(None, (event("stale", silent_s=0.6),)))
    assert meter.state == "silent"
    meter.take(Record(steady(0.1, start_s=2.0, first=100)[0], ()))
    assert meter.state == "streaming"


def test_the_meter_is_bounded_and_remembers_the_worst() -> None:
    meter = StreamMeter(RANGE)
    meter.take(Record(steady(0.1, [0.0, 24.0, 0.0, 0.0, 0.0, 0.0])[0], ()))
    for chunk in steady(200.0, np.zeros(6), 0.1, 10):
        meter.take(Record(chunk, ()))
    assert meter.traces().shape == (POINTS, 6)
    assert meter.worst == pytest.approx(0.96, abs=0.01)
    assert meter.saturation == pytest.approx(np.zeros(6), abs=0.01)
    assert meter.samples == 20010


def test_sparklines_span_their_levels_and_do_not_magnify_noise() -> None:
    assert sparkline(np.array([0.0, 1.0, 2.0]), 0.2) == "▁▅█"
    assert sparkline(np.array([1.0, 1.001, 1.0]), 0.2) == "▄▅▄"
    assert sparkline(np.array([]), 0.2) == ""
    assert bar(1.7, 4) == "#### 170 %"


def test_the_view_says_what_to_do_what_was_measured_and_what_is_doubtful() -> None:
    bench = Bench(BenchRun(setup(), predicted))
    text = drawn(bench, metered(steady(1.0)))
    assert "NOW: take all weights off, then tare" in text
    assert "[>] weight_before" in text
    bench.play(["next", *tared(), *case("tip", FDP=950), "next", load(truth("tip", {"FDP": 950})), "loaded", wait(5.0)])
    text = drawn(bench, metered(steady(1.0)))
    assert "NOW: confirm the loaded plateau" in text
    assert "measured   c001: (-0.89" in text
    assert "hangs now  c002: (-0.9" in text
    assert "! c002 reads" in text
    assert "OUTSIDE the band" in text
    assert "[-] weight_before" in text
    assert "[x] c001" in text
    assert "1 of 6 steps done, 1 skipped" in text
    assert all(word in text for _, _, word in KEYS)


def test_predictions_of_validation_cases_are_drawn_after_the_end_alone() -> None:
    bench = Bench(BenchRun(setup(), predicted))
    bench.play(["next", "next", "next", "posture_set", *tared(), *case("tip", FDP=500, FDS=500)])
    before = drawn(bench, metered(steady(1.0)), results=bench.run.results())
    assert "c003: (" in before
    assert "predicted" not in before
    bench.press("close")
    assert "predicted (-0.68 -1.74 +0.16) N" in drawn(bench, metered(steady(1.0)), results=bench.run.results())


@pytest.mark.parametrize(("key", "command"), [(k, c) for k, c, _ in KEYS if c not in
                         ("exclude", "known_weight", "note", "quit")] + [("\r", "confirm"), ("T", "tare")])  # fmt: skip
def test_keys_are_commands(key: str, command: str) -> None:
    assert KeyInput().feed(key) == [Pressed(command)]


def test_some_keys_ask_and_what_is_typed_is_no_command() -> None:
    keys = KeyInput()
    assert keys.feed("x") == []
    assert keys.question.startswith("Why")
    assert keys.feed("slipx\x7fped\n") == [Pressed("exclude", "slipped")]
    assert keys.question == ""
    assert keys.feed("kquiet" + ESCAPE + "n") == [Pressed("next")]
    assert keys.feed("w500 palmar\rt") == [Pressed("known_weight", "500 palmar"), Pressed("tare")]
    assert keys.feed("?ß1 ") == []


def test_quitting_asks_whether_to_unblind_and_only_yes_does() -> None:
    keys = KeyInput()
    assert keys.feed("q") == []
    assert "predictions" in keys.question
    assert keys.feed("y") == [Pressed("close")]
    assert keys.feed("qn") == [Pressed("quit")]
    assert keys.feed("q\r") == []
    assert keys.feed("q" + ESCAPE) == []
    assert keys.feed("qz") == []
    assert keys.feed("n") == [Pressed("quit")]
    assert keys.feed("q", closed=True) == [Pressed("quit")]


@pytest.mark.skipif(sys.platform == "win32", reason="a pseudo-terminal")
def test_keys_are_read_from_a_terminal_without_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    import pty
    import termios

    host, terminal = pty.openpty()
    with os.fdopen(terminal) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        before = termios.tcgetattr(terminal)
        with terminal_keys() as pressed:
            assert pressed() == ""
            os.write(host, b"tn\xc3\xa4")
            assert eventually(pressed) == "tnä"
            os.write(host, b"\x1b[A")
            time.sleep(0.05)
            assert pressed() == ""
        # The state at the end is the one before, echo and all.
        assert termios.tcgetattr(terminal)[3] == before[3]
    os.close(host)


def eventually(ask: Callable[[], Any]) -> Any:
    for _ in range(200):
        answer = ask()
        if answer:
            return answer
        time.sleep(0.01)
    return pytest.fail("nothing came")


def test_lines_are_read_without_waiting() -> None:
    take = typed_lines(io.StringIO("tare\n\n  note room 21 C \n"))
    assert eventually(take) == "tare"
    assert eventually(take) == "note room 21 C"
    assert take() is None
    pressed = from_lines(typed_lines(io.StringIO("exclude c001 it slipped\n")))
    assert eventually(pressed) == [Pressed("exclude", "c001 it slipped")]


def test_without_a_terminal_each_event_is_one_line() -> None:
    out = io.StringIO()
    view = LineView(out)
    bench = Bench(BenchRun(setup(), predicted)).play(["next", *tared(), *case("tip", FDP=950), "note a\tb"])
    view.tell(bench.said)
    view.refuse(SessionError("no", "yes"))
    lines = out.getvalue().splitlines()
    assert len(lines) == len(bench.said) + 1
    assert lines[0] == "     0.00 s  bench started"
    assert lines[-1] == "refused: no; expected yes."
    taken = next(line for line in lines if "case taken" in line)
    assert "masses_g FDP 950" in taken
    latin = io.TextIOWrapper(io.BytesIO(), encoding="cp1252")
    LineView(latin).tell([Event("note", 2.0, {"text": "Probe → 3"})])
    latin.flush()
    assert b"Probe ? 3" in latin.buffer.getvalue()
    assert line_of(Event("gap", 1.5, {"lost_samples": 3})) == "     1.50 s  gap; lost_samples 3"


def test_the_live_view_draws_on_a_terminal_that_knows_no_blocks() -> None:
    raw = io.BytesIO()
    out = io.TextIOWrapper(raw, encoding="cp437", errors="strict")
    console = Console(file=out, width=100, force_terminal=True, legacy_windows=False)
    bench = Bench(BenchRun(setup(), predicted)).play(["next", *tared()])
    with LiveView(bench.run, metered(steady(5.0)), KeyInput(), console) as view:
        view.refuse(SessionError("not so", "so"))
        view.draw(10**10)
        bench.press("close")
        view.draw(10**10)
    out.flush()
    text = raw.getvalue().decode("cp437")
    assert "not so; expected so." in text
    assert "NOW: closed" in text
    assert "disk 10.0 GB left" in text


class Paced:
    """Presses lines when the run's time has come."""

    def __init__(self, run: BenchRun, lines: list[tuple[float, str]]) -> None:
        self._run, self._lines = run, lines

    def __call__(self) -> list[Pressed]:
        out = []
        while self._lines and self._run.status().now_s >= self._lines[0][0]:
            command, _, argument = self._lines.pop(0)[1].partition(" ")
            out.append(Pressed(command, argument))
        return out


SPEED = 10.0
# What rests on the cell from when on, and what is pressed when.
LOADS = [LoadStep(0.0, REST), LoadStep(6.0, REST + truth("tip", {"FDP": 950}))]
LINES = [(0.3, "next"), (0.4, "tare"), (0.5, "confirm"), (6.5, "loaded"), (12.5, "confirm"), (12.6, "quit")]


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


def test_the_whole_protocol_draws_at_every_step() -> None:
    bench = Bench(BenchRun(setup(), predicted))
    meter = metered(steady(3.0))
    for line in whole():
        bench.play([line])
        assert "NOW: " in drawn(bench, meter)
    assert "[x] weight_after" in drawn(bench, meter)
    assert hung(REST)[-1] == "confirm"
