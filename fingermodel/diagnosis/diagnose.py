"""One session's diagnosis: search, read the posterior, check it on the validation cases, and say what is known."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from scipy.special import expit

from fingermodel.arrays import Floats
from fingermodel.comparison.comparison import Comparison, compare
from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.model_free.nulls import Null, nulls
from fingermodel.diagnosis.posterior.curves import SmoothCurve, own_curves
from fingermodel.diagnosis.posterior.fitting import Fitter
from fingermodel.diagnosis.posterior.hyper import BUDGET
from fingermodel.diagnosis.posterior.marginals import Posterior
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.search.beginning import Beginner, odds_of_taken, unlike_sound
from fingermodel.diagnosis.search.search import MOST_FITS, Searched, search, unsearched
from fingermodel.diagnosis.session_model.bad_cases import Explained
from fingermodel.diagnosis.session_model.candidates import NOTHING, Candidates, Explanation
from fingermodel.diagnosis.session_model.session import Session, session_of
from fingermodel.diagnosis.verdict.confounding import Confounding, confounding
from fingermodel.diagnosis.verdict.hints import Hint, hints
from fingermodel.diagnosis.verdict.predictive import PredictiveCheck, checks, holding, together
from fingermodel.diagnosis.verdict.sensitivity import Sensitivity, sensitivity
from fingermodel.diagnosis.verdict.session_faults import (
    PutRight,
    SessionFault,
    outdoes,
    put_right,
    put_right_beside,
    session_faults,
    unseen_faults,
)
from fingermodel.diagnosis.verdict.trend import Trend, trend_of
from fingermodel.diagnosis.verdict.verdict import (
    Verdict,
    doubted,
    explains_as_stated,
    judge,
    likeliest,
    stated_node,
    sure_names,
    with_unlike,
)
from fingermodel.fingers import Plane
from fingermodel.model import Model


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What was found out about one session."""

    session: Session  # the readings and the base model
    candidates: Candidates  # that were searched
    searched: Searched  # every fit
    posterior: Posterior  # of which everything that is said is a marginal
    stated: Optimum  # the base model as budget and noise are stated: what it leaves is what there is to explain
    refitted: Optimum  # the base model as `refit` fits it: errors before anything is added are of this
    log_evidence_of_nothing: float  # no effect and nothing smooth, which "nothing missing" stands for
    confounding: Confounding  # what the protocol cannot tell apart
    verdict: Verdict  # with its reasons
    # Predictive check of explanations on the validation cases, by explanation.
    checks: dict[Explanation, PredictiveCheck]
    sensitivity: Sensitivity  # the verdict's probability under other assumptions
    faults: tuple[SessionFault, ...]  # of the whole session (labels, side, signs, units, gain), most probable first
    hints: tuple[Hint, ...]  # formulas, where nothing fits
    curves: tuple[SmoothCurve, ...]  # of moment arms, tensions and forces, where nothing fits; the most evident first
    nulls: tuple[Null, ...]  # what the readings say without any model of the tendons
    trend: Trend | None  # of what the verdict leaves, along time or load
    # Cases more probably apart from the rest than not, by a slip or by noise: how probably, and what explains it.
    standing_apart: dict[int, tuple[float, Explained | None]]
    unlike: tuple[int, ...]  # fitted cases that stand apart, and of which all those alike do: see `unlike_sound`
    seconds: float  # of the computation
    comparisons: dict[Explanation, Comparison] = field(repr=False)  # of every explanation that was fitted

    @property
    def best(self) -> Optimum:
        """What the verdict would add: the named explanation, or else the most probable one."""
        return added_by(self.posterior, self.verdict)

    @property
    def judged(self) -> Optimum:
        """The explanation that the validation cases are told of."""
        return self.best if self.best.explanation in self.checks else self.posterior.leader

    @property
    def suspects(self) -> dict[int, tuple[float, Explained | None]]:
        """Cases that are more probably bad than not: probability, and what may have been done in them instead.

        The likeliest first. Verdict and errors are of the others.
        """
        apart = self.standing_apart.items()
        found = {c: (p * (slip.is_slip if slip else 1.0), slip) for c, (p, slip) in apart if c not in self.unlike}
        return {case: (p, slip) for case, (p, slip) in sorted(found.items(), key=lambda e: -e[1][0]) if p >= 0.5}

    @property
    def outliers(self) -> tuple[int, ...]:
        """Cases that stand apart and are no suspects: noise with a long tail explains them."""
        return tuple(sorted(self.standing_apart.keys() - self.suspects.keys() - set(self.unlike)))

    def comparison(self, fit: Optimum) -> Comparison:
        """Measured and predicted forces of a fit, cases that stand apart left out."""
        apart = [self.session.observations.ids[c] for c in self.standing_apart]
        return self.comparisons[fit.explanation].without(apart)

    def theta_of(self, fit: Optimum) -> Floats:
        """Parameters (p,) with which an explanation's fit is compared: of no effect those of a refit."""
        return fit.theta if fit.explanation.size else self.refitted.theta

    def validation_rmse(self, fit: Optimum) -> float | None:
        """RMSE [N] of the validation cases that do not stand apart, in the plane that the finger is judged in."""
        compared = self.comparison(fit).select(role="validation")
        return compared.errors(compared.judged_in).rmse_N


