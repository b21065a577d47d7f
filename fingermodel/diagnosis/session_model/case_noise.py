"""Noise that is independent by case, and columns in its units."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fingermodel.diagnosis.settings import LEVER_MM
from fingermodel.fitting.roots import root_of

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
Mask = NDArray[np.bool_]

# A reading is never better known than this [N; a tenth of it a N mm].
_LEAST_N = 1e-3


@dataclass(frozen=True, eq=False)
class CaseNoise:
    """Noise that is independent by case: as measured, by scatter of the tensions, and of bad cases.

    Attributes:
        groups: of cases with equally many rows: (g, L) rows, (g, L, L) measured covariance, (g, L, t) scatter columns.
        bad_size: (n,) how far a row may be off where its case is bad [N, N mm].
        cases: (n,) case of each row.
    """

    groups: tuple[tuple[Rows, Floats, Floats], ...]
    bad_size: Floats
    cases: Rows

    @classmethod
    def of(cls, blocks: Floats, rows: Rows, scatter: Floats, moment: Mask, bad_size: Floats) -> CaseNoise:
        """Sort readings by case.

        Args:
            blocks: (cases, 6, 6) covariance of each case.
            rows: (n,) indices of the readings into the flattened (cases, 6) wrench.
            scatter: (n, t) change of each reading when a tendon's tension doubles, to first order.
            moment: (n,) whether the reading is a moment.
            bad_size: (n,).
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
            least = _LEAST_N * np.where(moment[at], LEVER_MM, 1.0)
            own = own + (least**2)[:, :, None] * np.eye(len(at[0]))
            groups.append((at, own, scatter[at]))
        return cls(tuple(groups), bad_size, cases)

    def covariances(self, scatter: float, multiple: float, bad: Collection[int]) -> list[tuple[Rows, Floats]]:
        """Rows and covariance (g, L, L) of each group.

        Args:
            scatter: of the tensions from case to case, relative.
            multiple: of the measured noise.
            bad: cases whose reading may be anything.
        """
        out = []
        for rows, measured, by_tension in self.groups:
            blocks = multiple**2 * measured + scatter**2 * by_tension @ by_tension.swapaxes(1, 2)
            is_bad = np.isin(self.cases[rows[:, 0]], list(bad))
            blocks = blocks + (is_bad[:, None] * self.bad_size[rows] ** 2)[:, :, None] * np.eye(rows.shape[1])
            out.append((rows, blocks))
        return out

    def whitening(
        self, scatter: float, multiple: float, bad: Collection[int]
    ) -> tuple[list[tuple[Rows, Floats]], float]:
        """Inverse roots (g, L, L) of the same, and ln det of the whole covariance."""
        out, log_det = [], 0.0
        for rows, blocks in self.covariances(scatter, multiple, bad):
            roots = root_of(blocks)
            log_det += 2.0 * float(np.log(np.diagonal(roots, axis1=1, axis2=2)).sum())
            out.append((rows, np.asarray(np.linalg.inv(roots), dtype=np.float64)))
        return out, log_det


def whitened(roots: list[tuple[Rows, Floats]], columns: Floats) -> Floats:
    """Columns (n, k) or (n,) in units in which the noise by case is independent and of size 1."""
    out = np.empty_like(columns)
    for rows, inverse in roots:
        part = columns[rows] if columns.ndim == 2 else columns[rows][..., None]
        product = inverse @ part
        out[rows] = product if columns.ndim == 2 else product[..., 0]
    return out


@dataclass(frozen=True, eq=False)
class WhitenedSmooth:
    """Smooth columns under one noise by case.

    Attributes:
        roots: inverse roots of the noise by case.
        log_det: of the noise.
        part: (n, k) columns of a block, not whitened.
    """

    roots: list[tuple[Rows, Floats]]
    log_det: float
    part: Callable[[str], Floats]
    _whitened: dict[str, Floats] = field(default_factory=dict, repr=False)
    _inner: dict[tuple[str, str], Floats] = field(default_factory=dict, repr=False)

    def of(self, block: str) -> Floats:
        """(n, k) whitened columns of a block."""
        if block not in self._whitened:
            self._whitened[block] = whitened(self.roots, self.part(block))
        return self._whitened[block]

    def inner(self, a: str, b: str) -> Floats:
        """(k, k) inner products of two blocks."""
        if (a, b) not in self._inner:
            self._inner[a, b] = self.of(a).T @ self.of(b)
        return self._inner[a, b]
