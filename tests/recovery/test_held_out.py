"""Cases that were never fitted, counted in: they take back what they do not bear out, and name nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fingermodel.diagnosis.held_out import HeldOut
from fingermodel.diagnosis.questioned import Noise
from fingermodel.diagnosis.wildcard import AMPLITUDES_N, Wildcard, anything

from fingermodel.diagnosis.diagnose import UNSHOWN
from fingermodel.problems import map_problem
from fingermodel.refit import drawn_starts, slopes_of
from server.commands.diagnosis import run_diagnosis
from server.workflow import open_bench
from tests.second_simulator import write_session


def test_slopes_of_readings_never_fitted_are_those_of_the_prediction() -> None:
    bench = open_bench("DEV-08", catalogue=True)
    problem = map_problem(bench.model, bench.observations)
    problem = replace(problem, free=problem.free | bench.model.parameters.of_kind("effect"))
    every = HeldOut(problem, ()).every
    unseen = np.array(bench.observations.roles)[every.rows // 6] == "validation"
    assert set(every.rows[~unseen]) == set(problem.rows)
    # More cases than are fitted at once: more than one piece.
    assert len(np.unique(every.rows // 6)) > len(problem.fitted_readings.inputs.setting)
    (theta,) = drawn_starts(problem, 1)
    way = np.random.default_rng(4).normal(size=len(theta)) * problem.free
    step = 1e-4 * problem.scale * way

    def readings(at: np.ndarray) -> np.ndarray:
        wrench = np.asarray(bench.model.predict(bench.observations.inputs, at).reading)
        return wrench.reshape(-1)[every.rows]

    # What is left of a reading falls as its prediction rises.
    expected = -(readings(theta + step) - readings(theta - step)) / 2e-4
    slopes = slopes_of(problem, theta, every.rows) @ way
    for component in np.unique(every.rows % 6):
        own = every.rows % 6 == component
        tolerance = 1e-3 * float(np.median(np.abs(expected[own])))
        np.testing.assert_allclose(slopes[own], expected[own], rtol=2e-3, atol=tolerance)


def test_what_is_read_of_them_counts_only_as_far_as_what_is_fitted_is_read() -> None:
    bench = open_bench("DEV-08", catalogue=True)
    problem = map_problem(bench.model, bench.observations, "sagittal")
    every = HeldOut(replace(problem, rows=problem.rows[problem.rows % 6 < 2]), ()).every
    assert set(every.rows % 6) == {0, 1}
    assert (every.observations.wrench == bench.observations.wrench).all()


def test_readings_of_unknown_uncertainty_do_not_count() -> None:
    bench = open_bench("DEV-08", catalogue=True)
    problem = map_problem(bench.model, bench.observations)
    held = bench.observations.where("validation")
    covariance = bench.observations.covariance.copy()
    moments = (6 * held[:, None] + np.arange(3, 6)).reshape(-1)
    covariance[moments, :] = covariance[:, moments] = 0.0
    unknown = replace(problem, observations=replace(bench.observations, covariance=covariance))
    every = HeldOut(unknown, ()).every
    assert not np.isin(every.rows, moments).any()
    assert np.isin(6 * held, every.rows).all()


def test_something_else_that_can_be_nothing_gains_what_nothing_does(monkeypatch: pytest.MonkeyPatch) -> None:
    found = run_diagnosis(open_bench("DEV-08", catalogue=True))
    held_out = HeldOut(found.problem, found.candidates)
    monkeypatch.setattr("fingermodel.diagnosis.held_out.anything", lambda problem: np.zeros((len(problem.rows), 1)))
    none = Wildcard(np.zeros((len(found.problem.rows), 1)), AMPLITUDES_N)
    without = Noise.of(held_out.noise.covariance, held_out.unseen)
    nothing = found.evidence.nothing
    gained = held_out._gained(nothing, None, without)
    assert held_out._gained(nothing, none, without) == pytest.approx(gained, abs=1e-6)


def test_without_such_cases_all_stays_as_it_was() -> None:
    bench = open_bench("DEV-08", catalogue=True)
    found = run_diagnosis(bench)
    problem = found.problem
    roles = tuple("check" if role == "validation" else role for role in problem.observations.roles)
    none = replace(problem, observations=replace(problem.observations, roles=roles))
    wildcard = Wildcard.of(anything(problem), AMPLITUDES_N)
    held_out = HeldOut(none, found.candidates)
    assert held_out.counted_in(found.evidence, wildcard) == found.evidence.probability
    assert not held_out.most_missed(found.best).surprising


def test_a_companion_that_they_speak_against_is_not_named(tmp_path: Path) -> None:
    """The angles read off had made up for a plate that takes torque."""
    truth = write_session(tmp_path, "two", 2019)
    assert truth.effects == ("centre_migration", "volar_plate")
    found = run_diagnosis(open_bench(tmp_path, catalogue=True))
    assert (found.verdict.kind, found.verdict.effects) == ("found", ("centre_migration",)), found.verdict
    (why,) = [r for r in found.verdict.reasons if "if the cases never fitted counted too" in r]
    assert why.startswith("goniometer_bias beside it is not certain")
    assert "centre_migration and volar_plate" in why


def test_what_they_alone_show_is_said_beside_a_finding(tmp_path: Path) -> None:
    """Only cases that were never fitted extend a joint so far that its plate acts."""
    truth = write_session(tmp_path, "two", 2007)
    assert set(truth.effects) == {"cell_crosstalk", "volar_plate"}
    found = run_diagnosis(open_bench(tmp_path, catalogue=True))
    assert (found.verdict.kind, found.verdict.effects) == ("found", ("cell_crosstalk",)), found.verdict
    assert [UNSHOWN in reason for reason in found.verdict.reasons].count(True) == 1
    # Nor is that said of one whose other effect is found.
    other = tmp_path / "other"
    whole = write_session(other, "two", 2020)
    found = run_diagnosis(open_bench(other, catalogue=True))
    assert set(found.verdict.effects) == set(whole.effects) == {"cell_crosstalk", "intrinsic_bowstring"}
    assert not any(UNSHOWN in reason for reason in found.verdict.reasons)


@pytest.mark.full
def test_a_finding_that_they_speak_against_is_none(tmp_path: Path) -> None:
    truth = write_session(tmp_path, "one", 2201)
    assert truth.effects == ("volar_plate",)
    assert truth.rms_change_N["volar_plate"] < 0.001
    found = run_diagnosis(open_bench(tmp_path, catalogue=True))
    assert (found.verdict.kind, found.verdict.effects) == ("undecided", ()), found.verdict
    assert any("and of no effect" in short for short in found.verdict.short)
