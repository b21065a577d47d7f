"""From probabilities to a verdict that has its reasons: found, one of, none of the catalogue, nothing, or undecided."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fingermodel.diagnosis.candidates import Candidate, Names
from fingermodel.diagnosis.confounding import DETECTABLE, Confounding
from fingermodel.diagnosis.evidence import Evidence, Weighed, best_form
from fingermodel.parameters import Parameter
from fingermodel.problems import Problem

Floats = NDArray[np.float64]
Kind = Literal["found", "one_of", "none_of_catalogue", "nothing_missing", "undecided"]

SURE = 0.9
# Nothing is believed from here, if no effect by itself has a tenth of the probability.
NOTHING_SURE = 0.8
# Share of the misfit that an effect leaves when its form is off by 6 or 7 %: a companion may mend just that.
FORM_SHARE = 4e-3
# Of their error without a companion, what the cases never fitted may have with it for it to do more than that.
FORETOLD = 0.7
# Most names that `one_of` gives.
MOST_NAMES = 4
# A value is believed up to this multiple of its range: ranges are typical, not limits of nature.
RANGE_MARGIN = 1.5
# Widths of a prior within which anatomy and budget are believed, where the budget has its stated size.
STRAINED = 5.0
# Cases fewer than this cannot carry a diagnosis.
LEAST_CASES = 6


@dataclass(frozen=True)
class Verdict:
    """What the data say, and why.

    Attributes:
        kind: the verdict.
        names: candidates that it names.
        effects: their effects.
        probability: of the verdict.
        reasons: plain sentences for it.
        short: what was short of a stronger verdict.
    """

    kind: Kind
    names: tuple[str, ...]
    effects: tuple[str, ...]
    probability: float
    reasons: tuple[str, ...] = ()
    short: tuple[str, ...] = field(default=())


def inclusion(probability: Mapping[Names, float]) -> dict[str, float]:
    """Probability that each candidate acts, alone or with another, from those of all explanations."""
    out: dict[str, float] = {}
    for names, each in probability.items():
        for name in names or ():
            out[name] = out.get(name, 0.0) + each
    return dict(sorted(out.items(), key=lambda item: -item[1]))


def judge(
    problem: Problem,
    evidence: Evidence,
    candidates: tuple[Candidate, ...],
    classes: Confounding,
    validation_rmse: Callable[[Weighed], float | None],
    counted_in: Callable[[], Mapping[Names, float]],
) -> Verdict:
    """Decide by the conditions of each verdict; whatever meets none is undecided.

    Args:
        problem: that was searched.
        evidence: probabilities.
        candidates: that were searched.
        classes: what the protocol cannot tell apart.
        validation_rmse: RMSE [N] of the cases that were never fitted, under an explanation.
        counted_in: probabilities if these cases counted too; asked only of a finding.
    """
    nothing, p_other = evidence.nothing, evidence.probability[None]
    p_nothing = evidence.probability.get((), 0.0)
    included = inclusion(evidence.probability)
    best_name = max(included.values(), default=0.0)
    if p_other >= 0.5:
        return _other(problem, evidence, p_other, len(candidates))
    if p_nothing >= max(0.5, best_name, p_other):
        return _nothing(problem, nothing, p_nothing, included)
    certain = tuple(name for name, p in included.items() if p >= SURE)
    if certain:
        return _found(problem, evidence, certain, candidates, validation_rmse, counted_in())
    return _one_of(evidence, included, candidates, classes, p_nothing)


def _other(problem: Problem, evidence: Evidence, p_other: float, searched: int) -> Verdict:
    known = evidence.other.likely
    if evidence.together is None:
        named = [w for w in evidence.weighed if w.explanation.size]
        best = max(named, key=lambda w: w.log_evidence, default=evidence.nothing)
        left = (
            f"Even the best of the catalogue ({_words(best.explanation.names)}) leaves a misfit of {best.misfit:.0f} "
            f"where noise and priors leave about {len(problem.rows)}; "
        )
    else:
        # None of them was fitted to the end: what the best so far leaves would say less than it seems to.
        left = (
            f"All {searched} candidates at once leave a misfit of {evidence.together:.0f} of the "
            f"{evidence.nothing.fitted.objective:.0f} that the model without any effect leaves, where noise and priors "
            f"leave about {len(problem.rows)}: so one or two of them were looked for no further; "
        )
    reason = left + (
        f"something smooth of {evidence.other.amplitude_N:.2f} N that no effect here makes explains the rest."
        if known is None
        else f"{known.name}, which is known to happen in rigs and is none of the catalogue's, leaves "
        f"{known.misfit:.0f} ({known.words}; it changes the forces by {known.size_N:.3f} N, RMS)."
    )
    if p_other >= SURE:
        return Verdict("none_of_catalogue", (), (), p_other, (reason,))
    return Verdict("undecided", (), (), p_other, (reason,), ("something outside the catalogue is likely, not sure",))


def _nothing(problem: Problem, nothing: Weighed, p_nothing: float, included: dict[str, float]) -> Verdict:
    top = next(iter(included), None)
    if nothing.implausible:
        short = f"the model without any effect misfits ({nothing.misfit:.0f} of {len(problem.rows)})"
        return Verdict("undecided", (), (), p_nothing, (), (short,))
    if p_nothing >= NOTHING_SURE and all(p < 0.1 for p in included.values()):
        reason = (
            f"Noise and the rig's budget explain the readings (misfit {nothing.misfit:.0f} for "
            f"{len(problem.rows)} readings); no effect is needed."
        )
        return Verdict("nothing_missing", (), (), p_nothing, (reason,))
    short = f"nothing may be missing, but {top} is not ruled out (probability {included[top]:.2f})" if top else ""
    return Verdict("undecided", (), (), p_nothing, (), (short,))


def _found(
    problem: Problem,
    evidence: Evidence,
    certain: tuple[str, ...],
    candidates: tuple[Candidate, ...],
    validation_rmse: Callable[[Weighed], float | None],
    counted: Mapping[Names, float],
) -> Verdict:
    both = certain
    certain, passengers = _without_passengers(problem, evidence, certain, candidates, validation_rmse)
    doubted = _doubted(certain, counted)
    if doubted is not None:
        certain = tuple(name for name in certain if name != doubted)
        passengers = (f"{doubted} beside it is not certain: {_counted((doubted,), counted)}.",)
    chosen = best_form(evidence, certain)
    together = _all_of(certain, evidence.probability)
    order = [c.name for c in candidates]
    names = tuple(sorted(certain, key=order.index))
    effects = tuple(dict.fromkeys(next(c.effect for c in candidates if c.name == n) for n in names))
    if chosen is None:
        short = f"{_words(names)} acts, but with a companion that the data do not name"
        return Verdict("undecided", names, (), together, passengers, (short,))
    lacks = list(conditions(problem, evidence, chosen, validation_rmse))
    included = inclusion(evidence.probability)
    companion = doubted or next((name for name in included if name not in both and included[name] >= 0.5), None)
    if companion is not None and chosen.implausible:
        lacks.append(f"{_words(names)} acts, but not alone: perhaps with {companion}")
    if together < SURE:
        lacks.append(f"its probability is {together:.2f}, short of {SURE}")
    elif _all_of(certain, counted) < SURE:
        lacks.append(_counted(certain, counted))
    explain = "explain" if len(names) > 1 else "explains"
    reason = (
        f"{_words(names)} {explain} the readings: misfit {evidence.nothing.fitted.objective:.0f} falls to "
        f"{chosen.fitted.objective:.0f} for {len(problem.rows)} readings; it changes the forces by "
        f"{chosen.size_N:.3f} N (RMS)."
    )
    reasons = (reason, *passengers, *(_unsettled(evidence, certain) if doubted is None else ()))
    if len(certain) < len(both):
        # A companion was left out: what is left stands for both.
        impossible, another = bool(out_of_range(chosen)), chosen.may_be_another_law
    else:
        impossible = _share(evidence, lambda w: bool(out_of_range(w))) >= SURE
        of_another = _share(evidence, lambda w: w.may_be_another_law)
        another = of_another >= SURE
        if of_another >= 0.5 and not chosen.may_be_another_law:
            lacks.append(
                f"most of its probability ({of_another:.2f}) is that of laws whose form would be as far off as any "
                "that is tried"
            )
    # Of a pair, neither all of it nor what is left without a companion is believable then.
    worse = len(both) > 1 and _worse(problem, evidence, chosen, validation_rmse)
    if impossible or another or worse:
        lacks = lacks or ["with what acts beside it, it needs another law or a value that is not plausible"]
        # Unless what acts beside it is only not certain.
        if doubted is None:
            said = f"What comes nearest to the readings, {_words(names)}, is not believable: {'; '.join(lacks)}."
            return Verdict("none_of_catalogue", (), (), together, (said,))
    if lacks:
        return Verdict("undecided", names, (), together, reasons, tuple(lacks))
    return Verdict("found", names, effects, together, reasons)


def _without_passengers(
    problem: Problem,
    evidence: Evidence,
    certain: tuple[str, ...],
    candidates: tuple[Candidate, ...],
    validation_rmse: Callable[[Weighed], float | None],
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Leave out a companion where one effect alone fits, and say why: it may only mend that effect's form.

    So it is if it makes the prediction of the cases never fitted worse, where the one alone leaves no more than an
    error of its form would; or, beside a law that leaves no more than noise would, if it adds little and the cases
    never fitted are foretold about as well without it. What is so by definition, such as a mass or an angle, has no
    form to mend.
    """
    laws = {c.name for c in candidates if c.constitutive}
    pair = best_form(evidence, certain)
    if len(certain) < 2 or pair is None:
        return certain, ()
    worse, mended = [], []
    for w in evidence.weighed:
        name = w.explanation.names[0] if w.explanation.size == 1 else None
        if name not in certain or w.leaves_too_much(evidence.nothing):
            continue
        if rises(validation_rmse(w), validation_rmse(pair), typical_sd(problem)):
            worse.append(w)
        elif (
            name in laws
            and not w.implausible
            and not _foretells_better(validation_rmse(w), validation_rmse(pair), typical_sd(problem))
            and pair.log_evidence - w.log_evidence < _mending(evidence, w)
        ):
            mended.append(w)
    alone = max((*worse, *mended), key=lambda w: w.log_evidence, default=None)
    if alone is None:
        return certain, ()
    others = _words(tuple(name for name in certain if name not in alone.explanation.names))
    if alone in worse:
        why = (
            f"{others} beside it would lessen the misfit of what was fitted, but the error of the cases never fitted "
            f"would rise from {validation_rmse(alone):.3f} to {validation_rmse(pair):.3f} N: it mends the form of "
            "what acts, and only there."
        )
    else:
        why = (
            f"{others} beside it would lessen the misfit further, but no more than a form a little other than ours "
            "would; a load case that tells the two apart (`fingertwin next`) can show whether it acts too."
        )
    return alone.explanation.names, (why,)


