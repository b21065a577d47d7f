"""Gaussian algebra: weights with N(0, w²) priors whose columns explain readings.

A misfit is expressed by inner products of whitened columns, so that freeing weights at other widths costs the same
whatever the number of readings. Factorisations are of 1 + w G w, which is positive definite for any positive
semidefinite G.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.linalg import qr, solve_triangular
from scipy.special import log_ndtr, ndtri_exp

from fingermodel.arrays import Floats, Ints, Mask
from fingermodel.fitting.roots import root_of, root_of_one_plus

# Points by which the mass of several cut priors together is found.
_DRAWS = 512


@dataclass(frozen=True, eq=False)
class Quadratic:
    """Misfit as a function of how far some weights z are moved from where the model was linearised.

    misfit(z) = value − 2 z·gradient + zᵀ hessian z, everything eliminated so far at its best.
    """

    value: float  # misfit at z = 0, the penalty of what is eliminated included
    gradient: Floats  # (k,)
    hessian: Floats  # (k, k)
    log_det: float  # ln det of the noise and of all that is eliminated: ln det(1 + w G w)

    @classmethod
    def of_all(cls, parts: Sequence[Quadratic]) -> Quadratic:
        """What several say of the same weights, all together."""
        value, log_det = sum(q.value for q in parts), sum(q.log_det for q in parts)
        return cls(
            value, np.sum([q.gradient for q in parts], axis=0), np.sum([q.hessian for q in parts], axis=0), log_det
        )

    @classmethod
    def beside(cls, across: Floats, left: Floats, columns: Floats, log_det: float) -> Quadratic:
        """What readings whose noise is 1 say of further weights, beside others that are integrated out.

        Args:
            across: (l, n) of the others' columns (see `absorbed_by`).
            left: (n,) readings with every one of the others at 0.
            columns: (n, k) change of the readings by each further weight.
            log_det: of the noise and of the others.
        """
        turned, plain = across @ columns, across @ left
        gradient, hessian = columns.T @ left - turned.T @ plain, columns.T @ columns - turned.T @ turned
        return cls(float(left @ left) - float(plain @ plain), gradient, hessian, log_det)

    def turned(self, order: Ints, sign: Floats) -> Quadratic:
        """The same of other weights: in another order, and of another sign."""
        hessian = self.hessian[np.ix_(order, order)] * sign[:, None] * sign
        return Quadratic(self.value, self.gradient[order] * sign, hessian, self.log_det)

    def of_size(self, size: float, last: int = 0) -> Freed:
        """All weights with priors of one width about where they are, and what the last of them are."""
        count = len(self.gradient)
        return self.freed(np.full(count, size), np.zeros(count), last)

    def at(self, moved: Ints, by: Floats) -> Quadratic:
        """The same after some weights have been moved, and counted from there."""
        turned = self.hessian[:, moved] @ by
        value = self.value - 2.0 * float(by @ self.gradient[moved]) + float(by @ turned[moved])
        return Quadratic(value, self.gradient - turned, self.hessian, self.log_det)

    def freed(self, weight: Floats, x: Floats, last: int) -> Freed:
        """What all weights may be, and what the last of them are.

        Args:
            weight: (k,) widths of their priors; 0 keeps one where it is.
            x: (k,) where they stand now.
            last: how many of the last are wanted, all of which move.
        """
        kept = weight > 0.0
        place, w = x[kept], weight[kept]
        inner = (self.hessian if kept.all() else self.hessian[np.ix_(kept, kept)]) * w
        inner *= w[:, None]
        factor = root_of_one_plus(inner)
        step = solve_triangular(factor, w * self.gradient[kept] - place / w, lower=True, check_finite=False)
        misfit = self.value + float(np.sum((place / w) ** 2)) - float(step @ step)
        # The last block of a factor is that of the last weights alone, all others left open.
        first = len(w) - last
        own, wide = factor[first:, first:], np.diag(w[first:])
        inverse = solve_triangular(own, wide, lower=True, check_finite=False) if last else np.zeros((0, 0))
        mean = place[first:] + inverse.T @ step[first:]
        return Freed(misfit, self.log_det + 2.0 * float(np.log(np.diag(factor)).sum()), mean, inverse.T @ inverse)


@dataclass(frozen=True, eq=False)
class Freed:
    """Some weights at their posterior."""

    misfit: float  # least, priors' penalty included
    log_det: float  # of the noise and of all that is free
    mean: Floats  # (k,) in units of a width of 1
    covariance: Floats  # (k, k)

    @property
    def log_evidence(self) -> float:
        """Without the constant."""
        return -0.5 * self.misfit - 0.5 * self.log_det


@dataclass(frozen=True, eq=False)
class Everything:
    """All weights of a linearised session at their posterior."""

    names: tuple[str, ...]  # of the blocks
    mean: Floats  # (k,) in units of a width of 1
    covariance: Floats  # (k, k)
    place: Floats  # (k,) where they stand in the linearisation
    parameters: tuple[Ints, Ints]  # (p,) indices of those that are parameters, and where among the k they stand


def freed_by_columns(columns: Floats, left: Floats, last: int) -> Freed:
    """What weights with N(0, 1) priors may be, by an orthogonal factor of their columns.

    That loses nothing where inner products lose what is small beside the largest, and takes some times as long.

    Args:
        columns: (n, k) change of readings whose noise is 1, by each weight.
        left: (n,) readings with every weight at 0.
        last: how many of the last weights are wanted.
    """
    count = columns.shape[1]
    stacked = np.concatenate([np.column_stack([columns, left]), np.eye(count, count + 1)])
    # The orthogonal factor itself is not needed: its transpose turns the readings beside the columns.
    r = np.asarray(qr(stacked, mode="r", check_finite=False)[0], dtype=np.float64)
    inverse = np.asarray(np.linalg.inv(r[count - last : count, count - last : count]), dtype=np.float64)
    log_det = 2.0 * float(np.log(np.abs(np.diag(r)[:count])).sum())
    return Freed(float(r[count, count] ** 2), log_det, inverse @ r[count - last : count, count], inverse @ inverse.T)


def screened(quadratic: Quadratic, sets: list[tuple[int, ...]], x: Floats, one_sided: Mask) -> Floats:
    """Log evidence of many sets of weights, each freed with widths of 1 and all others moved to their null.

    Args:
        quadratic: of all these weights.
        sets: S sets of indices.
        x: (weights,) where they stand.
        one_sided: (weights,) whose prior is cut at the null.

    Returns:
        (S,) log evidence, without the constant; masses of cut priors taken one by one.
    """
    if not sets:
        return np.zeros(0)
    at_null = quadratic.at(np.arange(len(x)), -x)
    most = max((len(s) for s in sets), default=0)
    index = np.array([(*s, *[-1] * (most - len(s))) for s in sets], dtype=np.intp).reshape(len(sets), most)
    real = index >= 0
    # Where a set is shorter, what fills it up has no slope: it changes nothing.
    inner = at_null.hessian[index[:, :, None], index[:, None, :]] * (real[:, :, None] & real[:, None, :])
    score = at_null.gradient[index] * real
    inverse = np.linalg.inv(root_of_one_plus(inner))
    step = np.einsum("sij,sj->si", inverse, score)
    mean, sd = np.einsum("sji,sj->si", inverse, step), np.sqrt(np.einsum("sji,sji->si", inverse, inverse))
    mass = np.where(real & one_sided[index], np.log(2.0) + log_ndtr(mean / sd), 0.0).sum(axis=1)
    log_det = np.log(np.diagonal(inverse, axis1=1, axis2=2)).sum(axis=1)
    return 0.5 * ((step**2).sum(axis=1) - at_null.value - at_null.log_det) + log_det + mass


def log_mass(mean: Floats, covariance: Floats, cut: Mask) -> float:
    """Ln of 2ᵏ times the Gaussian's mass where k of its coordinates, whose priors are cut at 0, are positive."""
    which = np.flatnonzero(cut)
    if len(which) == 0:
        return 0.0
    return float(len(which) * np.log(2.0) + _log_orthant(mean[which], covariance[np.ix_(which, which)]))


