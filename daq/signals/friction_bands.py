"""The band of the rig's friction: the factor c on unloading against that on loading, of the same weights.

Friction in the rig's pulleys takes from the weights on loading and adds to them on unloading. Half the difference of
the two factors is how much it takes; their mean is what is left when it takes nothing, as after tapping the rig.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.measured import MeasuredSession
from daq.signals.friction_case import FrictionCase

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class FrictionBand:
    """Loading against unloading in one posture with one set of weights.

    Attributes:
        session: id; specimen: id.
        posture: name.
        masses_g: on each tendon.
        loading, unloading: c of each; tapped: after tapping the rig, None where that was not measured.
        mean: of loading and unloading.
        half_difference: (unloading − loading) / 2.
        half_difference_sd: its standard uncertainty from the readings alone, None where they state none.
    """

    session: str
    specimen: str
    posture: str
    masses_g: dict[str, float]
    loading: float
    unloading: float
    tapped: float | None
    mean: float
    half_difference: float
    half_difference_sd: float | None


@dataclass(frozen=True)
class BandMean:
    """Mean over bands.

    Attributes:
        n: bands; specimens: among which they are.
        mean: of loading and unloading.
        half_difference: (unloading − loading) / 2; sd: between bands (n − 1), None for one.
        sem: standard uncertainty of the half difference, clustered by specimen where there are several.
        low, high: its 95 % interval by Student's t; freedom: degrees of freedom.
    """

    n: int
    specimens: int
    mean: float
    half_difference: float
    sd: float | None
    sem: float | None
    low: float | None
    high: float | None
    freedom: int


@dataclass(frozen=True)
class Spread:
    """Mean of values in groups, and how well it is known."""

    mean: float
    sd: float | None
    sem: float | None
    low: float | None
    high: float | None
    freedom: int


def spread(groups: Sequence[Sequence[float]]) -> Spread:
    """Average values; over several groups the deviations of one group are summed before they are squared."""
    from scipy.special import stdtrit

    values = np.array([v for group in groups for v in group])
    n, clusters = len(values), len(groups)
    mean = float(values.mean())
    sd = float(values.std(ddof=1)) if n > 1 else None
    if clusters > 1:
        sums = np.array([sum(v - mean for v in group) for group in groups])
        sem: float | None = float(np.sqrt(clusters / (clusters - 1) * (sums**2).sum())) / n
        freedom = clusters - 1
    else:
        sem = None if sd is None else sd / float(np.sqrt(n))
        freedom = n - 1
    half = None if sem is None else float(stdtrit(freedom, 0.975)) * sem
    low, high = (None, None) if half is None else (mean - half, mean + half)
    return Spread(mean, sd, sem, low, high, freedom)


def bands(
    measured: MeasuredSession, cases: Sequence[FrictionCase], slopes: Sequence[Mapping[int, Floats]]
) -> list[FrictionBand]:
    """Compare loading with unloading in a session.

    Args:
        measured: the session.
        cases: its force balances.
        slopes: of each case's c by the force (3,) of each measured case that is in it.
    """
    groups: dict[tuple[object, ...], dict[str, int]] = {}
    for i, case in enumerate(cases):
        groups.setdefault((case.posture, tuple(case.masses_g.items())), {})[case.direction] = i
    out = []
    for at in groups.values():
        if not {"loading", "unloading"} <= set(at):
            continue
        down, up = cases[at["loading"]], cases[at["unloading"]]
        # A tare that both were measured against is in both, and goes out.
        change = dict(slopes[at["unloading"]]) | {k: -v for k, v in slopes[at["loading"]].items()}
        stated = down.factor_sd is not None and up.factor_sd is not None
        out.append(
            FrictionBand(
                session=down.session,
                specimen=down.specimen,
                posture=down.posture,
                masses_g=down.masses_g,
                loading=down.factor,
                unloading=up.factor,
                tapped=cases[at["tapped"]].factor if "tapped" in at else None,
                mean=0.5 * (down.factor + up.factor),
                half_difference=0.5 * (up.factor - down.factor),
                half_difference_sd=0.5 * _sd(measured, change) if stated else None,
            )
        )
    return out


def band_mean(found: Sequence[FrictionBand]) -> BandMean | None:
    """Average bands, None without any."""
    if not found:
        return None
    by_specimen: dict[str, list[float]] = {}
    for band in found:
        by_specimen.setdefault(band.specimen, []).append(band.half_difference)
    s = spread(list(by_specimen.values()))
    mean = float(np.mean([b.mean for b in found]))
    return BandMean(len(found), len(by_specimen), mean, s.mean, s.sd, s.sem, s.low, s.high, s.freedom)


def _sd(measured: MeasuredSession, slopes: Mapping[int, Floats]) -> float:
    """Return the standard uncertainty of a value with these slopes by the forces, shared errors included."""
    indices = list(slopes)
    n = len(indices)
    covariance = measured.covariance(indices).reshape(n, 6, n, 6)[:, :3, :, :3].reshape(3 * n, 3 * n)
    gradient = np.concatenate([slopes[i] for i in indices])
    return float(np.sqrt(max(gradient @ covariance @ gradient, 0.0)))
