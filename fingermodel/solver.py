"""Bounded Levenberg–Marquardt for residuals with Gaussian priors, compiled once and batched over starts or candidates.

SciPy's `least_squares` keeps iterates strictly inside the bounds and calls back into Python at every step; a fit of the
catalogue needs optima *at* bounds (one-sided effects) and hundreds of fits a second. See docs/decisions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

# Evaluations in which something must be gained.
PATIENCE = 8
# Of the first step, per unit of mean squared residual.
DAMPING = 0.1
CONVERGED, STALLED, TOO_MANY, NOT_FINITE = 0, 1, 2, 3


class Solution(NamedTuple):
    """Where the solver ended, in its scaled coordinates.

    Attributes:
        x: (parameters,).
        objective: sum of squared residuals plus the prior's penalty.
        jacobian: (residuals, parameters) at `x`.
        residual: (residuals,) at `x`.
        status: CONVERGED, STALLED, TOO_MANY or NOT_FINITE.
        evaluations: residual evaluations.
        decrement: twice the decrease that a further Gauss–Newton step promises.
    """

    x: Array
    objective: Array
    jacobian: Array
    residual: Array
    status: Array
    evaluations: Array
    decrement: Array


class _Loop(NamedTuple):
    x: Array
    residual: Array
    jacobian: Array
    objective: Array
    trial: Array
    promised: Array
    damping: Array
    growth: Array
    evaluations: Array
    decrement: Array
    status: Array
    milestone: Array


def minimise(
    linearise: Callable[[Array], tuple[Array, Array]],
    start: Array,
    centre: Array,
    weight: Array,
    lower: Array,
    upper: Array,
    free: Array,
    *,
    residuals: int | None = None,
    floor: Array | float = 1e-18,
    max_evaluations: Array | int = 400,
    tolerance: float = 1e-9,
) -> Solution:
    """Minimise |r(x)|² + Σ weight (x − centre)² within bounds, over the free parameters.

    Args:
        linearise: x to residuals (residuals,) and their Jacobian (residuals, parameters).
        start: (parameters,) first guess; scaled so that a step of one is a natural step.
        centre: (parameters,) of the prior.
        weight: (parameters,) prior precision, 0 for a flat prior.
        lower: (parameters,) bound.
        upper: (parameters,) bound.
        free: (parameters,) bool.
        residuals: how many there are; given, `linearise` is traced once instead of twice.
        floor: converged once a further step promises less than this …
        tolerance: … or less than this fraction of the objective.
        max_evaluations: of the residuals.
    """
    tiny = 1e-12  # keeps directions solvable that neither data nor prior determine

    def step(x: Array, residual: Array, jacobian: Array, damping: Array) -> tuple[Array, Array]:
        """Next trial within the bounds, and the decrease that the linearised problem promises for it."""
        gradient = residual @ jacobian + weight * (x - centre)
        held = ~free | ((x <= lower) & (gradient > 0.0)) | ((x >= upper) & (gradient < 0.0))
        keep = (~held).astype(gradient.dtype)
        gradient = gradient * keep
        hessian = (jacobian.T @ jacobian + jnp.diag(weight + tiny)) * jnp.outer(keep, keep) + jnp.diag(1.0 - keep)
        # The step is damped in the parameters' natural units, and the more the larger the misfit: directions that the
        # data hardly know would else be thrown far off by residuals that another parameter is to explain. Damping in
        # proportion to the misfit keeps the last steps quadratic (Yamashita & Fukushima 2001; Fan & Yuan 2005).
        level = damping * jnp.maximum(residual @ residual / residual.shape[0], tiny)
        factor = jnp.linalg.cholesky(hessian + level * jnp.diag(keep))
        trial = jnp.clip(x - jax.scipy.linalg.cho_solve((factor, True), gradient), lower, upper)
        move = trial - x
        return trial, -(2.0 * gradient @ move + move @ hessian @ move)

    def turn(loop: _Loop) -> _Loop:
        # One evaluation a turn gives residuals and Jacobian together, so that the model is compiled once.
        residual, jacobian = linearise(loop.trial)
        objective = residual @ residual + jnp.sum(weight * (loop.trial - centre) ** 2)
        gained = loop.objective - objective
        first = loop.evaluations == 0
        better = jnp.isfinite(objective) & (gained > 0.0)
        x = jnp.where(better, loop.trial, loop.x)
        residual = jnp.where(better, residual, loop.residual)
        jacobian = jnp.where(better, jacobian, loop.jacobian)
        # Nielsen's rule: damping falls smoothly with the quality of the step, and rises ever faster on failures.
        ratio = gained / jnp.where(loop.promised > 0.0, loop.promised, 1.0)
        eased = loop.damping * jnp.maximum(1.0 / 3.0, 1.0 - (2.0 * ratio - 1.0) ** 3)
        damping = jnp.where(better, jnp.maximum(eased, 1e-15), loop.damping * loop.growth)
        damping = jnp.where(first, loop.damping, damping)
        growth = jnp.where(better, 2.0, loop.growth * 2.0)
        best = jnp.where(better, objective, loop.objective)
        trial, promised = step(x, residual, jacobian, damping)
        decrement = jnp.abs(promised)
        evaluations = loop.evaluations + 1
        # At a kink of the model (a tendon coming to rest on a bone) steps go on to promise what they cannot keep.
        counted = evaluations % PATIENCE == 0
        crawling = counted & (loop.milestone - best < 10.0 * floor)
        milestone = jnp.where(counted, best, loop.milestone)
        status = jnp.where(
            decrement <= tolerance * best + floor,
            CONVERGED,
            jnp.where((damping > 1e12) | crawling, STALLED, jnp.where(evaluations >= max_evaluations, TOO_MANY, -1)),
        )
        status = jnp.where(first & ~jnp.isfinite(objective), NOT_FINITE, status)
        return _Loop(
            x, residual, jacobian, best, trial, promised, damping, growth, evaluations, decrement, status, milestone
        )

    count = jax.eval_shape(linearise, start)[0].shape[0] if residuals is None else residuals
    start = jnp.clip(start, lower, upper)
    infinite = jnp.array(jnp.inf)
    begin = _Loop(
        x=start,
        residual=jnp.zeros(count),
        jacobian=jnp.zeros((count, start.shape[0])),
        objective=infinite,
        trial=start,
        promised=infinite,
        damping=jnp.array(DAMPING),
        growth=jnp.array(2.0),
        evaluations=jnp.array(0),
        decrement=infinite,
        status=jnp.array(-1),
        milestone=infinite,
    )
    end = jax.lax.while_loop(lambda loop: loop.status < 0, turn, begin)
    return Solution(end.x, end.objective, end.jacobian, end.residual, end.status, end.evaluations, end.decrement)
