"""Noise that is independent by case."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fingermodel.fitting.roots import root_of

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]

# A reading is never better known than this [N; a tenth of it a N mm].
_LEAST_N = 1e-3


@dataclass(frozen=True, eq=False)
class CaseNoise:
    """Noise that is independent by case: of the readings, by scatter of the tensions, and of bad cases.

    One number says how large the noise of the readings is: what is added to the measured one [N; a moment has ten times
    as many N mm]; where none was measured, a multiple of the assumed one.

    Attributes:
        groups: of cases with equally many rows: (g, L) rows, (g, L, L) measured covariance, (g, L, t) scatter columns.
        bad_size: (n,) how far a row may be off where its case is bad [N, N mm].
        cases: (n,) case of each row.
        unit: (n,) what of each reading counts as much as a newton.
        assumed: whether the noise is.
    """

    groups: tuple[tuple[Rows, Floats, Floats], ...]
    bad_size: Floats
    cases: Rows
    unit: Floats
    assumed: bool

    @classmethod
    def of(
        cls, blocks: Floats, rows: Rows, scatter: Floats, unit: Floats, bad_size: Floats, assumed: bool
    ) -> CaseNoise:
        """Sort readings by case.

        Args:
            blocks: (cases, 6, 6) covariance of each case.
            rows: (n,) indices of the readings into the flattened (cases, 6) wrench.
            scatter: (n, t) change of each reading when a tendon's tension doubles, to first order.
            unit: (n,).
            bad_size: (n,).
            assumed: whether the blocks are.
        """
        cases, axis = rows // 6, rows % 6
        by_size: dict[int, list[Rows]] = {}
        for case in np.unique(cases):
            of_case = np.flatnonzero(cases == case)
            by_size.setdefault(len(of_case), []).append(of_case)
        groups = []
        for rows_of in by_size.values():
            at = np.array(rows_of)
            own = blocks[cases[at][:, :, None], axis[at][:, :, None], axis[at][:, None, :]]
            own = own + _each((_LEAST_N * unit[at]) ** 2)
            groups.append((at, own, scatter[at]))
        return cls(tuple(groups), bad_size, cases, unit, assumed)

    def covariances(self, scatter: float, noise: float, bad: Collection[int]) -> list[tuple[Rows, Floats]]:
        """Rows and covariance (g, L, L) of each group.

        Args:
            scatter: of the tensions from case to case, relative.
            noise: how large it is.
            bad: cases whose reading may be anything.
        """
        out = []
        for rows, measured, by_tension in self.groups:
            blocks = as_read(measured, self.unit[rows], noise, self.assumed)
            is_bad = np.isin(self.cases[rows[:, 0]], list(bad))
            blocks = blocks + scatter**2 * by_tension @ by_tension.swapaxes(1, 2)
            out.append((rows, blocks + _each(is_bad[:, None] * self.bad_size[rows] ** 2)))
        return out

    def whitening(self, scatter: float, noise: float, bad: Collection[int]) -> tuple[list[tuple[Rows, Floats]], float]:
        """Inverse roots (g, L, L) of the same, and ln det of the whole covariance."""
        out, log_det = [], 0.0
        for rows, blocks in self.covariances(scatter, noise, bad):
            roots = root_of(blocks)
            log_det += 2.0 * float(np.log(np.diagonal(roots, axis1=1, axis2=2)).sum())
            out.append((rows, np.asarray(np.linalg.inv(roots), dtype=np.float64)))
        return out, log_det


def as_read(blocks: Floats, unit: Floats, noise: float, assumed: bool) -> Floats:
    """Covariance (…, L, L) of readings as large as the readings have it.

    Args:
        blocks: (…, L, L) measured or assumed.
        unit: (…, L) what of each reading counts as much as a newton.
        noise: how large it is (see `CaseNoise`).
        assumed: whether the blocks are.
    """
    return noise**2 * blocks if assumed else blocks + _each((noise * unit) ** 2)


def _each(variance: Floats) -> Floats:
    """Diagonal covariance (…, L, L) of variances (…, L)."""
    out: Floats = variance[..., None] * np.eye(variance.shape[-1])
    return out
