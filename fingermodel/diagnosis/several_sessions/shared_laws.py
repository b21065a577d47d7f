"""Which small law a shared curve resembles: effects and formulas, each scored on specimens left out.

Every law has one value in all sessions. What it adds to a session's log density, its value learned from the other
specimens, is its left-out gain; laws that these load cases cannot part are rivals of each other.

What would decide between them is a load case, or what is read beside its forces: each law says what it would read, with
its value and interval, and all else is as unknown as the session leaves it. A reading is worth the mutual information
[nat] between law and reading (Lindley 1956).
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
from fingermodel.diagnosis.next_cases.next_cases import PlannedReading, expected, feasible, information, inputs_of
from fingermodel.diagnosis.posterior.gaussian import gain_of_each
from fingermodel.diagnosis.posterior.hyper import Node
from fingermodel.diagnosis.posterior.linearised import OTHERS
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.reading_changes import CaseChanges
from fingermodel.diagnosis.settings import ALIKE, SEED, WORTH_NAT
from fingermodel.diagnosis.verdict.hints import Formula, Hint, library
from fingermodel.diagnosis.verdict.predictive import unseen_errors
from fingermodel.stages import LoadCaseInput

# Laws that are looked at closely; laws and readings that are shown; and laws between which readings would decide.
_CLOSELY, _SHOWN, _LIVE = 40, 5, 6
# Step of a derivative, as a share of a parameter's width.
_STEP = 1e-3
# What is read: forces alone; Mz as well; forces where radiographs give the joint angles.
READINGS = ("forces", "forces and Mz at the tip", "forces, and joint angles by radiograph")
_MZ = 5
# Readings drawn by each law: the order of the best is to be right.
_DRAWS = 500
# A law, or the parameter of an effect (of stage ""), and (cases, 6) of each session per its scale.
_Offer = tuple[Formula, tuple[Floats, ...]]
# Change (cases, 6) by a law, and its standard deviation.
_Change = tuple[Floats, Floats]


@dataclass(frozen=True, eq=False)
class SharedLaw:
    """One law with one value in all sessions."""

    name: str  # of an effect's parameter, or the formula with its coefficient k
    unit: str  # of the value
    value: float  # by all sessions together
    sd: float  # of it
    each: Floats  # (sessions,) value by each session alone
    each_sd: Floats  # (sessions,) sd of each, the prior's where it says nothing
    log_evidence: float  # that it acts in all of them, over that it acts in none
    left_out_gain: Floats  # (sessions,) log density that it adds to each, its value learned from the other specimens
    # By session: RMSE [N] of the validation forces' components by mount, before and with the value of the others.
    unseen: tuple[dict[str, tuple[float, float]], ...]
    rivals: tuple[str, ...]  # other laws that these load cases cannot part from it
    formula: Hint | None  # with which it can be added; None for an effect, which has its name
    changes: tuple[Floats, ...]  # (cases, 6) of each session's readings by its value

    @property
    def agreement(self) -> float:
        """Mean squared distance of the sessions' own values from the common one, in their standard deviations."""
        return float(np.mean(((self.each - self.value) / np.hypot(self.each_sd, self.sd)) ** 2))


def shared_laws(fits: Sequence[Optimum], specimens: Sequence[str], nodes: Sequence[Node]) -> tuple[SharedLaw, ...]:
    """Score the library of laws over sessions, the best first.

    Args:
        fits: of each session, without the laws.
        specimens: of each session.
        nodes: of their hyperparameters.
    """
    offers = [*_effects(fits), *_formulas(fits)]
    columns = [_columns(fit, [changes[k] for _, changes in offers]) for k, fit in enumerate(fits)]
    asked = [fit.asked(c, node) for fit, c, node in zip(fits, columns, nodes, strict=True)]
    a, s = np.array([x[0] for x in asked]), np.array([x[1] for x in asked])
    # What the sessions of other specimens say.
    of = np.array(specimens)
    apart = (of[:, None] != of).astype(float)
    others_a, others_s = apart @ a, apart @ s
    left_out = gain_of_each(others_a + a, others_s + s) - gain_of_each(others_a, others_s)
    ranked = np.argsort(-left_out.sum(axis=0))[:_CLOSELY]
    alike = _alike(fits, [c[:, ranked] for c in columns], nodes)
    out: list[SharedLaw] = []
    taken: set[int] = set()
    for k, index in enumerate(ranked.tolist()):
        if k in taken or left_out[:, index].sum() <= 0.0 or len(out) == _SHOWN:
            continue
        group = np.flatnonzero(np.abs(alike[k]) >= ALIKE).tolist()
        taken |= set(group)
        rivals = tuple(offers[ranked[i]][0].text for i in group if i != k)
        said, learned = (a[:, index], s[:, index]), others_s[:, index] / (1.0 + others_a[:, index])
        out.append(_law(fits, nodes, offers[index], said, learned, left_out[:, index], rivals))
    return tuple(out)


