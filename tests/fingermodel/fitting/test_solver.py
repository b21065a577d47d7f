"""The bounded solver against SciPy, at bounds, without data, and when the model is not finite."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.optimize import least_squares, lsq_linear

from fingermodel.fitting.solver import CONVERGED, NOT_FINITE, STALLED, Solution, minimise


def _solve(seed: int, reach: float, bend: float = 0.3) -> tuple[Solution, float]:
    """Our optimum and SciPy's best of several starts for a mildly nonlinear problem in a box."""
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(12, 5)), rng.normal(size=12) * 2

    def residual(x: np.ndarray) -> np.ndarray:
        return a @ (x + bend * np.tanh(x) ** 2) - b

    def slopes(x: np.ndarray) -> np.ndarray:
        return a * (1.0 + 2.0 * bend * np.tanh(x) / np.cosh(x) ** 2)

    weight = np.full(5, 0.1)
    lower, upper = np.full(5, -reach), np.full(5, reach)
    ours = minimise(
        residual,
        slopes,
        np.zeros(5),
        np.zeros(5),
        weight,
        lower,
        upper,
        np.ones(5, bool),
    )

    def both(x: np.ndarray) -> np.ndarray:
        return np.concatenate([residual(x), np.sqrt(weight) * x])

    starts = [np.zeros(5), *rng.uniform(-0.9, 0.9, (4, 5)) * reach]
    costs = [least_squares(both, s, bounds=(lower, upper), xtol=1e-14, ftol=1e-14, gtol=1e-14).cost for s in starts]
    return ours, 2 * min(costs)


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), reach=st.sampled_from([0.2, 0.7, 5.0]))
def test_no_worse_than_scipy_within_bounds(seed: int, reach: float) -> None:
    ours, best = _solve(seed, reach)
    assert ours.status == CONVERGED
    assert np.all(np.abs(ours.x) <= reach)
    assert ours.objective <= best * (1 + 1e-6) + 1e-9


def test_a_linear_problem_is_solved_exactly() -> None:
    ours, best = _solve(1, 100.0, bend=0.0)
    assert ours.objective == pytest.approx(best, rel=1e-10)


def test_fixed_parameters_stay_and_undetermined_ones_do_not_wander() -> None:
    matrix = np.array([[1.0, 0.0, 0.0]])
    answer = minimise(
        lambda x: matrix @ x - 2.0,
        lambda _: matrix[:, :2],
        np.array([0.0, 0.5, 0.25]),
        np.zeros(3),
        np.zeros(3),
        np.full(3, -10.0),
        np.full(3, 10.0),
        np.array([True, True, False]),
    )
    assert answer.status == CONVERGED
    assert_allclose(answer.x, [2.0, 0.5, 0.25], atol=1e-6)


@pytest.mark.parametrize("first", [1, 2, 5])
def test_a_fit_that_goes_on_is_the_one_that_was_not_interrupted(first: int) -> None:
    """Ended after a step that failed or one that did not, and without an evaluation more."""
    calls: list[float] = []

    def residual(x: np.ndarray) -> np.ndarray:
        calls.append(float(x[0]))
        return np.array([np.arctan(5.0 * x[0]), 0.1 * x[1] + x[0] ** 2])

    def slopes(x: np.ndarray) -> np.ndarray:
        return np.array([[5.0 / (1.0 + 25.0 * x[0] ** 2), 0.0], [2.0 * x[0], 0.1]])

    start, none, far, free = np.array([3.0, 1.0]), np.zeros(2), np.full(2, 99.0), np.ones(2, bool)
    whole = minimise(residual, slopes, start, none, none, -far, far, free)
    tried = calls.copy()
    calls.clear()
    begun = minimise(residual, slopes, start, none, none, -far, far, free, max_evaluations=first)
    rest = minimise(residual, slopes, begun.x, none, none, -far, far, free, begun=begun)
    assert whole.evaluations > 7
    assert calls == tried
    assert begun.evaluations + rest.evaluations == whole.evaluations
    np.testing.assert_array_equal(rest.x, whole.x)
    assert rest.status == whole.status == CONVERGED


def test_there_is_nothing_to_go_on_from_where_the_model_is_not_finite() -> None:
    none, one = np.zeros(2), np.ones(2)
    begun = _in_unit_box(lambda x: x + np.nan, np.eye(2))
    free = np.ones(2, bool)
    answer = minimise(lambda x: x - 0.5, lambda _: np.eye(2), none, none, none, -one, one, free, begun=begun)
    assert answer.status == CONVERGED
    assert_allclose(answer.x, 0.5)


def _in_unit_box(residual: Callable[[np.ndarray], np.ndarray], slopes: np.ndarray) -> Solution:
    """Minimise over two parameters between -1 and 1, with slopes that are everywhere the same."""
    none, one = np.zeros(2), np.ones(2)
    return minimise(residual, lambda _: slopes, none, none, one, -one, one, np.ones(2, bool))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_model_that_is_not_finite_is_said_to_be(value: float) -> None:
    answer = _in_unit_box(lambda x: x + value, np.eye(2))
    assert answer.status == NOT_FINITE
    assert not answer.jacobian.any()


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_slopes_that_are_not_finite_lead_nowhere_and_end(value: float) -> None:
    answer = _in_unit_box(lambda x: x - 1.0, np.full((2, 2), value))
    assert answer.status == STALLED
    assert answer.objective == 2.0
    assert_allclose(answer.x, 0.0)


