"""How far the tensions of a session scatter from case to case, by its own forces: for `budget: estimate`.

While posture and cell stand, forces are a line in each tendon's weight and a constant beside it, whatever the finger.
What that leaves is scatter: unweighed hangers, zeros and friction leave nothing. Its size is that of a median, so that
a slip, or two tendons that are coupled, count little. A zero that is far off makes it too small, never too large.

Nothing else is estimated. What balance and intercepts show of pulleys and zeros may be their fault as well as the small
error of every rig, and a budget as large as the fault would hide it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.measured import MeasuredSession
from daq.signals.balance import direction_of

Floats = NDArray[np.float64]

# Late settling [N], of which a plateau shows nothing.
_SETTLING_N = 0.005
# By what of a scatter of this size it would show, a comparison counts: those of light loads are noise.
_USUAL = 0.01
# With fewer, the scatter is not known to a factor of 1.5, within which a diagnosis believes a stated one.
_COMPARISONS = 12
# Of the square of a standard normal number.
_MEDIAN = 0.4549


def is_asked(budget: str | Mapping[str, Any] | None) -> bool:
    """Whether a session's budget, or the one that its values depart from, leaves the scatter to be estimated."""
    if isinstance(budget, Mapping):
        return budget.get("base") == "estimate" and "tension_factor_case_sd" not in budget
    return budget == "estimate"


def tension_scatter(measured: MeasuredSession) -> tuple[float, str]:
    """Estimate the relative scatter of tensions by identification cases, and say what it rests on; 0 where untold.

    Averaged forces that state no uncertainty are left out: what they differ by may be noise.
    """
    rows = np.array(list(_left_of_lines(measured))).reshape(-1, 4)
    comparisons = round(float(rows[:, 3].sum()))
    if comparisons < _COMPARISONS:
        said = f"not told by {comparisons} comparisons of identification cases, {_COMPARISONS} are needed"
        return 0.0, f"budget estimated: scatter of tensions {said}; the certificate stands"
    scatter = _scatter(*rows.T)
    said = f"{100.0 * scatter:.1f} % from case to case, of {comparisons} comparisons"
    return scatter, f"budget estimated: tensions scatter by {said}; all else is as in the certificate or as stated"


def _left_of_lines(measured: MeasuredSession) -> Iterator[tuple[float, float, float, float]]:
    """Yield of each case along its force: what is left [N], its noise and a unit scatter [N²], how far it counts."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for i, m in enumerate(measured.cases):
        c = m.case
        if c.role == "identification" and m.noise_stated and any(c.masses_g.values()) and m.wrench[:3].any():
            groups.setdefault((c.posture, c.location, c.setting, c.mounting, direction_of(c)), []).append(i)
    for at in groups.values():
        n, hung = len(at), [measured.cases[i].case.masses_g for i in at]
        tendons = sorted({t for h in hung for t, mass in h.items() if mass > 0.0})
        masses = np.array([[h.get(t, 0.0) for t in tendons] for h in hung])
        masses /= masses.max(axis=0)
        loaded = (masses > 0.0).astype(float)
        columns = np.hstack([masses, loaded, np.ones((n, 1))])
        inverse = np.linalg.pinv(columns, rcond=1e-6)
        rest = np.eye(n) - columns @ inverse
        force = np.array([measured.cases[i].wrench[:3] for i in at])
        slope, start, constant = np.split(inverse @ force, [len(tendons), 2 * len(tendons)])
        # Each tendon scatters by itself; what is constant belongs to those that are loaded.
        share = constant / loaded.sum(axis=1)[:, None, None]
        of_tendons = masses[:, :, None] * slope + loaded[:, :, None] * (start + share)
        along = force / np.linalg.norm(force, axis=1, keepdims=True)
        left = np.einsum("ia,ia->i", along, rest @ force)
        covariance = measured.covariance(at).reshape(n, 6, n, 6)[:, :3, :, :3]
        noise = np.einsum("ia,ij,jakb,ik,ib->i", along, rest, covariance, rest, along, optimize=True)
        unit = np.einsum("ij,ijm->i", rest**2, np.einsum("ia,jma->ijm", along, of_tendons) ** 2)
        for i, free in enumerate(rest.diagonal()):
            if free > 1e-6:
                variance = float(noise[i] + _SETTLING_N**2 * free)
                shown = _USUAL**2 * unit[i] / (variance + _USUAL**2 * unit[i])
                yield float(left[i]), variance, float(unit[i]), float(free * shown)


def _scatter(left: Floats, noise: Floats, unit: Floats, weight: Floats) -> float:
    """Return the scatter under which the median of what is left is that which chance gives."""

    def usual(scatter: float) -> float:
        surprise = left**2 / (noise + scatter**2 * unit)
        order = np.argsort(surprise)
        return float(surprise[order][np.searchsorted(np.cumsum(weight[order]), 0.5 * weight.sum())])

    if usual(0.0) <= _MEDIAN:
        return 0.0
    low, high = 0.0, 1.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if usual(middle) > _MEDIAN else (low, middle)
    return high
