"""The bench's terminal: what is drawn, what keys do, what a pipe gets; and the loop that ties it all together."""

from __future__ import annotations

import io
import os
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from daq.acquisition.blocks import Chunk
from daq.acquisition.records import Record, StreamEvent
from daq.bench.run import BenchRun
from daq.errors import SessionError
from daq.journal.rows import Event
from daq.standins.simulated import LoadStep
from server.bench.keys import ESCAPE, KEYS, QUESTIONS, KeyInput, Pressed, terminal_keys, typed_lines
from server.bench.loop import from_lines
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


@pytest.mark.parametrize(
    ("key", "command"), [(k, c) for k, c, _ in KEYS if c not in QUESTIONS] + [("\r", "confirm"), ("T", "tare")]
)
def test_keys_are_commands(key: str, command: str) -> None:
    assert KeyInput().feed(key) == [Pressed(command)]


def test_some_keys_ask_and_what_is_typed_is_no_command() -> None:
    keys = KeyInput()
    assert keys.feed("x") == []
    assert keys.question.startswith("Which case is left out")
    assert keys.feed("c001 slipx\x7fped\n") == [Pressed("exclude", "c001 slipped")]
    assert keys.question == ""
    # The case that is meant is seen before anything is typed, and can be changed.
    begun = {"exclude": "c012 "}
    assert (keys.feed("x", answers_begin=begun), keys.typed) == ([], "c012 ")
    assert keys.feed("c001 shows it\n") == [Pressed("exclude", "c012 c001 shows it")]
    assert keys.feed("x" + 2 * "\x7f" + "1 slipped\n", answers_begin=begun) == [Pressed("exclude", "c011 slipped")]
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
    skipped = line_of(Event("case_skipped", 2.0, {"id": "c002"}))
    assert skipped == "     2.00 s  case skipped; id c002; repeat c002 goes back to it"
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


def test_the_whole_protocol_draws_at_every_step() -> None:
    bench = Bench(BenchRun(setup(), predicted))
    meter = metered(steady(3.0))
    for line in whole():
        bench.play([line])
        assert "NOW: " in drawn(bench, meter)
    assert "[x] weight_after" in drawn(bench, meter)
    assert hung(REST)[-1] == "confirm"