def _doubted(certain: tuple[str, ...], counted: Mapping[Names, float]) -> str | None:
    """The one of two names that would not be certain if the cases never fitted counted too, where the other would."""
    acts = inclusion(counted)
    doubted = [name for name in certain if acts.get(name, 0.0) < SURE]
    return doubted[0] if len(doubted) == 1 < len(certain) else None


def _all_of(certain: tuple[str, ...], probability: Mapping[Names, float]) -> float:
    """Probability that all of these act, alone or with another."""
    return sum(p for names, p in probability.items() if names and set(certain) <= set(names))


def _counted(names: tuple[str, ...], counted: Mapping[Names, float]) -> str:
    """How probable these would be if the cases never fitted counted too, and what would be instead."""
    rivals = {other: p for other, p in counted.items() if not set(names) <= set(other or ())}
    likeliest = max(rivals, key=lambda other: rivals[other])
    said = "something else" if likeliest is None else _words(likeliest)
    alone = " alone" if likeliest and len(likeliest) == 1 else ""
    return (
        f"if the cases never fitted counted too, its probability would be {_all_of(names, counted):.2f} "
        f"(and of {said}{alone} {rivals[likeliest]:.2f})"
    )


def _share(evidence: Evidence, that: Callable[[Weighed], bool]) -> float:
    """Probability of all explanations whose best form is so."""
    forms = ((p, best_form(evidence, names)) for names, p in evidence.probability.items() if names)
    return sum(p for p, form in forms if form is not None and that(form))


