"""The closed forms under a diagnosis: evidence, one-sided priors, wildcard, confounding."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from fingermodel.diagnosis.calibration import calibrate
from fingermodel.diagnosis.candidates import Candidate, Explanation, log_prior, log_prior_else, pairs_of, single
from fingermodel.diagnosis.evidence import estimates_at, estimates_of
from fingermodel.diagnosis.linear import Linear, log_mass
from fingermodel.diagnosis.robustness import left_out
from fingermodel.diagnosis.wildcard import FORM_ERRORS, Wildcard
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import trapezoid
from scipy.stats import multivariate_normal, norm

from fingermodel.diagnosis.confounding import confounding
from tests.fingermodel.explained import candidates, straight
from tests.settings import load_profile

load_profile()
Floats = NDArray[np.float64]


def about(linear: Linear, x: Floats) -> Linear:
    """The same, straightened out about another point (parameters,)."""
    return replace(linear, residual=linear.residual - linear.h @ x, x=x)


def log_density(linear: Linear, columns: list[int]) -> float:
    """ln N(y; 0, 1 + HHᵀ) over some columns, without the constant."""
    h, n = linear.h[:, columns], len(linear.residual)
    value = multivariate_normal(np.zeros(n), np.eye(n) + h @ h.T).logpdf(linear.residual)
    return float(value + 0.5 * n * np.log(2.0 * np.pi))


@given(st.integers(0, 10_000), st.sets(st.integers(6, 10), min_size=1, max_size=4))
def test_the_gain_is_the_ratio_of_exact_evidences(seed: int, freed: set[int]) -> None:
    linear, base = straight(seed), list(range(6))
    expected = log_density(linear, [*base, *freed]) - log_density(linear, base)
    assert linear.log_evidence_base == pytest.approx(log_density(linear, base), abs=1e-7)
    assert linear.gain(sorted(freed)) == pytest.approx(expected, abs=1e-7)


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


@given(st.integers(0, 10_000))
def test_the_wildcard_is_the_density_of_its_covariance(seed: int) -> None:
    linear = straight(seed)
    columns = np.random.default_rng(seed + 1).normal(size=(30, 8))
    wildcard = Wildcard.of(columns, np.array([0.0, 0.3, 2.0]))
    free, scale = np.arange(6), np.full(6, 1.5)
    h = linear.h[:, free] * scale
    for amplitude, value in zip(wildcard.amplitudes, wildcard.profile(linear, free, scale), strict=True):
        covariance = np.eye(30) + h @ h.T + amplitude**2 * columns @ columns.T
        expected = multivariate_normal(np.zeros(30), covariance).logpdf(linear.residual) + 15.0 * np.log(2.0 * np.pi)
        assert value == pytest.approx(expected, abs=1e-6)


@given(st.integers(0, 10_000))
def test_a_straight_line_is_the_same_about_any_of_its_points(seed: int) -> None:
    linear = straight(seed, one_sided=(7,))
    x = np.random.default_rng(seed + 1).normal(size=11) * 5.0
    x[8:] = 0.0
    moved, free = about(linear, x), np.arange(8)
    wildcard = Wildcard.of(np.random.default_rng(seed + 2).normal(size=(30, 8)), np.array([0.0, 0.3, 2.0]))
    assert moved.log_evidence_base == pytest.approx(linear.log_evidence_base, abs=1e-7)
    assert moved.gain([6, 9]) == pytest.approx(linear.gain([6, 9]), abs=1e-7)
    assert moved.mean([7])[1] == pytest.approx(linear.mean([7])[1], abs=1e-9)
    assert moved.unexplained == pytest.approx(linear.unexplained, abs=1e-9)
    width = np.linspace(1.0, 2.0, 8)
    assert wildcard.profile(moved, free, width) == pytest.approx(wildcard.profile(linear, free, width), abs=1e-7)
    for one, other in zip(
        estimates_of(moved, free, width, wildcard, 0.3), estimates_of(linear, free, width, wildcard, 0.3), strict=True
    ):
        assert one == pytest.approx(other, abs=1e-8)


def test_slopes_almost_without_bound_leave_no_misfit_below_none() -> None:
    """Near a posture that transmits no force a tendon's point moves readings by 10⁶ uncertainties a prior width."""
    linear, free = straight(3), np.arange(6)
    wildcard = Wildcard.of(np.random.default_rng(4).normal(size=(30, 8)), np.array([0.0, 0.1]))
    x = np.zeros(11)
    x[:6] = 4.0
    misfits = []
    for steep in (1e4, 1e6):
        h = linear.h.copy()
        h[:, 0] *= steep
        h[:, 1] = h[:, 0] * 1.001 + linear.h[:, 1]
        misfits.append(estimates_of(replace(linear, h=h, x=x), free, np.ones(6), wildcard, 0.1)[0])
    assert misfits[1] > 0.0
    assert misfits[1] == pytest.approx(misfits[0], rel=1e-3)


