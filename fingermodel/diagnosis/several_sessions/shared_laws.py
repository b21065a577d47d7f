"""Which small law a shared curve resembles: effects and formulas, each scored on specimens left out.

Every law has one value in all sessions. What it adds to a session's log density, its value learned from the other
specimens, is its left-out gain; laws that these load cases cannot part are rivals of each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fingermodel.arrays import Floats
from fingermodel.diagnosis.posterior.gaussian import gain_of_each
from fingermodel.diagnosis.posterior.hyper import Node
from fingermodel.diagnosis.posterior.linearised import OTHERS
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.settings import ALIKE
from fingermodel.diagnosis.verdict.hints import Formula, Hint, library
from fingermodel.diagnosis.verdict.predictive import unseen_errors

# Laws that are looked at closely, and shown.
_CLOSELY, _SHOWN = 40, 5


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


# Step of a derivative, as a share of a parameter's width.
_STEP = 1e-3


# A law, or the parameter of an effect (of stage ""), and (cases, 6) of each session per its scale.
_Offer = tuple[Formula, tuple[Floats, ...]]


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
