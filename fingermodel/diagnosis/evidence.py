"""Probabilities of explanations, with the size of the budget and the exact form of each effect left open.

Two assumptions would otherwise decide: that this rig's small errors are no larger than its budget says, and that an
effect has exactly our form. Both are integrated out, about each optimum, on the straightened model: the budget's priors
times b from 1 to 2, and an addition by the wildcard whose amplitude is a tenth of the effect's own. A budget smaller
than stated is not tried: it would make a discovery of what the rig is allowed.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, logsumexp

from fingermodel.diagnosis.candidates import Candidate, Explanation, log_prior, log_prior_else, members
from fingermodel.diagnosis.fitted import Fitted, far_off
from fingermodel.diagnosis.linear import Linear, Posterior
from fingermodel.diagnosis.search import Search
from fingermodel.diagnosis.wildcard import FORM_ERRORS, Wildcard, form_of, rms_of
from fingermodel.problems import Problem

Floats = NDArray[np.float64]

BUDGET_FACTORS = np.array([1.0, 1.41, 2.0])
# ln of the budget's size: two thirds of rigs lie below a factor 1.6.
BUDGET_SPREAD = 0.5
# An effect's form may be off by this share of the change that it makes in each case.
FORM_ERROR = 0.1
# χ² that noise would exceed once in a thousand times.
IMPLAUSIBLE = 1e-3
# A finding may leave a tenth of what it explains: no effect has exactly our form.
LEFT_OVER = 0.1
# Whatever its form: what leaves more of the misfit than this is not the explanation. More may be left by what is so by
# definition, if the readings show it to be no further off than is usual (another angle at each tendon, say): the base,
# bent to do without the effect, hides most of it. A law that leaves as much may be another law.
LEFT_OVER_PLAIN, LEFT_OVER_USUAL = 0.45, 0.75
# Standard deviations at which an effect's form begins to matter.
CLEAR = 10.0
# Smallest amplitude [N] that would be something of its own.
LEAST_ELSE_N = 0.02
# Things that rigs are known to do beyond the catalogue, and from which probability one of them is named.
KNOWN_THINGS, KNOWN_SURE = 5, 0.9
# How many explanations are weighed with all this, in how many forms of the same effects at most; and how many where the
# best leaves more than so much a reading.
WEIGHED, FORMS = 10, 2
FAR_WEIGHED, FAR = 16, 2.0


@dataclass(frozen=True, eq=False)
class Weighed:
    """An explanation with its evidence.

    Attributes:
        fitted: its optimum.
        form: the error of its form, relative to its own change; nothing has none.
        size_N: RMS change of the fitted forces that it makes.
        log_evidence: all integrated out.
        form_error: most probable, as a share of the effect.
        budget_factor: most probable multiple of the budget.
        misfit: χ² with the budget and the error of the form as large as is most probable.
        plain_misfit: the same without any error of the form.
        log_prior: of the explanation.
        defined: whether all its members are what they are by definition, and none is a law.
        x_allowing: (parameters,) in prior widths, where the error of the form and the budget's size are allowed for.
        sd_allowing: (parameters,) of these; zero where nothing moves.
    """

    fitted: Fitted
    form: Wildcard
    size_N: float
    log_evidence: float
    form_error: float
    budget_factor: float
    misfit: float
    plain_misfit: float
    log_prior: float
    defined: bool
    x_allowing: Floats
    sd_allowing: Floats

    def sd(self, index: int) -> float | None:
        """Standard deviation of a parameter in its unit, an error of the form allowed for; None if it is held."""
        sd = float(self.sd_allowing[index] * self.fitted.problem.scale[index])
        return sd or None

    @property
    def explanation(self) -> Explanation:
        """What is freed."""
        return self.fitted.explanation

    @property
    def implausible(self) -> bool:
        """Whether noise would leave a larger misfit less than once in a thousand times."""
        return bool(chdtrc(len(self.fitted.problem.rows), self.misfit) < IMPLAUSIBLE)

    @property
    def may_be_another_law(self) -> bool:
        """Whether an error of a law's form would be taken larger than any that is tried."""
        return not self.defined and self.form_error >= FORM_ERRORS[-1]

    def leaves_too_much(self, nothing: Weighed) -> bool:
        """Whether far more of the misfit is left than an error of its form could be: then it is not the explanation."""
        readings = len(self.fitted.problem.rows)
        excess = max(nothing.fitted.objective - readings, 1.0)
        if self.implausible and self.misfit - readings > LEFT_OVER * excess:
            return True
        if self.defined and self.form_error <= FORM_ERROR:
            conceded = LEFT_OVER_USUAL
        elif self.form_error < FORM_ERRORS[-1]:
            conceded = LEFT_OVER_PLAIN
        else:
            # It would be taken larger still: no more is conceded to a law than the largest that is tried leaves.
            conceded = LEFT_OVER if self.defined else float(FORM_ERRORS[-1] ** 2)
        return bool(chdtrc(readings, self.plain_misfit) < IMPLAUSIBLE) and (
            self.plain_misfit - readings > conceded * excess
        )