def test_the_prior_is_a_probability() -> None:
    many = (
        *candidates(3),
        Candidate("p.a", "p", ((9,),), 0.5, False),
        Candidate("p.b", "p", ((10,),), 0.5, False),
    )
    alone = [single(c, 0) for c in many]
    two = [Explanation((a.name, b.name), (a.effect, b.effect), (), (0, 0)) for a, b in pairs_of(many)]
    mass = sum(np.exp(log_prior(e, many)) for e in [Explanation((), (), ()), *alone, *two]) + np.exp(log_prior_else())
    assert mass == pytest.approx(1.0, abs=0.12)
    assert log_prior(Explanation((), (), ()), many) == pytest.approx(np.log(0.5))


def test_effects_that_do_the_same_are_one_class() -> None:
    linear = straight(5, effects=3)
    h = linear.h.copy()
    h[:, 7] = 2.0 * h[:, 6]
    same = confounding(replace(linear, h=5.0 * h), candidates(3))
    assert same.correlation[0, 1] == pytest.approx(1.0, abs=1e-6)
    assert same.classes == (("e0", "e1"),)
    assert same.alike("e0") == ("e1",)


def test_what_the_base_absorbs_cannot_be_detected() -> None:
    linear = straight(6, effects=2)
    h = linear.h.copy()
    h[:, :6] *= 1e4
    h[:, 6] = h[:, 0] * 1e-4
    shown = confounding(replace(linear, h=h), candidates(2))
    assert shown.detectability["e0"] < 0.01
    assert shown.detectability["e1"] > 1.0


def test_stated_probabilities_come_true_on_simulated_sessions() -> None:
    linear = straight(7, readings=60, effects=6, one_sided=(8, 9))
    found = calibrate(replace(linear, h=3.0 * linear.h), candidates(6), draws=600)
    assert found.false_finding_rate <= 0.02
    assert found.right is not None
    assert found.right >= 0.95
    for stated, came_true, count in found.reliability:
        assert abs(stated - came_true) <= 3.0 * np.sqrt(stated * (1.0 - stated) / count) + 0.05


def test_only_a_mounts_readings_are_a_whole_mount() -> None:
    held = SimpleNamespace(
        postures=("hook", "hook", "straight", "straight"),
        masses_g=({"FDS": 500.0}, {"FDP": 500.0}) * 2,
        locations=("tip", "bone") * 2,
    )
    problem = cast("Any", SimpleNamespace(rows=np.arange(24), observations=held))
    parts = {words: (rows.sum(), mount) for words, rows, mount in left_out(problem)}
    assert {words for words, (_, mount) in parts.items() if mount} == {"the tip readings", "the bone readings"}
    assert {"posture hook", "posture straight", "tendon FDS", "tendon FDP"} < set(parts)
    assert all(count == 12 for count, _ in parts.values())


def test_values_are_less_sure_where_the_form_may_be_otherwise_and_the_base_is_bent_less() -> None:
    rng = np.random.default_rng(3)
    h = rng.normal(size=(60, 3))
    # The form is off along what the base's second parameter does.
    root = h[:, [1]] * 4.0
    x = np.array([0.3, 5.0, 2.0])
    fitted = SimpleNamespace(
        x=x,
        inner=np.arange(3),
        objective=np.inf,
        explanation=Explanation(("e",), ("e",), (2,)),
        linear=Linear(h @ x, h, np.arange(2), np.zeros(3, dtype=bool), np.zeros(3)),
    )
    form = Wildcard(root, FORM_ERRORS)
    misfit, plain, plain_sd = estimates_at(cast("Any", fitted), form, 1.0, 0.0)
    less, allowing, sd = estimates_at(cast("Any", fitted), form, 1.0, 0.2)
    assert plain == pytest.approx(x, rel=0.1)
    assert (sd >= plain_sd).all()
    assert 0.0 < less < misfit
    assert abs(allowing[1]) < 0.7 * abs(plain[1])
