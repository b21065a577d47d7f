"""What would decide between the laws that a shared curve resembles: load cases, and what is read beside the forces.

Each law says what a load case would read, with its value and interval; all else is as unknown as the session leaves it.
A reading is worth the mutual information [nat] between law and reading (Lindley 1956).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import softmax

from fingermodel.arrays import Floats
from fingermodel.comparison.comparison import muscles_of
from fingermodel.diagnosis.diagnose import Diagnosis
from fingermodel.diagnosis.next_cases.next_cases import (
    PlannedReading,
    expected,
    feasible,
    information,
    inputs_of,
)
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.reading_changes import CaseChanges
from fingermodel.diagnosis.settings import WORTH_NAT
from fingermodel.diagnosis.several_sessions.shared_laws import SharedLaw
from fingermodel.diagnosis.verdict.hints import library
from fingermodel.fitting.identification import SEED
from fingermodel.stages import LoadCaseInput

# What is read: forces alone; Mz as well; forces where radiographs give the joint angles.
READINGS = ("forces", "forces and Mz at the tip", "forces, and joint angles by radiograph")
_MZ = 5
_LAWS, _SHOWN = 6, 5
# Readings drawn by each law: the order of the best is to be right.
_DRAWS = 500
# Change (cases, 6) by a law, and its standard deviation.
Change = tuple[Floats, Floats]


@dataclass(frozen=True)
class Deciding:
    """A reading that would part the laws."""

    case: PlannedReading  # what to hang where
    reading: str  # one of READINGS
    information_nat: float  # between law and reading

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
    slopes = {law.text: law.slopes for law in library(planned, fit.theta) if law.text in texts}
    leading = [law for law in laws if law.name in slopes][:_LAWS]
    if not leading:
        return (), ()
    first = leading[0]
    names = list(dict.fromkeys([first.name, *(r for r in first.rivals if r in slopes), *(w.name for w in leading)]))[
        :_LAWS
    ]
    prior = softmax([float(live.get(name, first).left_out_gain.sum()) for name in names])
    changes = [_change(slopes[n], live.get(n), slopes[first.name], first) for n in names]
    return _ranked(fit, cases, planned.inputs, changes, prior), tuple(names)


def _change(slope: Floats, law: SharedLaw | None, leading: Floats, first: SharedLaw) -> Change:
    """Change (cases, 6) by a law and its standard deviation; a rival's value is that which resembles the first most."""
    if law is not None:
        return law.value * slope, law.sd * slope
    ratio = float((slope * leading).sum() / max((slope**2).sum(), 1e-12))
    return first.value * ratio * slope, first.sd * ratio * slope


def _ranked(
    fit: Optimum, cases: Sequence[PlannedReading], inputs: LoadCaseInput, changes: Sequence[Change], prior: Floats
) -> tuple[Deciding, ...]:
    """The most telling readings of those that load the same tendons."""
    rng, best = np.random.default_rng(SEED), dict[tuple[str, ...], Deciding]()
    change, sd = (np.array(both).swapaxes(0, 1) for both in zip(*changes, strict=True))
    for reading in READINGS:
        read = [0, 1, *([] if fit.session.plane == "sagittal" else [2]), *([_MZ] if reading == READINGS[1] else [])]
        # The posture will be set anew: its angles are as unknown as the budget has it, or read from a radiograph.
        anew = 0.0 if reading == READINGS[2] else fit.hyper.values(fit.best).budget
        mean, plain = expected(fit, inputs, read, anew)
        means, sds = mean[:, None] + change[..., read], sd[..., read]
        spreads = plain[:, None] + sds[..., :, None] * sds[..., None, :]
        for k, case in enumerate(cases):
            if reading == READINGS[0] or case.location == "tip":
                told, _ = information(list(zip(means[k], spreads[k], strict=True)), prior, rng, _DRAWS)
                key = (case.posture, case.location, muscles_of(case.masses_g), reading)
                if key not in best or told > best[key].information_nat:
                    best[key] = Deciding(case, reading, told)
    ranked = sorted(best.values(), key=lambda d: -d.information_nat)
    return tuple(d for d in ranked if d.information_nat >= WORTH_NAT)[:_SHOWN]