def log_mass_apart(mean: Floats, covariance: Floats, cut: Mask) -> float:
    """The same with each coordinate taken by itself."""
    sd = np.sqrt(np.diag(covariance)[cut])
    return float((np.log(2.0) + log_ndtr(mean[cut] / sd)).sum())


def _log_orthant(mean: Floats, covariance: Floats) -> float:
    """Ln P(x > 0) of a Gaussian by sequential conditioning (Geweke, Hajivassiliou, Keane).

    What is least likely comes first (Gibson, Glasbey and Elston 1994): drawn later, hardly a point would reach it.
    """
    order = np.argsort(mean / np.sqrt(np.diag(covariance)))
    mean, covariance = mean[order], covariance[np.ix_(order, order)]
    factor = root_of(covariance)
    last = len(mean) - 1
    uniform = _evenly(_DRAWS, last)
    z, log_weight = np.zeros((_DRAWS, last)), np.zeros(_DRAWS)
    for i in range(len(mean)):
        limit = -(mean[i] + z[:, :i] @ factor[i, :i]) / factor[i, i]
        above = log_ndtr(-limit)
        log_weight += above
        if i < last:
            # Drawn beyond the limit by their logarithm: however far out that is, they differ.
            z[:, i] = -ndtri_exp(np.log(uniform[:, i]) + above)
    top = log_weight.max()
    return float(top + np.log(np.mean(np.exp(log_weight - top))))


def gain_of_each(information: Floats, score: Floats) -> Floats:
    """Log evidence (…) that weights with N(0, 1) priors add, each by itself; of each its information and score (…)."""
    return 0.5 * score**2 / (1.0 + information) - 0.5 * np.log1p(information)


@cache
def _evenly(count: int, dimensions: int) -> Floats:
    """Points (count, dimensions) that fill the unit cube evenly: Roberts' additive recurrence."""
    # Powers of the root of x^(d+1) = x + 1.
    ratio = 2.0
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / (dimensions + 1))
    steps = ratio ** -np.arange(1.0, dimensions + 1.0)
    return (np.arange(count)[:, None] * steps[None, :] + 0.5) % 1.0
