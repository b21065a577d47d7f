"""A bench that follows a protocol with repeats, overloads and taps: what it asks for, and what the session says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from daq.bench.result import write_bench_session
from daq.bench.run import BenchRun
from daq.checks import check
from daq.errors import InputError
from daq.sessions.protocols import Protocol
from tests.daq.bench_plays import (
    PROTOCOL,
    Bench,
    Line,
    case,
    hung,
    journalled,
    load,
    predicted,
    setup,
    tared,
    truth,
    wait,
)

FDP = truth("tip", {"FDP": 950})
BLOCK = {"role": "identification", "location": "tip", "postures": ["hook"], "masses_g": [{"FDP": 950}]}
OVER = "hang 1.2 times the weights (FDP 1140 g), take them down to FDP 950 g"
HELD = 0.04 * FDP


def following(**changes: Any) -> Any:
    return setup(protocol=Protocol.model_validate(PROTOCOL | {"blocks": [BLOCK | changes]}))


def bench(**changes: Any) -> Bench:
    return Bench(BenchRun(following(**changes), predicted, "s"))


def todo(played: Bench) -> str:
    return played.run.status().todo


ALL = ["load", "overload", "unload", "tap"]
# Loaded, overloaded, unloaded to the weight, and tapped, with what friction holds.
WHOLE: list[Line] = [
    "next", *tared(), *hung(FDP - HELD), "next", load(1.2 * FDP), wait(1.0), *hung(FDP + HELD), "next", *hung(FDP),
    *tared(), "next",
]  # fmt: skip


def test_each_step_says_what_to_do() -> None:
    played = bench(actions=ALL)
    assert todo(played.play(["next", *tared()])) == "hang the weights, then mark loaded"
    played.play([*hung(FDP), "next"])
    assert played.run.status().step == "c002: FDP 950 g, hook, tip, unloaded from 1.2 times the weights"
    assert todo(played) == f"{OVER}, then mark loaded"
    played.play([*hung(FDP), "next"])
    assert played.run.status().step.startswith("c003: FDP 950 g, hook, tip, tapped, unloaded from 1.2")
    assert todo(played) == "leave the weights hanging, tap the rig, then mark loaded"
    # Once they were taken off, all must be done again.
    played.play(tared())
    assert todo(played) == f"{OVER}, tap the rig, then mark loaded"


def test_tapping_after_plain_loading_asks_for_no_overload() -> None:
    played = bench(actions=["load", "tap"]).play(["next", *tared(), *hung(FDP), "next"])
    assert todo(played) == "leave the weights hanging, tap the rig, then mark loaded"
    assert todo(played.play(["slipped", *tared()])) == "hang the weights, tap the rig, then mark loaded"


def test_what_was_skipped_does_not_hang() -> None:
    # The overload was passed over, so the tapped reading needs it all the same.
    played = bench(actions=ALL).play(["next", *tared(), *hung(FDP), "next", "next"])
    assert todo(played) == f"{OVER}, tap the rig, then mark loaded"


def test_direction_and_what_was_done_are_in_the_session(tmp_path: Path) -> None:
    played = journalled(tmp_path, following(actions=ALL)).play([*WHOLE, "close"])
    assert played.journal is not None
    session = write_bench_session(played.journal, tmp_path / "S1")
    played.journal.close()
    unloaded = "unloaded from 1.2 times the weights"
    assert [(c.direction, c.note) for c in session.cases] == [
        ("loading", None), ("unloading", unloaded), ("unloading", f"tapped, {unloaded}"),
    ]  # fmt: skip
    texts = [e.text for e in session.events if e.kind == "note" and (e.text or "").startswith("c00")]
    assert texts == [f"c002: {unloaded}", f"c003: tapped, {unloaded}"]
    # All three between the same two tares.
    assert len({(c.unloaded_s, c.unloaded_after_s) for c in session.cases}) == 1
    report = check(tmp_path / "S1")
    assert report.errors == ()
    assert {f.code for f in report.warnings} == {"single_posture"}


def test_the_planned_repeat_is_one_and_more_may_be_added(tmp_path: Path) -> None:
    masses = [{"FDP": 950}, {"FDS": 950}]
    played = journalled(tmp_path, following(masses_g=masses, repeat_first=True))
    played.play(["next", *tared(), *case("tip", FDP=950), "next", *case("tip", FDS=950), "next"])
    assert played.run.status().step == "c003: FDP 950 g, hook, tip, repeat of c001"
    played.play([*case("tip", FDP=950), "repeat", *case("tip", FDP=950), "repeat c001", *case("tip", FDP=950), "close"])
    assert played.journal is not None
    session = write_bench_session(played.journal, tmp_path / "S1")
    played.journal.close()
    assert {c.id: c.repeat_of for c in session.cases} == {
        "c001": None, "c002": None, "c003": "c001", "c001r1": "c001", "c001r2": "c001",
    }  # fmt: skip


def test_a_repeat_of_what_was_skipped_stands_alone() -> None:
    played = bench(repeat_first=True).play(["next", "next", *tared(), *case("tip", FDP=950)])
    assert {k: c.get("repeat_of") for k, c in played.run.record.cases.items()} == {"c002": None}


def test_an_overload_is_no_plateau_before_it_is_taken_down() -> None:
    played = bench(actions=ALL).play(["next", *tared(), *hung(FDP), "next", load(1.2 * FDP), wait(6.0)])
    assert played.run.status().offer is None
    with pytest.raises(InputError, match="no plateau to confirm"):
        played.press("confirm")
