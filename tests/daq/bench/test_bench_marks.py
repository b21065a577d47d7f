"""What is marked at a bench: known weights, tares and what ends them, postures and places."""

from __future__ import annotations

from typing import Any

import pytest

from tests.daq.bench_lines import BEGUN, bench, refused
from tests.daq.bench_plays import (
    NOTHING,
    WEIGHT,
    Line,
    case,
    hung,
    tared,
    truth,
    wait,
)  # fmt: skip

FDP, FDS = truth("tip", {"FDP": 950}), truth("tip", {"FDS": 950})


def test_a_known_weight_that_is_skipped_is_recorded() -> None:
    played = bench().play([*BEGUN, *case("tip", FDP=950), "close"])
    assert [v["when"] for v in played.values("known_weight_skipped")] == ["before", "after"]
    assert played.values("closed")[0]["undone"] == ["c002", "c003", "c004"]
    texts = [e["text"] for e in played.run.record.events if e["kind"] == "note"]
    assert texts[0] == "the known weight before the cases was skipped"
    assert texts[-1] == "closed without cases c002 c003 c004"


def test_a_known_weight_tells_a_wrong_sign_or_gain() -> None:
    played = bench().play([*tared(), *hung(-WEIGHT)])
    assert played.values("weighed")[0]["gain"] == pytest.approx(-1.0, abs=0.01)
    assert "Turn the sign" in played.warnings()
    played = bench().play([*tared(), *hung(1.1 * WEIGHT)])
    assert "calibration" in played.warnings()
    played = bench().play([*tared(), *hung(NOTHING)])
    assert "Did it hang on the cell" in played.warnings()
    assert "rotation" not in played.warnings()


@pytest.mark.parametrize(
    ("direction", "said"),
    [("palmar", "500 g palmar"), ("-y", "500 g palmar"), ([0.0, 3.0, 4.0], "500 g along (0, 0.6, 0.8)")],
)  # fmt: skip
def test_what_to_do_says_which_known_weight_is_to_be_hung(direction: Any, said: str) -> None:
    played = bench(known_weight={"mass_g": 500, "direction": direction, "mount": "tip"})
    assert "the known weight before the cases has no tare" in refused(played, "loaded")
    played.play(tared())
    assert played.run.status().todo == f"hang {said} on the cell at the tip, then mark loaded"
    assert played.run.status().step == f"weight_before: known weight on the cell (before): {said} at the tip"


@pytest.mark.parametrize("line", ["posture_set relaxed", "tare 5", "next c003", "close now"])
def test_a_word_that_would_be_passed_over_is_refused(line: str) -> None:
    command, _, _ = line.partition(" ")
    assert f"expected {command} alone" in refused(bench(), line)


def test_a_known_weight_is_described_when_it_is_not_known_and_put_in_between() -> None:
    played = bench(known_weight=None)
    assert "mass and direction" in refused(played, "loaded")
    for line, said in (
        ("known_weight", "500 palmar"),
        ("known_weight 500", "500 palmar"),
        ("known_weight 500 sideways", "direction"),
        ("known_weight -5 palmar", "mass_g"),
        ("known_weight 500 palmar nose", "mount"),
    ):
        assert said in refused(played, line)
    script: list[Line] = [
        "known_weight 500 palmar", *tared(), *hung(WEIGHT), "next", *tared(), *case("tip", FDP=950),
        "known_weight 250 palmar", *tared(), *hung(0.5 * WEIGHT),
    ]  # fmt: skip
    played.play(script)
    assert [(c["when"], c["mass_g"]) for c in played.run.record.checks] == [("before", 500.0), ("during", 250.0)]
    assert [v["gain"] for v in played.values("weighed")] == pytest.approx([1.0, 1.0], abs=0.01)
    # The tare of a weight on the cell itself is none for the finger.
    played.press("next")
    assert "no tare" in refused(played, "loaded")


@pytest.mark.parametrize("line", ["posture_set", "cell_moved", "retied", "slipped"])
def test_what_moves_the_finger_ends_the_life_of_a_tare(line: str) -> None:
    played = bench().play([*BEGUN, *case("tip", FDP=950), line, *tared(), "next"])
    # The tare after it does not bracket the case before it.
    assert "unloaded_after_s" not in played.run.record.cases["c001"]
    assert played.run.status().tare_age_s is not None
    played.press(line)
    assert played.run.status().tare_age_s is None
    assert "no tare" in refused(played, "loaded")


def test_moistening_leaves_a_tare_alone() -> None:
    played = bench().play([*BEGUN, *case("tip", FDP=950), "moistened", *tared()])
    assert "unloaded_after_s" in played.run.record.cases["c001"]
    assert [e["kind"] for e in played.run.record.events] == ["note", "tare", "moisten", "tare"]


def test_settings_and_mountings_are_counted_by_posture_and_place() -> None:
    script: list[Line] = [
        *BEGUN, *case("tip", FDP=950), "posture_set", *tared(), "repeat", *case("tip", FDP=950), "next",
        "cell_moved", *tared(), *case("tip", FDS=950), "next", "posture_set", *tared(), *case("tip", FDP=500, FDS=500),
    ]  # fmt: skip
    cases = bench().play(script).run.record.cases
    assert {k: (c["posture"], c["setting"], c["mounting"]) for k, c in cases.items()} == {
        "c001": ("hook", 0, 0), "c001r1": ("hook", 1, 0), "c002": ("hook", 1, 1), "c003": ("relaxed", 0, 1),
    }  # fmt: skip


def test_another_posture_or_place_must_be_marked() -> None:
    played = bench().play(["next", "next", "next", *tared()])
    assert "the posture is hook; expected relaxed for c003" in refused(played, "loaded")
    assert played.run.status().todo == "set posture relaxed, then mark it"
    played.press("posture_set")
    assert played.run.status().todo == "take all weights off, then tare"
    played.press("next")
    assert "the cell's place is tip; expected bone for c004" in refused(played, "loaded")


def test_an_unloaded_plateau_is_offered_and_only_a_tare_confirms_itself() -> None:
    played = bench().play(["next", "unloaded", wait(5.0)])
    assert played.values("tare") == []
    assert played.run.status().todo.startswith("confirm the unloaded plateau")
    played.press("tare")
    assert len(played.values("tare")) == 1
    assert played.run.status().todo == "hang the weights, then mark loaded"
