"""Bounded Levenberg–Marquardt for residuals with Gaussian priors.

SciPy's `least_squares` keeps iterates strictly inside the bounds; a fit of the catalogue needs optima *at* bounds
(one-sided effects), and damping in prior widths. Only residuals and Jacobian are a compiled program: the linear algebra
of a step is faster in LAPACK than in what XLA makes of it. See docs/decisions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dposv

Floats = NDArray[np.float64]

# Evaluations in which something must be gained.
PATIENCE = 8
# Mean squared residuals from which a fit is off, and far off.
OFF, FAR = 2.0, 30.0
# What one that is off may crawl by, as a share of what one that is far off may.
OFF_CRAWL = 1.0 / 3.0
# Of the first step, per unit of mean squared residual.
DAMPING = 0.1
# Damping from which there is nowhere left to go, and below which it is none.
MOST_DAMPING, LEAST_DAMPING = 1e12, 1e-15
# Keeps directions solvable that neither data nor prior determine.
TINY = 1e-12
CONVERGED, STALLED, TOO_MANY, NOT_FINITE = 0, 1, 2, 3


class Solution(NamedTuple):
    """Where the solver ended, in its scaled coordinates.

    Attributes:
        x: (parameters,).
        objective: sum of squared residuals plus the prior's penalty.
        jacobian: (residuals, parameters) at `x`; zero for what is not free.
        residual: (residuals,) at `x`.
        status: CONVERGED, STALLED, TOO_MANY or NOT_FINITE.
        evaluations: residual evaluations.
        decrement: twice the decrease that a further Gauss–Newton step promises.
        damping: of the next step, and by how much it grows should that fail: to go on from here.
    """

    x: Floats
    objective: float
    jacobian: Floats
    residual: Floats
    status: int
    evaluations: int
    decrement: float
    damping: tuple[float, float]


class _Box(NamedTuple):
    """The free parameters' priors and bounds, each (free,)."""

    centre: Floats
    weight: Floats
    lower: Floats
    upper: Floats


class _Normal(NamedTuple):
    """The problem straightened about a point, in the free parameters.

    Attributes:
        x: (free,) the point.
        gradient: (free,) half the objective's.
        hessian: (free, free) half the objective's, of Gauss and Newton.
        level: mean squared residual.
    """

    x: Floats
    gradient: Floats
    hessian: Floats
    level: float

    @classmethod
    def about(cls, x: Floats, residual: Floats, jacobian: Floats, box: _Box) -> _Normal:
        """Make the normal equations; `jacobian` is (residuals, free)."""
        hessian = jacobian.T @ jacobian
        hessian.flat[:: len(x) + 1] += box.weight + TINY
        gradient = residual @ jacobian + box.weight * (x - box.centre)
        return cls(x, gradient, hessian, max(float(residual @ residual) / len(residual), TINY))

    def step(self, damping: float, box: _Box) -> tuple[Floats, float] | None:
        """Next trial (free,) within the bounds, and the decrease promised for it; None if there is no step.

        The step is damped in the parameters' natural units, and the more the larger the misfit: directions that the
        data hardly know would else be thrown far off by residuals that another parameter is to explain. Damping in
        proportion to the misfit keeps the last steps quadratic (Yamashita & Fukushima 2001; Fan & Yuan 2005).
        """
        down, up = self.gradient > 0.0, self.gradient < 0.0
        held = np.flatnonzero((down & (self.x <= box.lower)) | (up & (self.x >= box.upper)))
        if len(held) == len(self.x):
            return self.x, 0.0
        damped, gradient = self.hessian.copy(), self.gradient.copy()
        damped.flat[:: len(gradient) + 1] += damping * self.level
        # What is held has an equation of its own, which says that it stays: cheaper than to cut it out.
        damped[held] = damped[:, held] = gradient[held] = 0.0
        damped[held, held] = 1.0
        _, step, failed = dposv(damped, gradient, lower=True, overwrite_a=True)
        if failed:
            return None
        trial = np.clip(self.x - step, box.lower, box.upper)
        move = trial - self.x
        return trial, -float(2.0 * gradient @ move + move @ self.hessian @ move)