@dataclass(frozen=True)
class Known:
    """A known thing outside the catalogue, as it was weighed.

    Attributes:
        name: of the ready-made effect.
        words: where or when.
        log_evidence: on the footing of other explanations, the share of its form in its prior included.
        size_N: RMS change that it makes.
        misfit: χ² that is left, an error of its form allowed for.
    """

    name: str
    words: str
    log_evidence: float
    size_N: float
    misfit: float


@dataclass(frozen=True, eq=False)
class Other:
    """Something that the catalogue does not hold: anything smooth, or what rigs are known to do.

    Attributes:
        log_evidence: of both together.
        amplitude_N: most probable size of what is smooth.
        known: what rigs are known to do and these readings may show, each with its probability if it is something else.
    """

    log_evidence: float
    amplitude_N: float
    known: tuple[tuple[Known, float], ...] = ()

    @property
    def likely(self) -> Known | None:
        """The known thing that it more probably is than anything smooth."""
        return next((known for known, probability in self.known if probability >= KNOWN_SURE), None)


@dataclass(frozen=True, eq=False)
class Evidence:
    """All explanations weighed, best first, and the competitor that the catalogue does not hold.

    Attributes:
        weighed: best first; nothing is among them.
        other: what the catalogue does not hold.
        probability: by explanation's names; `()` is nothing missing, None is something else.
        together: χ² that all candidates at once leave, where that is too much for any few of them (see `Search`).
        log_norm: log posterior of all of them together, of which the probabilities are shares.
    """

    weighed: tuple[Weighed, ...]
    other: Other
    probability: dict[tuple[str, ...] | None, float]
    together: float | None = None
    log_norm: float = 0.0

    @property
    def nothing(self) -> Weighed:
        """The base model."""
        return next(w for w in self.weighed if w.explanation.size == 0)


def weigh(
    problem: Problem,
    search: Search,
    candidates: tuple[Candidate, ...],
    wildcard: Wildcard,
    known: tuple[Known, ...] = (),
) -> Evidence:
    """Weigh the explanations that are in question.

    Args:
        problem: that was searched.
        search: its outcome.
        candidates: that were searched.
        wildcard: of the problem.
        known: what rigs are known to do beyond the catalogue.
    """
    sane = [f for f in search.fitted if f.sane]
    ranked = sorted(sane, key=lambda f: -(f.log_evidence + log_prior(f.explanation, candidates)))
    chosen = _in_question(ranked, lost=search.together is not None)
    if search.nothing not in chosen:
        chosen.append(search.nothing)
    weighed = [weigh_one(problem, fitted, candidates) for fitted in chosen]
    nothing = next(w for w in weighed if w.explanation.size == 0)
    return assemble(weighed, other_evidence(nothing.fitted, wildcard, known), together=search.together)


def _in_question(ranked: Sequence[Fitted], *, lost: bool) -> list[Fitted]:
    """The best explanations, and the best singles even where pairs are ahead of them all; of each its best forms.

    Args:
        ranked: by their posterior, best first.
        lost: whether no few of them can explain the readings: then none of them counts, whatever its form.
    """
    several: list[Fitted] = []
    for fitted in ranked:
        if sum(f.explanation.names == fitted.explanation.names for f in several) < FORMS:
            several.append(fitted)
    singles = [f for f in several if f.explanation.size == 1][:4]
    # Where much is left, an error of form decides, and may turn the order of these.
    count = FAR_WEIGHED if ranked and not lost and far_off(ranked[0], FAR) else WEIGHED
    chosen = several[: count - len(singles)]
    return chosen + [f for f in singles if f not in chosen]


