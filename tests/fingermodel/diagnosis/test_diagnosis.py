"""The closed forms under a diagnosis: one-sided priors, confounding, and what a sensitivity analysis says."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import trapezoid
from scipy.stats import norm

from fingermodel.diagnosis.posterior.gaussian import Quadratic, log_mass
from fingermodel.diagnosis.session_model.candidates import Candidate, Candidates
from fingermodel.diagnosis.verdict.confounding import Confounding, confounding
from fingermodel.diagnosis.verdict.sensitivity import Assumption, Sensitivity
from fingermodel.fitting.roots import absorbed_by
from tests.settings import load_profile

load_profile()
Floats = NDArray[np.float64]


@given(st.floats(-3.0, 3.0), st.floats(0.2, 5.0))
def test_a_one_sided_prior_doubles_what_lies_on_its_side(mean: float, precision: float) -> None:
    value = log_mass(np.array([mean]), np.array([[1.0 / precision]]), np.array([True]))
    assert value == pytest.approx(np.log(2.0) + norm.logcdf(mean * np.sqrt(precision)), abs=1e-9)


def test_several_one_sided_priors_count_with_their_orthant() -> None:
    rng = np.random.default_rng(3)
    root = rng.normal(size=(3, 3)) + 2.0 * np.eye(3)
    covariance, mean = root @ root.T, np.array([1.0, -0.5, 2.0])
    draws = mean + rng.normal(size=(400_000, 3)) @ root.T
    expected = np.log(8.0 * np.mean(np.all(draws > 0.0, axis=1)))
    value = log_mass(mean, covariance, np.array([True] * 3))
    assert value == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("pull", [1.0, 40.0])
@pytest.mark.parametrize("correlation", [-0.9, 0.0, 0.9])
@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
def test_what_is_held_at_its_null_counts_however_hard_it_is_pulled(
    pull: float, correlation: float, order: list[int]
) -> None:
    """One at its null, whose mean lies far beyond it, and one that stands half a width from its own."""
    covariance = np.array([[1.0, correlation], [correlation, 1.0]])
    mean = np.array([0.0, 0.5]) - pull * covariance[:, 0]
    # Exact by one integral: the second's mass where it is positive, given the first.
    a = np.linspace(0.0, 20.0 / pull, 20_001)
    spread = np.sqrt(1.0 - correlation**2)
    given_a = mean[1] + correlation * (a - mean[0])
    logs = norm.logpdf(a, mean[0]) + norm.logcdf(given_a / spread)
    expected = logs.max() + np.log(trapezoid(np.exp(logs - logs.max()), a)) + 2.0 * np.log(2.0)
    value = log_mass(mean[order], covariance[np.ix_(order, order)], np.array([True, True]))
    assert value == pytest.approx(expected, abs=0.01)


def compared(slopes: Floats, absorbed: Floats) -> Confounding:
    """Candidates of one parameter each against each other, what the base absorbs left open."""
    effects = slopes.shape[1]
    left = Quadratic.beside(absorbed_by(absorbed)[0], np.zeros(len(slopes)), slopes, 0.0)
    optimum: Any = SimpleNamespace(
        hyper=SimpleNamespace(without_smooth=lambda node: node),
        best=(0,),
        effects_at=lambda _: (left, np.arange(10, 10 + effects)),
    )
    listed = Candidates(tuple(Candidate(f"e{k}", f"e{k}", ((10 + k,),), 1.0) for k in range(effects)))
    return confounding(cast("Any", optimum), listed)


def test_effects_that_do_the_same_are_one_class() -> None:
    rng = np.random.default_rng(5)
    slopes = 5.0 * rng.normal(size=(30, 3))
    slopes[:, 1] = 2.0 * slopes[:, 0]
    same = compared(slopes, rng.normal(size=(30, 6)))
    assert same.correlation[0, 1] == pytest.approx(1.0, abs=1e-6)
    assert same.classes == (("e0", "e1"),)
    assert same.alike("e0") == ("e1",)
    assert same.alike("e2") == same.alike("else") == ()


def test_what_the_base_absorbs_cannot_be_detected() -> None:
    rng = np.random.default_rng(6)
    absorbed, slopes = 1e4 * rng.normal(size=(30, 6)), rng.normal(size=(30, 2))
    slopes[:, 0] = 1e-4 * absorbed[:, 0]
    shown = compared(slopes, absorbed)
    assert shown.detectability["e0"] < 0.01
    assert shown.detectability["e1"] > 1.0


def test_a_sensitivity_analysis_says_what_would_make_it_less_probable_than_not() -> None:
    tried = (
        Assumption("prior", "the prior of nothing is 0.8", 0.7),
        Assumption("budget", "the budget is 4 times as large", 0.3),
        Assumption("without", "without posture hook", 0.2),
        Assumption("without", "without FDP", 0.95),
    )
    found = Sensitivity(tried, 2.0, "undecided")
    assert found.flips_when == ("the budget is 4 times as large",)
    assert found.rests_on == ("without posture hook",)
    body = found.as_dict()
    assert [a["probability"] for a in body["assumptions"]] == [0.7, 0.3, 0.2, 0.95]
    assert body["assumptions"][0].keys() == {"group", "words", "probability"}
    assert (body["budget_multiple_at_which_it_fails"], body["sagittal_alone"]) == (2.0, "undecided")