# What is not finite is said by the status; it is not worth a warning at each operation.
@np.errstate(invalid="ignore", over="ignore")
def minimise(
    residuals: Callable[[Floats], Floats],
    slopes: Callable[[Floats], Floats],
    start: Floats,
    centre: Floats,
    weight: Floats,
    lower: Floats,
    upper: Floats,
    free: NDArray[np.bool_],
    *,
    floor: float = 1e-18,
    max_evaluations: int = 400,
    tolerance: float = 1e-9,
    crawl: float = 0.0,
    steepest: float = np.inf,
    begun: Solution | None = None,
) -> Solution:
    """Minimise |r(x)|² + Σ weight (x − centre)² within bounds, over the free parameters.

    Args:
        residuals: x to residuals (residuals,).
        slopes: x to the Jacobian (residuals, free) of what is free; asked for only where a step has led to something
            better, since it takes several times as long.
        start: (parameters,) first guess; scaled so that a step of one is a natural step.
        centre: (parameters,) of the prior.
        weight: (parameters,) prior precision, 0 for a flat prior.
        lower: (parameters,) bound.
        upper: (parameters,) bound.
        free: (parameters,) bool.
        floor: converged once a further step promises less than this …
        tolerance: … or less than this fraction of the objective.
        max_evaluations: of the residuals.
        crawl: stalled if a few evaluations gain less than this share of what a fit that is far off has beyond that, or
            a third of it of what one that is off has.
        steepest: no step is taken to where a slope is as large as this: there the residuals are no function to descend.
        begun: of the same problem, ended at `start`: go on as if it had not ended, without evaluating anything there.
    """
    at = np.flatnonzero(free)
    box = _Box(centre[at], weight[at], lower[at], upper[at])
    damping, growth, evaluations, milestone = DAMPING, 2.0, 0, np.inf
    if begun is None or not np.isfinite(begun.objective):
        x, evaluations = np.clip(start, lower, upper), 1
        residual = residuals(x)
        best = _objective(residual, x, centre, weight)
        if not np.isfinite(best):
            none = np.zeros_like(residual)
            return Solution(x, np.inf, np.zeros((len(none), len(x))), none, NOT_FINITE, 1, np.inf, (damping, growth))
        jacobian = slopes(x)
    else:
        x, residual, best, jacobian = begun.x, begun.residual, begun.objective, begun.jacobian[:, at]
        damping, growth = begun.damping
    normal = _Normal.about(x[at], residual, jacobian, box)
    while True:
        # A point without finite slopes offers no step however much it is damped.
        step = normal.step(damping, box) if np.isfinite(normal.gradient).all() else None
        decrement = np.inf if step is None else abs(step[1])
        # At a kink of the model (a tendon coming to rest on a bone) steps go on to promise what they cannot keep.
        counted = evaluations % PATIENCE == 0
        beyond, far_beyond = (max(best - limit * len(residual), 0.0) for limit in (OFF, FAR))
        crawling = counted and milestone - best < 10.0 * floor + crawl * max(OFF_CRAWL * beyond, far_beyond)
        milestone = best if counted else milestone
        status = -1
        if decrement <= tolerance * best + floor:
            status = CONVERGED
        elif damping > MOST_DAMPING or crawling:
            status = STALLED
        elif evaluations >= max_evaluations:
            status = TOO_MANY
        if status >= 0:
            whole = np.zeros((len(residual), len(x)))
            whole[:, at] = jacobian
            return Solution(x, best, whole, residual, status, evaluations, decrement, (damping, growth))
        evaluations += 1
        gained = -np.inf
        if step is not None:
            trial = x.copy()
            trial[at], promised = step
            tried = residuals(trial)
            objective = _objective(tried, trial, centre, weight)
            gained = best - objective if np.isfinite(objective) else -np.inf
        there = slopes(trial) if gained > 0.0 else None
        if there is not None and (steepest == np.inf or np.abs(there).max() < steepest):
            x, residual, jacobian, best = trial, tried, there, objective
            normal = _Normal.about(x[at], residual, jacobian, box)
            # Nielsen's rule: damping falls smoothly with the quality of the step, and rises ever faster on failures.
            ratio = min(gained / promised if promised > 0.0 else gained, 2.0)
            damping = max(damping * max(1.0 / 3.0, 1.0 - (2.0 * ratio - 1.0) ** 3), LEAST_DAMPING)
            growth = 2.0
        else:
            damping *= growth
            growth *= 2.0


def _objective(residual: Floats, x: Floats, centre: Floats, weight: Floats) -> float:
    return float(residual @ residual) + float(np.sum(weight * (x - centre) ** 2))
