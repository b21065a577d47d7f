"""Sensitivity analysis: the probability of what is said, under other assumptions and without parts of the data.

It is shown, and conditions nothing. Everything is asked of the linearised models again; nothing is refitted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from fingermodel.arrays import Mask
from fingermodel.comparison.comparison import muscles_of
from fingermodel.diagnosis.posterior.hyper import ANATOMY, BUDGET, NOISE, Node
from fingermodel.diagnosis.posterior.marginals import Posterior
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.settings import EVIDENCE_POWER, P_NOTHING, SURE
from fingermodel.diagnosis.verdict.verdict import Kind, Verdict

# Other priors on nothing, and factors on the effects' widths, that are shown; and steps by which noise is larger.
_PRIORS, _WIDTHS, _NOISE = (0.2, 0.8), (0.5, 2.0), 2
# Explanations that are asked again, besides the base model; of parts of the data that are left out, fewer.
_ASKED, _ASKED_OF_PARTS = 4, 2

Value = Callable[[Optimum, Node], float]


@dataclass(frozen=True)
class Assumption:
    """The probability of what is said under one assumption."""

    group: str  # prior, width, budget, anatomy, noise, without, or plane
    words: str  # the assumption
    probability: float  # of what the verdict says


@dataclass(frozen=True)
class Sensitivity:
    """The probability of what is said under every assumption tried."""

    assumptions: tuple[Assumption, ...]  # in the order of their groups
    # Smallest multiple of the budget tried at which it is not sure; None if it is at all of them.
    budget_multiple_at_which_it_fails: float | None
    sagittal_alone: str | None  # the kind of verdict where only the sagittal plane counts

    @property
    def flips_when(self) -> tuple[str, ...]:
        """Assumptions under which it would be less probable than not."""
        return tuple(a.words for a in self.assumptions if a.probability < 0.5 and a.group != "without")

    @property
    def rests_on(self) -> tuple[str, ...]:
        """Parts of the data without which it would be less probable than not."""
        return tuple(a.words for a in self.assumptions if a.probability < 0.5 and a.group == "without")

    def as_dict(self) -> dict[str, Any]:
        """As the answer gives it."""
        return {
            "flips_when": list(self.flips_when),
            "rests_on": list(self.rests_on),
            "budget_multiple_at_which_it_fails": self.budget_multiple_at_which_it_fails,
            "sagittal_alone": self.sagittal_alone,
            "assumptions": [asdict(a) for a in self.assumptions],
        }


def sensitivity(posterior: Posterior, verdict: Verdict) -> Sensitivity:
    """Ask the explanations that matter again how probable what the verdict says is."""
    ranked = sorted(posterior.fits.values(), key=posterior.weight, reverse=True)
    asked = list(dict.fromkeys([*ranked[:_ASKED], posterior.nothing]))
    said = _statement(verdict, posterior)
    out = [Assumption("prior", f"the prior of nothing is {p:g}", said(_again(asked, _prior(p)))) for p in _PRIORS]
    out += [
        Assumption("width", f"effects may be {w:g} times as large", said(_again(asked, _width(w)))) for w in _WIDTHS
    ]
    fails = None
    for index, multiple in enumerate(posterior.leader.hyper.axes[BUDGET].values):
        p = said(_again(asked, _fixed(BUDGET, index)))
        size = f"{multiple:g} times as large" if multiple > 1.0 else "as stated"
        out.append(Assumption("budget", f"the budget is {size}", p))
        if p < SURE and fails is None:
            fails = float(multiple)
    for index, multiple in enumerate(posterior.leader.hyper.axes[ANATOMY].values):
        words = (
            f"specimens differ {multiple:g} times as much as stated" if multiple > 1.0 else "specimens differ as stated"
        )
        out.append(Assumption("anatomy", words, said(_again(asked, _fixed(ANATOMY, index)))))
    noises = posterior.leader.hyper.axes[NOISE].values
    index = min(posterior.leader.best[NOISE] + _NOISE, len(noises) - 1)
    size, assumed = noises[index], posterior.nothing.session.observations.noise_assumed
    words = f"the noise is {size:.2g} times as assumed" if assumed else f"the noise is {1000.0 * size:.0f} mN larger"
    out.append(Assumption("noise", words, said(_again(asked, _fixed(NOISE, index)))))
    few = list(dict.fromkeys([*ranked[:_ASKED_OF_PARTS], posterior.nothing]))
    for words, gone in _parts(posterior.nothing):
        out.append(Assumption("without", words, said(_less(few, gone))))
    sagittal = None
    if posterior.nothing.session.plane == "space":
        aside = ~np.isin(posterior.nothing.session.rows[posterior.nothing.session.fitted] % 6, (0, 1, 5))
        planar = _less(asked, aside)
        p = said(planar)
        out.append(Assumption("plane", "only the sagittal plane counts", p))
        sagittal = _kind(planar, verdict, p)
    return Sensitivity(tuple(out), fails, sagittal)


def _statement(verdict: Verdict, posterior: Posterior) -> Callable[[Posterior], float]:
    """The probability of what a verdict says, in any posterior."""
    if verdict.kind == "one_of":
        return lambda p: p.of_any(verdict.names)
    if verdict.names:
        return lambda p: p.of_names(verdict.names)
    likeliest = next(iter(posterior.inclusion), "")
    singles: dict[str, Callable[[Posterior], float]] = {
        "nothing_missing": lambda p: p.p_nothing,
        "none_of_catalogue": lambda p: p.p_beyond,
        "named": lambda p: p.of_names([likeliest]),
    }
    # Undecided: the likeliest of them.
    return singles.get(verdict.kind) or max(singles.values(), key=lambda said: said(posterior))


def _kind(posterior: Posterior, verdict: Verdict, probability: float) -> Kind:
    """The kind of verdict that a posterior would lead to, as far as the explanations asked tell."""
    if probability >= SURE:
        return verdict.kind
    if posterior.p_beyond >= SURE:
        return "none_of_catalogue"
    return "nothing_missing" if posterior.p_nothing >= SURE else "undecided"


def _again(fits: Sequence[Optimum], value: Value) -> Posterior:
    """The posterior of some explanations, the best node of each with another value.

    Around that node the sum changes little: what is asked is how it fares.
    """
    nodes = {f.explanation: {f.best: value(f, f.best)} for f in fits}
    return Posterior.of({f.explanation: f for f in fits}, nodes=nodes)


def _less(fits: Sequence[Optimum], gone: Mask) -> Posterior:
    """The posterior of some explanations without some of the fitted readings (n,), at their best nodes."""
    return Posterior.of({f.explanation: _without(f, gone) for f in fits})


def _prior(p: float) -> Value:
    # A prior is not raised to the evidence's power.
    ratio = np.log([p / P_NOTHING, (1.0 - p) / (1.0 - P_NOTHING)]) / EVIDENCE_POWER
    return lambda fit, node: fit.log_posterior + float(ratio[int(fit.explanation.size > 0)])


def _width(factor: float) -> Value:
    return lambda fit, node: fit.log_joint(node, width=factor)


def _fixed(axis: int, index: int) -> Value:
    return lambda fit, node: fit.log_joint((*node[:axis], index, *node[axis + 1 :]))


def _without(fit: Optimum, gone: Mask) -> Optimum:
    """A fit without some of the fitted readings (n,), at its best node alone."""
    readings = {"residual": fit.residual[~gone], "slopes": fit.slopes[~gone]}
    other = fit.but(session=fit.session.without(gone), node=fit.best, **readings)
    # Other nodes are not looked for: that would take as long as a search.
    other.__dict__["nodes"] = {fit.best: other.log_joint(fit.best)}
    return other


def _parts(fit: Optimum) -> list[tuple[str, Mask]]:
    """Postures, sets of tendons and mounts: each in words, and which fitted readings (n,) are of it."""
    session, observations = fit.session, fit.session.observations
    cases = session.rows[session.fitted] // 6
    kinds = (
        ("posture {}", observations.postures),
        ("{}", tuple(muscles_of(m) if m else "" for m in observations.masses_g)),
        ("readings at the {}", observations.locations),
    )
    out = []
    for words, of_case in kinds:
        names = np.array(of_case)[cases]
        for name in dict.fromkeys(names):
            gone = names == name
            if name and not gone.all():
                out.append((f"without {words.format(name)}", gone))
    return out
