"""Gaussian weights: closed forms against dense algebra, and whatever a covariance may be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import multivariate_normal

from fingermodel.diagnosis.posterior.gaussian import Quadratic, log_mass, log_mass_apart, screened
from fingermodel.fitting.roots import absorbed_by, root_of

Floats = NDArray[np.float64]
SEEDS = st.integers(0, 10**6)


def problem(seed: int, n: int = 12, k: int = 7) -> tuple[Floats, Floats, Floats, Floats]:
    """Readings less the model at a point, columns, that point, and widths."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=n) * 3.0, rng.normal(size=(n, k)), rng.normal(size=k), rng.uniform(0.1, 3.0, k)


def quadratic(residual: Floats, columns: Floats) -> Quadratic:
    return Quadratic(float(residual @ residual), columns.T @ residual, columns.T @ columns, 0.0)


def dense(residual: Floats, columns: Floats, x: Floats, width: Floats) -> tuple[float, float, Floats, Floats]:
    """Misfit, ln det, and posterior of the weights by the textbook."""
    y = residual + columns @ x
    covariance = np.eye(len(y)) + (columns * width**2) @ columns.T
    gain = (columns * width**2).T @ np.linalg.inv(covariance)
    posterior = np.diag(width**2) - gain @ columns * width**2
    return float(y @ np.linalg.solve(covariance, y)), float(np.linalg.slogdet(covariance)[1]), gain @ y, posterior


@given(SEEDS)
@settings(max_examples=40, deadline=None)
def test_freed_weights_are_the_textbook_posterior(seed: int) -> None:
    residual, columns, x, width = problem(seed)
    freed = quadratic(residual, columns).freed(width, x, len(x))
    misfit, log_det, mean, covariance = dense(residual, columns, x, width)
    assert freed.misfit == pytest.approx(misfit)
    assert freed.log_det == pytest.approx(log_det)
    np.testing.assert_allclose(freed.mean, mean, atol=1e-9)
    np.testing.assert_allclose(freed.covariance, covariance, atol=1e-9)


@given(SEEDS, st.integers(1, 5))
@settings(max_examples=40, deadline=None)
def test_eliminating_some_first_changes_nothing(seed: int, first: int) -> None:
    residual, columns, x, width = problem(seed)
    whole = quadratic(residual, columns).freed(width, x, len(x))
    across, log_det = absorbed_by(columns[:, :first] * width[:first])
    left = residual + columns[:, :first] @ x[:first]
    rest = Quadratic.beside(across, left, columns[:, first:], log_det)
    later = rest.freed(width[first:], x[first:], len(x) - first)
    assert later.misfit == pytest.approx(whole.misfit)
    assert later.log_det == pytest.approx(whole.log_det)
    np.testing.assert_allclose(later.mean, whole.mean[first:], atol=1e-8)


@given(SEEDS)
@settings(max_examples=20, deadline=None)
def test_a_weight_of_no_width_stays_where_it_is(seed: int) -> None:
    residual, columns, x, width = problem(seed)
    width[2] = 0.0
    held = quadratic(residual, columns).freed(width, x, 0)
    without = np.delete(np.arange(len(x)), 2)
    other = quadratic(residual, columns[:, without]).freed(width[without], x[without], 0)
    assert held.misfit == pytest.approx(other.misfit)
    assert held.log_det == pytest.approx(other.log_det)


@given(SEEDS)
@settings(max_examples=20, deadline=None)
def test_screening_is_what_freeing_each_set_would_give(seed: int) -> None:
    residual, columns, x, _ = problem(seed)
    sets = [(), (0,), (1, 4), (2, 3, 6)]
    one_sided = np.zeros(len(x), dtype=bool)
    one_sided[4] = True
    values = screened(quadratic(residual, columns), sets, x, one_sided)
    for chosen, value in zip(sets, values, strict=True):
        index = list(chosen)
        y = residual + columns @ x
        freed = quadratic(y, columns[:, index]).freed(np.ones(len(index)), np.zeros(len(index)), len(index))
        mass = log_mass_apart(freed.mean, freed.covariance, one_sided[index]) if index else 0.0
        assert value == pytest.approx(freed.log_evidence + mass, abs=1e-8)


@given(SEEDS, st.integers(1, 6), st.floats(0.0, 1e-12))
@settings(max_examples=60, deadline=None)
def test_any_positive_semidefinite_covariance_has_a_root(seed: int, rank: int, rounding: float) -> None:
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(8, rank)) * 10.0 ** rng.uniform(-8, 8)
    covariance = columns @ columns.T
    # What rounding does to it: not quite symmetric, and a little negative somewhere.
    covariance = covariance + rounding * np.abs(covariance).max() * rng.normal(size=covariance.shape)
    root = root_of(covariance)
    scale = max(float(np.abs(covariance).max()), 1e-300)
    np.testing.assert_allclose(root @ root.T / scale, 0.5 * (covariance + covariance.T) / scale, atol=1e-6)


def test_no_covariance_at_all_has_a_root_too() -> None:
    assert np.isfinite(root_of(np.zeros((3, 3)))).all()
    assert np.abs(root_of(np.zeros((3, 3)))).max() < 1e-100


@given(SEEDS)
@settings(max_examples=30, deadline=None)
def test_columns_that_are_alike_or_nothing_do_no_harm(seed: int) -> None:
    residual, columns, x, width = problem(seed)
    columns[:, 1] = columns[:, 0] * 1e8
    columns[:, 2] = 0.0
    freed = quadratic(residual, columns).freed(width, x, len(x))
    assert np.isfinite([freed.misfit, freed.log_det, freed.log_evidence]).all()
    # What no reading sees keeps its prior.
    assert freed.mean[2] == pytest.approx(0.0, abs=1e-9)
    assert freed.covariance[2, 2] == pytest.approx(width[2] ** 2)


@given(SEEDS)
@settings(max_examples=10, deadline=None)
def test_the_mass_on_one_side_is_that_of_the_gaussian(seed: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3))
    covariance, mean = root @ root.T + 0.1 * np.eye(3), rng.normal(size=3)
    exact = multivariate_normal(-mean, covariance).cdf(np.zeros(3))
    found = log_mass(mean, covariance, np.ones(3, dtype=bool))
    assert found == pytest.approx(3.0 * np.log(2.0) + np.log(exact), abs=0.05)
