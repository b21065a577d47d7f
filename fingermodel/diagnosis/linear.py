"""The model straightened out about one optimum: what a set of parameters would explain, in closed form.

All parameters are in units of their prior's width about its centre, all readings whitened, so the prior is N(0, 1) and
the noise is N(0, 1): y = H x + e. Columns of effects that are not free are there too, at their null.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, solve_triangular
from scipy.special import log_ndtr, ndtri_exp

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]


@dataclass(frozen=True)
class Linear:
    """A linear model with Gaussian priors.

    What is left at the optimum is kept, not y itself: near a posture that transmits no force slopes are so steep that
    y = residual + H x is lost in its own digits, and all that is made of it.

    Attributes:
        residual: (n,) whitened readings less the model at the point about which it is straightened out.
        h: (n, parameters) whitened slopes in prior widths.
        base: indices of the parameters that are always free.
        one_sided: (parameters,) whose prior is cut at the null.
        x: (parameters,) that point, in prior widths about the priors' centre.
    """

    residual: Floats
    h: Floats
    base: Ints
    one_sided: NDArray[np.bool_]
    x: Floats

    @cached_property
    def _base(self) -> Posterior:
        """Of the base alone."""
        return self.posterior(self.base)

    def posterior(self, free: Ints, scale: Floats | None = None) -> Posterior:
        """What these parameters can be, all others at the priors' centre.

        Args:
            free: indices.
            scale: (free,) factors on their priors' widths.
        """
        held = np.setdiff1d(np.flatnonzero(self.x), free)
        width = np.ones(len(free)) if scale is None else scale
        return Posterior(self.residual + self.h[:, held] @ self.x[held], self.h[:, free] * width, self.x[free] / width)

    def project(self, columns: Floats) -> Floats:
        """What of some columns (n, k) the base cannot explain, in the metric of C₀⁻¹: C₀⁻¹ columns."""
        base = self._base
        out: Floats = columns - base.h @ cho_solve((base.factor, True), base.h.T @ columns)
        return out

    @property
    def unexplained(self) -> Floats:
        """(n,) the same of the readings: C₀⁻¹ y."""
        return self._base.left

    @cached_property
    def effects(self) -> Ints:
        """Indices of all parameters beyond the base."""
        return np.setdiff1d(np.flatnonzero(np.abs(self.h).sum(axis=0) > 0), self.base)

    @cached_property
    def information(self) -> tuple[Floats, Floats]:
        """A = GᵀC₀⁻¹G (parameters, parameters) and s = GᵀC₀⁻¹y (parameters,), zero outside `effects`."""
        size = self.h.shape[1]
        g = self.h[:, self.effects]
        solved = self.project(g)
        full, score = np.zeros((size, size)), np.zeros(size)
        full[np.ix_(self.effects, self.effects)] = g.T @ solved
        score[self.effects] = g.T @ self.unexplained
        return full, score

    @cached_property
    def log_evidence_base(self) -> float:
        """Ln N(y; 0, C₀) without its constant."""
        return self._base.log_evidence

    def gain(self, parameters: Sequence[int], scale: float = 1.0) -> float:
        """Log evidence gained by freeing some effect parameters, their priors `scale` times as wide.

        One-sided priors count with their ln 2 and the posterior mass on their side.
        """
        chosen = np.array(parameters, dtype=int)
        full, score = self.information
        size = Size(full[np.ix_(chosen, chosen)] * scale**2, score[chosen] * scale)
        return size.log_evidence(self.one_sided[chosen])

    def mean(self, parameters: Sequence[int]) -> tuple[Ints, Floats]:
        """Most probable values of the base and some effect parameters: their indices, and values in prior widths."""
        free = np.concatenate([self.base, np.array(parameters, dtype=int)]).astype(np.intp)
        return free, self.posterior(free).values


@dataclass(frozen=True, eq=False)
class Size:
    """What readings say of some effect parameters, everything else left open, as a Gaussian likelihood.

    Attributes:
        information: (k, k) in prior widths.
        score: (k,).
    """

    information: Floats
    score: Floats

    def __add__(self, other: Size) -> Size:
        """What two sessions say, if the parameters are the same in both."""
        return Size(self.information + other.information, self.score + other.score)

    @cached_property
    def _precision(self) -> Floats:
        return np.asarray(np.eye(len(self.score)) + self.information, dtype=np.float64)

    @cached_property
    def mean(self) -> Floats:
        """(k,) most probable, in prior widths."""
        return np.asarray(np.linalg.solve(self._precision, self.score), dtype=np.float64)

    @cached_property
    def covariance(self) -> Floats:
        """(k, k) of it."""
        return np.asarray(np.linalg.inv(self._precision), dtype=np.float64)

    def log_evidence(self, one_sided: NDArray[np.bool_]) -> float:
        """What it adds to a log evidence over the parameters at their null."""
        # Not from the inverse: where columns are nearly alike and steep, its digits are lost.
        value = float(0.5 * self.score @ self.mean - 0.5 * np.linalg.slogdet(self._precision)[1])
        return value + log_mass(self.mean, self.covariance, one_sided) if one_sided.any() else value


@dataclass(frozen=True, eq=False)
class Posterior:
    """Of N(0, 1) parameters whose slopes are known, from readings with N(0, 1) noise.

    Attributes:
        residual: (n,) readings less the model about some point.
        h: (n, k) slopes.
        x: (k,) that point.
    """

    residual: Floats
    h: Floats
    x: Floats

    @cached_property
    def factor(self) -> Floats:
        """(k, k) lower Cholesky factor of 1 + HᵀH."""
        return np.asarray(np.linalg.cholesky(np.eye(self.h.shape[1]) + self.h.T @ self.h), dtype=np.float64)

    @cached_property
    def _step(self) -> Floats:
        """(k,) to the most probable values, turned by the factor."""
        return np.asarray(solve_triangular(self.factor, self.h.T @ self.residual - self.x, lower=True))

    @cached_property
    def values(self) -> Floats:
        """(k,) most probable."""
        return np.asarray(self.x + solve_triangular(self.factor, self._step, lower=True, trans="T"))

    @cached_property
    def covariance(self) -> Floats:
        """(k, k) of them."""
        return np.asarray(cho_solve((self.factor, True), np.eye(len(self.x))), dtype=np.float64)

    @property
    def misfit(self) -> float:
        """χ² and the priors' penalty there: yᵀ (1 + HHᵀ)⁻¹ y."""
        return float(self.residual @ self.residual + self.x @ self.x - self._step @ self._step)

    @cached_property
    def left(self) -> Floats:
        """(n,) what the most probable values leave: (1 + HHᵀ)⁻¹ y."""
        out: Floats = self.residual - self.h @ (self.values - self.x)
        return out

    @property
    def log_evidence(self) -> float:
        """Ln N(y; 0, 1 + HHᵀ) without its constant."""
        return -0.5 * self.misfit - float(np.log(np.diag(self.factor)).sum())


