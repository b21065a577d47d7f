"""Parameter identification by maximum a posteriori: all parameters at once, with priors and bounds."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from fingermodel.compiled.programs import stored
from fingermodel.fingers import FingerValues
from fingermodel.fitting.fit_report import Fit, Optimum, Outcome, describe
from fingermodel.fitting.problems import FittedReadings, Problem, Whitener, objective_at
from fingermodel.fitting.solver import CONVERGED, NOT_FINITE, STALLED, Solution, minimise
from fingermodel.model import Structure, parts_of, predict_batch, predict_parts
from fingermodel.stages import LoadCaseInput

Floats = NDArray[np.float64]


# Of the solver's further starts, so that a refit repeats to the last digit.
SEED = 20191107


def refit_map(
    problem: Problem,
    start: Floats | None = None,
    starts: int = 1,
    progress: Callable[[float], None] | None = None,
) -> Fit:
    """Solve a problem by bounded Levenberg–Marquardt and describe its optimum.

    Args:
        problem: of `map_problem` or `eq5_problem`.
        start: (parameters,) instead of the priors' centre.
        starts: how many; those after the first are drawn from the priors. One finds an optimum, several find out
            whether there are others that fit as well.
        progress: called with the fraction of the starts that are done.
    """
    began = time.perf_counter()
    optima, evaluations = [], 0
    for guess in [problem.start if start is None else start, *drawn_starts(problem, starts - 1)]:
        solution = solve(problem, guess)
        evaluations += int(solution.evaluations)
        optima.append(_optimum(problem, solution))
        if progress is not None:
            progress(len(optima) / starts)
    seconds = time.perf_counter() - began
    before = objective_at(problem, problem.model.parameters.initial)
    return describe(problem, optima, "map", before, evaluations, seconds)


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
    whitener: Whitener | None = None,
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
        whitener: instead of the problem's.
    """
    scale, centre, fitted, model = problem.scale, problem.centre, problem.fitted_readings, problem.model
    active, at = _active(problem), model.places[problem.free]
    white = fitted.whitener if whitener is None else whitener
    # Of all cases, fitted or not: the program that predicts them is there anyway.
    predict = predict_batch.program(model.compiled, fitted.values, model.placed(centre), fitted.every_case, active)
    differentiate = _slopes_program(problem, active, fitted, len(problem.rows))

    def residuals(x: Floats) -> Floats:
        reading = predict(fitted.values, model.placed(centre + scale * x), fitted.every_case, active).reading
        return white @ (fitted.measured - np.asarray(reading).reshape(-1)[problem.rows])

    def slopes(x: Floats) -> Floats:
        return white @ np.take(differentiate(centre + scale * x), at, axis=1)

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


def whole_slopes(problem: Problem, theta: Floats) -> Floats:
    """Whitened slopes (residuals, parameters) of all parameters, those of effects that are not free at their null."""
    every = np.ones(len(problem.model.structure.effects), dtype=bool)
    fitted = problem.fitted_readings
    slopes = _slopes_program(problem, every, fitted, len(problem.rows))(theta)
    return fitted.whitener @ np.take(slopes, problem.model.places, axis=1)


def reading_slopes(problem: Problem, theta: Floats) -> Floats:
    """Slopes (residuals, parameters) of measured less predicted readings [N, N mm], in scaled coordinates.

    Of all parameters; those of effects that are not free are at their null.
    """
    every = np.ones(len(problem.model.structure.effects), dtype=bool)
    slopes = _slopes_program(problem, every, problem.fitted_readings, len(problem.rows))(theta)
    return np.take(slopes, problem.model.places, axis=1)


def slopes_of(problem: Problem, theta: Floats, rows: NDArray[np.intp], of: LoadCaseInput | None = None) -> Floats:
    """Slopes (rows, parameters) of any readings, fitted or not, of the components that are; zero for what is held.

    In scaled coordinates [N, N mm], by pieces of the size that is compiled for what is fitted.

    Args:
        problem: whose parameters and components.
        theta: (parameters,).
        rows: indices into the flattened (cases, 6) wrench.
        of: load cases that the rows count; by default the session's.
    """
    every = problem.observations.inputs if of is None else of
    fitted, model, cases = problem.fitted_readings, problem.model, rows // 6
    active, components = _active(problem), np.unique(problem.rows % 6)
    room = min(len(fitted.inputs.setting), len(fitted.at) // len(components))
    used, out = np.unique(cases), np.empty((len(rows), len(theta)))
    for first in range(0, len(used), room):
        piece = used[first : first + room]
        here = np.isin(cases, piece)
        inputs = every.rows(np.resize(piece, len(fitted.inputs.setting)))
        at = np.searchsorted(piece, cases[here]) * len(components) + np.searchsorted(components, rows[here] % 6)
        places = jax.device_put(np.pad(at, (0, len(fitted.at) - len(at))))
        own = replace(fitted, inputs=inputs, at=places)
        out[here] = np.take(_slopes_program(problem, active, own, len(at))(theta), model.places, axis=1)
    return out * problem.free


def _slopes_program(
    problem: Problem, active: NDArray[np.bool_], of: FittedReadings, count: int
) -> Callable[[Floats], Floats]:
    """From parameters to slopes (count, places) of the effects that are active; zero for the others.

    Of so many readings, without what fills them up. They stand where `Model.places` says.
    """
    model = problem.model
    given = (of.values, of.inputs, of.components, of.at, model.placed(problem.scale), active)
    program = _slopes.program(model.compiled, *given, model.placed(problem.centre))
    return lambda theta: np.asarray(program(*given, model.placed(theta)))[:count]


def _active(problem: Problem) -> NDArray[np.bool_]:
    """(effects,) which of them can change anything: those with a free parameter, or one held off its null."""
    return problem.model.acting(problem.free | (problem.centre != problem.model.parameters.initial))


@stored(hurried=True)
def _slopes(
    structure: Structure,
    values: FingerValues,
    cases: LoadCaseInput,
    components: Array,
    rows: Array,
    scale: Array,
    active: Array,
    theta: Array,
) -> Array:
    """Slopes of what is measured less what is predicted (rows, places), in scaled coordinates."""
    count = cases.setting.shape[0]

    def readings(parts: tuple[Array, ...]) -> Array:
        return jax.vmap(lambda own, case: predict_parts(structure, values, own, case, active).reading)(parts, cases)

    # Every case with parameters of its own: one reverse pass a component then differentiates all cases.
    reading, pull_back = jax.vjp(readings, parts_of(structure, jnp.broadcast_to(theta, (count, theta.shape[0]))))
    back = jax.vmap(lambda component: pull_back(jnp.broadcast_to(component, reading.shape))[0])(components)
    slopes = jnp.concatenate(back, axis=-1)
    return -jnp.swapaxes(slopes, 0, 1).reshape(-1, theta.shape[0])[rows] * scale
