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
# How much worse than without it the bend may foresee what a step gains before it is no longer counted with.
LENIENCE = 1.5
# Cosine between a step and what it turned the gradient by, from which it can be learned from.
LEAST_ALONG = 1e-8
# Keeps directions solvable that neither data nor prior determine.
TINY = 1e-12
CONVERGED, STALLED, TOO_MANY, NOT_FINITE = 0, 1, 2, 3


class Memory(NamedTuple):
    """What the steps so far have taught.

    Attributes:
        damping: of the next step.
        growth: by how much it grows should that fail.
        bend: (free, free) half of what Gauss and Newton leave out of the objective's Hessian: each residual times its
            curvature, and sharp turns at kinks. None before anything is known of it.
        bent: whether the next step counts with it.
    """

    damping: float = DAMPING
    growth: float = 2.0
    bend: Floats | None = None
    bent: bool = False

    def succeeded(self, ratio: float) -> Memory:
        """Nielsen's rule: damping falls smoothly with the quality of the step, and rises ever faster on failures.

        Args:
            ratio: of what a step gained to what it had promised.
        """
        damping = self.damping * max(1.0 / 3.0, 1.0 - (2.0 * min(ratio, 2.0) - 1.0) ** 3)
        return self._replace(damping=max(damping, LEAST_DAMPING), growth=2.0)

    def failed(self) -> Memory:
        """Damp more."""
        return self._replace(damping=self.damping * self.growth, growth=2.0 * self.growth)

    def judged(self, move: Floats, gained: float, straight: float) -> Memory:
        """Count with the bend if it foresaw better what a step would gain, and no longer if it did so clearly worse.

        Args:
            move: (free,) the step.
            gained: by it.
            straight: what Gauss and Newton would have promised for it.
        """
        if self.bend is None or not np.isfinite(gained):
            return self
        without, with_it = abs(gained - straight), abs(gained - straight + float(move @ self.bend @ move))
        return self._replace(bent=with_it < without or (self.bent and with_it <= LENIENCE * without))

    def learned(self, move: Floats, turned: Floats, left_out: Floats) -> Memory:
        """Learn from a step that led to something better; the update of NL2SOL (Dennis, Gay & Welsch 1981).

        Args:
            move: (free,) the step.
            turned: (free,) by how much half the gradient changed.
            left_out: (free,) what of that the change of the slopes has caused.
        """
        along = float(turned @ move)
        if along <= LEAST_ALONG * float(np.linalg.norm(turned) * np.linalg.norm(move)):
            return self
        bend = np.zeros((len(move), len(move))) if self.bend is None else self.bend
        known = abs(float(move @ bend @ move))
        if known > 0.0:
            # Residuals shrink, and their part of the curvature with them.
            bend = bend * min(1.0, abs(float(move @ left_out)) / known)
        miss = left_out - bend @ move
        cross = np.outer(miss / along, turned)
        bend = bend + cross + cross.T - np.outer(float(miss @ move) / along**2 * turned, turned)
        return self._replace(bend=bend)


class Solution(NamedTuple):
    """Where the solver ended, in its scaled coordinates.

    Attributes:
        x: (parameters,).
        objective: sum of squared residuals plus the prior's penalty.
        jacobian: (residuals, parameters) at `x`; zero for what is not free.
        residual: (residuals,) at `x`.
        status: CONVERGED, STALLED, TOO_MANY or NOT_FINITE.
        evaluations: residual evaluations.
        decrement: of the objective, that the linearised problem promises beyond `x`, whether a step keeps it or not.
        memory: of the steps so far, to go on from here.
    """

    x: Floats
    objective: float
    jacobian: Floats
    residual: Floats
    status: int
    evaluations: int
    decrement: float
    memory: Memory


class _Box(NamedTuple):
    """The free parameters' priors and bounds, each (free,)."""

    centre: Floats
    weight: Floats
    lower: Floats
    upper: Floats