def _foretells_better(alone: float | None, pair: float | None, sd: float) -> bool:
    """Whether cases never fitted are foretold far better with a companion, which what mends a form does not do.

    Beyond half the uncertainty `sd` [N] of the readings.
    """
    return alone is not None and pair is not None and pair < min(FORETOLD * alone, alone - 0.5 * sd)


def _mending(evidence: Evidence, alone: Weighed) -> float:
    """Log evidence that a companion may add by mending a law's form: as far off as the readings show, and no further.

    An error of a form that is so large has left that share, squared, of what the misfit was.
    """
    return 0.5 * min(FORM_SHARE, alone.form_error**2) * evidence.nothing.fitted.objective


def _unsettled(evidence: Evidence, certain: tuple[str, ...]) -> tuple[str, ...]:
    """Say that something acts beside a single effect, where only its name is open."""
    if len(certain) != 1:
        return ()
    beside = {
        next(name for name in names if name not in certain): p
        for names, p in evidence.probability.items()
        if names is not None and len(names) == 2 and certain[0] in names
    }
    total = sum(beside.values())
    ranked = sorted(beside, key=lambda name: -beside[name])
    if total < SURE or beside[ranked[0]] >= SURE:
        return ()
    named = [name for name in ranked[:MOST_NAMES] if beside[name] >= 0.05]
    said = " or ".join(f"{name} ({beside[name]:.2f})" for name in named)
    return (
        f"Something acts beside it (probability {total:.2f}), which these load cases do not settle: {said}. "
        "`fingertwin next` tells what would.",
    )


