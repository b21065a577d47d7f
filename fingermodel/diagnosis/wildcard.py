"""A competitor that can be anything smooth: what the evidence for "none of the catalogue" is measured with.

The wildcard is a Gaussian process over posture × muscle × load × component, added to any explanation with an amplitude
τ [N]. With an effect it stands for the effect's form being a little otherwise than ours (τ small against the effect);
without one it stands for something that the catalogue does not hold (τ anything).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from fingermodel.diagnosis.linear import Linear
from fingermodel.observations import Observations
from fingermodel.problems import Problem

Floats = NDArray[np.float64]

# Postures this far apart [rad] say little about each other.
POSTURE_LENGTH = 0.6
# A lever [mm] that turns an unexplained force into an unexplained moment.
LEVER_MM = 10.0
AMPLITUDES_N = np.concatenate([[0.0], np.geomspace(1e-3, 3.0, 28)])


def features(problem: Problem) -> Floats:
    """Columns (n, k) whose sum with independent N(0, 1) weights is the wildcard of amplitude 1 N, whitened.

    Each muscle pulls in proportion to its load, smoothly over postures; a smaller part bends with the load, another
    belongs to each setting of the rig, and the smallest to each case alone.
    """
    observations = problem.observations
    cases, components = problem.rows // 6, problem.rows % 6
    used = np.unique(cases)
    tension = np.asarray(observations.inputs.tension)
    largest = np.maximum(tension.max(axis=0), 1e-9)
    load = tension / largest
    names = list(dict.fromkeys(observations.postures[i] for i in used if observations.postures[i]))
    angles = observations.posture_angles
    root = _posture_root(np.array([angles[n] for n in names]))
    place = np.array([names.index(p) if p in names else -1 for p in observations.postures])
    smooth = np.where(place[:, None] >= 0, root[np.maximum(place, 0)], 0.0)
    size = np.where(components >= 3, LEVER_MM, 1.0)
    blocks: list[Floats] = []
    kinds = sorted({(observations.locations[c], int(k)) for c, k in zip(cases, components, strict=True)})
    located = np.array(observations.locations)[cases]
    checks = np.array([observations.roles[c] == "check" for c in cases])
    for location, component in kinds:
        rows = (located == location) & (components == component) & ~checks
        if not rows.any():
            continue
        for m in range(load.shape[1]):
            pull = load[cases, m] * rows
            if not pull.any():
                continue
            blocks.append(pull[:, None] * smooth[cases])
            blocks.append(0.3 * (pull * (1.0 - load[cases, m]))[:, None] * smooth[cases])
        settings = np.asarray(observations.inputs.setting)[cases]
        blocks.append(0.2 * (rows[:, None] & (settings[:, None] == np.unique(settings)[None, :])))
    norm = np.sqrt((load**2).sum(axis=1))
    alone = np.zeros((len(cases), len(cases)))
    np.fill_diagonal(alone, 0.1 * norm[cases] * ~checks)
    columns = np.concatenate([*blocks, alone], axis=1) * size[:, None]
    out: Floats = problem.whitener @ columns[:, np.abs(columns).sum(axis=0) > 0]
    return out


def _posture_root(angles: Floats) -> Floats:
    distance = ((angles[:, None, :] - angles[None, :, :]) ** 2).sum(axis=-1)
    kernel = np.exp(-0.5 * distance / POSTURE_LENGTH**2) + 1e-9 * np.eye(len(angles))
    out: Floats = np.linalg.cholesky(kernel)
    return out


@dataclass(frozen=True)
class Wildcard:
    """Whitened features, reduced to as many directions as there are readings."""

    root: Floats

    @classmethod
    def of(cls, problem: Problem) -> Wildcard:
        """Build the wildcard of a problem's readings."""
        phi = features(problem)
        values, vectors = np.linalg.eigh(phi @ phi.T)
        kept = values > 1e-9 * values.max()
        return cls(vectors[:, kept] * np.sqrt(values[kept]))

    def profile(self, linear: Linear, free: NDArray[np.intp], scale: Floats) -> Floats:
        """Ln N(y; 0, 1 + H P Hᵀ + τ² K) for every amplitude, without its constant.

        Args:
            linear: the straightened model.
            free: indices of the free parameters.
            scale: (free,) factors on their priors' widths.
        """
        h = linear.h[:, free] * scale
        factor = np.linalg.cholesky(np.eye(h.shape[1]) + h.T @ h)
        inner = np.linalg.solve(factor, np.column_stack([h.T @ linear.y, h.T @ self.root]))
        y_part, root_part = inner[:, 0], inner[:, 1:]
        quiet = linear.y @ linear.y - y_part @ y_part
        cross = self.root.T @ linear.y - root_part.T @ y_part
        gram = self.root.T @ self.root - root_part.T @ root_part
        values, vectors = np.linalg.eigh(gram)
        values = np.maximum(values, 0.0)
        seen = (vectors.T @ cross) ** 2
        tau2 = AMPLITUDES_N[:, None] ** 2
        explained = (tau2 * seen / (1.0 + tau2 * values)).sum(axis=1)
        return np.asarray(
            -0.5 * (quiet - explained) - 0.5 * np.log1p(tau2 * values).sum(axis=1) - np.log(np.diag(factor)).sum()
        )


def log_marginal(profile: Floats, scale_N: float) -> tuple[float, float]:
    """Log evidence over a half-normal amplitude of a given size, and the most probable amplitude [N]."""
    amplitude = AMPLITUDES_N
    edges = np.concatenate([[0.0], np.sqrt(np.maximum(amplitude[1:-1] * amplitude[2:], 0.0)), [amplitude[-1] * 2.0]])
    edges = np.insert(edges, 1, amplitude[1] / 2.0)
    weight = _half_normal(edges[1:] / scale_N) - _half_normal(edges[:-1] / scale_N)
    log_weight = np.log(np.maximum(weight, 1e-300))
    total = profile + log_weight
    return float(logsumexp(total)), float(amplitude[int(np.argmax(total))])


def log_marginal_any(profile: Floats, least_N: float) -> tuple[float, float]:
    """Log evidence over an amplitude that may be anything above the least, flat in its logarithm."""
    chosen = least_N <= AMPLITUDES_N
    total = np.where(chosen, profile, -np.inf) - np.log(chosen.sum())
    return float(logsumexp(total)), float(AMPLITUDES_N[int(np.argmax(total))])


def _half_normal(x: Floats) -> Floats:
    from scipy.special import erf

    out: Floats = erf(x / np.sqrt(2.0))
    return out


def rms_of(observations: Observations, rows: NDArray[np.intp], change: Floats) -> float:
    """Root mean square [N] of a change (n, 6) of readings over the fitted force components that it touches."""
    values = change.reshape(-1)[rows[rows % 6 < 3]]
    touched = np.abs(values) > 0.05 * max(np.abs(values).max(initial=0.0), 1e-12)
    return float(np.sqrt(np.mean(values[touched] ** 2))) if touched.any() else 0.0