class _Normal(NamedTuple):
    """The problem linearised about a point, in the free parameters.

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

    def promise(self, move: Floats) -> float:
        """Decrease that is promised for a move (free,)."""
        return -float(2.0 * self.gradient @ move + move @ self.hessian @ move)

    def decrement(self, box: _Box) -> float:
        """Decrease that is promised without any damping, within the bounds."""
        step = self.step(Memory(damping=0.0), box) if np.isfinite(self.gradient).all() else None
        return 0.0 if step is None else max(step[1], 0.0)

    def step(self, memory: Memory, box: _Box) -> tuple[Floats, float] | None:
        """Next trial (free,) within the bounds, and the decrease promised for it; None if there is no step.

        The step is damped in the parameters' natural units, and the more the larger the misfit: directions that the
        data hardly know would else be thrown far off by residuals that another parameter is to explain. Damping in
        proportion to the misfit keeps the last steps quadratic (Yamashita & Fukushima 2001; Fan & Yuan 2005).
        What a step would take beyond a bound goes to the bound, and the others' step is made anew with it: a step that
        is only cut off there has lost what it was balanced by, and leads uphill.
        """
        down, up = self.gradient > 0.0, self.gradient < 0.0
        fixed = (down & (self.x <= box.lower)) | (up & (self.x >= box.upper))
        bend = memory.bend if memory.bent else None
        model = self if bend is None else self._replace(hessian=self.hessian + bend)
        move = np.zeros_like(self.x)
        while not fixed.all():
            damped = model.hessian.copy()
            damped.flat[:: len(move) + 1] += memory.damping * self.level
            right = damped[:, fixed] @ move[fixed] + self.gradient
            # What is fixed has an equation of its own, which says where it goes: cheaper than to cut it out.
            damped[fixed] = damped[:, fixed] = 0.0
            damped[fixed, fixed], right[fixed] = 1.0, -move[fixed]
            _, step, failed = dposv(damped, right, lower=True, overwrite_a=True)
            if failed:
                # With the bend there may be no minimum.
                return None if bend is None else self.step(memory._replace(bent=False), box)
            trial = self.x - step
            beyond = ~fixed & ((trial < box.lower) | (trial > box.upper))
            if not beyond.any():
                break
            move[beyond] = np.clip(trial, box.lower, box.upper)[beyond] - self.x[beyond]
            fixed |= beyond
        else:
            trial = self.x + move
        trial = np.clip(trial, box.lower, box.upper)
        return trial, model.promise(trial - self.x)


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
    bends: bool = True,
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
        bends: learn the curvature of the residuals from the steps: needs some, and then saves many.
        begun: of the same problem, ended at `start`: go on as if it had not ended, without evaluating anything there.
    """
    at = np.flatnonzero(free)
    box = _Box(centre[at], weight[at], lower[at], upper[at])
    memory, evaluations, milestone = Memory(), 0, np.inf
    if begun is None or not np.isfinite(begun.objective):
        x, evaluations = np.clip(start, lower, upper), 1
        residual = residuals(x)
        best = _objective(residual, x, centre, weight)
        if not np.isfinite(best):
            none = np.zeros_like(residual)
            return Solution(x, np.inf, np.zeros((len(none), len(x))), none, NOT_FINITE, 1, np.inf, memory)
        jacobian = slopes(x)
    else:
        x, residual, best, jacobian = begun.x, begun.residual, begun.objective, begun.jacobian[:, at]
        memory = begun.memory
    normal = _Normal.about(x[at], residual, jacobian, box)
    while True:
        # A point without finite slopes offers no step however much it is damped.
        step = normal.step(memory, box) if np.isfinite(normal.gradient).all() else None
        by_step = np.inf if step is None else abs(step[1])
        # At a kink of the model (a tendon coming to rest on a bone) steps go on to promise what they cannot keep.
        counted = evaluations % PATIENCE == 0
        beyond, far_beyond = (max(best - limit * len(residual), 0.0) for limit in (OFF, FAR))
        crawling = counted and milestone - best < 10.0 * floor + crawl * max(OFF_CRAWL * beyond, far_beyond)
        milestone = best if counted else milestone
        status = -1
        if by_step <= tolerance * best + floor:
            status = CONVERGED
        elif memory.damping > MOST_DAMPING or crawling:
            status = STALLED
        elif evaluations >= max_evaluations:
            status = TOO_MANY
        if status >= 0:
            whole = _of_all(jacobian, at, len(x))
            return Solution(x, best, whole, residual, status, evaluations, normal.decrement(box), memory)
        evaluations += 1
        gained = -np.inf
        if step is not None:
            trial = x.copy()
            trial[at], promised = step
            tried = residuals(trial)
            objective = _objective(tried, trial, centre, weight)
            gained = best - objective if np.isfinite(objective) else -np.inf
            move = trial[at] - x[at]
            memory = memory.judged(move, gained, normal.promise(move))
        there = slopes(trial) if gained > 0.0 else None
        if there is not None and (steepest == np.inf or np.abs(there).max() < steepest):
            after = _Normal.about(trial[at], tried, there, box)
            memory = memory.succeeded(gained / promised if promised > 0.0 else gained)
            if bends:
                memory = memory.learned(move, after.gradient - normal.gradient, tried @ there - tried @ jacobian)
            x, residual, jacobian, best, normal = trial, tried, there, objective, after
        else:
            memory = memory.failed()


def _objective(residual: Floats, x: Floats, centre: Floats, weight: Floats) -> float:
    return float(residual @ residual) + float(np.sum(weight * (x - centre) ** 2))


def _of_all(jacobian: Floats, at: NDArray[np.intp], count: int) -> Floats:
    """Slopes (residuals, count) of all parameters, from those of what is free."""
    whole = np.zeros((len(jacobian), count))
    whole[:, at] = jacobian
    return whole
