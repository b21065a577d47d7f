"""Refits find a known truth within the uncertainty that they state, and say what they cannot know."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from fingermodel.api import add, refit
from fingermodel.budget import SYNEK2019
from fingermodel.diagnosis.answer.addition import add_effects
from fingermodel.fingers.files import read_finger
from fingermodel.fitting.eq5 import refit_slsqp
from fingermodel.fitting.fit_report import Fit
from fingermodel.fitting.identification import refit_map
from fingermodel.fitting.problems import eq5_problem, objective_at
from fingermodel.model import Model
from fingermodel.session import Session
from tests.recovery.rigs import misstate, record
from tests.stated import stated_problem

Floats = NDArray[np.float64]


class Recovered(NamedTuple):
    """A simulated session, its refit, and the truth as a parameter vector and as wrenches by case."""

    bench: Session
    fit: Fit
    truth: Floats
    wrenches: dict[str, Floats]


@pytest.fixture(scope="module", params=[1, 2])
def recovered(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Recovered:
    seed = int(request.param)
    folder = tmp_path_factory.mktemp(f"rig{seed}")
    truth, wrenches = record(folder, seed)
    bench = Session.open(folder, catalogue=False)
    theta = np.array([truth[name] for name in bench.model.parameters.names])
    return Recovered(bench, refit(bench), theta, wrenches)


def test_truth_lies_within_the_stated_uncertainty(recovered: Recovered) -> None:
    fit = recovered.fit
    assert fit.outcome == "converged"
    sd = np.sqrt(np.diag(fit.covariance))
    z = ((fit.theta - recovered.truth)[sd > 0]) / sd[sd > 0]
    assert np.mean(np.abs(z) < 1.96) > 0.9
    assert np.abs(z).max() < 4.0


def test_truth_is_as_likely_as_it_should_be(recovered: Recovered) -> None:
    """How much worse the truth fits than the optimum is chi-square with as many degrees of freedom as parameters."""
    fit = recovered.fit
    problem = stated_problem(recovered.bench.model, recovered.bench.observations)
    worse = objective_at(problem, recovered.truth) - fit.objective
    low, high = (float(stats.chi2.ppf(p, int(fit.free.sum()))) for p in (1e-3, 1 - 1e-3))
    assert low < worse < high


def test_misfit_is_what_noise_alone_leaves(recovered: Recovered) -> None:
    """The penalised optimum itself is chi-square with as many degrees of freedom as readings."""
    fit = recovered.fit
    assert fit.objective < stats.chi2.ppf(1 - 1e-4, fit.residuals)
    assert fit.objective > 0.4 * fit.residuals


def test_unseen_loads_are_predicted_within_the_stated_uncertainty(recovered: Recovered) -> None:
    bench, fit = recovered.bench, recovered.fit
    unseen = bench.observations.where("validation")
    slope = np.asarray(bench.model.jacobian(bench.observations.inputs, fit.theta))[unseen][:, :3]
    variance = np.einsum("ncp,pq,ncq->nc", slope, fit.covariance, slope)
    predicted = np.asarray(bench.model.predict(bench.observations.inputs, fit.theta).reading)[unseen, :3]
    first = np.asarray(bench.model.predict(bench.observations.inputs).reading)[unseen, :3]
    truth = np.array([recovered.wrenches[bench.observations.ids[i]][:3] for i in unseen])
    z = np.sqrt(np.mean((predicted - truth) ** 2 / variance))
    assert 0.2 < z < 1.5
    assert np.sqrt(np.mean((predicted - truth) ** 2)) < 0.3 * np.sqrt(np.mean((first - truth) ** 2))


def test_validation_cases_are_never_fitted(recovered: Recovered) -> None:
    """Spoiling every validation reading changes nothing in the fit."""
    bench = recovered.bench
    spoilt = bench.observations.wrench.copy()
    spoilt[bench.observations.where("validation")] += 5.0
    one = add_effects(bench.model, bench.observations, (), starts=1)
    two = add_effects(bench.model, replace(bench.observations, wrench=spoilt), (), starts=1)
    assert np.array_equal(one.fit.theta, two.fit.theta)


def test_intervals_hold_the_truth_where_loads_scatter_and_hangers_were_not_weighed(tmp_path: Path) -> None:
    """No file states the scatter: told of noise alone, an interval would be several times too narrow."""
    truth, _ = record(tmp_path, 7)
    misstate(tmp_path / "session.yaml", 7, scatter=0.02, hanger_g=12.0)
    bench = Session.open(tmp_path)
    fit = add(bench, "hanger_mass", starts=4).fit
    known = [p for p in fit.parameters if p.identified and p.sd and p.name in truth]
    z = np.array([(p.value - truth[p.name]) / (p.sd or np.inf) for p in known])
    assert len(z) > 40
    assert np.mean(np.abs(z) < 1.96) > 0.85
    hanger = fit.parameter("hanger_mass.m0")
    assert hanger.sd is not None
    assert hanger.value == pytest.approx(12.0, abs=3.0 * hanger.sd)
    assert fit.errors.scatter == pytest.approx(0.02, abs=0.007)
    assert "of each tension from case to case" in fit.message


def test_a_mistyped_mass_moves_no_parameter(recovered: Recovered) -> None:
    """The case is said to stand apart, and every value stays within half of what it is uncertain by."""
    bench = recovered.bench
    tension = np.asarray(bench.observations.inputs.tension)
    case = next(i for i in bench.observations.where("identification") if (tension[i] > 0.0).sum() == 1)
    tripled = np.where(np.arange(len(tension)) == case, 3.0, 1.0)[:, None]
    inputs = bench.observations.inputs._replace(tension=jnp.asarray(tension * tripled))
    fit = add_effects(bench.model, replace(bench.observations, inputs=inputs), (), starts=1).fit
    sound = add_effects(bench.model, bench.observations, (), starts=1).fit
    assert fit.errors.not_counted == (bench.observations.ids[case],)
    assert f"Not counted: {bench.observations.ids[case]}" in fit.message
    sd = np.sqrt(np.diag(sound.covariance))
    assert np.abs((fit.theta - sound.theta)[sd > 0.0] / sd[sd > 0.0]).max() < 0.5


def test_values_that_fit_as_well_widen_the_uncertainty(recovered: Recovered) -> None:
    """Several places fit this rig nearly as well; a single start would not know."""
    problem = stated_problem(recovered.bench.model, recovered.bench.observations)
    alone = refit_map(problem)
    assert len(recovered.fit.optima) > 1
    assert sum(share for _, share in recovered.fit.optima) == pytest.approx(1.0)
    assert np.trace(recovered.fit.covariance) > np.trace(alone.covariance)
    assert min(objective for objective, _ in recovered.fit.optima) <= alone.objective * (1 + 1e-9)
    assert recovered.fit.optima[0] == (recovered.fit.objective, max(share for _, share in recovered.fit.optima))
    assert "fit nearly as well" in recovered.fit.message


def test_what_was_not_loaded_is_called_unknown() -> None:
    """Without EDC cases the data say nothing about how the hood shares its tension."""
    bench = Session.open("synek2019_H01", catalogue=False)
    keep = ["EDC" not in m for m in bench.observations.masses_g]
    roles = tuple(r if k else "validation" for r, k in zip(bench.observations.roles, keep, strict=True))
    fit = refit_map(stated_problem(bench.model, replace(bench.observations, roles=roles)))
    assert not fit.parameter("fraction.EDC_ES").identified
    assert fit.parameter("fraction.RI_ES").identified
    assert "fraction.EDC_ES" in [p.name for p in fit.parameters if not p.identified]
    assert "say nothing about" in fit.message


def test_a_flat_direction_has_no_uncertainty_but_a_flag() -> None:
    """Eq 5 puts no prior on the fractions: without EDC cases its fraction is undetermined, not merely wide."""
    bench = Session.open("synek2019_H01", catalogue=False)
    roles = tuple(
        "validation" if "EDC" in m else r
        for r, m in zip(bench.observations.roles, bench.observations.masses_g, strict=True)
    )
    fit = refit_map(eq5_problem(bench.model, replace(bench.observations, roles=roles)))
    unknown = fit.parameter("fraction.EDC_ES")
    assert unknown.sd is None
    assert not unknown.identified
    assert fit.parameter("fraction.RI_ES").sd is not None


def test_two_parameters_that_act_alike_are_named_as_a_pair() -> None:
    """A common error of friction and the gain of the cell scale every tip force alike."""
    bench = Session.open("synek2019_HMEAN", catalogue=False)
    budget = replace(SYNEK2019, name="wide", tension_factor_common_sd=0.5, cell_gain_sd=0.5)
    model = Model(bench.model.finger, bench.model.layout, budget)
    fit = refit_map(stated_problem(model, bench.observations))
    pairs = {frozenset(pair[:2]) for pair in fit.correlated}
    gains = {frozenset(("tension_factor.common", f"cell_gain.{c}")) for c in ("Fx", "Fy")}
    assert pairs & (gains | {frozenset(("cell_gain.Fx", "cell_gain.Fy"))})
    assert "cannot be told apart" in fit.message


def test_a_parameter_at_its_bound_is_said_to_be() -> None:
    bench = Session.open("DEV-12", catalogue=False)
    fit = refit_map(stated_problem(bench.model, bench.observations))
    held = [p for p in fit.parameters if p.at_bound]
    assert held
    assert all(p.value in (0.0, 1.0) for p in held if p.name.startswith("fraction"))
    assert "at a bound" in fit.message


def test_our_solver_is_no_worse_than_slsqp_on_the_published_objective() -> None:
    for name in ("synek2019_HMEAN", "synek2019_H01"):
        bench = Session.open(name, catalogue=False)
        problem = eq5_problem(bench.model, bench.observations)
        published, ours = refit_slsqp(problem), refit_map(problem)
        assert published.outcome == ours.outcome == "converged"
        assert len(ours.parameters) == 56
        assert ours.objective <= published.objective * (1 + 1e-6)


def test_eq5_finds_the_published_points() -> None:
    """The identification run again ends at the published optimised model (same data, same objective)."""
    bench = Session.open("synek2019_HMEAN", catalogue=False)
    fit = refit_slsqp(eq5_problem(bench.model, bench.observations))
    published = Model(read_finger("synek2019_optimised"), bench.model.layout, bench.model.budget).initial
    points = bench.model.parameters.select("point.")
    assert np.max(np.abs(fit.theta - published)[points]) < 0.05
    assert np.max(np.abs(fit.theta - published)[bench.model.parameters.select("fraction.")]) < 0.002
