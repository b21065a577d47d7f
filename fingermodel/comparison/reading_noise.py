"""Covariance of a session's readings: a block of each case, and the tares that several cases share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.measured import MeasuredSession, Tare

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SharedTare:
    """A tare that several cases were measured against.

    Attributes:
        cases: (m,) their indices.
        columns: (m, 6, 6) a case's part in it; the parts' products are what the cases' readings have in common.
    """

    cases: NDArray[np.intp]
    columns: Floats


@dataclass(frozen=True, eq=False)
class Noise:
    """Covariance of n readings, whose size grows with n and not with its square.

    Attributes:
        blocks: (n, 6, 6) of each case [N, N mm], shared tares included.
        shared: tares of several cases.
    """

    blocks: Floats
    shared: tuple[SharedTare, ...] = ()

    @property
    def alone(self) -> Floats:
        """(n, 6, 6) of each case, without the tares that it shares with others."""
        out = self.blocks.copy()
        for tare in self.shared:
            out[tare.cases] -= tare.columns @ tare.columns.swapaxes(1, 2)
        return out

    @property
    def variance(self) -> Floats:
        """(6 n,) of each reading."""
        return np.diagonal(self.blocks, axis1=1, axis2=2).reshape(-1).copy()

    def of(self, rows: NDArray[np.intp]) -> Floats:
        """(k, k) covariance of some readings, given by their indices among the 6 n."""
        case, axis = rows // 6, rows % 6
        out = np.zeros((len(rows), len(rows)))
        for tare in self.shared:
            at = np.flatnonzero(np.isin(case, tare.cases))
            columns = tare.columns[np.searchsorted(tare.cases, case[at]), axis[at]]
            out[np.ix_(at, at)] += columns @ columns.T
        same = case[:, None] == case
        out[same] = self.blocks[case[:, None], axis[:, None], axis][same]
        return out

    @property
    def tares(self) -> Floats:
        """(6 n, 6 tares) columns whose sum of squares is what the shared tares contribute."""
        out = np.zeros((len(self.blocks), 6, len(self.shared), 6))
        for k, tare in enumerate(self.shared):
            out[tare.cases, :, k, :] = tare.columns
        return out.reshape(6 * len(self.blocks), 6 * len(self.shared))

    def turned(self, turn: Floats) -> Noise:
        """Return the covariance of the readings after each was multiplied by a matrix (n, 6, 6)."""
        shared = tuple(SharedTare(t.cases, turn[t.cases] @ t.columns) for t in self.shared)
        return Noise(turn @ self.blocks @ np.swapaxes(turn, 1, 2), shared)


def noise_of(measured: MeasuredSession, spread: Floats) -> Noise:
    """Return the covariance of a session's cases, then of its checks.

    Args:
        measured: the session.
        spread: (6, 6) of averaged readings that state no uncertainty; a case can state that of its force alone.
    """
    cases, count = measured.cases, len(measured.cases)
    blocks = np.zeros((count + len(measured.checks), 6, 6))
    for i, m in enumerate(cases):
        blocks[i] = m.covariance
        if m.plateau is None:
            unstated = 3 if m.noise_stated else 0
            blocks[i, unstated:, unstated:] += spread[unstated:, unstated:]
    for i, check in enumerate(measured.checks):
        blocks[count + i] = check.covariance
    shared = []
    for tare, weights in zip(measured.tares, measured.tare_weights.T, strict=True):
        of = np.flatnonzero(weights)
        # The same to the last digit whether or not another case shares it: a force is not told anew for that.
        blocks[of] += weights[of, None, None] ** 2 * tare.covariance
        if len(of) > 1:
            shared.append(SharedTare(of, weights[of, None, None] * _root(tare)))
    return Noise(blocks, tuple(shared))


def _root(tare: Tare) -> Floats:
    if not np.count_nonzero(tare.covariance - np.diag(np.diag(tare.covariance))):
        return np.asarray(np.sqrt(np.maximum(np.diag(tare.covariance), 0.0)) * np.eye(6))
    values, vectors = np.linalg.eigh(tare.covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