def weigh_one(problem: Problem, fitted: Fitted, candidates: tuple[Candidate, ...]) -> Weighed:
    """Weigh one fit, its budget and its form left open."""
    change, form = change_and_form(problem, fitted, candidates)
    each = [at_budget(fitted, form, b) for b in BUDGET_FACTORS]
    total = np.array([value for value, _ in each]) + fitted.of_bounds + budget_log_weight()
    best = int(np.argmax(total))
    factor, error = float(BUDGET_FACTORS[best]), each[best][1]
    misfit, x, sd = estimates_at(fitted, form, factor, error)
    free, scale = scales(fitted, factor)
    plain_misfit = min(fitted.linear.posterior(free, scale).misfit, fitted.objective)
    return Weighed(
        fitted,
        form,
        rms_of(problem.observations, problem.rows, change),
        float(logsumexp(total)),
        error,
        factor,
        misfit,
        plain_misfit,
        log_prior(fitted.explanation, candidates),
        not any(c.constitutive for c in candidates if c.name in fitted.explanation.names),
        x,
        sd,
    )


def evidence_as_stated(problem: Problem, fitted: Fitted, candidates: tuple[Candidate, ...]) -> float:
    """Log evidence of one fit with the budget as large as the problem says, its form left open."""
    _, form = change_and_form(problem, fitted, candidates)
    return at_budget(fitted, form, 1.0)[0] + fitted.of_bounds


def change_and_form(problem: Problem, fitted: Fitted, candidates: tuple[Candidate, ...]) -> tuple[Floats, Wildcard]:
    """What an explanation changes (cases, 6) [N, N mm], and the error of its form."""
    change = change_of(problem, fitted, fitted.explanation.parameters)
    return change, Wildcard.of(_form_columns(problem, fitted, candidates, change), FORM_ERRORS)


def _form_columns(problem: Problem, fitted: Fitted, candidates: tuple[Candidate, ...], change: Floats) -> Floats:
    """Errors of the forms of all members, which change the readings (cases, 6) together.

    A member that hardly stands out lends no freedom to the others.
    """
    columns = []
    for own in (member.parameters for member in members(fitted.explanation, candidates)):
        strength = fitted.strength(own)
        weight = strength / (strength + CLEAR)
        alone = change if fitted.explanation.size == 1 else change_of(problem, fitted, own)
        columns.append(weight * form_of(problem, alone))
    return np.concatenate(columns, axis=1) if columns else np.zeros((len(problem.rows), 1))


def scales(fitted: Fitted, factor: float, free: NDArray[np.intp] | None = None) -> tuple[NDArray[np.intp], Floats]:
    """Indices of what is free (by default what no bound holds), and factors on the priors' widths.

    They are those of a budget so many times as large.
    """
    free = fitted.inner if free is None else free
    own = np.isin(free, list(fitted.explanation.parameters))
    return free, np.where(own, 1.0, factor)


def at_budget(fitted: Fitted, form: Wildcard, factor: float) -> tuple[float, float]:
    """Log evidence with the budget so many times as large, and the most probable error of the effect's form."""
    free, scale = scales(fitted, factor)
    return form.log_marginal(form.profile(fitted.linear, free, scale), FORM_ERROR)


def estimates_at(fitted: Fitted, form: Wildcard, factor: float, form_error: float) -> tuple[float, Floats, Floats]:
    """χ², and values and standard deviations (parameters,) in prior widths, an error of the effect's form allowed for.

    Without it the base is bent until it makes up for the form, and values look better known than they are.
    """
    free, scale = scales(fitted, factor)
    misfit, values, covariance = estimates_of(fitted.linear, free, scale, form, form_error)
    x, sd = fitted.x.copy(), np.zeros_like(fitted.x)
    x[free] = values * scale
    sd[free] = np.sqrt(np.diag(covariance)) * scale
    return min(misfit, fitted.objective), x, sd


