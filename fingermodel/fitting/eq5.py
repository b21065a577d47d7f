"""The published identification: three separate problems of Eq 5, each by SciPy's SLSQP (Synek et al. 2019, p. 9)."""

from __future__ import annotations

import time
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from daq.errors import ModelError
from fingermodel.fingers import FingerValues
from fingermodel.fitting.fit_report import Fit, Optimum, Outcome, describe
from fingermodel.fitting.problems import Problem, objective_at
from fingermodel.model import Model, predict_case
from fingermodel.stages import LoadCaseInput
from fingermodel.structure import Structure

Floats = NDArray[np.float64]


def refit_slsqp(problem: Problem, *, accuracy: float = 1e-8) -> Fit:
    """Solve the published separate problems of Eq 5 by SciPy's SLSQP, one for each independent set of muscles.

    Raises:
        ModelError: a case that loads muscles of two problems at once, which the published split cannot use.
    """
    from scipy.optimize import minimize

    began = time.perf_counter()
    theta = problem.start.copy()
    before = objective_at(problem, problem.model.parameters.initial)
    outcome: Outcome = "converged"
    evaluations = 0
    cases = problem.rows // 6
    for muscles in independent_muscles(problem.model):
        mine = _cases_of(problem, muscles)
        chosen = problem.free & _parameters_of(problem.model, muscles)
        use = np.isin(cases, mine)
        if not use.any():
            continue
        scale = problem.scale[chosen]
        limits = list(zip((problem.lower[chosen]) / scale, (problem.upper[chosen]) / scale, strict=True))

        def objective(
            x: Floats, chosen: NDArray[np.bool_] = chosen, use: NDArray[np.bool_] = use, scale: Floats = scale
        ) -> tuple[float, Floats]:
            trial = theta.copy()
            trial[chosen] = x * scale
            value, gradient = _eq5(problem, trial, use, chosen)
            return value, gradient[chosen] * scale

        answer = minimize(
            objective,
            theta[chosen] / scale,
            jac=True,
            method="SLSQP",
            bounds=limits,
            options={"ftol": accuracy, "maxiter": 1000},
        )
        theta[chosen] = np.clip(answer.x * scale, problem.lower[chosen], problem.upper[chosen])
        evaluations += int(answer.nfev)
        if answer.status != 0:
            outcome = "too_many_evaluations" if answer.status == 9 else "stalled"
    seconds = time.perf_counter() - began
    optimum = Optimum(theta, _whitened_jacobian(problem, theta), objective_at(problem, theta), outcome)
    return describe(problem, [optimum], "slsqp", before, evaluations, seconds)


def independent_muscles(model: Model) -> list[tuple[str, ...]]:
    """Sets of muscles that share no parameter: each flexor alone, and all that pull on the hood together."""
    hood = model.finger.topology.hood
    members = hood.members if hood else ()
    alone = [(m,) for m in model.finger.topology.muscles if m not in members]
    return alone + ([members] if members else [])


def _cases_of(problem: Problem, muscles: tuple[str, ...]) -> list[int]:
    out = []
    for i in sorted(set((problem.rows // 6).tolist())):
        loaded = {m for m, mass in problem.observations.masses_g[i].items() if mass}
        if loaded and loaded <= set(muscles):
            out.append(i)
        elif loaded & set(muscles):
            raise ModelError(
                f"case {problem.observations.ids[i]} loads {'+'.join(sorted(loaded))} together",
                "identification cases of one tendon (or tendons of the hood alone) for --method slsqp",
                "Use --method map, which fits all parameters at once",
            )
    return out


def _parameters_of(model: Model, muscles: tuple[str, ...]) -> NDArray[np.bool_]:
    hood = model.finger.topology.hood
    slips = set(muscles)
    fractions = False
    if hood and set(muscles) & set(hood.members):
        slips |= {hood.central_slip, hood.radial_band, hood.ulnar_band, hood.terminal_slip}
        fractions = True
    out = []
    for name in model.parameters.names:
        parts = name.split(".")
        out.append((parts[0] == "point" and parts[2] in slips) or (parts[0] == "fraction" and fractions))
    return np.array(out)


def _eq5(problem: Problem, theta: Floats, use: NDArray[np.bool_], chosen: NDArray[np.bool_]) -> tuple[float, Floats]:
    value, gradient = _eq5_compiled(
        problem.model.structure,
        problem.model.values,
        problem.observations.inputs,
        jnp.asarray(problem.rows),
        jnp.asarray(problem.observations.wrench.reshape(-1)[problem.rows]),
        jnp.asarray(use.astype(float)),
        jnp.asarray(theta),
    )
    z = np.where(chosen, (theta - problem.centre) / problem.scale, 0.0)
    penalty = problem.weight * z
    return float(value) + float(penalty @ z), np.asarray(gradient) + 2.0 * penalty / problem.scale


@partial(jax.jit, static_argnums=0)
def _eq5_compiled(
    structure: Structure,
    values: FingerValues,
    cases: LoadCaseInput,
    rows: Array,
    wrench: Array,
    use: Array,
    theta: Array,
) -> tuple[Array, Array]:
    def squares(t: Array) -> Array:
        batch = jax.vmap(lambda case: predict_case(structure, values, t, case).reading)(cases)
        return jnp.sum(use * (wrench - batch.reshape(-1)[rows]) ** 2)

    return jax.value_and_grad(squares)(theta)


def _whitened_jacobian(problem: Problem, theta: Floats) -> Floats:
    """Derivative of the predicted, whitened readings in scaled coordinates: (residuals, parameters)."""
    jacobian = np.asarray(problem.model.jacobian(problem.observations.inputs, theta))
    out: Floats = problem.whitener @ (jacobian.reshape(-1, len(theta))[problem.rows] * problem.scale)
    return out
