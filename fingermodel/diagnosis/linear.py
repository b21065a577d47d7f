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

    Attributes:
        y: (n,) whitened readings, the constant part of the model taken off.
        h: (n, parameters) whitened slopes in prior widths.
        base: indices of the parameters that are always free.
        one_sided: (parameters,) whose prior is cut at the null.
    """

    y: Floats
    h: Floats
    base: Ints
    one_sided: NDArray[np.bool_]

    @cached_property
    def _base(self) -> tuple[Floats, Floats, Floats]:
        """Cholesky factor of 1 + HᵀH over the base; Hᵀ y; and the base's slopes."""
        h = self.h[:, self.base]
        factor = np.asarray(np.linalg.cholesky(np.eye(h.shape[1]) + h.T @ h), dtype=np.float64)
        return factor, h.T @ self.y, h

    def project(self, columns: Floats) -> Floats:
        """What of some columns (n, k) the base cannot explain, in the metric of C₀⁻¹: C₀⁻¹ columns."""
        factor, _, h = self._base
        out: Floats = columns - h @ cho_solve((factor, True), h.T @ columns)
        return out

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
        score[self.effects] = solved.T @ self.y
        return full, score

    @cached_property
    def log_evidence_base(self) -> float:
        """Ln N(y; 0, C₀) without its constant."""
        factor, right, _ = self._base
        explained = solve_triangular(factor, right, lower=True)
        return float(-0.5 * (self.y @ self.y - explained @ explained) - np.log(np.diag(factor)).sum())

    def gain(self, parameters: Sequence[int], scale: float = 1.0) -> float:
        """Log evidence gained by freeing some effect parameters, their priors `scale` times as wide.

        One-sided priors count with their ln 2 and the posterior mass on their side.
        """
        chosen = np.array(parameters, dtype=int)
        full, score = self.information
        a, s = full[np.ix_(chosen, chosen)] * scale**2, score[chosen] * scale
        hessian = np.eye(len(chosen)) + a
        mean = np.linalg.solve(hessian, s)
        value = 0.5 * s @ mean - 0.5 * np.linalg.slogdet(hessian)[1]
        return float(value) + log_mass(mean, hessian, self.one_sided[chosen])

    def mean(self, parameters: Sequence[int]) -> tuple[Ints, Floats]:
        """Most probable values of the base and some effect parameters: their indices, and values in prior widths."""
        free = np.concatenate([self.base, np.array(parameters, dtype=int)])
        h = self.h[:, free]
        values = np.asarray(np.linalg.solve(np.eye(len(free)) + h.T @ h, h.T @ self.y), dtype=np.float64)
        return free.astype(np.intp), values


def posterior(y: Floats, h: Floats) -> tuple[Floats, Floats]:
    """Most probable values (k,) and covariance (k, k) of N(0, 1) parameters whose slopes are h (n, k)."""
    covariance = np.asarray(np.linalg.inv(np.eye(h.shape[1]) + h.T @ h), dtype=np.float64)
    return covariance @ (h.T @ y), covariance


def log_mass(mean: Floats, precision: Floats, one_sided: NDArray[np.bool_]) -> float:
    """Ln of 2ⁿ times the Gaussian's mass where the n one-sided coordinates are positive (their null is 0).

    Args:
        mean: (k,) of the Gaussian, before any bound.
        precision: (k, k).
        one_sided: (k,).
    """
    which = np.flatnonzero(one_sided)
    if len(which) == 0:
        return 0.0
    covariance = np.asarray(np.linalg.inv(precision), dtype=np.float64)[np.ix_(which, which)]
    if len(which) == 1:
        return float(np.log(2.0) + log_ndtr(mean[which[0]] / np.sqrt(covariance[0, 0])))
    return float(len(which) * np.log(2.0) + _log_orthant(mean[which], covariance))


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
