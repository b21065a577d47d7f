"""A bench that broke off goes on from its journal: at the same step, with the same forces, blind, and tared anew."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.acquisition.acquire import Acquisition
from daq.bench.forces import Result
from daq.bench.record import BenchRecord
from daq.bench.result import write_bench_session
from daq.bench.resume import LEAST_AWAY_S, broken_off
from daq.bench.run import BenchRun
from daq.checks import check
from daq.drivers.recorded import Feed, Replay
from daq.errors import InputError
from daq.journal.reader import JournalReader
from daq.journal.writer import Journal
from daq.recordings.readings import ReadingBlock, open_readings
from daq.sessions.models import LoadCase
from daq.sessions.protocols import Protocol
from daq.signals.corrections import measure
from tests.daq.bench_plays import (
    PROTOCOL,
    WEIGHT,
    Bench,
    Line,
    case,
    gone_on,
    hung,
    journalled,
    predicted,
    setup,
    tared,
    truth,
    wait,
)  # fmt: skip

# All that changes where a bench stands.
EVENTFUL: list[Line] = [
    *tared(), *hung(WEIGHT), "next", *tared(), *case("tip", FDP=950), "repeat", *case("tip", FDP=950),
    "exclude c001r1 it slipped", "include c001r1", "exclude c001r1 it slipped",
    "next", "next", "repeat c002", "next", "known_weight 250 palmar tip", *tared(), *hung(0.5 * WEIGHT), "next",
    "posture_set", *tared(), "repeat c001", "next", *case("tip", FDP=500, FDS=500), *tared(), "next",
    "cell_moved", "posture_set", *tared(), *case("bone", FDP=950), "next", "known_weight 100 palmar", "next",
]  # fmt: skip


def standing(run: BenchRun) -> dict[str, Any]:
    """Where a bench stands, as far as it outlives a crash."""
    status = run.status()
    seen = {"step": status.step, "checklist": status.checklist, "cases": run.record.cases, "checks": run.record.checks}
    forces = {"forces": [as_told(r) for r in run.results()], "last": as_told(status.last)}
    return deepcopy(seen | forces)


def as_told(result: Result | None) -> Any:
    return None if result is None else result.as_value()


def test_wherever_it_breaks_off_it_stands_there_again(tmp_path: Path) -> None:
    played = journalled(tmp_path)
    stood = [(len(played.said), standing(played.run))]
    for line in EVENTFUL:
        played.play([line])
        if len(played.said) > stood[-1][0]:
            stood.append((len(played.said), standing(played.run)))
    assert played.journal is not None
    whole_of = broken_off(played.journal)
    assert whole_of is not None
    assert len(stood) > 40
    for n, before in stood:
        events = tuple(played.said[:n])
        part = replace(whole_of, events=events, record=BenchRecord.of(events))
        run = BenchRun(setup(), predicted, "s")
        run.resume(events, part.plateaus(played.journal), part.last_s, part.last_s + 60.0)
        assert standing(run) == before
        assert run.status().tare_age_s is None
    # Counters go on too: what is set anew from here on is another setting and mounting.
    last = Bench(run, now_s=part.last_s + 60.0)
    last.play(["repeat c004", "posture_set", "cell_moved"])
    assert last.values("set_posture") == [{"posture": "relaxed", "setting": 2}]
    assert last.values("move_cell") == [{"location": "bone", "mounting": 1}]
    played.journal.close()


def crashed(folder: Path) -> list[Result]:
    """A bench that was killed while the second case hung; what it had measured."""
    script: list[Line] = [
        "next", *tared(), *case("tip", FDP=950), *tared(), "next", *case("tip", FDS=950), "next", wait(1.0),
        "posture_set", *tared(), *case("tip", FDP=250, FDS=700), "next", wait(1.0), "cell_moved", *tared(),
        *case("bone", FDP=950)[:-1],
    ]  # fmt: skip
    played = journalled(folder).play(script)
    assert played.journal is not None
    played.journal.close()
    return played.run.results()


def test_a_session_in_two_parts_is_one_session(tmp_path: Path) -> None:
    shown = crashed(tmp_path)
    played = gone_on(tmp_path, 600.0)
    with pytest.raises(InputError, match="c004 has no tare"):
        played.press("loaded")
    played.play([*tared(), *case("bone", FDP=950), *tared(), "next", *tared(), *hung(WEIGHT), "next", "close"])
    assert played.journal is not None
    session = write_bench_session(played.journal, tmp_path / "S1")
    played.journal.close()
    assert [c.id for c in session.cases] == ["c001", "c002", "c003", "c004"]
    report = check(tmp_path / "S1")
    assert report.errors == ()
    # A pause is said; nothing else is wrong.
    assert {f.code for f in report.warnings} == {"time_jump"}
    measured = measure(session)
    for result, again in zip(shown, measured.cases, strict=False):
        assert again.wrench[:3] == pytest.approx(result.force_N, abs=1e-9)
    assert measured.cases[3].wrench[:3] == pytest.approx(truth("bone", {"FDP": 950})[:3], abs=0.02)
    # One time: it increases, and has one pause, over which no tare reaches.
    t = np.concatenate([b.t_s for b in open_readings(tmp_path / "S1" / "readings.csv.gz").blocks()])
    pause = int(np.argmax(np.diff(t)))
    assert np.sort(np.diff(t))[0] > 0.0
    assert t[pause + 1] - t[pause] == pytest.approx(600.0, abs=0.02)
    for one in session.cases:
        for _, (start, end) in one.windows():
            assert (start < t[pause]) == (end < t[pause + 1]) == (one.id != "c004")
    texts = [e.text for e in session.events if e.kind == "note" and "broke off" in (e.text or "")]
    assert texts == [f"the log broke off at {t[pause]:.1f} s and went on at {t[pause] + 600.0:.1f} s; "
                     "tares before it are not used after it"]  # fmt: skip


def test_validation_stays_blind_when_it_goes_on(tmp_path: Path) -> None:
    crashed(tmp_path)
    asked: list[str] = []

    def ask(one: LoadCase) -> Any:
        asked.append(one.id)
        return predicted(one)

    played = gone_on(tmp_path, 60.0, ask)
    played.play([*tared(), *case("bone", FDP=950), *tared()])
    assert "c003" not in asked
    assert played.run.results()[2].predicted_N is None
    # A reason for an exclusion is still one that no prediction gave.
    played.press("exclude c003 the weights were exchanged")
    played.press("close")
    assert [r.case for r in played.run.results()] == ["c001", "c002", "c004"]
    assert played.journal is not None
    played.journal.close()


def test_it_may_break_off_again_and_before_anything_was_done(tmp_path: Path) -> None:
    played = journalled(tmp_path)
    for k in range(2):
        assert played.journal is not None
        played.journal.close()
        played = gone_on(tmp_path, 30.0)
        played.play([*tared(), *hung(WEIGHT), "next"] if k == 0 else [])
    assert played.journal is not None
    times = [(e.value["broke_off_s"], e.at_s) for e in played.journal.events() if e.kind == "bench_resumed"]
    assert times == [(0.0, LEAST_AWAY_S), (times[1][0], times[1][0] + 30.0)]
    assert times[1][0] > 10.0
    assert played.run.status().step.startswith("c001")
    played.play([*tared(), *case("tip", FDP=950), "close"])
    assert played.journal is not None
    session = write_bench_session(played.journal, tmp_path / "S1")
    played.journal.close()
    assert ([c.id for c in session.cases], [w.when for w in session.checks]) == (["c001"], ["before"])


@pytest.mark.parametrize(("wall_s", "away_s"), [(-1e6, LEAST_AWAY_S), (0.2, LEAST_AWAY_S), (90.0, 90.0)])
def test_time_goes_on_with_the_wall_clock_but_never_back(tmp_path: Path, wall_s: float, away_s: float) -> None:
    crashed(tmp_path)
    with JournalReader.open(tmp_path / "bench.ftj") as kept:
        before = broken_off(kept)
    assert before is not None
    assert before.from_s(lambda: wall_s) - before.last_s == pytest.approx(away_s)


STREAM = {"driver": "simulated", "settings": {}, "cell": {"serial": "FT1"}, "clock": "device"}
OTHER = Protocol.model_validate(PROTOCOL | {"id": "other"})


@pytest.mark.parametrize(
    ("changes", "stream", "said"),
    [
        ({}, {}, ""),
        ({"protocol_name": "another.yaml"}, {}, ""),
        ({"id": "another"}, {}, ""),
        (
            {"protocol": OTHER},
            {},
            "protocol other is not that of session S1, which is to go on; expected small as it was",
        ),
        ({"tension_factor": 0.9}, {}, "tension_factor is 0.9; expected 0.835, as session S1 began"),
        ({"specimen": dict(setup().specimen) | {"side": "right"}}, {}, "specimen.side is 'right'; expected 'left'"),
        ({"known_weight": None}, {}, "known_weight is absent"),
        ({}, {"driver": "bota-sensone"}, "driver is 'bota-sensone'; expected 'simulated'"),
        ({}, {"settings": {"speed": 2.0}}, "settings.speed is 2.0; expected absent"),
        ({}, {"cell": {"serial": "FT2"}}, "cell.serial is 'FT2'; expected 'FT1'"),
    ],
)
def test_it_goes_on_only_as_it_began(
    tmp_path: Path, changes: dict[str, Any], stream: dict[str, Any], said: str
) -> None:
    crashed(tmp_path)
    with JournalReader.open(tmp_path / "bench.ftj") as kept:
        before = broken_off(kept)
    assert before is not None
    if not said:
        before.require_same(setup(**changes), STREAM | stream)
        return
    with pytest.raises(InputError) as caught:
        before.require_same(setup(**changes), STREAM | stream)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_session_begun_last_is_the_one_that_goes_on(tmp_path: Path) -> None:
    played = journalled(tmp_path).play(["close"])
    journal = played.journal
    assert journal is not None
    closed = broken_off(journal)
    assert closed is not None
    assert closed.record.closed
    stream = journal.add_stream("simulated", {}, {"serial": "FT1"}, "device")
    Bench(BenchRun(setup(id="S2"), predicted, stream), journal, stream).play([wait(1.0)])
    journal.add_stream("replay", {}, {})
    second = broken_off(journal)
    assert second is not None
    assert (second.stream.id, second.record.setup.id, second.record.closed) == (stream, "S2", False)
    journal.close()
    with Journal.create(tmp_path / "empty.ftj", "b", reserve_bytes=0) as empty:
        empty.add_stream("replay", {}, {})
        assert broken_off(empty) is None


def test_an_acquisition_numbers_and_times_its_samples_on() -> None:
    t_s = np.arange(200) / 100.0
    acquisition = Acquisition(Replay(), lambda: Feed([ReadingBlock(t_s, np.ones((200, 6)))], 0.0))
    acquisition.go_on_from(1000, 11.99, 20.0)
    acquisition.start()
    records = list(acquisition.records())
    chunks = [r.chunk for r in records if r.chunk is not None]
    assert chunks[0].first_seq == 1000
    assert chunks[-1].next_seq == 1200
    assert np.concatenate([c.t_s for c in chunks]) == pytest.approx(20.0 + t_s)
    assert all(at >= 20.0 for c in chunks for _, at in c.reads)
    assert all(e.at_s >= 20.0 for r in records for e in r.events)