def log_mass(mean: Floats, covariance: Floats, one_sided: NDArray[np.bool_]) -> float:
    """Ln of 2ⁿ times the Gaussian's mass where the n one-sided coordinates are positive (their null is 0).

    Args:
        mean: (k,) of the Gaussian, before any bound.
        covariance: (k, k).
        one_sided: (k,).
    """
    which = np.flatnonzero(one_sided)
    if len(which) == 0:
        return 0.0
    if len(which) == 1:
        i = which[0]
        return float(np.log(2.0) + log_ndtr(mean[i] / np.sqrt(covariance[i, i])))
    return float(len(which) * np.log(2.0) + _log_orthant(mean[which], covariance[np.ix_(which, which)]))


def _log_orthant(mean: Floats, covariance: Floats, draws: int = 512) -> float:
    """Ln P(x > 0) of a Gaussian by sequential conditioning (Geweke, Hajivassiliou, Keane).

    What is least likely comes first (Gibson, Glasbey and Elston 1994): drawn later, hardly a point would reach it.
    """
    order = np.argsort(mean / np.sqrt(np.diag(covariance)))
    mean, covariance = mean[order], covariance[np.ix_(order, order)]
    factor = np.linalg.cholesky(covariance + 1e-12 * np.trace(covariance) * np.eye(len(mean)))
    last = len(mean) - 1
    uniform = _evenly(draws, last)
    z = np.zeros((draws, last))
    log_weight = np.zeros(draws)
    for i in range(len(mean)):
        limit = -(mean[i] + z[:, :i] @ factor[i, :i]) / factor[i, i]
        above = log_ndtr(-limit)
        log_weight += above
        if i < last:
            # Drawn beyond the limit by their logarithm: however far out that is, they differ.
            z[:, i] = -ndtri_exp(np.log(uniform[:, i]) + above)
    top = log_weight.max()
    return float(top + np.log(np.mean(np.exp(log_weight - top))))


@cache
def _evenly(count: int, dimensions: int) -> Floats:
    """Points (count, dimensions) that fill the unit cube evenly: Roberts' additive recurrence."""
    # Powers of the root of x^(d+1) = x + 1.
    ratio = 2.0
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / (dimensions + 1))
    steps = ratio ** -np.arange(1.0, dimensions + 1.0)
    out: Floats = (np.arange(count)[:, None] * steps[None, :] + 0.5) % 1.0
    return out
