"""Parameter identification by maximum a posteriori: all parameters at once, with priors and bounds."""

from __future__ import annotations

import time
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from fingermodel.fingers import FingerValues
from fingermodel.fit_report import Fit, Optimum, Outcome, describe
from fingermodel.model import Structure, jax_values, predict_case
from fingermodel.problems import Problem, objective_at
from fingermodel.solver import CONVERGED, NOT_FINITE, STALLED, Solution, minimise
from fingermodel.stages import LoadCaseInput

Floats = NDArray[np.float64]


# Of the solver's further starts, so that a refit repeats to the last digit.
SEED = 20191107


def refit_map(problem: Problem, start: Floats | None = None, starts: int = 1) -> Fit:
    """Solve a problem by bounded Levenberg–Marquardt and describe its optimum.

    Args:
        problem: of `map_problem` or `eq5_problem`.
        start: (parameters,) instead of the priors' centre.
        starts: how many; those after the first are drawn from the priors. One finds an optimum, several find out
            whether there are others that fit as well.
    """
    began = time.perf_counter()
    optima, evaluations = [], 0
    for guess in [problem.start if start is None else start, *_drawn(problem, starts - 1)]:
        solution = solve(problem, guess)
        evaluations += int(solution.evaluations)
        optima.append(_optimum(problem, solution))
    seconds = time.perf_counter() - began
    before = objective_at(problem, problem.model.parameters.initial)
    return describe(problem, optima, "map", before, evaluations, seconds)


def _drawn(problem: Problem, count: int) -> list[Floats]:
    rng = np.random.default_rng(SEED)
    drawn = [problem.centre + rng.normal(size=len(problem.centre)) * problem.scale for _ in range(count)]
    return [np.where(problem.free, np.clip(x, problem.lower, problem.upper), problem.centre) for x in drawn]


def _optimum(problem: Problem, solution: Solution) -> Optimum:
    theta: Floats = problem.centre + problem.scale * np.asarray(solution.x)
    theta = np.where(problem.free, np.clip(theta, problem.lower, problem.upper), problem.centre)
    codes: dict[int, Outcome] = {CONVERGED: "converged", STALLED: "stalled", NOT_FINITE: "not_finite"}
    outcome = codes.get(int(solution.status), "too_many_evaluations")
    return Optimum(theta, np.asarray(solution.jacobian), float(solution.objective), outcome)


def solve(problem: Problem, start: Floats) -> Solution:
    """Run the compiled solver; the answer is in coordinates scaled about the priors' centre."""
    scale = problem.scale
    wrench = np.nan_to_num(problem.observations.wrench).reshape(-1)[problem.rows]
    # Only the cases that are fitted: validation cases would be differentiated for nothing.
    used, place = np.unique(problem.rows // 6, return_inverse=True)
    cases = jax.tree.map(lambda field: field[used], problem.observations.inputs)
    return _solve(
        problem.model.structure,
        jax_values(problem.model.finger.values),
        cases,
        jnp.asarray(6 * place + problem.rows % 6),
        jnp.asarray(wrench),
        jnp.asarray(problem.whitener),
        jnp.asarray(problem.centre),
        jnp.asarray(scale),
        jnp.asarray((start - problem.centre) / scale),
        jnp.asarray(problem.weight),
        jnp.asarray((problem.lower - problem.centre) / scale),
        jnp.asarray((problem.upper - problem.centre) / scale),
        jnp.asarray(problem.free),
    )


@partial(jax.jit, static_argnums=0)
def _solve(
    structure: Structure,
    values: FingerValues,
    cases: LoadCaseInput,
    rows: Array,
    wrench: Array,
    whitener: Array,
    centre: Array,
    scale: Array,
    start: Array,
    weight: Array,
    lower: Array,
    upper: Array,
    free: Array,
) -> Solution:
    def linearise(x: Array) -> tuple[Array, Array]:
        theta = centre + scale * x

        def one(case: LoadCaseInput) -> tuple[Array, Array]:
            # Reverse mode: six readings against a hundred parameters.
            def reading(t: Array) -> tuple[Array, Array]:
                value = predict_case(structure, values, t, case).reading
                return value, value

            jacobian, value = jax.jacrev(reading, has_aux=True)(theta)
            return value, jacobian

        value, jacobian = jax.vmap(one)(cases)
        size = theta.shape[0]
        residual = whitener @ (wrench - value.reshape(-1)[rows])
        return residual, -(whitener @ (jacobian.reshape(-1, size)[rows] * scale))

    zero = jnp.zeros_like(start)
    return minimise(linearise, start, zero, weight, lower, upper, free)
