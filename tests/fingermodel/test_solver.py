"""The bounded solver against SciPy, at bounds, without data, and when the model is not finite."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.optimize import least_squares

from fingermodel.solver import CONVERGED, NOT_FINITE, Solution, minimise


def _solve(seed: int, reach: float, bend: float = 0.3) -> tuple[Solution, float]:
    """Our optimum and SciPy's best of several starts for a mildly nonlinear problem in a box."""
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(12, 5)), rng.normal(size=12) * 2

    def residual(x: jax.Array) -> jax.Array:
        return jnp.asarray(a) @ (x + bend * jnp.tanh(x) ** 2) - jnp.asarray(b)

    weight = np.full(5, 0.1)
    lower, upper = np.full(5, -reach), np.full(5, reach)
    ours = minimise(
        lambda x: (residual(x), jax.jacobian(residual)(x)),
        jnp.zeros(5),
        jnp.zeros(5),
        jnp.asarray(weight),
        jnp.asarray(lower),
        jnp.asarray(upper),
        jnp.ones(5, bool),
    )

    def both(x: np.ndarray) -> np.ndarray:
        return np.concatenate([a @ (x + bend * np.tanh(x) ** 2) - b, np.sqrt(weight) * x])

    starts = [np.zeros(5), *rng.uniform(-0.9, 0.9, (4, 5)) * reach]
    costs = [least_squares(both, s, bounds=(lower, upper), xtol=1e-14, ftol=1e-14, gtol=1e-14).cost for s in starts]
    return ours, 2 * min(costs)


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), reach=st.sampled_from([0.2, 0.7, 5.0]))
def test_no_worse_than_scipy_within_bounds(seed: int, reach: float) -> None:
    ours, best = _solve(seed, reach)
    assert int(ours.status) == CONVERGED
    assert np.all(np.abs(np.asarray(ours.x)) <= reach)
    assert float(ours.objective) <= best * (1 + 1e-6) + 1e-9


def test_a_linear_problem_is_solved_exactly() -> None:
    ours, best = _solve(1, 100.0, bend=0.0)
    assert float(ours.objective) == pytest.approx(best, rel=1e-10)


def test_fixed_parameters_stay_and_undetermined_ones_do_not_wander() -> None:
    matrix = jnp.array([[1.0, 0.0, 0.0]])
    answer = minimise(
        lambda x: (matrix @ x - 2.0, matrix),
        jnp.array([0.0, 0.5, 0.25]),
        jnp.zeros(3),
        jnp.zeros(3),
        jnp.full(3, -10.0),
        jnp.full(3, 10.0),
        jnp.array([True, True, False]),
    )
    assert int(answer.status) == CONVERGED
    assert_allclose(np.asarray(answer.x), [2.0, 0.5, 0.25], atol=1e-6)


def test_a_model_that_is_not_finite_is_said_to_be() -> None:
    answer = minimise(
        lambda x: (x * jnp.nan, jnp.eye(2)),
        jnp.zeros(2),
        jnp.zeros(2),
        jnp.ones(2),
        jnp.full(2, -1.0),
        jnp.full(2, 1.0),
        jnp.ones(2, bool),
    )
    assert int(answer.status) == NOT_FINITE
