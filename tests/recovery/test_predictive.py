"""The predictive check: validation cases are predicted by the model that they test, as far as they are known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from fingermodel.diagnosis.session_model.session import session_of
from fingermodel.diagnosis.verdict.predictive import check
from fingermodel.fitting.identification import drawn_starts, slopes_of
from fingermodel.session import Session
from server.application.diagnosing import run_diagnosis
from tests.simulator import draw_session


def test_slopes_of_validation_readings_are_those_of_the_prediction() -> None:
    bench = Session.open("DEV-08")
    session = session_of(bench.model, bench.observations)
    problem = replace(session.problem, free=session.problem.free | bench.model.parameters.of_kind("effect"))
    rows = session.rows[~session.fitted]
    assert {bench.observations.roles[i] for i in rows // 6} == {"validation"}
    (theta,) = drawn_starts(problem, 1)
    way = np.random.default_rng(4).normal(size=len(theta)) * problem.free
    step = 1e-4 * problem.scale * way

    def readings(at: np.ndarray) -> np.ndarray:
        wrench = np.asarray(bench.model.predict(bench.observations.inputs, at).reading)
        return wrench.reshape(-1)[rows]

    # What is left of a reading falls as its prediction rises.
    expected = -(readings(theta + step) - readings(theta - step)) / 2e-4
    slopes = slopes_of(problem, theta, rows) @ way
    for component in np.unique(rows % 6):
        own = rows % 6 == component
        tolerance = 1e-3 * float(np.median(np.abs(expected[own])))
        np.testing.assert_allclose(slopes[own], expected[own], rtol=2e-3, atol=tolerance)


def test_validation_readings_of_unknown_uncertainty_do_not_count() -> None:
    bench = Session.open("DEV-08")
    held = bench.observations.where("validation")
    moments = (6 * held[:, None] + np.arange(3, 6)).reshape(-1)
    turn = np.tile(np.eye(6), (len(bench.observations.ids), 1, 1))
    turn[held, 3:, 3:] = 0.0
    session = session_of(bench.model, replace(bench.observations, noise=bench.observations.noise.turned(turn)))
    assert not np.isin(session.rows, moments).any()
    assert np.isin(6 * held, session.rows[~session.fitted]).all()


def test_without_validation_cases_nothing_is_vetoed() -> None:
    bench = Session.open("DEV-08")
    roles = tuple("check" if role == "validation" else role for role in bench.observations.roles)
    found = run_diagnosis(replace(bench, observations=replace(bench.observations, roles=roles)))
    assert found.verdict.effects == ("zero_offset",)
    assert check(found.best).p_value is None


def test_what_only_a_validation_case_shows_is_no_slip(tmp_path: Path) -> None:
    draw_session(tmp_path, 63, {"volar_plate": 0.6}, nuisance_scale=0.8)
    bench = Session.open(tmp_path)
    found = run_diagnosis(bench)
    # The plate is tight in hyperextension under an extending torque: these tendons are together there alone.
    shows = [c for c, m in enumerate(bench.observations.masses_g) if bench.observations.postures[c] == "hyperextension"]
    only = next(c for c in shows if {m for m, g in bench.observations.masses_g[c].items() if g} == {"FDP", "EDC"})
    assert bench.observations.roles[only] == "validation"
    assert only in found.session.unlike_fitted
    assert found.suspects == {}
    assert found.verdict.kind == "undecided"
    assert bench.observations.ids[only] in found.verdict.short[0]
