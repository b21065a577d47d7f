"""The friction correction c by force balance (Synek et al. 2019, PeerJ 7:e7470, Eq 1): tension = c m g.

For a posture and weights measured at both mounts, the tip force turned into the metacarpal's axes and the bone force
together balance the tendons. c = ‖R F_tip + F_bone‖ / (Σ m g). The norm is biased upwards by noise and misalignment, so
the balance along the metacarpal's axis v = +x and across it are given too. Readings on loading, on unloading and after
tapping the rig are kept apart.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.errors import SessionError
from daq.measured import MeasuredSession
from daq.signals.balance import Balance, balances
from daq.signals.friction_bands import BandMean, FrictionBand, band_mean, bands, spread
from daq.signals.friction_case import FrictionCase

Floats = NDArray[np.float64]
SCHEMA = "fingertwin/friction/1"
DIRECTIONS = ("loading", "unloading", "tapped")


@dataclass(frozen=True)
class FrictionMean:
    """Mean of c over cases.

    Attributes:
        name: of the specimen or direction, or `pooled`.
        n: cases; specimens: among which they are.
        factor: mean c; sd: between cases (n − 1), None for one case.
        sem: standard uncertainty of the mean; pooled over specimens, it is clustered by specimen.
        low, high: 95 % interval by Student's t.
        freedom: its degrees of freedom: cases − 1 for one specimen, specimens − 1 when pooled.
        along, across: means of those.
        above_one: cases with c > 1.
    """

    name: str
    n: int
    specimens: int
    factor: float
    sd: float | None
    sem: float | None
    low: float | None
    high: float | None
    freedom: int
    along: float
    across: float
    above_one: int


@dataclass(frozen=True)
class FrictionResult:
    """Friction per case, per specimen and pooled.

    Attributes:
        cases: in the order of the sessions.
        specimens: one mean each, in order of first appearance.
        pooled: over all cases.
        sem_unclustered: sd / √n, as if the cases were independent.
        sd_population: sd with n in the denominator.
        directions: one mean each, where any case is unloading or tapped.
        bands: of each set of weights that was read on loading and on unloading; band: their mean, None without any.
        unpaired: `session: posture, masses` that lack a tip or a bone reading.
        notes: what limits the numbers.
    """

    cases: tuple[FrictionCase, ...]
    specimens: tuple[FrictionMean, ...]
    pooled: FrictionMean
    sem_unclustered: float | None
    sd_population: float
    directions: tuple[FrictionMean, ...]
    bands: tuple[FrictionBand, ...]
    band: BandMean | None
    unpaired: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def factor(self) -> float:
        """The pooled c."""
        return self.pooled.factor

    @property
    def n(self) -> int:
        """Number of cases."""
        return self.pooled.n

    def as_dict(self) -> dict[str, Any]:
        """Return the answer as plain data; c is a ratio and has no unit."""
        return {"schema": SCHEMA, **asdict(self)}


def friction(sessions: Sequence[MeasuredSession]) -> FrictionResult:
    """Find the friction correction of measured sessions.

    Args:
        sessions: measured; those of one specimen are counted together.

    Raises:
        SessionError: no posture and weights were measured at both tip and bone.
    """
    cases: list[FrictionCase] = []
    both: list[FrictionBand] = []
    unpaired: list[str] = []
    notes: list[str] = []
    for measured in sessions:
        pairs, alone = balances(measured)
        found, slopes = _cases(measured, pairs)
        cases += found
        both += bands(measured, found, slopes)
        unpaired += alone
        if any(p.abduction for p in measured.session.postures_deg.values()):
            notes.append(f"{measured.session.id}: turned by Rz(MCP) Ry(abduction) Rz(PIP + DIP)")
    if not cases:
        names = ", ".join(m.session.id for m in sessions) or "none"
        raise SessionError(
            f"no pair of tip and bone cases with the same posture and masses in {names}",
            "at least one such pair",
            "Measure a load case at both mounts, or state tension_factor as a number",
        )
    groups = _by_specimen(cases)
    pooled = _mean("pooled", groups)
    if len(groups) == 1:
        notes.append("one specimen: the interval is that of its cases and says nothing of other specimens")
    if pooled.above_one:
        notes.append(f"c > 1 in {pooled.above_one} of {pooled.n} cases, which friction cannot explain")
    band = band_mean(both)
    if band is not None and band.high is not None and band.high < 0.0:
        notes.append("c is less on unloading than on loading, as friction never has it: were the directions exchanged?")
    apart = {d: [c for c in cases if c.direction == d] for d in DIRECTIONS}
    mixed = len(apart["loading"]) < len(cases)
    if len(apart["unloading"]) == len(cases):
        notes.append("all cases are on unloading, where friction adds to the weights: c is too large by that")
    elif mixed:
        counts = ", ".join(f"{len(of)} {d}" for d, of in apart.items() if of)
        notes.append(f"the means take all directions together: {counts}")
    factors = np.array([c.factor for c in cases])
    return FrictionResult(
        cases=tuple(cases),
        specimens=tuple(_mean(group[0].specimen, [group]) for group in groups),
        pooled=pooled,
        sem_unclustered=None if pooled.sd is None else pooled.sd / float(np.sqrt(pooled.n)),
        sd_population=float(factors.std()),
        directions=tuple(_mean(d, _by_specimen(of)) for d, of in apart.items() if of and mixed),
        bands=tuple(both),
        band=band,
        unpaired=tuple(unpaired),
        notes=tuple(notes),
    )


def _cases(measured: MeasuredSession, found: Sequence[Balance]) -> tuple[list[FrictionCase], list[dict[int, Floats]]]:
    """Return c of each balance, and its slopes by the forces (3,) of the cases."""
    session = measured.session
    cases, slopes = [], []
    for b in found:
        unit, weight = b.direction_of_pull, b.weight_N
        slopes.append(
            {i: unit @ b.turn / (weight * len(b.tip)) for i in b.tip}
            | {i: unit / (weight * len(b.bone)) for i in b.bone}
        )
        cases.append(
            FrictionCase(
                session=session.id,
                specimen=session.specimen.id,
                posture=b.posture,
                masses_g=dict(b.masses_g),
                direction=b.direction,
                tip_cases=tuple(measured.cases[i].case.id for i in b.tip),
                bone_cases=tuple(measured.cases[i].case.id for i in b.bone),
                weight_N=weight,
                factor=b.tension_N / weight,
                factor_sd=None if b.variance_N2 is None else float(np.sqrt(b.variance_N2)) / weight,
                along=float(b.force_N[0]) / weight,
                across=float(np.hypot(b.force_N[1], b.force_N[2])) / weight,
                above_one=b.above_one,
            )
        )
    return cases, slopes


def _by_specimen(cases: Sequence[FrictionCase]) -> list[list[FrictionCase]]:
    out: dict[str, list[FrictionCase]] = defaultdict(list)
    for case in cases:
        out[case.specimen].append(case)
    return list(out.values())


def _mean(name: str, groups: Sequence[Sequence[FrictionCase]]) -> FrictionMean:
    """Average c over the cases of specimens."""
    cases = [c for group in groups for c in group]
    c = spread([[case.factor for case in group] for group in groups])
    return FrictionMean(
        name=name,
        n=len(cases),
        specimens=len(groups),
        factor=c.mean,
        sd=c.sd,
        sem=c.sem,
        low=c.low,
        high=c.high,
        freedom=c.freedom,
        along=float(np.mean([c.along for c in cases])),
        across=float(np.mean([c.across for c in cases])),
        above_one=sum(c.above_one for c in cases),
    )
