"""An explanation at its optimum: its evidence, and the model straightened out about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from daq.errors import SessionError
from fingermodel.diagnosis.candidates import Explanation, mask
from fingermodel.diagnosis.linear import Linear, log_mass
from fingermodel.fit_report import held_at_bound
from fingermodel.problems import Problem
from fingermodel.refit import STEEPEST, whole_slopes
from fingermodel.solver import CONVERGED, STALLED, Solution

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Fitted:
    """An explanation at its optimum.

    Attributes:
        explanation: what is freed.
        theta: (parameters,).
        x: (parameters,) the same in prior widths about the centre.
        objective: χ² plus penalty; infinite where the model is not sane.
        solution: where the solver ended.
        problem: that was solved.
    """

    explanation: Explanation
    theta: Floats
    x: Floats
    objective: float
    solution: Solution = field(repr=False)
    problem: Problem = field(repr=False)

    @property
    def jacobian(self) -> Floats:
        """(n, parameters) of the whitened residuals; zero for what is not free (see `everything`)."""
        return self.solution.jacobian

    @property
    def residual(self) -> Floats:
        """(n,) whitened."""
        return self.solution.residual

    @property
    def chi2(self) -> float:
        """Without the priors' penalty."""
        return float(self.residual @ self.residual)

    @property
    def sane(self) -> bool:
        """Whether it is an optimum at all, whatever the misfit (see `objective_of`)."""
        return bool(np.isfinite(self.objective))

    @property
    def converged(self) -> bool:
        """Whether the solver had done."""
        return self.solution.status in (CONVERGED, STALLED)

    @cached_property
    def _inside(self) -> NDArray[np.bool_]:
        return self.problem.free & ~held_at_bound(self.problem, self.theta)

    @cached_property
    def inner(self) -> NDArray[np.intp]:
        """Free parameters that are not held at any bound."""
        return np.flatnonzero(self._inside)

    @cached_property
    def moving(self) -> NDArray[np.intp]:
        """The same, and the explanation's own one-sided parameters even at their null."""
        return np.flatnonzero(self._inside | self._at_null)

    @cached_property
    def _at_null(self) -> NDArray[np.bool_]:
        """(parameters,) the explanation's own one-sided parameters that are at their null."""
        at_null = self.theta <= self.problem.lower + 1e-6 * self.problem.scale
        own = mask(self.problem.model, self.explanation)
        return own & self.problem.model.parameters.one_sided & at_null

    @cached_property
    def _gradient(self) -> Floats:
        """(parameters,) half the objective's, in prior widths."""
        return self.x + self.jacobian.T @ self.residual

    @cached_property
    def log_evidence(self) -> float:
        """Laplace evidence; one-sided priors count with their ln 2 and the posterior mass on their side.

        A fit counts as it stands. Of what its slopes promise only that counts which lies beyond the null: at a kink of
        the model they promise a step that leads nowhere.
        """
        return self._laplace(trusted=self._at_null & (self._gradient > 0.0) if self.converged else None)

    @cached_property
    def promise(self) -> float:
        """The evidence that a further step of the straightened model promises."""
        return self._laplace(trusted=np.ones_like(self._at_null))

    @cached_property
    def gaussian_log_evidence(self) -> float:
        """Log of N(y; 0, 1 + HHᵀ) of the straightened model without its constant, over what no bound holds."""
        return self._straight(self.inner, self.inner).log_evidence_base

    @property
    def of_bounds(self) -> float:
        """What bounds and cut priors change of the evidence: the straightened model knows nothing of them."""
        return self.log_evidence - self.gaussian_log_evidence

    def _laplace(self, trusted: NDArray[np.bool_] | None) -> float:
        free = self.moving
        if not self.sane:
            return -np.inf
        factor = self._factor
        gradient = self._gradient[free]
        if trusted is not None:
            gradient = gradient * trusted[free]
        step = solve_triangular(factor, gradient, lower=True)
        objective = self.objective - (float(step @ step) if trusted is not None else 0.0)
        value = -0.5 * objective - float(np.log(np.diag(factor)).sum())
        one_sided = self.problem.model.parameters.one_sided
        own = np.array([i for i in self.explanation.parameters if i in set(free)], dtype=int)
        if not one_sided[own].any():
            return value
        mean = self.x[free] - solve_triangular(factor, step, lower=True, trans="T")
        at = np.searchsorted(free, own)
        columns = solve_triangular(factor, np.eye(len(free))[:, at], lower=True)
        return value + log_mass(mean[at], columns.T @ columns, one_sided[own])

    @cached_property
    def _factor(self) -> Floats:
        """Cholesky factor of 1 + HᵀH over what moves."""
        h = self.jacobian[:, self.moving]
        return np.asarray(np.linalg.cholesky(np.eye(h.shape[1]) + h.T @ h), dtype=np.float64)

    @cached_property
    def linear(self) -> Linear:
        """The model straightened out about this optimum, with what is free here."""
        return self._straight(self.moving, np.setdiff1d(self.moving, self.explanation.parameters))

    @cached_property
    def everything(self) -> Linear:
        """The same with the slopes of every effect, at its null where it is not free: what others would explain."""
        return replace(self.linear, h=-whole_slopes(self.problem, self.theta))

    def _straight(self, free: NDArray[np.intp], base: NDArray[np.intp]) -> Linear:
        # What a bound holds is no part of the straightened model: it stays as it is.
        x = np.zeros_like(self.x)
        x[free] = self.x[free]
        return Linear(self.residual, -self.jacobian, base, self.problem.model.parameters.one_sided, x)

    @cached_property
    def covariance(self) -> Floats:
        """(moving, moving) of the parameters in prior widths."""
        h = self.jacobian[:, self.moving]
        return np.asarray(np.linalg.inv(np.eye(h.shape[1]) + h.T @ h), dtype=np.float64)

    def draws(self, count: int, rng: np.random.Generator) -> Floats:
        """Draw parameter vectors (count, parameters) from the posterior, within the bounds."""
        free, problem = self.moving, self.problem
        root = np.linalg.cholesky(self.covariance + 1e-12 * np.eye(len(free)))
        x = np.tile(self.x, (count, 1))
        x[:, free] += rng.normal(size=(count, len(free))) @ root.T
        out: Floats = np.clip(problem.centre + problem.scale * x, problem.lower, problem.upper)
        return out

    def strength(self, parameters: Sequence[int]) -> float:
        """How many standard deviations some parameters together lie from their null."""
        at = np.flatnonzero(np.isin(self.moving, list(parameters)))
        if len(at) == 0:
            return 0.0
        x = self.x[self.moving[at]]
        return float(np.sqrt(x @ np.linalg.solve(self.covariance[np.ix_(at, at)], x)))

    def sd(self, index: int) -> float | None:
        """Standard deviation of a parameter in its unit; None where it is held."""
        at = np.flatnonzero(self.moving == index)
        return float(np.sqrt(self.covariance[at[0], at[0]]) * self.problem.scale[index]) if len(at) else None


def objective_of(solution: Solution) -> float:
    """χ² plus penalty; infinite where slopes have no bound, as in a posture that transmits no force."""
    sane = np.isfinite(solution.objective) and np.abs(solution.jacobian).max() < STEEPEST
    return solution.objective if sane else np.inf


def require_sane(fitted: Fitted) -> Fitted:
    """Return a fit, unless there is none.

    Raises:
        SessionError: every start led to a posture that transmits no force.
    """
    if not fitted.sane:
        raise SessionError(
            f"with {' and '.join(fitted.explanation.names) or 'no effect'} every fit ends in a posture that transmits "
            "no force",
            "readings that a finger can make in the postures which the session gives",
            "Look at its postures and the cell's frame; `fingertwin compare` shows where they miss",
        )
    return fitted


def far_off(fitted: Fitted, limit: float) -> bool:
    """Whether χ² per reading is above a limit."""
    return fitted.objective > limit * len(fitted.problem.rows)