def estimates_of(
    linear: Linear, free: NDArray[np.intp], scale: Floats, form: Wildcard, form_error: float
) -> tuple[float, Floats, Floats]:
    """χ² of a straightened model with some parameters free, their values (free,) and covariance (free, free).

    Both in units of their priors' widths, which are `scale` (free,) times as wide; the effect's form is in error.
    """
    exact = linear.posterior(free, scale)
    white = form.allowed_for(form_error, np.column_stack([exact.residual, exact.h]))
    allowing = Posterior(white[:, 0], white[:, 1:], exact.x)
    return allowing.misfit, allowing.values, allowing.covariance


def budget_log_weight() -> Floats:
    """Log prior of the budget factors."""
    weight = np.exp(-0.5 * (np.log(BUDGET_FACTORS) / BUDGET_SPREAD) ** 2)
    out: Floats = np.log(weight / weight.sum())
    return out


def other_at_budget(nothing: Fitted, wildcard: Wildcard, factor: float) -> tuple[float, float]:
    """Log evidence of something else with the budget so many times as large, and its most probable amplitude [N]."""
    free, scale = scales(nothing, factor)
    return wildcard.log_marginal_any(wildcard.profile(nothing.linear, free, scale), LEAST_ELSE_N)


def other_evidence(nothing: Fitted, wildcard: Wildcard, known: tuple[Known, ...] = ()) -> Other:
    """Evidence for something that is none of the catalogue: half of its prior is on what rigs are known to do."""
    each = [other_at_budget(nothing, wildcard, b) for b in BUDGET_FACTORS]
    total = np.array([value for value, _ in each]) + budget_log_weight()
    parts = np.array([logsumexp(total), *(k.log_evidence - np.log(KNOWN_THINGS) for k in known)]) + np.log(0.5)
    whole = float(logsumexp(parts))
    shares = np.exp(parts[1:] - whole)
    return Other(
        whole,
        each[int(np.argmax(total))][1],
        tuple(sorted(((k, float(p)) for k, p in zip(known, shares, strict=True)), key=lambda pair: -pair[1])),
    )


def assemble(
    weighed: Sequence[Weighed], other: Other, nothing: float = 0.5, *, together: float | None = None
) -> Evidence:
    """Turn evidences into probabilities: explanations of the same names add up, what does not fit counts for none.

    Args:
        weighed: explanations, the base model among them.
        other: something that is none of the catalogue.
        nothing: prior of the base model.
        together: of `Evidence`; then none of them counts.
    """
    none = next(w for w in weighed if w.explanation.size == 0)
    total: dict[tuple[str, ...] | None, list[float]] = {None: [other.log_evidence + log_prior_else(nothing)]}
    for w in weighed:
        if w.explanation.size and (together is not None or struck_out(w, none)):
            total.setdefault(w.explanation.names, [-np.inf])
            continue
        total.setdefault(w.explanation.names, []).append(w.log_evidence + w.log_prior)
    values = {names: float(logsumexp(v)) for names, v in total.items()}
    norm = float(logsumexp(list(values.values())))
    ranked = sorted(weighed, key=lambda w: (-values[w.explanation.names], -(w.log_evidence + w.log_prior)))
    probability = {n: float(np.exp(v - norm)) for n, v in values.items()}
    return Evidence(tuple(ranked), other, probability, together, norm)


def struck_out(weighed: Weighed, nothing: Weighed) -> bool:
    """Whether an explanation counts for none: the base model does not fit, and what it leaves is too much."""
    return nothing.implausible and weighed.leaves_too_much(nothing)


def best_form(evidence: Evidence, names: Collection[str]) -> Weighed | None:
    """Of exactly these names, as a set, the form that stands: one that is struck out never before one that is not."""
    forms = (w for w in evidence.weighed if set(w.explanation.names) == set(names))
    return max(forms, key=lambda w: (not struck_out(w, evidence.nothing), w.log_evidence), default=None)


def change_of(problem: Problem, fitted: Fitted, parameters: Sequence[int]) -> Floats:
    """(n, 6) what some effect parameters change in every reading [N, N mm], everything else the same."""
    model, inputs = problem.model, problem.observations.inputs
    without, own = fitted.theta.copy(), list(parameters)
    without[own] = model.parameters.initial[own]
    out: Floats = np.asarray(model.predict(inputs, fitted.theta).reading) - np.asarray(
        model.predict(inputs, without).reading
    )
    return out
