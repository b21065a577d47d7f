"""A competitor that can be anything smooth: what the evidence for "none of the catalogue" is measured with.

The wildcard is a Gaussian process over posture × muscle × load × component, added to any explanation with an amplitude
τ [N]. With an effect it stands for the effect's form being a little otherwise than ours (τ small against the effect);
without one it stands for something that the catalogue does not hold (τ anything).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dormqr, dpstrf, dptsv, dsytrd
from scipy.special import erf, logsumexp

from fingermodel.diagnosis.linear import Linear
from fingermodel.observations import Observations
from fingermodel.problems import Problem

Floats = NDArray[np.float64]

# Postures this far apart [rad] say little about each other.
POSTURE_LENGTH = 0.6
# A lever [mm] that turns an unexplained force into an unexplained moment.
LEVER_MM = 10.0
# Share of an error in an effect's form that does not point along the effect.
ASIDE = 0.4
AMPLITUDES_N = np.concatenate([[0.0], np.geomspace(1e-3, 3.0, 28)])
# Of a matrix that LAPACK reduces in blocks.
BLOCK = 32
# Share of the noise's variance below which what is left of a reading's own is left out.
NEGLIGIBLE = 1e-3
FORM_ERRORS = np.concatenate([[0.0], np.geomspace(5e-3, 0.2, 11)])


@dataclass(frozen=True, eq=False)
class _Places:
    """Where each fitted reading belongs: one row a reading.

    `kinds` are masks of (location, component), `load` each muscle's share of its largest load, `smooth` the posture's
    values on a smooth basis, `settings` a column for each setting of a posture.
    """

    kinds: list[NDArray[np.bool_]]
    load: Floats
    smooth: Floats
    settings: Floats
    moment: NDArray[np.bool_]


def _places(problem: Problem) -> _Places:
    observations = problem.observations
    cases, components = problem.rows // 6, problem.rows % 6
    tension = np.asarray(observations.inputs.tension)
    load = (tension / np.maximum(tension.max(axis=0), 1e-9))[cases]
    names = list(dict.fromkeys(observations.postures[i] for i in cases if observations.postures[i]))
    angles = observations.posture_angles
    root = _posture_root(np.array([angles[n] for n in names]))
    place = np.array([names.index(p) if p in names else -1 for p in observations.postures])[cases]
    smooth = np.where(place[:, None] >= 0, root[np.maximum(place, 0)], 0.0)
    located = np.array(observations.locations)[cases]
    checks = np.array([observations.roles[c] == "check" for c in cases])
    kinds = [
        (located == location) & (components == component) & ~checks
        for location in dict.fromkeys(located)
        for component in sorted(set(components))
    ]
    setting = np.asarray(observations.inputs.setting)[cases]
    settings = (setting[:, None] == np.unique(setting)[None, :]).astype(float)
    return _Places([k for k in kinds if k.any()], load, smooth, settings, components >= 3)


def anything(problem: Problem) -> Floats:
    """Columns (n, k) whose sum with independent N(0, 1) weights is anything smooth of amplitude 1 N, whitened.

    Each muscle pulls in proportion to its load, smoothly over postures; smaller parts bend with the load or do not
    depend on it, another belongs to each setting of the rig, and the smallest to each case alone.
    """
    at = _places(problem)
    blocks: list[Floats] = []
    for rows in at.kinds:
        for m in range(at.load.shape[1]):
            load = at.load[:, m] * rows
            if load.any():
                blocks.append(load[:, None] * at.smooth)
                blocks.append(0.3 * (load * (1.0 - at.load[:, m]))[:, None] * at.smooth)
                blocks.append(0.2 * (load > 0.0)[:, None] * at.smooth)
        blocks.append(0.2 * rows[:, None] * at.settings)
    blocks.append(np.diag(0.1 * np.sqrt((at.load**2).sum(axis=1))))
    return _whitened(problem, np.concatenate(blocks, axis=1) * np.where(at.moment, LEVER_MM, 1.0)[:, None])


def form_of(problem: Problem, change: Floats) -> Floats:
    """Columns (n, k) of an error in an effect's form, relative to the change that the effect makes in each case.

    Args:
        problem: whose readings count.
        change: (cases, 6) that the effect makes [N, N mm].
    """
    at = _places(problem)
    cases = problem.rows // 6
    force, moment = np.linalg.norm(change[:, :3], axis=1), np.linalg.norm(change[:, 3:], axis=1)
    # An effect that shows in moments alone may still be a little off in forces, and the other way round.
    size = np.where(at.moment, np.maximum(moment, LEVER_MM * force)[cases], force[cases])
    own = change.reshape(-1)[problem.rows]
    # Along its own direction: by all tendons alike, by each, by posture; and how each of these depends on the load.
    heavy = at.load.max(axis=1) - 0.5
    blocks: list[Floats] = [own[:, None], (own * heavy)[:, None], own[:, None] * at.smooth]
    for m in range(at.load.shape[1]):
        pulled = own * (at.load[:, m] > 0.0)
        if pulled.any():
            blocks += [pulled[:, None], (pulled * heavy)[:, None], pulled[:, None] * at.smooth]
    # And a little in any direction.
    for rows in at.kinds:
        for m in range(at.load.shape[1]):
            loaded = ASIDE * size * (at.load[:, m] > 0.0) * rows
            if loaded.any():
                blocks += [loaded[:, None] * at.smooth, (loaded * (at.load[:, m] - 0.5))[:, None] * at.smooth]
    columns = np.concatenate(blocks, axis=1)
    return _whitened(problem, columns) if columns.any() else np.zeros((len(problem.rows), 1))


def _whitened(problem: Problem, columns: Floats) -> Floats:
    return problem.fitted_readings.whitener @ columns[:, np.abs(columns).sum(axis=0) > 0]


def _posture_root(angles: Floats) -> Floats:
    distance = ((angles[:, None, :] - angles[None, :, :]) ** 2).sum(axis=-1)
    kernel = np.exp(-0.5 * distance / POSTURE_LENGTH**2) + 1e-9 * np.eye(len(angles))
    out: Floats = np.linalg.cholesky(kernel)
    return out


@dataclass(frozen=True, eq=False)
class Wildcard:
    """A Gaussian process over the readings, as few whitened columns as it takes.

    Attributes:
        root: (n, k).
        amplitudes: that are tried, the first of them 0.
    """

    root: Floats
    amplitudes: Floats

    @classmethod
    def of(cls, columns: Floats, amplitudes: Floats) -> Wildcard:
        """Reduce columns to what matters at the largest amplitude, against noise of one.

        A pivoted Cholesky factor, ended where no reading has more variance left than that: a tenth of the work of
        eigenvalues, and the same as far as anybody could see.
        """
        covariance = columns @ columns.T
        least = max(NEGLIGIBLE / float(amplitudes[-1]) ** 2, 1e-7 * float(np.diag(covariance).max()))
        if np.diag(covariance).max() <= least:
            return cls(np.zeros((len(columns), 1)), amplitudes)
        factor, pivots, rank, _ = dpstrf(covariance, tol=least, lower=1)
        root = np.empty((len(columns), rank))
        root[pivots - 1] = np.tril(factor)[:, :rank]
        return cls(root, amplitudes)

    @cached_property
    def _gram(self) -> Floats:
        """(k, k)."""
        out: Floats = self.root.T @ self.root
        return out

    def profile(self, linear: Linear, free: NDArray[np.intp], scale: Floats) -> Floats:
        """Ln N(y; 0, 1 + H P Hᵀ + τ² K) for every amplitude, without its constant.

        Args:
            linear: the straightened model.
            free: indices of the free parameters.
            scale: (free,) factors on their priors' widths.
        """
        without = linear.posterior(free, scale)
        absorbed = solve_triangular(without.factor, without.h.T @ self.root, lower=True)
        gram = self._gram - absorbed.T @ absorbed
        explained, log_size = _at_amplitudes(gram, self.root.T @ without.left, self.amplitudes)
        return np.asarray(without.log_evidence + 0.5 * explained - 0.5 * log_size)

    def allowed_for(self, amplitude: float, columns: Floats) -> Floats:
        """Whitened columns (n, k) in the metric of noise and of this process with an amplitude together."""
        if amplitude == 0.0:
            return columns
        factor = np.linalg.cholesky(np.eye(len(self.root)) + amplitude**2 * (self.root @ self.root.T))
        out: Floats = solve_triangular(factor, columns, lower=True)
        return out

    def log_marginal(self, profile: Floats, scale: float) -> tuple[float, float]:
        """Log evidence over a half-normal amplitude of a given size, and the most probable amplitude."""
        a = self.amplitudes
        edges = np.concatenate([[0.0, a[1] / 2.0], np.sqrt(a[1:-1] * a[2:]), [a[-1] * 2.0]])
        weight = erf(edges[1:] / (scale * np.sqrt(2.0))) - erf(edges[:-1] / (scale * np.sqrt(2.0)))
        total = profile + np.log(np.maximum(weight, 1e-300))
        return float(logsumexp(total)), float(a[int(np.argmax(total))])

    def log_marginal_any(self, profile: Floats, least: float) -> tuple[float, float]:
        """Log evidence over an amplitude that may be anything above the least, flat in its logarithm."""
        chosen = self.amplitudes >= least
        total = np.where(chosen, profile, -np.inf) - np.log(chosen.sum())
        return float(logsumexp(total)), float(self.amplitudes[int(np.argmax(total))])


def _at_amplitudes(gram: Floats, cross: Floats, amplitudes: Floats) -> tuple[Floats, Floats]:
    """For every amplitude τ: τ² cᵀ (1 + τ² G)⁻¹ c, and ln det(1 + τ² G), each (amplitudes,).

    Made tridiagonal once, which takes a third of the time of eigenvalues with their vectors; then each is a line.

    Args:
        gram: (k, k) G.
        cross: (k,) c.
        amplitudes: τ.
    """
    if len(cross) == 1:
        tau2 = amplitudes**2
        return tau2 * cross[0] ** 2 / (1.0 + tau2 * gram[0, 0]), np.log1p(tau2 * gram[0, 0])
    # In blocks, for which it wants room.
    reflectors, diagonal, beside, factors, _ = dsytrd(gram, lower=1, lwork=BLOCK * len(cross))
    turned = cross.copy()
    turned[1:] = dormqr("L", "T", reflectors[1:, :-1], factors, cross[1:, None], lwork=len(cross))[0][:, 0]
    explained, log_size = np.zeros(len(amplitudes)), np.zeros(len(amplitudes))
    for i, tau2 in enumerate(amplitudes**2):
        pivots, _, solved, _ = dptsv(1.0 + tau2 * diagonal, tau2 * beside, turned)
        explained[i] = tau2 * turned @ solved
        log_size[i] = np.log(pivots).sum()
    return explained, log_size


def rms_of(observations: Observations, rows: NDArray[np.intp], change: Floats) -> float:
    """Root mean square [N] of a change (n, 6) of readings over the fitted force components that it touches."""
    values = change.reshape(-1)[rows[rows % 6 < 3]]
    touched = np.abs(values) > 0.05 * max(np.abs(values).max(initial=0.0), 1e-12)
    return float(np.sqrt(np.mean(values[touched] ** 2))) if touched.any() else 0.0