def _columns(fit: Optimum, changes: Sequence[Floats]) -> Floats:
    rows = fit.session.rows[fit.session.fitted]
    return np.array([c.reshape(-1)[rows] for c in changes]).T


def _alike(fits: Sequence[Optimum], columns: Sequence[Floats], nodes: Sequence[Node]) -> Floats:
    """Correlation (k, k) of what the sessions together see of each law."""
    information = np.sum(
        [fit.quadratic_of(c, node).hessian for fit, c, node in zip(fits, columns, nodes, strict=True)], axis=0
    )
    size = np.sqrt(np.maximum(np.diag(information), 1e-12))
    return information / size[:, None] / size


def _effects(fits: Sequence[Optimum]) -> list[_Offer]:
    """Parameters of effects that all sessions have, linearised at their null."""
    table = fits[0].session.model.parameters
    common = set.intersection(*({f.session.model.parameters.names[i] for i in f.parameters_of[OTHERS]} for f in fits))
    plain, out = [fit.session.changes.readings(fit.theta) for fit in fits], []
    for name in table.names:
        if name not in common:
            continue
        changes, scale = [], float(fits[0].session.problem.scale[table.names.index(name)])
        for fit, now in zip(fits, plain, strict=True):
            theta = fit.theta.copy()
            theta[fit.session.model.parameters.names.index(name)] += _STEP * scale
            changes.append((fit.session.changes.readings(theta) - now) / _STEP)
        if all(c.any() for c in changes):
            unit = table.parameters[table.names.index(name)].unit
            out.append((Formula("", None, name, unit, scale, changes[0]), tuple(changes)))
    return out


def _formulas(fits: Sequence[Optimum]) -> list[_Offer]:
    found = [{law.text: law for law in library(f.session.changes, f.theta)} for f in fits]
    common = [text for text in found[0] if all(text in other for other in found)]
    out = [(found[0][t], tuple(found[0][t].scale * other[t].slopes for other in found)) for t in common]
    return [(law, changes) for law, changes in out if all(c.any() for c in changes)]


def _law(
    fits: Sequence[Optimum],
    nodes: Sequence[Node],
    offer: _Offer,
    said: tuple[Floats, Floats],
    learned: Floats,
    left_out: Floats,
    rivals: tuple[str, ...],
) -> SharedLaw:
    (a, s), (law, changes) = said, offer
    value, sd = law.scale * s.sum() / (1.0 + a.sum()), law.scale / np.sqrt(1.0 + a.sum())
    unseen = tuple(
        unseen_errors(fit, node, learned[k] * changes[k]) for k, (fit, node) in enumerate(zip(fits, nodes, strict=True))
    )
    evidence = float(gain_of_each(a.sum(keepdims=True), s.sum(keepdims=True))[0])
    formula = Hint(law, float(value), evidence, float(left_out.sum())) if law.stage else None
    return SharedLaw(
        law.text,
        law.unit,
        float(value),
        float(sd),
        law.scale * s / (1.0 + a),
        law.scale / np.sqrt(1.0 + a),
        evidence,
        left_out,
        unseen,
        rivals,
        formula,
        tuple(float(value) / law.scale * change for change in changes),
    )


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
    leading = [law for law in laws if law.name in slopes][:_LIVE]
    if not leading:
        return (), ()
    first = leading[0]
    names = list(dict.fromkeys([first.name, *(r for r in first.rivals if r in slopes), *(w.name for w in leading)]))[
        :_LIVE
    ]
    prior = softmax([float(live.get(name, first).left_out_gain.sum()) for name in names])
    changes = [_change(slopes[n], live.get(n), slopes[first.name], first) for n in names]
    return _ranked(fit, cases, planned.inputs, changes, prior), tuple(names)


def _change(slope: Floats, law: SharedLaw | None, leading: Floats, first: SharedLaw) -> _Change:
    """Change (cases, 6) by a law and its standard deviation; a rival's value is that which resembles the first most."""
    if law is not None:
        return law.value * slope, law.sd * slope
    ratio = float((slope * leading).sum() / max((slope**2).sum(), 1e-12))
    return first.value * ratio * slope, first.sd * ratio * slope


def _ranked(
    fit: Optimum, cases: Sequence[PlannedReading], inputs: LoadCaseInput, changes: Sequence[_Change], prior: Floats
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
