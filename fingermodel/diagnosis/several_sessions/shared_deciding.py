"""What would decide between the laws that a shared curve resembles: load cases, and what is read beside the forces.

Each law says what a load case would read, with its value and interval; all else is as unknown as the session leaves it.
A reading is worth the mutual information [nat] between law and reading (Lindley 1956).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from fingermodel.arrays import Floats
from fingermodel.comparison.comparison import muscles_of
from fingermodel.diagnosis.diagnose import Diagnosis
from fingermodel.diagnosis.next_cases.next_cases import (
    PlannedReading,
    feasible,
    information,
    inputs_of,
    most_information,
)
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.case_noise import as_read, by_case
from fingermodel.diagnosis.session_model.reading_changes import CaseChanges
from fingermodel.diagnosis.settings import LEVER_MM, SEED, WORTH_NAT
from fingermodel.diagnosis.several_sessions.shared_laws import SharedLaw
from fingermodel.diagnosis.verdict.hints import library

# What is read: forces alone; Mz as well; forces where radiographs give the joint angles.
READINGS = ("forces", "forces and Mz at the tip", "forces, and joint angles by radiograph")
_MZ = 5
_LAWS, _SHOWN = 6, 5
# Readings drawn by each law: the order of the best is to be right.
_DRAWS = 500
# Step of a slope, in prior widths.
_STEP = 1e-3


@dataclass(frozen=True)
class Deciding:
    """A reading that would part the laws.

    Attributes:
        case: what to hang where.
        reading: one of READINGS.
        information_nat: between law and reading.
    """

    case: PlannedReading
    reading: str
    information_nat: float

    def as_dict(self) -> dict[str, Any]:
        """As the answer gives it."""
        return self.case.as_dict() | {
            "reading": self.reading,
            "information_nat": self.information_nat,
            "text": f"{self.case.words}, {self.reading}: {self.information_nat:.2f} nat",
        }


def deciding(
    diagnosis: Diagnosis, fit: Optimum, laws: Sequence[SharedLaw]
) -> tuple[tuple[Deciding, ...], tuple[str, ...]]:
    """Rank what could be read on a specimen like this one by what it would tell of the laws.

    Args:
        diagnosis: of the session.
        fit: what is known to act in it.
        laws: that are live, with their rivals; formulas alone are held against each other.

    Returns:
        The readings, best first, and the formulas that they would part.
    """
    texts = [law.name for law in laws if law.formula is not None]
    texts += [rival for law in laws for rival in law.rivals]
    live = {law.name: law for law in laws}
    cases = feasible(diagnosis)
    planned = CaseChanges(diagnosis.session.model, inputs_of(diagnosis, cases))
    slopes = {text: change for (_, _, text, _), _, change in library(planned, fit.theta) if text in texts}
    leading = [law for law in laws if law.name in slopes][:_LAWS]
    if not leading:
        return (), ()
    first = leading[0]
    names = list(dict.fromkeys([first.name, *(r for r in first.rivals if r in slopes), *(w.name for w in leading)]))[
        :_LAWS
    ]
    prior = np.array([np.exp(live[n].left_out_gain.sum() if n in live else first.left_out_gain.sum()) for n in names])
    prior /= prior.sum()
    changes = [_change(slopes[n], live.get(n), slopes[first.name], first) for n in names]
    return _ranked(fit, cases, planned, changes, prior), tuple(names)


def _change(slope: Floats, law: SharedLaw | None, leading: Floats, first: SharedLaw) -> tuple[Floats, Floats]:
    """Change (cases, 6) by a law and its standard deviation; a rival's value is that which resembles the first most."""
    if law is not None:
        return law.value * slope, law.sd * slope
    ratio = float((slope * leading).sum() / max((slope**2).sum(), 1e-12))
    return first.value * ratio * slope, first.sd * ratio * slope


def _ranked(
    fit: Optimum,
    cases: Sequence[PlannedReading],
    planned: CaseChanges,
    changes: Sequence[tuple[Floats, Floats]],
    prior: Floats,
) -> tuple[Deciding, ...]:
    session, model = fit.session, planned.model
    theta, covariance, index = fit.parameter_posterior(fit.best)
    slopes = np.empty((len(cases), 6, len(index)))
    for k, i in enumerate(index):
        both = []
        for sign in (1.0, -1.0):
            moved = theta.copy()
            moved[i] += sign * _STEP * session.problem.scale[i]
            both.append(planned.readings(moved))
        slopes[:, :, k] = (both[0] - both[1]) / (2.0 * _STEP)
    values = fit.hyper.values(fit.best)
    mean = planned.readings(theta)
    force = np.nanmedian(np.diagonal(session.observations.case_covariance, axis1=1, axis2=2)[:, :3])
    unit = np.array([1.0, 1.0, 1.0, LEVER_MM, LEVER_MM, LEVER_MM])
    noise = as_read(np.diag(force * unit**2), unit, values.errors.noise, session.observations.noise_assumed)
    of_angle = np.array([model.parameters.names[i].startswith("posture_angle.") for i in index])
    change, sd = (np.array(both).swapaxes(0, 1) for both in zip(*changes, strict=True))
    offers: list[_Offer] = []
    for reading in READINGS:
        read = [0, 1, *([] if session.plane == "sagittal" else [2]), *([_MZ] if reading == READINGS[1] else [])]
        which = [k for k, case in enumerate(cases) if reading == READINGS[0] or case.location == "tip"]
        rest, angles = (slopes[which][:, read][..., chosen] for chosen in (~of_angle, of_angle))
        # The posture will be set anew: its angles are as unknown as the budget has it, or read from a radiograph.
        anew = 0.0 if reading == READINGS[2] else values.budget
        plain = rest @ covariance[np.ix_(~of_angle, ~of_angle)] @ rest.swapaxes(1, 2)
        plain += anew**2 * angles @ angles.swapaxes(1, 2) + noise[np.ix_(read, read)]
        plain += by_case(mean[which][:, read], unit[read], values.errors, values.groups)
        means = (mean[:, None] + change)[which][..., read]
        spreads = plain[:, None] + _outer(sd[which][..., read])
        most = most_information(means, spreads, prior)
        offers += [_Offer(cases[k], reading, *of_case) for k, *of_case in zip(which, means, spreads, most, strict=True)]
    return _best(offers, prior)


class _Offer(NamedTuple):
    """A reading with what each law expects of it: (laws, components), (laws, components, components)."""

    case: PlannedReading
    reading: str
    mean: Floats
    covariance: Floats
    most_nat: float


def _best(offers: Sequence[_Offer], prior: Floats) -> tuple[Deciding, ...]:
    """The most telling of those that load the same tendons; what cannot be among them is not drawn."""
    best: dict[tuple[str, str, str, str], Deciding] = {}
    rng = np.random.default_rng(SEED)
    for offer in sorted(offers, key=lambda o: -o.most_nat):
        if sum(d.information_nat >= offer.most_nat for d in best.values()) >= _SHOWN or offer.most_nat < WORTH_NAT:
            break
        told, _ = information(list(zip(offer.mean, offer.covariance, strict=True)), prior, rng, _DRAWS)
        key = (offer.case.posture, offer.case.location, muscles_of(offer.case.masses_g), offer.reading)
        if key not in best or told > best[key].information_nat:
            best[key] = Deciding(offer.case, offer.reading, told)
    ranked = sorted(best.values(), key=lambda d: -d.information_nat)
    return tuple(d for d in ranked if d.information_nat >= WORTH_NAT)[:_SHOWN]


def _outer(x: Floats) -> Floats:
    return x[..., :, None] * x[..., None, :]
