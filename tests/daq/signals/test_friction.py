from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.errors import SessionError
from daq.measured import MeasuredSession
from daq.sessions import Posture, parse_session, read_session
from daq.signals.balance import tip_to_metacarpal
from daq.signals.corrections import measure
from daq.signals.friction import friction
from tests.daq.benches import averaged

SPECIMENS = ("H01", "H02", "H03", "B01")


def published() -> list[MeasuredSession]:
    return [measure(read_session(f"synek2019_{s}")) for s in SPECIMENS]


def pair(factor: float, tip: list[float] | None = None, **changes: object) -> MeasuredSession:
    """A session whose tip and bone forces balance c m g along the metacarpal."""
    data = averaged()
    tip = tip or [-0.5, -2.0, 0.3]
    weight = 0.6 * 9.81
    turn = tip_to_metacarpal(Posture.model_validate(data["postures_deg"]["minor_flexion"]))
    bone = np.array([factor * weight, 0, 0]) - turn @ tip
    common = {"role": "validation", "posture": "minor_flexion", "masses_g": {"FDP": 300, "FDS": 300}}
    data["cases"] = [
        {"id": "t", "location": "tip", "force_N": tip, **common},
        {"id": "b", "location": "bone", "force_N": bone.tolist(), **common},
    ]
    for case in data["cases"]:
        case.update(changes)
    session, faults = parse_session(data, None)
    assert session is not None, faults
    return measure(session)


def test_the_published_factor_to_its_last_digit() -> None:
    result = friction(published())
    assert result.n == 32
    assert round(result.factor, 3) == 0.835
    assert round(result.factor, 4) == 0.8348
    assert result.pooled.sd == pytest.approx(0.0622, abs=5e-5)
    assert result.sd_population == pytest.approx(0.0612, abs=5e-5)
    assert [round(s.factor, 3) for s in result.specimens] == [0.914, 0.790, 0.806, 0.830]
    assert [s.n for s in result.specimens] == [8, 8, 8, 8]


def test_without_turning_the_tip_force_the_balance_is_lost() -> None:
    ratios = []
    for m in published():
        tip = {(c.case.posture, str(c.case.masses_g)): c.wrench[:3] for c in m.cases if c.case.location == "tip"}
        for c in m.cases:
            if c.case.location == "bone":
                total = tip[c.case.posture, str(c.case.masses_g)] + c.wrench[:3]
                ratios.append(np.linalg.norm(total) / (sum(c.case.masses_g.values()) * 9.81e-3))
    assert np.mean(ratios) == pytest.approx(0.597, abs=5e-4)


def test_the_pooled_uncertainty_counts_specimens_not_cases() -> None:
    result = friction(published())
    assert result.pooled.freedom == 3
    assert result.pooled.sem is not None
    assert result.sem_unclustered is not None
    means = [s.factor for s in result.specimens]
    # With equally many cases a specimen, clustering is the scatter of the specimens' means.
    assert result.pooled.sem == pytest.approx(np.std(means, ddof=1) / 2.0)
    assert result.pooled.sem > 2.0 * result.sem_unclustered
    assert result.pooled.low is not None
    assert result.pooled.low < 0.75
    assert result.pooled.above_one == 2
    assert any("c > 1 in 2 of 32" in n for n in result.notes)


def test_along_is_below_the_norm_and_across_makes_up_for_it() -> None:
    for c in friction(published()).cases:
        assert c.along <= c.factor
        assert np.hypot(c.along, c.across) == pytest.approx(c.factor)


@given(st.floats(0.3, 1.4), st.tuples(*[st.floats(-5, 5)] * 3))
def test_a_balanced_pair_gives_its_factor(factor: float, tip: tuple[float, ...]) -> None:
    (case,) = friction([pair(factor, list(tip))]).cases
    assert case.factor == pytest.approx(factor)
    assert case.along == pytest.approx(factor)
    assert case.across == pytest.approx(0.0, abs=1e-9)
    assert case.above_one == (case.factor > 1.0)


