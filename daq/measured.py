"""Measured bench session: one wrench a load case, with the covariance that shared tares give them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from daq.errors import SessionError
from daq.recordings.plateaus import Plateau
from daq.recordings.windows import Span
from daq.sessions.models import LoadCase, Session

Floats = NDArray[np.float64]

# Of a reading [N, N mm] in a digest: below what cells resolve, above what computers differ by.
_DIGITS = 4


@dataclass(frozen=True, eq=False)
class Tare:
    """An unloaded reading that one or more load cases are measured against.

    Attributes:
        mean: (6,) wrench [N, N mm] in mount axes.
        covariance: (6, 6) of it.
        mid_s: middle of its window [s].
        location: of the cell.
        window_s: the window.
    """

    mean: Floats
    covariance: Floats
    mid_s: float
    location: str = "tip"
    window_s: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, eq=False)
class MeasuredCase:
    """The wrench that the finger exerted on the cell in one load case.

    Attributes:
        case: what was set.
        wrench: (6,) [N, N mm] in mount axes, right-hand-equivalent; NaN moments where none was read.
        covariance: (6, 6) of the loaded reading alone (plateau, quantisation, drift between two tares); the tares' part
            is shared between cases and comes with `MeasuredSession.covariance`.
        loaded_mid_s: middle of the loaded window; unloaded_mid_s: of the tare before.
        steady: whether the plateau was, None where that is open.
        plateau: the reduced loaded window, in the cell's axes.
        has_torque: whether the torque was read.
        noise_stated: whether the covariance says anything: not for averaged forces without an uncertainty.
        to_other_mount: (6, 6) makes of the wrench what it is if the cell was at the other mount.
    """

    case: LoadCase
    wrench: Floats
    covariance: Floats
    loaded_mid_s: float | None
    unloaded_mid_s: float | None
    steady: bool | None
    plateau: Plateau | None
    has_torque: bool
    noise_stated: bool
    to_other_mount: Floats = field(default_factory=lambda: np.eye(6))


@dataclass(frozen=True, eq=False)
class MeasuredCheck:
    """A known weight hung on the cell, and what the cell made of it.

    Attributes:
        force_N: (3,) the weight's true pull on the cell, in mount axes.
        wrench: (6,) measured, tare removed [N, N mm].
        covariance: (6, 6) of it.
        when: before, during or after the session.
        mount: tip or bone.
        mass_g: of the weight.
        mounting: how many times the cell had been moved there.
    """

    force_N: Floats
    wrench: Floats
    covariance: Floats
    when: str
    mount: str
    mass_g: float
    mounting: int = 0


@dataclass(frozen=True)
class EstimatedTension:
    """The friction correction c of a session, estimated from its own cases.

    Attributes:
        value: tension = c m g; sd: its standard uncertainty.
        pairs: balances of tip and bone readings that it rests on; above_one: those with more tension than weight.
        constant_N: force that does not grow with the weight, along the tendons; constant_sd_N: of it.
    """

    value: float
    sd: float
    pairs: int
    above_one: int
    constant_N: float
    constant_sd_N: float


@dataclass(frozen=True, eq=False)
class MeasuredSession:
    """A bench session as wrenches.

    Attributes:
        session: what was set.
        cases: n load cases, in the session's order, without those that it excludes.
        tares: that the cases share.
        tare_weights: (n, tares) share of each tare in what was taken from each case; 1 for one tare, 1 − a and a
            between two, nothing for an averaged force.
        checks: with known weights.
        tension_factor: the friction correction c: tension = c m g.
        tension_factor_source: where it comes from.
        estimated_tension: the same with its uncertainty, where it was estimated from the cases; None where stated.
        notes: what the reader of the results should know, such as converted units.
        creep: share of its force by which a loaded reading usually changes within its window; 0 where that is noise.
        dead_forces: the cell's force channels that never change, in any window.
        plateaus: of all windows, from which the wrenches were made.
        tension_case_sd: scatter of tensions from case to case, relative, where the budget leaves that to the session's
            own forces; 0 where it does not, or these do not tell.
    """

    session: Session
    cases: tuple[MeasuredCase, ...]
    tares: tuple[Tare, ...]
    tare_weights: Floats
    checks: tuple[MeasuredCheck, ...]
    tension_factor: float
    tension_factor_source: str
    notes: tuple[str, ...]
    creep: float = 0.0
    tension_case_sd: float = 0.0
    estimated_tension: EstimatedTension | None = None
    dead_forces: tuple[str, ...] = ()
    plateaus: Mapping[Span, Plateau] = field(default_factory=dict, repr=False)

    @property
    def tension_factor_rel_sd(self) -> float:
        """Relative standard uncertainty of the friction correction; 0 where it was stated."""
        estimate = self.estimated_tension
        return 0.0 if estimate is None else estimate.sd / estimate.value

    def require_forces(self) -> None:
        """Refuse to fit a force that was not read: its zeros would be taken for measured ones.

        Raises:
            SessionError: a force channel that never changes.
        """
        if self.dead_forces:
            raise SessionError(
                f"{self.session.readings}: {', '.join(self.dead_forces)} never changes in any window",
                "the noise of a live channel",
                "Look for a broken wire, or a column that was filled in",
            )

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of what a fit takes of it: what was set in each case, and what was read."""
        postures = self.session.postures_deg
        cases = [
            [c.id, c.role, c.location, c.posture, c.setting, c.mounting, c.masses_g, _rounded(m.wrench)]
            for m in sorted(self.cases, key=lambda m: m.case.id)
            for c in (m.case,)
        ]
        said = {
            "cases": cases,
            "postures_deg": {name: postures[name].model_dump() for name in {m.case.posture for m in self.cases}},
            "checks": [[c.mount, c.mounting, _rounded(c.force_N), _rounded(c.wrench)] for c in self.checks],
            "pull_N_per_kg": round(self.tension_factor * self.session.gravity_m_s2, _DIGITS),
        }
        return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()

    def covariance(self, indices: Sequence[int] | None = None) -> Floats:
        """Return the covariance (6 n, 6 n) of the wrenches, one after another: own parts and shared tares.

        Args:
            indices: of the cases wanted, in that order; all of them by default.
        """
        chosen = np.arange(len(self.cases)) if indices is None else np.asarray(indices, dtype=int)
        n = len(chosen)
        out = np.zeros((n, 6, n, 6))
        for row, index in enumerate(chosen):
            out[row, :, row, :] = self.cases[index].covariance
        weights, axes = self.tare_weights[chosen], np.arange(6)
        # Of many cases few share a tare, and one case has two at most.
        for index in np.flatnonzero(weights.any(axis=0)):
            rows = np.flatnonzero(weights[:, index])
            shares = np.outer(weights[rows, index], weights[rows, index])
            out[np.ix_(rows, axes, rows, axes)] += np.einsum("ij,ab->iajb", shares, self.tares[index].covariance)
        return out.reshape(6 * n, 6 * n)

    def standard_uncertainties(self) -> Floats:
        """Return those of the wrenches (n, 6) [N, N mm], shared tares included."""
        out = np.array([m.covariance.diagonal() for m in self.cases]).reshape(-1, 6)
        for tare, weights in zip(self.tares, self.tare_weights.T, strict=True):
            rows = np.flatnonzero(weights)
            out[rows] += weights[rows, None] ** 2 * tare.covariance.diagonal()
        return np.sqrt(out)

    def case_covariance(self, index: int) -> Floats:
        """Return the covariance (6, 6) of one case's wrench, its tares included."""
        return self.covariance([index])


def _rounded(values: Floats) -> list[float]:
    # Zero has no sign.
    return [round(float(v), _DIGITS) + 0.0 for v in values]