def conditions(
    problem: Problem, evidence: Evidence, chosen: Weighed, validation_rmse: Callable[[Weighed], float | None]
) -> tuple[str, ...]:
    """What a finding lacks: a fit, its form, a held-out error that does not rise, a value in range, a sane anatomy."""
    out = []
    if chosen.leaves_too_much(evidence.nothing):
        out.append(f"a misfit of {chosen.plain_misfit:.0f} is left for {len(problem.rows)} readings")
    if chosen.may_be_another_law:
        out.append(
            f"its form would be off by {100.0 * chosen.form_error:.0f} % or more, the largest error that is tried: "
            "it may be another law"
        )
    if _worse(problem, evidence, chosen, validation_rmse):
        before, after = validation_rmse(evidence.nothing), validation_rmse(chosen)
        out.append(f"the error of the cases never fitted rises from {before:.3f} to {after:.3f} N")
    strange = out_of_range(chosen)
    if strange:
        out.append(f"{strange[0]} lies outside what is plausible")
    moved = strained(chosen)
    if moved:
        out.append(f"it needs {moved[0]} further from its prior than is plausible")
    return tuple(out)


def _worse(
    problem: Problem, evidence: Evidence, chosen: Weighed, validation_rmse: Callable[[Weighed], float | None]
) -> bool:
    """Whether the error of the cases that were never fitted rises beyond its uncertainty."""
    return rises(validation_rmse(evidence.nothing), validation_rmse(chosen), typical_sd(problem))


