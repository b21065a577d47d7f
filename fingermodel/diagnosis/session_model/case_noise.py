"""Noise that is independent by case."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fingermodel.arrays import Floats, Ints
from fingermodel.diagnosis.session_model.group_errors import GroupErrors
from fingermodel.fitting.roots import root_of

# A reading is never better known than this [N; a tenth of it a N mm].
_LEAST_N = 1e-3


class CaseErrors(NamedTuple):
    """How large noise that is independent by case is."""

    scatter: float  # of the tensions from case to case, relative
    # Of the readings: what is added to the measured one [N; a moment has ten times as many N mm]; where none was
    # measured, a multiple of the assumed one.
    noise: float
    component: float = 0.0  # scatter of each component of the reading, relative to what is expected of it
    direction: float = 0.0  # scatter of the force in every direction: of each component, relative to the force
    angle_rad: float = 0.0  # scatter of each joint angle

    @property
    def variances(self) -> Floats:
        """(kinds,) of scatter: of tensions, components, directions and angles."""
        return np.array([self.scatter, self.component, self.direction, self.angle_rad]) ** 2


class Scatter(NamedTuple):
    """Changes of readings by what scatters from case to case, to first order."""

    by_tension: Floats  # (n, t) when a tendon's tension doubles
    by_angle: Floats  # (n, r) per radian of each joint angle

    def of_kinds(self, at: Ints, unit: Floats) -> Floats:
        """Covariance (kinds, g, L, L) of some rows (g, L) by a scatter of each kind that is 1 (see `CaseErrors`).

        Args:
            at: which rows, by case.
            unit: (g, L) what of each reading counts as much as a newton.
        """
        tension, angle = self.by_tension[at], self.by_angle[at]
        force = np.linalg.norm(tension * (unit == 1.0)[:, :, None], axis=(1, 2))
        return np.array(
            [
                tension @ tension.swapaxes(1, 2),
                _each(tension.sum(axis=2) ** 2),
                _each((force[:, None] * unit) ** 2),
                angle @ angle.swapaxes(1, 2),
            ]
        )


@dataclass(frozen=True, eq=False)
class CaseNoise:
    """Noise that is independent by case: of the readings, by scatter, and of bad cases."""

    # Of cases with equally many rows: (g, L) rows, (g, L, L) measured covariance, and (kinds, g, L, L) by a scatter of
    # each kind that is 1.
    groups: tuple[tuple[Ints, Floats, Floats], ...]
    bad_size: Floats  # (n,) how far a row may be off where its case is bad [N, N mm]
    cases: Ints  # (n,) case of each row
    unit: Floats  # (n,) what of each reading counts as much as a newton
    assumed: bool  # whether the noise is

    @classmethod
    def of(
        cls, blocks: Floats, rows: Ints, scatter: Scatter, unit: Floats, bad_size: Floats, assumed: bool
    ) -> CaseNoise:
        """Sort readings by case.

        Args:
            blocks: (cases, 6, 6) covariance of each case.
            rows: (n,) indices of the readings into the flattened (cases, 6) wrench, ascending.
            scatter: of them.
            unit: (n,).
            bad_size: (n,).
            assumed: whether the blocks are.
        """
        cases, axis = rows // 6, rows % 6
        _, first, count = np.unique(cases, return_index=True, return_counts=True)
        groups = []
        for size in dict.fromkeys(count.tolist()):
            at = first[count == size, None] + np.arange(size)
            own = blocks[cases[at][:, :, None], axis[at][:, :, None], axis[at][:, None, :]]
            own = own + _each((_LEAST_N * unit[at]) ** 2)
            groups.append((at, own, scatter.of_kinds(at, unit[at])))
        return cls(tuple(groups), bad_size, cases, unit, assumed)

    def covariances(self, errors: CaseErrors, bad: Collection[int]) -> list[tuple[Ints, Floats]]:
        """Rows (g, L) and covariance (g, L, L) of each group, by errors of some size, where some cases are bad."""
        out = []
        for rows, measured, of_kinds in self.groups:
            is_bad = np.isin(self.cases[rows[:, 0]], list(bad))
            blocks = as_read(measured, self.unit[rows], errors.noise, self.assumed)
            blocks = blocks + np.tensordot(errors.variances, of_kinds, 1)
            out.append((rows, blocks + _each(is_bad[:, None] * self.bad_size[rows] ** 2)))
        return out

    def whitening(self, errors: CaseErrors, bad: Collection[int]) -> tuple[list[tuple[Ints, Floats]], float]:
        """Inverse roots (g, L, L) of the same, and ln det of the whole covariance."""
        out, log_det = [], 0.0
        for rows, blocks in self.covariances(errors, bad):
            roots = root_of(blocks)
            log_det += 2.0 * float(np.log(np.diagonal(roots, axis1=1, axis2=2)).sum())
            out.append((rows, np.asarray(np.linalg.inv(roots), dtype=np.float64)))
        return out, log_det


def as_read(blocks: Floats, unit: Floats, noise: float, assumed: bool) -> Floats:
    """Covariance (…, L, L) of readings as large as the readings have it.

    Args:
        blocks: (…, L, L) measured or assumed.
        unit: (…, L) what of each reading counts as much as a newton.
        noise: how large it is (see `CaseErrors`).
        assumed: whether the blocks are.
    """
    return noise**2 * blocks if assumed else blocks + _each((noise * unit) ** 2)


def by_case(mean: Floats, unit: Floats, errors: CaseErrors, groups: GroupErrors) -> Floats:
    """Covariance (n, L, L) of scatter from case to case of readings that are expected, each clamped anew.

    All tensions scatter alike, and angles turn the force. A tip that is held elsewhere gives it a lever.

    Args:
        mean: (n, L) what is expected [N, N mm].
        unit: (L,) what of each reading counts as much as a newton.
        errors: how large they are.
        groups: errors of each weight and line, and of zero and mounting in each setting.
    """
    is_force = unit == 1.0
    force = np.linalg.norm(mean * is_force, axis=1)[:, None]
    aside = np.linalg.norm([errors.direction, errors.angle_rad, groups.line_rad, groups.turn_rad])
    lever_mm = groups.hold_mm * ~is_force
    out: Floats = (errors.scatter**2 + groups.weight**2) * mean[:, :, None] * mean[:, None, :]
    of_each = (errors.component * mean) ** 2 + (aside * force * unit) ** 2 + (lever_mm * force) ** 2
    return out + _each(of_each + (groups.zero_N**2 + groups.drift_N**2) * unit**2)


def _each(variance: Floats) -> Floats:
    """Diagonal covariance (…, L, L) of variances (…, L)."""
    return variance[..., None] * np.eye(variance.shape[-1])