@given(st.tuples(*[st.floats(-90, 90)] * 4))
def test_the_turn_is_a_rotation_and_without_abduction_one_about_z(angles: tuple[float, ...]) -> None:
    posture = Posture(**dict(zip(("MCP", "PIP", "DIP", "abduction"), angles, strict=True)))
    R = tip_to_metacarpal(posture)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    total = np.deg2rad(sum(angles[:3]))
    flat = tip_to_metacarpal(posture.model_copy(update={"abduction": 0.0}))
    np.testing.assert_allclose(
        flat[:2, :2], [[np.cos(total), -np.sin(total)], [np.sin(total), np.cos(total)]], atol=1e-9
    )


def test_flexion_turns_the_distal_phalanx_palmar() -> None:
    R = tip_to_metacarpal(Posture(MCP=30.0, PIP=30.0, DIP=30.0))
    np.testing.assert_allclose(R @ [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], atol=1e-12)


def test_readings_noise_gives_each_factor_its_uncertainty() -> None:
    (without,) = friction([pair(0.8)]).cases
    assert without.factor_sd is None
    (with_sd,) = friction([pair(0.8, force_sd_N=0.1)]).cases
    assert with_sd.factor_sd == pytest.approx(0.1 * np.sqrt(2) / (0.6 * 9.81))


def test_repeats_are_averaged_and_loading_is_kept_from_unloading() -> None:
    session = pair(0.8).session
    tip, bone = session.cases
    again = tip.model_copy(update={"id": "t2", "repeat_of": "t", "force_N": (-0.7, -2.0, 0.3)})
    back = [c.model_copy(update={"id": c.id + "u", "direction": "unloading"}) for c in (tip, bone)]
    result = friction([measure(session.model_copy(update={"cases": (tip, again, bone, *back)}))])
    assert [c.direction for c in result.cases] == ["loading", "unloading"]
    assert result.cases[0].tip_cases == ("t", "t2")
    assert result.cases[1].factor == pytest.approx(0.8)


def both_ways(loading: float, unloading: float, tapped: float | None = None, **changes: Any) -> MeasuredSession:
    """A session with a pair on loading, one on unloading and, where asked for, one after tapping."""
    down = pair(loading, **changes).session
    more = [("u", unloading, None), ("p", tapped, "tapped, unloaded from 1.2 times the weights")]
    cases = list(down.cases)
    for name, factor, note in more:
        if factor is not None:
            told = {"direction": "unloading", "note": note}
            cases += [c.model_copy(update={"id": c.id + name, **told}) for c in pair(factor, **changes).session.cases]
    return measure(down.model_copy(update={"cases": tuple(cases)}))


@given(st.floats(0.3, 1.4), st.floats(0.3, 1.4), st.floats(0.3, 1.4))
def test_loading_unloading_and_tapping_are_reported_apart(loading: float, unloading: float, tapped: float) -> None:
    result = friction([both_ways(loading, unloading, tapped)])
    assert [(d.name, d.n) for d in result.directions] == [("loading", 1), ("unloading", 1), ("tapped", 1)]
    assert [d.factor for d in result.directions] == pytest.approx([loading, unloading, tapped])
    (band,) = result.bands
    assert (band.loading, band.unloading, band.tapped) == pytest.approx((loading, unloading, tapped))
    assert band.mean == pytest.approx(0.5 * (loading + unloading))
    assert band.half_difference == pytest.approx(0.5 * (unloading - loading), abs=1e-9)
    assert result.band is not None
    assert (result.band.n, result.band.half_difference) == (1, band.half_difference)
    # Friction may hold more than hangs where the weights were let down to it, and never else.
    flagged = {c.direction for c in result.cases if c.above_one}
    assert flagged == {d for d, c in (("loading", loading), ("tapped", tapped)) if c > 1.0}
    assert "1 loading, 1 unloading, 1 tapped" in result.notes[-1]