def rises(before: float | None, after: float | None, sd: float) -> bool:
    """Whether an error [N] of cases never fitted rises beyond its uncertainty, with readings known to `sd` [N]."""
    return before is not None and after is not None and after > 1.1 * before + 2.0 * sd


def typical_sd(problem: Problem) -> float:
    """Typical uncertainty [N] of a measured force component."""
    blocks = problem.observations.case_covariance
    return float(np.sqrt(np.median(np.diagonal(blocks, axis1=1, axis2=2)[:, :3])))


def out_of_range(chosen: Weighed) -> tuple[str, ...]:
    """Names of the explanation's parameters that lie outside their plausible range, beyond their uncertainty."""
    fitted, table = chosen.fitted, chosen.fitted.problem.model.parameters.parameters
    return tuple(
        table[i].name
        for i in fitted.explanation.parameters
        if not believable(table[i], float(fitted.theta[i]), chosen.sd(i) or 0.0)
    )


def believable(parameter: Parameter, value: float, sd: float) -> bool:
    """Whether a value lies within reach of a parameter's plausible range, its uncertainty allowed for."""
    if parameter.plausible is None:
        return True
    low, high = parameter.plausible
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    reach = RANGE_MARGIN * half if low < 0.0 < high else RANGE_MARGIN * 2.0 * half - half
    return abs(value - middle) <= reach + 2.0 * sd


def strained(chosen: Weighed) -> tuple[str, ...]:
    """Base parameters that lie further from their prior than `STRAINED` widths, beside what an explanation changes.

    What is truly missing sets the anatomy free: it does not matter whether it was bent as far without.
    """
    table = chosen.fitted.problem.model.parameters
    own = set(chosen.explanation.parameters)
    # What only makes up for the effect's form being a little otherwise is no strain of the anatomy.
    strain = np.minimum(np.abs(chosen.fitted.x), np.abs(chosen.x_allowing))
    beyond = np.flatnonzero(strain > STRAINED * chosen.budget_factor)
    return tuple(table.names[i] for i in beyond if i not in own)


def _one_of(
    evidence: Evidence,
    included: dict[str, float],
    candidates: tuple[Candidate, ...],
    classes: Confounding,
    p_nothing: float,
) -> Verdict:
    singles = {names[0]: p for names, p in evidence.probability.items() if names is not None and len(names) == 1}
    ranked = sorted(singles.items(), key=lambda item: -item[1])
    chosen, total = [], 0.0
    for name, p in ranked[:MOST_NAMES]:
        chosen.append(name)
        total += p
        if total >= SURE:
            break
    effects = tuple(dict.fromkeys(next(c.effect for c in candidates if c.name == n) for n in chosen))
    top = next(iter(included), None)
    if total >= SURE and len(chosen) > 1:
        alike = [n for n in chosen[1:] if n in classes.alike(chosen[0])]
        reason = f"{' or '.join(chosen)}: these load cases do not tell them apart" + (
            f" ({chosen[0]} and {alike[0]} change the same readings)." if alike else "."
        )
        return Verdict("one_of", tuple(chosen), effects, total, (reason,))
    short = []
    if p_nothing > 0.1:
        short.append(f"nothing missing has a probability of {p_nothing:.2f}")
    if top is not None:
        short.append(f"the best candidate, {top}, has {included[top]:.2f}")
    weak = [n for n, d in classes.detectability.items() if d < DETECTABLE]
    if weak:
        short.append(f"these data cannot show {len(weak)} of {len(candidates)} candidates at all")
    return Verdict("undecided", (), (), max(included.values(), default=0.0), (), tuple(short))


def _words(names: tuple[str, ...]) -> str:
    return " and ".join(names) if names else "no effect"
