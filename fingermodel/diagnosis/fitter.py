"""Fit explanations one by one, and remember the best optimum of each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fingermodel.diagnosis.candidates import NOTHING_MISSING, Explanation, mask
from fingermodel.diagnosis.fitted import Fitted, objective_of, require_sane
from fingermodel.problems import Problem
from fingermodel.refit import drawn_starts, solve
from fingermodel.solver import Solution

Floats = NDArray[np.float64]

# Further starts of the base model, drawn from its priors; its optima are several (see docs/decisions/0007).
BASE_STARTS = 3
# Of these, where none of the first led anywhere.
BASE_AGAIN = 12
# Most fits only have to show that they are not in question; those that are get finished.
FLOOR = 0.03
FIRST, SECOND, LAST = 3, 15, 60
# What is far from fitting need not be known to the last digit: see `minimise`.
CRAWL = 3e-3
# Prior widths from the centre that are none.
ROUNDING = 1e-9
# Prior widths from its null at which a parameter begins of which nothing is known.
HALF = 0.5
# Log evidence that a fit must promise beyond what is known to be worth another.
WORTHWHILE = 1.0


def fit_from(
    explanation: Explanation,
    problem: Problem,
    start: Floats,
    evaluations: int,
    *,
    finely: bool = False,
    begun: Solution | None = None,
) -> Fitted:
    """Fit from one start (parameters,), or go on from where a fit begun ended; finely if its optimum is to be known.

    Args:
        explanation: what the problem frees beyond the budget.
        problem: to solve.
        start: (parameters,).
        evaluations: at most so many.
        finely: to the last hundredth of log evidence, and learning from the steps: that takes more than a few of them.
        begun: how an earlier fit of this problem ended at `start`.
    """
    floor = FLOOR / 10.0 if finely else FLOOR
    solution = solve(problem, start, floor, evaluations, crawl=CRAWL, bends=finely, begun=begun)
    x = np.where(np.abs(solution.x) < ROUNDING, 0.0, solution.x)
    theta = problem.centre + problem.scale * x
    return Fitted(explanation, theta, x, objective_of(solution), solution, problem)


def further(fit: Fitted, evaluations: int, *, finely: bool = False) -> Fitted:
    """Take a fit further from where it stands, as if it had not ended."""
    return fit_from(fit.explanation, fit.problem, fit.theta, evaluations, finely=finely, begun=fit.solution)


class Fitter:
    """Fits explanations of one problem.

    Attributes:
        problem: to explain.
        best: each explanation's optimum in which least is left.
        deeper: of some, another fit that is not done and promises to become better yet.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.best: dict[Explanation, Fitted] = {}
        self.deeper: dict[Explanation, Fitted] = {}

    def fit(
        self, explanation: Explanation, starts: Iterable[Floats], evaluations: int = FIRST, *, finely: bool = False
    ) -> Fitted:
        """Fit from each start (parameters,) and keep the best optimum ever found of this explanation."""
        problem = replace(self.problem, free=self.problem.free | mask(self.problem.model, explanation))
        for start in starts:
            guess = np.where(problem.free, np.clip(start, problem.lower, problem.upper), problem.centre)
            self._keep(fit_from(explanation, problem, guess, evaluations, finely=finely))
        return self.best[explanation]

    def go_on(self, begun: Fitted, evaluations: int, *, finely: bool = False) -> Fitted:
        """Take a fit further and keep the best optimum ever found of its explanation."""
        self._keep(further(begun, evaluations, finely=finely), begun)
        return self.best[begun.explanation]

    def _keep(self, found: Fitted, begun: Fitted | None = None) -> None:
        old = self.best.get(found.explanation)
        if old is None:
            self.best[found.explanation] = found
            return
        better, worse = (found, old) if found.objective < old.objective - 1e-6 else (old, found)
        self.best[found.explanation] = better
        # What has just been begun in a deeper valley may still stand higher; where a fit came from is none.
        if worse is not begun and not worse.converged and worse.promise > better.promise + WORTHWHILE:
            self.deeper[found.explanation] = worse

    def base(self, start: Floats | None = None, drawn: int = BASE_STARTS) -> Fitted:
        """Fit the model without any effect.

        From one start it may end in a posture that transmits no force, which is no optimum: hence some are drawn.

        Raises:
            SessionError: it ends there from all of them.
        """
        starts = [self.problem.centre] if start is None else [start, self.problem.centre]
        further = drawn_starts(self.problem, max(drawn, BASE_AGAIN))
        nothing = self.fit(NOTHING_MISSING, [*starts, *further[:drawn]], SECOND)
        if not nothing.sane:
            nothing = self.fit(NOTHING_MISSING, further[drawn:], SECOND)
        return require_sane(self.go_on(nothing, LAST, finely=True))

    def expected(self, host: Fitted, explanation: Explanation) -> Floats:
        """Where the straightened model about an optimum expects another explanation's optimum."""
        free, mean = host.everything.mean(explanation.parameters)
        expected = host.x.copy()
        expected[free] = mean
        # Where an effect does not act, what tells its forms apart has no slope: a fit begun at its null stays there.
        own = np.array(explanation.parameters, dtype=int)
        unknown = own[~host.everything.h[:, own].any(axis=0) & (host.x[own] == 0.0)]
        expected[unknown] = HALF
        # A straight line is not to be trusted further than the priors reach.
        x: Floats = np.clip(expected, -4.0, 4.0)
        out: Floats = self.problem.centre + self.problem.scale * x
        return out