def diagnose(
    model: Model,
    observations: Observations,
    *,
    plane: Plane | None = None,
    held: Sequence[str] = (),
    start: Floats | None = None,
    thorough: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Diagnosis:
    """Find out what is missing.

    Args:
        model: with the candidates among its effects, all at their null.
        observations: of the session.
        plane: of the forces that count; by default what the finger's axes can predict.
        held: parameters of effects that the model has already; they are free throughout, and no candidates.
        start: (parameters,) of an earlier fit, as one more start.
        thorough: three times as many fits.
        progress: is told the share done.
    """
    began = time.perf_counter()
    session = session_of(model, observations, plane, held)
    candidates = Candidates.of(model, sagittal=session.plane == "sagittal", held=held)
    most = MOST_FITS * (3 if thorough else 1)
    beginner = Beginner(session, candidates, start, progress)
    begun = beginner.grossly()
    before = put_right(candidates, begun.nothing)
    # What would make up for a fault of the whole session is no finding, and not looked for.
    faulty = outdoes(before, beginner.most_of_any(begun))
    searched = unsearched(begun) if faulty else search(beginner, begun, most)
    posterior = Posterior.of(searched.fits, searched.promised)
    nothing = posterior.nothing
    session = nothing.session
    fitter = Fitter(session, candidates, nothing.hyper)
    starts = [nothing.theta, session.problem.centre]
    stated, refitted = (
        fitter.fit_at(NOTHING, starts, node, nothing.bad) for node in (stated_node(nothing), searched.plain)
    )
    of_nothing, alike = fitter.log_evidence_without_smooth(nothing), confounding(nothing, candidates)
    named = likeliest(posterior)
    fit = posterior.best_fit(named) or posterior.leader
    shares = holding(posterior, fit)
    asked_of = [fit, posterior.leader, nothing, *(posterior.fits[e] for e in shares)]
    checked = checks(posterior, dict.fromkeys(asked_of))
    missed = [observations.ids[case] for case in checked[fit.explanation].missed]
    verdict = judge(posterior, stated, candidates, alike, together(checked, shares), fit.explanation.names, missed)
    added = added_by(posterior, verdict)
    # What is in no catalogue may be what rigs are known to do.
    trend = trend_of(posterior.leader if verdict.kind == "none_of_catalogue" else added)
    if trend:
        verdict = doubted(verdict, added, trend)
    unlike = unlike_sound(session, searched.slips)
    if unlike:
        verdict = with_unlike(verdict, [observations.ids[case] for case in unlike])
    asked = sensitivity(posterior, verdict)
    found: tuple[Hint, ...] = ()
    curves: tuple[SmoothCurve, ...] = ()
    put = [*before, *(put_right_beside(candidates, posterior.leader) if posterior.leader.explanation.size else [])]
    if not faulty and (verdict.kind in ("none_of_catalogue", "undecided") or not explains_as_stated(fit)):
        put += put_right(candidates, begun.nothing, before)
    of_all = session_faults(put, posterior, checked, trend)
    faults = tuple([fault for fault, _ in of_all] or unseen_faults(candidates, posterior, checked))
    right = of_all[0][1] if of_all else None
    if faults:
        # To be put right in the session: what would make up for it is no finding.
        verdict = Verdict("undecided", (), (), faults[0].probability, (), (faults[0].effect,))
    elif verdict.kind in ("none_of_catalogue", "undecided"):
        found, curves = _of_what_is_left(posterior, searched)
    if progress:
        progress(1.0)
    for kept in (*posterior.fits.values(), stated, refitted):
        kept.forget()
    session.forget()
    return Diagnosis(
        session,
        candidates,
        searched,
        posterior,
        stated,
        refitted,
        of_nothing,
        alike,
        verdict,
        checked,
        asked,
        faults,
        found,
        curves,
        nulls(model, observations),
        trend,
        _apart(searched, checked[posterior.leader.explanation], right),
        unlike if right is None else (),
        time.perf_counter() - began,
        {e: compare(model, observations, (f if e.size else refitted).theta) for e, f in posterior.fits.items()},
    )


def _of_what_is_left(posterior: Posterior, searched: Searched) -> tuple[tuple[Hint, ...], tuple[SmoothCurve, ...]]:
    """Formulas and curves that would fit, beside what is sure to act by its name: what is not, would explain a part."""
    sure = posterior.best_fit(sure_names(posterior)) or posterior.nothing
    # What is missing counts as scatter where no effect may act; with all candidates free it does not.
    node = (*searched.plain[:BUDGET], *sure.hyper.as_named(sure.best)[BUDGET:])
    return hints(sure, node), own_curves(sure, node)


def _apart(
    searched: Searched, checked: PredictiveCheck, right: PutRight | None
) -> dict[int, tuple[float, Explained | None]]:
    """Cases more probably bad than not, validation cases among them; beside a fault of the session, if there is one.

    What such a fault does to a case is no slip.
    """
    odds, slips = dict(searched.bad), dict(searched.slips)
    again = frozenset[int]()
    if right is not None:
        checked, again = right.predicted, right.offer.again
        odds, slips = odds_of_taken(right.fit.bad, [right.fit], right.fit)
    # So many among the validation cases as slips can hardly be say that the prediction is wrong, not the cases.
    if not checked.vetoes:
        odds |= checked.bad
        slips |= checked.slips
    apart = {case: float(expit(o)) for case, o in odds.items() if case not in again}
    return {case: (p, slips.get(case)) for case, p in apart.items() if p >= 0.5}


def added_by(posterior: Posterior, verdict: Verdict) -> Optimum:
    """What a verdict would add: the named explanation, or else the most probable one."""
    if verdict.kind == "found" or (verdict.kind == "undecided" and verdict.names):
        return posterior.best_fit(verdict.names) or posterior.leader
    if verdict.kind in ("nothing_missing", "none_of_catalogue"):
        return posterior.nothing
    return posterior.leader
