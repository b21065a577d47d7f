"""A bench run: what it takes, what it refuses, what it warns of, and what it keeps to itself."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.acquisition.blocks import Chunk
from daq.bench.plateau_finder import PlateauFinder, PlateauRules
from daq.bench.record import BenchRecord
from daq.bench.run import BenchRun
from daq.errors import InputError
from daq.journal.rows import Event
from daq.sessions.models import LoadCase
from daq.sessions.protocols import Timing
from daq.standins.simulated import SimulatedCell
from tests.daq.bench_lines import BEGUN, bench, refused
from tests.daq.bench_plays import (
    NOTHING,
    QUIET,
    Bench,
    Line,
    case,
    hung,
    load,
    predicted,
    setup,
    tared,
    truth,
    wait,
    whole,
)  # fmt: skip

FDP, FDS = truth("tip", {"FDP": 950}), truth("tip", {"FDS": 950})


@pytest.mark.parametrize("seed", range(3))
def test_a_whole_protocol_measures_the_truth_within_its_uncertainty(seed: int) -> None:
    played = bench().play(whole(), SimulatedCell(rate_hz=100.0, noise_correlation=0.5), seed)
    results = played.run.results()
    assert [r.case for r in results] == ["c001", "c002", "c003", "c004"]
    assert [r["gain"] for r in played.values("weighed")] == pytest.approx([1.0, 1.0], abs=0.01)
    assert [k["when"] for k in played.values("known_weight")] == ["before", "after"]
    assert played.warnings() == ""
    z = []
    for result in results:
        taken = played.run.record.cases[result.case]
        assert len(taken["unloaded_after_s"]) == 2
        z += list((result.force_N - truth(taken["location"], taken["masses_g"])[:3]) / result.sd_N)
    assert np.abs(z).max() < 4.0
    assert 0.2 < np.std(z) < 2.0
    assert {state for _, _, state in played.run.status().checklist} == {"done"}


def test_the_record_is_the_same_from_the_events_alone() -> None:
    played = bench().play(whole())
    assert BenchRecord.of(played.said).document() == played.run.record.document()
    assert {e.stream for e in played.said} == {"s"}


def test_windows_keep_the_guard_time_from_every_mark() -> None:
    played = bench().play(whole())
    marks = [e.at_s for e in played.said if e.kind in ("loaded", "unloaded")]
    windows = [c[k] for c in played.run.record.cases.values() for k in ("unloaded_s", "loaded_s", "unloaded_after_s")]
    assert len(windows) == 12
    for start, end in windows:
        since = start - max(m for m in marks if m < start)
        assert since >= 1.5 - 0.01
        assert not [m for m in marks if start < m < end]


def test_a_load_without_a_tare_is_refused_and_nothing_is_recorded() -> None:
    played = bench().play(["next", load(FDP), wait(1.0)])
    assert "no tare" in refused(played, "loaded")
    played.play([*tared(), *case("tip", FDP=950), "posture_set"])
    assert "already" in refused(played, "loaded")
    played.press("next")
    assert "no tare" in refused(played, "loaded")
    assert list(played.run.record.cases) == ["c001"]


def test_a_tare_taken_under_load_is_warned_of_while_the_weight_hangs() -> None:
    # The second weight hung already when the tare was taken, so nothing is left of the first.
    played = bench().play([load(FDP), *BEGUN[:1], wait(0.3), "tare", wait(5.0), "loaded", wait(4.5)])
    assert "forgotten tare" in played.warnings()
    assert played.values("case_taken") == []
    assert played.run.status().offer is not None


@pytest.mark.parametrize(
    ("hangs", "doubted"),
    [(FDP, False), (FDP * 0.95, False), (FDP * 0.5, True), (FDS, True), (-FDP, True), (NOTHING, True)],
)
def test_a_wrong_weight_or_tendon_is_warned_of_before_it_is_confirmed(
    hangs: NDArray[np.float64], doubted: bool
) -> None:
    played = bench().play([*BEGUN, load(hangs), wait(0.3), "loaded", wait(4.5)])
    assert ("wrong tendon" in played.warnings()) == doubted
    assert played.values("case_taken") == []
    live = played.run.status().live
    assert live is not None
    assert live.outside is doubted


def test_a_force_beyond_the_weights_needs_no_prediction_to_be_doubted() -> None:
    run = BenchRun(setup())
    played = Bench(run).play([*BEGUN, load(8.0 * FDP), wait(0.3), "loaded", wait(4.5)])
    assert "wrong weight" in played.warnings()
    assert "predicted_N" not in str(played.said)


def test_a_model_that_fails_ends_nothing() -> None:
    def fails(asked: LoadCase) -> None:
        raise ZeroDivisionError(asked.id)

    played = Bench(BenchRun(setup(), fails)).play([*BEGUN, *case("tip", FDP=950)])
    assert list(played.run.record.cases) == ["c001"]
    assert "no prediction (ZeroDivisionError: c001)" in played.warnings()


def test_overload_keeps_readings_out_of_every_window() -> None:
    hard = np.array([0.0, -40.0, 0.0, 0.0, 0.0, 0.0])
    script: list[Line] = [
        *BEGUN, load(FDP), wait(0.3), "loaded", wait(2.5), load(hard), wait(0.3), load(FDP), wait(6.0), "confirm",
    ]  # fmt: skip
    played = bench().play(script)
    assert "overload" in played.warnings()
    start, end = played.values("case_taken")[0]["loaded_s"]
    hit = next(e.at_s for e in played.said if e.kind == "loaded") + 2.5
    assert start > hit + 0.3 + 1.4
    assert end > start + 2.0
    assert "overload" in played.run.status().warnings[0]


def test_an_overload_names_its_channels_once_for_each_mark() -> None:
    one, two = np.array([0.0, -40.0, 0.0, 0.0, 0.0, 0.0]), np.array([40.0, -40.0, 0.0, 0.0, 0.0, 0.0])
    hit: list[Line] = ["loaded", wait(1.0), load(one), wait(1.0), load(two), wait(1.0), load(one), wait(1.0)]
    played = bench().play([*BEGUN, *hit, load(FDP), wait(1.0), *hit])
    said = [w["text"] for w in played.values("warning") if w["code"] == "overload"]
    assert [text.split(" at ")[0] for text in said] == ["overload of Fy"] * 2
    assert all("while loaded: take off what presses on the cell" in text for text in said)


@pytest.mark.parametrize(("resolution_N", "remarked"), [(0.0, True), (2.0, False)])
def test_a_channel_that_stands_still_under_load_and_did_not_in_the_tare_is_remarked(
    resolution_N: float, remarked: bool
) -> None:
    """A channel at a limit that nobody told us has no noise; one of a coarse cell had none in the tare either."""
    played = bench()
    take = played.run.take

    def spoiled(chunk: Chunk) -> tuple[Event, ...]:
        wrench = chunk.wrench.copy()
        wrench[:, 1] = np.maximum(wrench[:, 1], -1.5)
        if resolution_N:
            wrench[:, 1] = resolution_N * np.round(wrench[:, 1] / resolution_N)
        return take(replace(chunk, wrench=wrench))

    played.run.take = spoiled  # type: ignore[method-assign]
    played.play([*BEGUN, *hung(FDP)])
    assert len(played.values("case_taken")) == 1
    assert ("Fy stands still" in played.warnings()) == remarked


def test_a_status_flag_withdraws_an_offer() -> None:
    played = bench().play([*BEGUN, load(FDP), wait(0.3), "loaded", wait(5.0)])
    assert played.run.status().offer is not None
    hard = np.array([0.0, -40.0, 0.0, 0.0, 0.0, 0.0])
    played = bench().play([*BEGUN, load(FDP), wait(0.3), "loaded", wait(5.0), load(hard), wait(0.4)])
    assert played.run.status().offer is None
    assert "no plateau" in refused(played, "confirm")
    assert len(played.values("plateau_lost")) == 1


@pytest.mark.parametrize("share", [0.965, 0.93, 0.8])
def test_a_slip_during_the_plateau_withdraws_it_and_ends_the_tare(share: float) -> None:
    script: list[Line] = [*BEGUN, load(FDP), wait(0.3), "loaded", wait(4.6), load(share * FDP), wait(1.0)]
    played = bench().play(script, replace(QUIET, ringing_share=0.0))
    slip_s = 0.3 + 5.0 + 0.3 + 4.6
    assert len(played.values("plateau_lost")) == 1
    assert "slipped?" in played.warnings()
    assert played.run.status().offer is None
    assert "no plateau" in refused(played, "confirm")
    played.press("slipped suture of FDP")
    assert "no tare" in refused(played, "loaded")
    # What comes after is another plateau; none has the slip inside.
    again = bench().play([*script, wait(5.0), "confirm"], replace(QUIET, ringing_share=0.0))
    start, _ = again.values("case_taken")[0]["loaded_s"]
    assert start > slip_s + 0.5
    assert again.run.record.cases["c001"]["loaded_s"] == [start, _]


def test_creep_is_no_plateau_until_it_ends() -> None:
    creep: list[Line] = [
        line for k in range(100) for line in (load(FDP * (1.0 - 0.25 * k / 100)), wait(0.06))
    ]  # fmt: skip
    smooth = replace(QUIET, ringing_share=0.0)
    played = bench().play([*BEGUN, "loaded", *creep], smooth)
    assert played.run.status().offer is None
    assert "creeps" in played.run.status().reason
    played = bench().play([*BEGUN, "loaded", *creep, wait(4.0)], smooth)
    assert played.run.status().offer is not None


def test_drift_of_the_zero_is_warned_of_and_taken_out_between_two_tares() -> None:
    def drifted(wrench: NDArray[np.float64], seconds: float, from_N: float) -> list[Line]:
        steps = round(seconds / 0.1)
        shift = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]) * 0.02
        return [line for k in range(steps) for line in (load(wrench + shift * (from_N + 0.1 * k)), wait(0.1))]

    smooth = replace(QUIET, ringing_share=0.0)
    script: list[Line] = [
        "next", "tare", *drifted(NOTHING, 5.0, 0.0), load(FDP), "loaded", *drifted(FDP, 6.0, 5.0), "confirm",
        "tare", *drifted(NOTHING, 6.0, 11.0),
    ]  # fmt: skip
    played = bench().play(script, smooth)
    assert "the zero" not in played.warnings()
    before, after = (v["force_N"][0] for v in played.values("measured"))
    assert before - FDP[0] > 0.09
    assert after == pytest.approx(FDP[0], abs=0.02)
    far: list[Line] = ["next", *tared(), *case("tip", FDP=950), load(NOTHING + 0.3), wait(0.3), "tare", wait(5.0)]
    played = bench().play(far)
    assert "has moved by +0.3 N since the last tare" in played.warnings()


def test_repeats_are_added_and_never_replace() -> None:
    script: list[Line] = [
        *BEGUN, *case("tip", FDP=950), "repeat", *case("tip", FDP=950), "repeat", *case("tip", FDP=950), "next",
        *case("tip", FDS=950), "repeat c001", *case("tip", FDP=950),
    ]  # fmt: skip
    cases = bench().play(script).run.record.cases
    assert {k: c.get("repeat_of") for k, c in cases.items()} == {
        "c001": None, "c001r1": "c001", "c001r2": "c001", "c002": None, "c001r3": "c001",
    }  # fmt: skip
    assert len({tuple(c["loaded_s"]) for c in cases.values()}) == 5


def test_a_repeat_asked_for_late_comes_before_what_waits() -> None:
    played = bench().play([*BEGUN, *case("tip", FDP=950), "next", "repeat"])
    assert played.run.status().step.startswith("c001r1: FDP 950 g, hook, tip, repeat of c001")
    played.press("next")
    assert played.run.status().step.startswith("c002")
    assert played.values("case_skipped") == [{"id": "c001r1"}]


def test_a_case_that_was_skipped_can_be_gone_back_to() -> None:
    played = bench().play([*BEGUN, *case("tip", FDP=950), "next", "next"])
    assert played.values("case_skipped") == [{"id": "c002"}]
    assert played.run.status().answers_begin["repeat"] == "c002"
    assert "no case c003 was taken or skipped; expected one of c001 c002" in refused(played, "repeat c003")
    played.play(["repeat c002", *case("tip", FDS=950), "next"])
    taken = played.run.record.cases["c002"]
    assert (taken["masses_g"], taken.get("repeat_of")) == ({"FDS": 950}, None)
    status = played.run.status()
    assert [(name, state) for name, _, state in status.checklist] == [
        ("weight_before", "skipped"), ("c001", "done"), ("c002", "done"), ("c003", "now"), ("c004", "open"),
        ("weight_after", "open"),
    ]  # fmt: skip
    assert status.answers_begin["repeat"] == "c002"
    played.play(["repeat c002", "next", "next", "next", "next"])
    assert played.run.status().step == "all steps are done"
    played.press("repeat c003")
    assert played.run.status().step.startswith("c003")
    played.press("close")
    assert played.values("closed")[0]["undone"] == ["c002r1", "c004", "c003"]


def test_a_tare_of_the_known_weight_is_none_of_a_case() -> None:
    script: list[Line] = [*BEGUN, *case("tip", FDP=950), "next", "next", "next", "next", *tared(), "repeat c001"]
    played = bench().play(script)
    assert played.run.status().step.startswith("c001r1")
    assert "no tare" in refused(played, "loaded")


def test_validation_stays_blind_until_the_session_is_closed() -> None:
    asked: list[str] = []

    def ask(one: LoadCase) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        asked.append(one.id)
        return predicted(one)

    # c003 hangs wrongly: neither a warning nor a number may tell before the end.
    script: list[Line] = ["next", "next", "next", "posture_set", *tared(), *case("tip", FDP=250, FDS=700), *tared()]
    played = Bench(BenchRun(setup(), ask)).play(script)
    assert list(played.run.record.cases) == ["c003"]
    assert asked == []
    assert played.warnings() == ""
    assert "predicted" not in str(played.values("measured"))
    assert played.run.results()[0].outside is None
    last = played.run.status().last
    assert last is not None
    assert last.predicted_N is None
    played.press("close")
    assert set(asked) == {"c003"}
    result = played.run.results()[0]
    assert result.predicted_N == pytest.approx(truth("tip", {"FDP": 500, "FDS": 500})[:3])
    assert played.values("closed")[0]["comparison"][0]["case"] == "c003"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"load_cell": {"model": "ATI Nano17"}}, "serial and calibration"),
        ({"specimen": {"id": "P1", "species": "human", "digit": "third", "side": "sinister"}}, "side"),
        ({"specimen": {"id": "P1", "species": "human", "digit": "third", "side": "left", "name": "X"}}, "name"),
        ({"tension_factor": 0.0}, "tension_factor"),
        ({"finger": "an1979_midle"}, "an1979_middle"),
        ({"known_weight": {"mass_g": 500, "direction": "down"}}, "direction"),
        ({"unloaded_state": "loose"}, "unloaded_state"),
    ],
)
def test_a_setup_that_would_spoil_the_session_is_refused_at_once(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        BenchRun(setup(**changes))


def test_unknown_commands_name_the_known_ones() -> None:
    played = bench()
    assert "Did you mean confirm?" in refused(played, "comfirm")
    assert "one of tare unloaded" in refused(played, "")
    assert "an empty note" in refused(played, "note  ")
    assert "no case c9 was taken" in refused(played, "repeat c9")
    assert "no case is named" in refused(played, "repeat")
    assert played.run.status().answers_begin == {}


def test_the_ring_is_bounded() -> None:
    finder = PlateauFinder(PlateauRules(window_s=1.0, most_s=4.0))
    for k in range(600):
        t = k * 0.1 + np.arange(10) / 100
        finder.take(t, np.random.default_rng(k).normal(size=(10, 6)) * 0.01, np.zeros(10, bool))
    t, wrench = finder.readings((0.0, 100.0))
    assert 8.0 <= t[-1] - t[0] <= 8.2
    assert wrench.shape == (len(t), 6)


def test_a_gap_is_no_part_of_a_window() -> None:
    finder = PlateauFinder(PlateauRules(window_s=1.0, guard_s=0.0))
    finder.restart(0.0)
    t = np.concatenate([np.arange(90) / 100, 1.4 + np.arange(130) / 100])
    for k in range(0, len(t), 10):
        part = t[k : k + 10]
        finder.take(part, np.random.default_rng(k).normal(size=(10, 6)) * 0.01, np.zeros(10, bool))
    assert finder.offer is not None
    assert finder.offer.window_s[0] >= 1.39


def test_guard_time_follows_the_time_constant_of_the_rig() -> None:
    timing = Timing(tare_s=4.0, load_s=5.0, settle_s=1.5, guard_s=0.3)
    assert PlateauRules.of(timing).guard_s == 1.5
    assert PlateauRules.of(timing, time_constant_s=0.5).guard_s == 2.5
    assert PlateauRules.of(timing).window_s == pytest.approx(2.2)
