"""Parameter identification by maximum a posteriori: all parameters at once, with priors and bounds."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from fingermodel.compiled.programs import stored
from fingermodel.fingers import FingerValues
from fingermodel.fitting.fit_report import Fit, Optimum, Outcome, describe
from fingermodel.fitting.problems import Differentiated, Problem, objective_at
from fingermodel.fitting.reading_errors import AS_STATED, ReadingErrors
from fingermodel.fitting.solver import CONVERGED, NOT_FINITE, STALLED, Solution, minimise
from fingermodel.model import predict_batch, predict_parts
from fingermodel.stages import LoadCaseInput
from fingermodel.structure import Structure

Floats = NDArray[np.float64]


# Of the solver's further starts, so that a refit repeats to the last digit.
SEED = 20191107


def refit_map(
    problem: Problem,
    start: Floats | None = None,
    starts: int = 1,
    progress: Callable[[float], None] | None = None,
    *,
    also: Sequence[Floats] = (),
    errors: ReadingErrors = AS_STATED,
) -> Fit:
    """Solve a problem by bounded Levenberg–Marquardt and describe its optimum.

    Args:
        problem: of `refit_problem` or `eq5_problem`.
        start: (parameters,) instead of the priors' centre.
        starts: how many; those after the first are drawn from the priors. One finds an optimum, several find out
            whether there are others that fit as well.
        progress: called with the fraction of the starts that are done.
        also: further starts, each (parameters,).
        errors: of the readings that the problem counts with, to be told.
    """
    began = time.perf_counter()
    optima, evaluations = [], 0
    guesses = [problem.start if start is None else start, *also, *drawn_starts(problem, starts - 1)]
    for guess in guesses:
        solution = solve(problem, guess)
        evaluations += int(solution.evaluations)
        optima.append(_optimum(problem, solution))
        if progress is not None:
            progress(len(optima) / len(guesses))
    seconds = time.perf_counter() - began
    before = objective_at(problem, problem.model.parameters.initial)
    return describe(problem, optima, "map", before, evaluations, seconds, errors)


def drawn_starts(problem: Problem, count: int) -> list[Floats]:
    """Draw further starts (parameters,) from the priors, within the bounds; always the same ones."""
    rng = np.random.default_rng(SEED)
    drawn = [problem.centre + rng.normal(size=len(problem.centre)) * problem.scale for _ in range(count)]
    return [np.where(problem.free, np.clip(x, problem.lower, problem.upper), problem.centre) for x in drawn]


def _optimum(problem: Problem, solution: Solution) -> Optimum:
    theta: Floats = problem.centre + problem.scale * np.asarray(solution.x)
    theta = np.where(problem.free, np.clip(theta, problem.lower, problem.upper), problem.centre)
    codes: dict[int, Outcome] = {CONVERGED: "converged", STALLED: "stalled", NOT_FINITE: "not_finite"}
    outcome = codes.get(int(solution.status), "too_many_evaluations")
    return Optimum(theta, np.asarray(solution.jacobian), float(solution.objective), outcome)


# A ten-thousandth of a unit of chi-square is nothing to anybody.
FLOOR = 1e-4
EVALUATIONS = 400
# Standard uncertainties that a prior width may change a reading by. In a posture that transmits no force there is no
# bound to it, and whatever the misfit there, that is no optimum.
STEEPEST = 1e6


def solve(
    problem: Problem,
    start: Floats,
    floor: float = FLOOR,
    evaluations: int = EVALUATIONS,
    *,
    crawl: float = 0.0,
    bends: bool = True,
    begun: Solution | None = None,
) -> Solution:
    """Minimise a problem; the answer is in coordinates scaled about the priors' centre.

    Args:
        problem: to solve.
        start: (parameters,).
        floor: units of chi-square that a further step must promise; Eq 5 has no such unit and goes on to rounding.
        evaluations: at most so many.
        crawl: of `minimise`, for fits that only have to show that they are not in question.
        bends: of `minimise`.
        begun: of `minimise`: an earlier answer for this problem, to go on from.
    """
    scale, centre, fitted, model = problem.scale, problem.centre, problem.fitted_readings, problem.model
    active, white = _active(problem), problem.whitener
    _begin_to_compile(problem, active)

    def residuals(x: Floats) -> Floats:
        # Of all cases, fitted or not: whoever compares them wants the same.
        reading = model.predict(fitted.every_case, centre + scale * x, active).reading
        return white @ (fitted.measured - np.asarray(reading).reshape(-1)[problem.rows])

    def slopes(x: Floats) -> Floats:
        return white @ _slopes_at(problem, active, fitted.differentiated, centre + scale * x)[:, problem.free]

    return minimise(
        residuals,
        slopes,
        (start - centre) / scale,
        np.zeros_like(start),
        problem.weight,
        (problem.lower - centre) / scale,
        (problem.upper - centre) / scale,
        problem.free,
        floor=floor if problem.weighted else 1e-18,
        max_evaluations=evaluations,
        crawl=crawl,
        steepest=STEEPEST if problem.weighted else np.inf,
        bends=bends,
        begun=begun,
    )


def reading_slopes(problem: Problem, theta: Floats) -> Floats:
    """Slopes (residuals, parameters) of measured less predicted readings [N, N mm], in scaled coordinates.

    Of all parameters; those of effects that are not free are at their null.
    """
    every = np.ones(len(problem.model.structure.effects), dtype=bool)
    return _slopes_at(problem, every, problem.fitted_readings.differentiated, theta)


def slopes_of(problem: Problem, theta: Floats, rows: NDArray[np.intp], of: LoadCaseInput | None = None) -> Floats:
    """Slopes (rows, parameters) of any readings, fitted or not, in scaled coordinates [N, N mm]; zero for what is held.

    Args:
        problem: whose parameters and components.
        theta: (parameters,).
        rows: indices into the flattened (cases, 6) wrench.
        of: load cases that the rows count; by default the session's.
    """
    inputs = problem.observations.inputs if of is None else of
    if len(rows) == 0:
        return np.zeros((0, len(theta)))
    return _slopes_at(problem, _active(problem), Differentiated.of(problem.model, inputs, rows), theta) * problem.free


def _begin_to_compile(problem: Problem, active: NDArray[np.bool_]) -> None:
    """Begin to compile what a fit calls: the first program is compiled while the second is traced."""
    model, fitted, of = problem.model, problem.fitted_readings, problem.fitted_readings.differentiated
    predicted, differentiated = (model.given(cases, problem.centre)[0] for cases in (fitted.every_case, of.cases))
    predict_batch.program(model.compact.structure, *predicted, active)
    _slopes.program(model.compact.structure, *differentiated, active)


def _slopes_at(problem: Problem, active: NDArray[np.bool_], of: Differentiated, theta: Floats) -> Floats:
    """Slopes (rows, parameters) of the effects that are active, in scaled coordinates; zero for the others."""
    compact, given = problem.model.compact, problem.model.given(of.cases, theta)
    found = [np.asarray(_slopes(compact.structure, *piece, active)) for piece in given]
    every = np.concatenate(found).reshape(-1, found[0].shape[-1])
    return compact.spread(every[of.at], of.own) * problem.scale


def _active(problem: Problem) -> NDArray[np.bool_]:
    """(effects,) which of them can change anything: those with a free parameter, or one held off its null."""
    return problem.model.acting(problem.free | (problem.centre != problem.model.parameters.initial))


@stored(hurried=True)
def _slopes(
    structure: Structure,
    values: FingerValues,
    theta: Array,
    own: Array,
    cases: LoadCaseInput,
    active: Array,
) -> Array:
    """Slopes (cases, 6, parameters of all parts in a row) of what is measured less what is predicted."""

    def readings(parts: tuple[Array, ...]) -> Array:
        return jax.vmap(lambda of_case, case: predict_parts(structure, values, of_case, case, active).reading)(
            parts, cases
        )

    # Every case with parameters of its own: one reverse pass a component then differentiates all cases.
    every = structure.parts(jnp.broadcast_to(theta, (own.shape[0], theta.shape[0])), own)
    reading, pull_back = jax.vjp(readings, every)
    back = jax.vmap(lambda component: pull_back(jnp.broadcast_to(component, reading.shape))[0])(jnp.eye(6))
    return -jnp.swapaxes(jnp.concatenate(back, axis=-1), 0, 1)
