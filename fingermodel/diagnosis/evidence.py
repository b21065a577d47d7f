"""Probabilities of explanations, with the size of the budget and the exact form of each effect left open.

Two assumptions would otherwise decide: that this rig's small errors are no larger than its budget says, and that an
effect has exactly our form. Both are integrated out, about each optimum, on the straightened model: the budget's priors
times b from 1 to 2, and an addition by the wildcard whose amplitude is a tenth of the effect's own. A budget smaller
than stated is not tried: it would make a discovery of what the rig is allowed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from fingermodel.diagnosis.candidates import Candidate, Explanation, log_prior, log_prior_else
from fingermodel.diagnosis.search import Fitted, Search
from fingermodel.diagnosis.wildcard import Wildcard, log_marginal, log_marginal_any, rms_of
from fingermodel.problems import Problem

Floats = NDArray[np.float64]

BUDGET_FACTORS = np.array([1.0, 1.41, 2.0])
# ln of the budget's size: two thirds of rigs lie below a factor 1.6.
BUDGET_SPREAD = 0.5
# An effect's form may be off by this share of the change that it makes …
FORM_ERROR = 0.1
# … and what the base model leaves out anyway is of this size [N].
LEAST_FORM_N = 2e-3
# Smallest amplitude [N] that would be something of its own.
LEAST_ELSE_N = 0.02
# How many explanations are weighed with all this.
WEIGHED = 10


@dataclass(frozen=True, eq=False)
class Weighed:
    """An explanation with its evidence.

    Attributes:
        fitted: its optimum.
        profiles: (budget factors, amplitudes) log evidence.
        size_N: RMS change of the fitted forces that it makes.
        log_evidence: all integrated out.
        amplitude_N: of the wildcard that goes with it.
        log_prior: of the explanation.
    """

    fitted: Fitted
    profiles: Floats
    size_N: float
    log_evidence: float
    amplitude_N: float
    log_prior: float

    @property
    def explanation(self) -> Explanation:
        """What is freed."""
        return self.fitted.explanation


@dataclass(frozen=True, eq=False)
class Evidence:
    """All explanations weighed, best first, and the competitor that the catalogue does not hold.

    Attributes:
        weighed: best first; nothing is among them.
        other_log_evidence: of something that the catalogue does not hold.
        other_amplitude_N: its most probable size.
        probability: by explanation's names; `()` is nothing missing, None is something else.
    """

    weighed: tuple[Weighed, ...]
    other_log_evidence: float
    other_amplitude_N: float
    probability: dict[tuple[str, ...] | None, float]

    def of(self, names: tuple[str, ...]) -> Weighed | None:
        """The weighed explanation of those names."""
        return next((w for w in self.weighed if w.explanation.names == names), None)

    @property
    def nothing(self) -> Weighed:
        """The base model."""
        return next(w for w in self.weighed if w.explanation.size == 0)


def weigh(problem: Problem, search: Search, candidates: tuple[Candidate, ...], wildcard: Wildcard) -> Evidence:
    """Weigh the explanations that are in question.

    Args:
        problem: that was searched.
        search: its outcome.
        candidates: that were searched.
        wildcard: of the problem.
    """
    ranked = sorted(search.fitted, key=lambda f: -(f.log_evidence + log_prior(f.explanation, candidates)))
    chosen = _in_question(ranked)
    if search.nothing not in chosen:
        chosen.append(search.nothing)
    weighed = [_weighed(problem, fitted, search.nothing, candidates, wildcard) for fitted in chosen]
    other = other_evidence([w.profiles for w in weighed if w.explanation.size == 0])
    return assemble(weighed, other)


def _in_question(ranked: Sequence[Fitted]) -> list[Fitted]:
    """The best explanations, and the best singles even where pairs are ahead of them all."""
    singles = [f for f in ranked if f.explanation.size == 1][:4]
    chosen = list(ranked[: WEIGHED - len(singles)])
    return chosen + [f for f in singles if f not in chosen]


def _weighed(
    problem: Problem, fitted: Fitted, nothing: Fitted, candidates: tuple[Candidate, ...], wildcard: Wildcard
) -> Weighed:
    size = effect_size(problem, fitted)
    profiles = np.array([_profile(wildcard, fitted, b) for b in BUDGET_FACTORS])
    value, amplitude = _integrated(profiles, size)
    # The straightened model knows nothing of bounds: what the cut priors change comes from the fit itself.
    correction = fitted.log_evidence - fitted.gaussian_log_evidence
    return Weighed(fitted, profiles, size, value + correction, amplitude, log_prior(fitted.explanation, candidates))


def _profile(wildcard: Wildcard, fitted: Fitted, factor: float) -> Floats:
    free = fitted.moving
    own = np.isin(free, list(fitted.explanation.parameters))
    return wildcard.profile(fitted.linear, free, np.where(own, 1.0, factor))


def budget_log_weight() -> Floats:
    """Log prior of the budget factors."""
    weight = np.exp(-0.5 * (np.log(BUDGET_FACTORS) / BUDGET_SPREAD) ** 2)
    out: Floats = np.log(weight / weight.sum())
    return out


def _integrated(profiles: Floats, size_N: float) -> tuple[float, float]:
    """Log evidence over budget and form, and the amplitude of the form's error [N] at the best budget."""
    scale = FORM_ERROR * size_N + LEAST_FORM_N
    each = [log_marginal(p, scale) for p in profiles]
    total = np.array([e[0] for e in each]) + budget_log_weight()
    return float(logsumexp(total)), each[int(np.argmax(total))][1]


def other_evidence(profiles: Sequence[Floats]) -> tuple[float, float]:
    """Log evidence of something smooth that is none of the catalogue, and its most probable amplitude [N]."""
    best = (-np.inf, 0.0)
    for own in profiles:
        each = [log_marginal_any(p, LEAST_ELSE_N) for p in own]
        total = np.array([e[0] for e in each]) + budget_log_weight()
        value = float(logsumexp(total))
        if value > best[0]:
            best = (value, each[int(np.argmax(total))][1])
    return best


def assemble(weighed: Sequence[Weighed], other: tuple[float, float], nothing: float = 0.5) -> Evidence:
    """Turn evidences into probabilities; explanations of the same names add up."""
    total: dict[tuple[str, ...] | None, list[float]] = {None: [other[0] + log_prior_else(nothing)]}
    for w in weighed:
        total.setdefault(w.explanation.names, []).append(w.log_evidence + w.log_prior)
    values = {names: float(logsumexp(v)) for names, v in total.items()}
    norm = float(logsumexp(list(values.values())))
    ranked = sorted(weighed, key=lambda w: -(w.log_evidence + w.log_prior))
    return Evidence(tuple(ranked), other[0], other[1], {n: float(np.exp(v - norm)) for n, v in values.items()})


def effect_size(problem: Problem, fitted: Fitted) -> float:
    """RMS change [N] of the fitted forces that an explanation makes at its optimum, everything else the same."""
    if fitted.explanation.size == 0:
        return 0.0
    return rms_of(problem.observations, problem.rows, change_of(problem, fitted))


def change_of(problem: Problem, fitted: Fitted) -> Floats:
    """(n, 6) what an explanation changes in every reading [N, N mm]."""
    model, inputs = problem.model, problem.observations.inputs
    without = fitted.theta.copy()
    own = list(fitted.explanation.parameters)
    without[own] = model.parameters.initial[own]
    out: Floats = np.asarray(model.predict(inputs, fitted.theta).reading) - np.asarray(
        model.predict(inputs, without).reading
    )
    return out
