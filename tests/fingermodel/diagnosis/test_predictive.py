"""Predictive check: what the model itself would read is predicted, whatever only the validation cases can tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.posterior.fitting import Fitter
from fingermodel.diagnosis.posterior.hyper import Hyperparameters
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.candidates import NOTHING, Candidates, Explanation
from fingermodel.diagnosis.session_model.session import session_of
from fingermodel.diagnosis.settings import P_VALUE
from fingermodel.diagnosis.verdict.predictive import check, unseen_errors, whereabouts
from fingermodel.session import Session

Floats = NDArray[np.float64]


@pytest.fixture(scope="module")
def bench() -> Session:
    return Session.open("DEV-01")


def as_read(bench: Session, theta: Floats, times: Floats | float = 1.0) -> Observations:
    """The session as the model reads it, with its noise; what effects change comes `times` (cases, 1) as large."""
    o, model = bench.observations, bench.model
    with_it, rng = np.asarray(model.predict(o.inputs, theta).reading), np.random.default_rng(3)
    plain = theta.copy()
    effects = model.parameters.of_kind("effect")
    plain[effects] = model.parameters.initial[effects]
    without = np.asarray(model.predict(o.inputs, plain).reading)
    noise = [rng.multivariate_normal(np.zeros(6), np.nan_to_num(c)) for c in o.noise.alone]
    return replace(o, wrench=without + times * (with_it - without) + np.array(noise))


def fitted(bench: Session, observations: Observations, names: tuple[str, ...]) -> Optimum:
    """An explanation of these names, fitted to the identification cases."""
    session = session_of(bench.model, observations)
    candidates = Candidates.of(bench.model, sagittal=session.plane == "sagittal")
    fitter = Fitter(session, candidates, Hyperparameters.of(session))
    explanation: Explanation = next((e for e in candidates.singles if e.names == names), NOTHING)
    base = fitter.fit(NOTHING, session.problem.centre, fitter.hyper.usual)
    start = base.expected(explanation, base.best)
    return fitter.fit(explanation, start, base.best) if names else base


def set_off(bench: Session, sds: float) -> Optimum:
    """The base model, fitted where the posture that no fitted case has was set so many standard deviations off."""
    o, table = bench.observations, bench.model.parameters
    used = {o.postures[k] for k, role in enumerate(o.roles) if role == "identification"}
    (new,) = {p for p in o.postures if p} - used
    own = [i for i, name in enumerate(table.names) if name.startswith(f"posture_angle.{new}.")]
    theta = table.initial.copy()
    theta[own] += sds * table.sd[own] * np.where(np.arange(len(own)) % 2, -1.0, 1.0)
    return fitted(bench, as_read(bench, theta), ())


def test_a_posture_that_no_fitted_case_has_may_be_set_as_badly_as_the_budget_says(bench: Session) -> None:
    found = check(set_off(bench, 3.0))
    assert found.p_value is not None
    assert found.p_value > 1e-2
    assert not found.bad


def test_the_validation_readings_are_linearised_where_they_lie(bench: Session) -> None:
    fit = set_off(bench, 4.0)
    measured = fit.session.measured[~fit.session.fitted]
    first, last = (np.abs(measured - fit.unseen_about(x)[0]).max() for x in (fit.x, whereabouts(fit)))
    assert last < 0.2 * first


@pytest.mark.parametrize(("times", "vetoed"), [(1.0, False), (1.05, False), (4.0, True)])
@pytest.mark.parametrize("unseen", ["tendons together", "posture"])
def test_where_nothing_alike_is_fitted_an_effect_may_be_off_by_what_its_name_allows(
    bench: Session, unseen: str, times: float, vetoed: bool
) -> None:
    o, table = bench.observations, bench.model.parameters
    theta = table.initial.copy()
    theta[table.names.index("sheath_friction.mu")] = 0.12
    loads = [frozenset(m for m, g in masses.items() if g > 0.0) for masses in o.masses_g]
    each = loads if unseen == "tendons together" else o.postures
    seen = {of for of, role in zip(each, o.roles, strict=True) if role == "identification"}
    new = np.array([of not in seen and role == "validation" for of, role in zip(each, o.roles, strict=True)])
    assert new.any()
    readings = as_read(bench, theta, np.where(new, times, 1.0)[:, None])
    found = check(fitted(bench, readings, ("sheath_friction",)))
    assert found.p_value is not None
    assert (found.p_value < P_VALUE) == vetoed


def test_where_no_load_is_new_there_is_nothing_else_to_allow_for(bench: Session) -> None:
    o, table = bench.observations, bench.model.parameters
    theta = table.initial.copy()
    theta[table.names.index("sheath_friction.mu")] = 0.12
    loads = [frozenset(m for m, g in masses.items() if g > 0.0) for masses in o.masses_g]
    seen = {load for load, role in zip(loads, o.roles, strict=True) if role == "identification"}
    roles = tuple(
        "identification" if role == "validation" and load not in seen else role
        for load, role in zip(loads, o.roles, strict=True)
    )
    assert "validation" in roles
    readings = replace(as_read(bench, theta), roles=roles)
    found = check(fitted(bench, readings, ("sheath_friction",)))
    assert found.p_value is not None
    assert found.p_value > P_VALUE


def test_the_unseen_error_is_over_force_components_as_every_rmse(bench: Session) -> None:
    fit = fitted(bench, bench.observations, ())
    off_N, change = 1e4, np.zeros(bench.observations.wrench.shape)
    change[np.array(bench.observations.roles) == "validation", :3] = off_N
    errors = unseen_errors(fit, fit.best, change)
    assert set(errors) == {"tip", "bone"}
    for _, after in errors.values():
        assert after == pytest.approx(off_N, rel=1e-3)