def test_sessions_that_only_know_loading_have_no_band() -> None:
    result = friction([pair(0.8)])
    assert (result.directions, result.bands, result.band) == ((), (), None)
    assert not [n for n in result.notes if "direction" in n]
    unloading = friction([pair(0.9, direction="unloading")])
    assert [d.name for d in unloading.directions] == ["unloading"]
    assert unloading.band is None


def test_a_band_is_as_uncertain_as_its_readings_and_clustered_by_specimen() -> None:
    (band,) = friction([both_ways(0.8, 0.9, force_sd_N=0.1)]).bands
    one = 0.1 * np.sqrt(2) / (0.6 * 9.81)
    assert band.half_difference_sd == pytest.approx(one / np.sqrt(2))
    assert friction([both_ways(0.8, 0.9)]).bands[0].half_difference_sd is None
    sessions = []
    for k, (loading, unloading) in enumerate([(0.80, 0.84), (0.80, 0.86), (0.82, 0.90)]):
        measured = both_ways(loading, unloading)
        specimen = measured.session.specimen.model_copy(update={"id": f"P{k}"})
        sessions.append(replace(measured, session=measured.session.model_copy(update={"specimen": specimen})))
    mean = friction(sessions).band
    assert mean is not None
    assert (mean.n, mean.specimens, mean.freedom) == (3, 3, 2)
    assert mean.half_difference == pytest.approx(0.03)
    assert mean.sem == pytest.approx(np.std([0.02, 0.03, 0.04], ddof=1) / np.sqrt(3))


@pytest.mark.parametrize("exchanged", [False, True])
def test_friction_that_would_help_the_weights_on_loading_is_remarked(exchanged: bool) -> None:
    measured = []
    for k, ways in enumerate([(0.80, 0.84), (0.80, 0.86), (0.82, 0.90)]):
        found = both_ways(*(ways[::-1] if exchanged else ways))
        specimen = found.session.specimen.model_copy(update={"id": f"P{k}"})
        measured.append(replace(found, session=found.session.model_copy(update={"specimen": specimen})))
    assert any("directions exchanged?" in note for note in friction(measured).notes) == exchanged


def test_unloading_alone_overstates_the_factor_and_that_is_said() -> None:
    alone = friction([pair(0.9, direction="unloading")])
    assert any("c is too large" in note for note in alone.notes)
    assert not any("c is too large" in note for note in friction([both_ways(0.8, 0.9)]).notes)


def test_nothing_to_pair() -> None:
    session = pair(0.8).session
    alone = measure(session.model_copy(update={"cases": session.cases[:1]}))
    with pytest.raises(SessionError, match="no pair of tip and bone cases"):
        friction([alone])
    with pytest.raises(SessionError, match="no pair"):
        friction([])
    bone = measure(session.model_copy(update={"cases": session.cases[1:]}))
    assert friction([pair(0.8), bone]).unpaired == ("S1: minor_flexion, FDP 300 g, FDS 300 g: no tip case",)
    back = measure(both_ways(0.8, 0.9).session.model_copy(update={"cases": both_ways(0.8, 0.9).session.cases[3:]}))
    assert friction([pair(0.8), back]).unpaired == ("S1: minor_flexion, FDP 300 g, FDS 300 g, unloading: no tip case",)


def test_one_specimen_says_that_it_is_alone() -> None:
    result = friction(published()[:1])
    assert result.pooled.freedom == 7
    assert any("one specimen" in n for n in result.notes)
    single = friction([pair(0.8)])
    assert single.pooled.sem is None
    assert single.sem_unclustered is None


def test_the_answer_is_plain_data() -> None:
    answer = friction(published()).as_dict()
    assert answer["schema"] == "fingertwin/friction/1"
    json.dumps(answer)
    assert {"weight_N", "masses_g", "factor"} <= set(answer["cases"][0])


def test_simulated_rigs_pass_what_their_sessions_state() -> None:
    result = friction([measure(read_session("DEV-01"))])
    assert result.pooled.factor == pytest.approx(0.835, abs=0.02)