def test_slopes_are_asked_for_only_where_a_step_led_to_something_better() -> None:
    """They take ten times as long as the residuals."""
    at: list[float] = []
    tried: list[float] = []

    def residual(x: np.ndarray) -> np.ndarray:
        tried.append(float(x[0]))
        return np.array([np.arctan(5.0 * x[0])])

    def slopes(x: np.ndarray) -> np.ndarray:
        at.append(float(x[0]))
        return np.array([[5.0 / (1.0 + 25.0 * x[0] ** 2)]])

    start = np.array([3.0])
    none = np.zeros(1)
    answer = minimise(residual, slopes, start, none, none, np.array([-99.0]), np.array([99.0]), np.ones(1, bool))
    assert answer.status == CONVERGED
    assert answer.evaluations == len(tried)
    sizes = np.abs(np.arctan(5.0 * np.array(at)))
    assert np.all(np.diff(sizes) < 0.0)
    assert len(at) < len(tried)


@pytest.mark.parametrize(("depth", "may_be_left"), [(100.0, True), (3.0, True), (1.2, False)])
def test_a_fit_that_is_off_and_crawls_is_left_only_if_that_is_asked_for(depth: float, may_be_left: bool) -> None:
    """A valley whose floor goes down ever more slowly, above anything that noise would leave, or near it."""

    def residual(x: np.ndarray) -> np.ndarray:
        return np.array([depth + np.exp(-x[0])])

    def slopes(x: np.ndarray) -> np.ndarray:
        return np.array([[-np.exp(-x[0])]])

    none = np.zeros(1)
    whole, asked = (
        minimise(
            residual,
            slopes,
            np.array([-2.0]),
            none,
            none,
            np.array([-99.0]),
            np.array([99.0]),
            np.ones(1, bool),
            tolerance=0.0,
            crawl=crawl,
        )
        for crawl in (0.0, 3e-3)
    )
    if may_be_left:
        assert asked.status == STALLED
        assert whole.evaluations > asked.evaluations
        assert whole.objective < asked.objective < whole.objective * 1.01
    else:
        assert asked.evaluations == whole.evaluations


def test_where_much_is_left_what_steps_have_taught_saves_further_ones() -> None:
    """Brown and Dennis' function, whose least value is 85822.2 (Moré, Garbow and Hillstrom 1981, problem 16)."""
    t = 0.2 * np.arange(1, 21)

    def parts(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return x[0] + t * x[1] - np.exp(t), x[2] + x[3] * np.sin(t) - np.cos(t)

    def residual(x: np.ndarray) -> np.ndarray:
        a, b = parts(x)
        return np.asarray(a**2 + b**2)

    def slopes(x: np.ndarray) -> np.ndarray:
        a, b = parts(x)
        return 2.0 * np.stack([a, a * t, b, b * np.sin(t)], axis=1)

    start, none, far = np.array([25.0, 5.0, -5.0, -1.0]), np.zeros(4), np.full(4, np.inf)
    taught, untaught = (
        minimise(residual, slopes, start, none, none, -far, far, np.ones(4, bool), bends=bends)
        for bends in (True, False)
    )
    for answer in (taught, untaught):
        assert answer.status == CONVERGED
        assert answer.objective == pytest.approx(85822.2, abs=0.05)
    assert taught.evaluations < 0.75 * untaught.evaluations


def test_no_step_is_taken_to_where_slopes_have_no_bound() -> None:
    def slopes(x: np.ndarray) -> np.ndarray:
        return np.array([[-1.0 if x[0] < 3.0 else -1e9]])

    def end(**more: float) -> Solution:
        one = np.ones(1)
        return minimise(
            lambda x: np.array([5.0 - x[0]]), slopes, 0.0 * one, 0.0 * one, 0.0 * one, -9.0 * one, 9.0 * one, one > 0.0,
            **more,  # type: ignore[arg-type]
        )  # fmt: skip

    assert end().x[0] > 3.0
    kept = end(steepest=1e6)
    assert 2.9 < kept.x[0] <= 3.0
    assert np.abs(kept.jacobian).max() == 1.0


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), alike=st.sampled_from([1e-1, 1e-2, 1e-3]))
def test_a_step_that_meets_a_bound_keeps_its_balance(seed: int, alike: float) -> None:
    # Columns that are nearly the same balance each other: to cut one off at its bound alone would lead uphill.
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(30, 1)) + alike * rng.normal(size=(30, 8))
    measured = columns @ rng.normal(size=8) + 0.01 * rng.normal(size=30)
    weight, lower, upper = np.full(8, 1e-3), np.full(8, -0.5), np.full(8, 0.5)

    def minimised(evaluations: int) -> Solution:
        return minimise(
            lambda x: columns @ x - measured,
            lambda _: columns,
            np.zeros(8),
            np.zeros(8),
            weight,
            lower,
            upper,
            np.ones(8, bool),
            max_evaluations=evaluations,
        )

    stacked = np.concatenate([columns, np.diag(np.sqrt(weight))])
    best = lsq_linear(stacked, np.concatenate([measured, np.zeros(8)]), (lower, upper), method="bvls", tol=1e-14)
    ours = minimised(40)
    assert ours.objective <= 2.0 * best.cost * (1.0 + 1e-6)
    # What the linearised problem promises is there, and nothing is left in the end.
    assert ours.decrement <= 1e-6 * ours.objective
    early = minimised(2)
    assert early.decrement <= early.objective - 2.0 * best.cost + 1e-9
