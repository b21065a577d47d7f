"""Faults of a whole session, as explanations of their own: its labels or units put right, and the base model fitted.

Tendons or postures exchanged, the side mirrored, the sign of an angle, a unit, one mount's gain, one weight. Each is
one way in which what was entered differs from what was done in many cases at once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import get_args

import numpy as np
from scipy.special import logit, logsumexp

from fingermodel.arrays import Mask
from fingermodel.comparison.comparison import compare
from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.posterior.fitting import Fitter
from fingermodel.diagnosis.posterior.hyper import Node
from fingermodel.diagnosis.posterior.marginals import Posterior
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.search.beginning import Beginner, bad_in
from fingermodel.diagnosis.session_model.candidates import NOTHING, Candidates, Explanation
from fingermodel.diagnosis.session_model.session import Session, session_of
from fingermodel.diagnosis.settings import FAR, P_FAULT, SURE
from fingermodel.diagnosis.verdict.changes import Amend, Change, Kind, changes, told
from fingermodel.diagnosis.verdict.corrections import OF_A_SLIP, Corrected, Entries
from fingermodel.diagnosis.verdict.predictive import PredictiveCheck, check
from fingermodel.diagnosis.verdict.trend import Trend
from fingermodel.diagnosis.verdict.verdict import explains_with_rig_as_stated

# Faults that are fitted, of those that promise most.
_FITTED = 2
# Most times that the likeliest is fitted while its amount moves.
_ROUNDS = 4
# Relative move of a changed value from which the session is fitted again with it.
_MOVED = 0.02


@dataclass(frozen=True)
class SessionFault:
    """A fault of the whole session."""

    kind: Kind  # of fault
    words: str  # what was done instead of what was entered
    probability: float  # that it is so
    amend: tuple[Amend, ...] = ()  # amendments that put it right; none where amendments cannot
    # RMSE of the validation cases as they were entered, and with it put right; None where that was not asked.
    validation_rmse_N: tuple[float, float] | None = None

    @property
    def effect(self) -> str:
        """What shows once it is put right."""
        later = "what is missing shows once that is corrected"
        if self.validation_rmse_N is None:
            return later
        before, after = self.validation_rmse_N
        return f"{later}; the RMSE of the validation cases is then {after:.3f} N instead of {before:.3f} N"


@dataclass(frozen=True, eq=False)
class PutRight:
    """How well the readings are explained with one fault put right."""

    offer: Corrected  # the fault, its amount as the fit tells it
    log_posterior: float  # of the base model, and of one effect beside it; the fault's own prior included
    fit: Optimum  # the better of the two
    entered: Fitter  # fits the session without the fault, mostly as it was entered

    @cached_property
    def predicted(self) -> PredictiveCheck:
        """The validation cases held against what it predicts."""
        return check(self.fit)

    @property
    def of_all(self) -> float:
        """Log posterior by all cases: those that were fitted, and the validation cases as they are then predicted."""
        unseen = ~self.entered.session.fitted
        return self.log_posterior + self.predicted.log_evidence + float(self.offer.log_units[unseen].sum())

    @cached_property
    def without(self) -> float:
        """The same of that explanation without the fault, fitted from there.

        Where a search without the fault went astray, a fault may win by where its own fit began.
        """
        fit = self.entered.fit(self.fit.explanation, self.fit.theta, self.fit.mode, self.fit.bad)
        return fit.log_posterior + check(fit).log_evidence


def put_right(candidates: Candidates, nothing: Optimum, before: Sequence[PutRight] | None = None) -> list[PutRight]:
    """Put faults of the whole session right, one at a time, and fit the base model again, slips beside it or not.

    Those that balance shows are all fitted; of the others, those that promise most where the finger is as measured, and
    the amounts that promise most about the base model. Where an effect promises far more, it comes first; they are
    asked again beside it, and if that does not explain the session.

    Args:
        candidates: of the diagnosis.
        nothing: the base model of the session as it was entered.
        before: faults that were fitted before the search; then those are that were passed over because an effect
            promised far more.
    """
    session, hyper = nothing.session, nothing.hyper
    as_measured = Fitter(session, candidates, hyper).linearised(
        NOTHING, session.problem.centre, hyper.usual, nothing.bad, 0.0
    )
    # Readings miss the finger as it was measured by more than noise, and by less than most faults. How much of that may
    # be something smooth is not known before: with some of it, the others' misfit does not decide; or as they read.
    smooth = hyper.with_smooth(hyper.usual)
    hosts = ((as_measured, smooth), (nothing, nothing.best))
    least = [max(_of_effects(*host, candidates) - FAR, 0.0) for host in hosts]
    if before is not None:
        if not any(least):
            return []
        least = [0.0 for _ in hosts]
    entries = Entries(session, session.problem.centre)
    by_balance = list(entries.frames())
    possible = _Possible.of(entries, [] if by_balance else list(entries.signs()), len(by_balance))
    best, changes = dict[Corrected, None](), dict[str, Corrected]()
    for (host, node), more in zip(hosts, least, strict=True):
        best |= dict.fromkeys(possible.labels(as_measured, node, more))
        changes |= possible.changed(host, node, more)
    best |= dict.fromkeys(changes.values())
    known = {put.offer.fault for put in before or ()}
    offers = [o for o in [*by_balance, *best] if o.fault not in known]
    bases = {o: _base(candidates, nothing, o, frozenset()) for o in offers}
    alone = {o: _fitted(nothing, o, possible.prior(o.kind), base, 0) for o, base in bases.items()}
    if not alone:
        return []
    # Beside an effect, and beside slips, the likeliest is likelier still.
    likeliest = max(alone, key=lambda o: alone[o].log_posterior)
    slips = [frozenset[int](), nothing.bad]
    if alone[likeliest].log_posterior > nothing.log_posterior:
        slips.append(bad_in(Beginner(_with_readings(session, likeliest.observations), candidates).gross()))
    beside = [
        _fitted(
            nothing,
            likeliest,
            possible.prior(likeliest.kind),
            _base(candidates, nothing, likeliest, bad) if bad else bases[likeliest],
            _ROUNDS,
        )
        for bad in dict.fromkeys(slips)
    ]
    alone[likeliest] = max(beside, key=lambda put: put.log_posterior)
    return list(alone.values())


def put_right_beside(candidates: Candidates, leader: Optimum) -> list[PutRight]:
    """Put what promises most beside an explanation right, and fit it again.

    Beside a strong effect the base model alone does not show what else is another than was entered.

    Args:
        candidates: of the diagnosis.
        leader: the explanation, of a session as it was entered.
    """
    possible = _Possible.of(Entries(leader.session, leader.theta), [], 0)
    out = []
    for offer in [*possible.labels(leader, leader.best), *possible.changed(leader, leader.best).values()]:
        fitter = Fitter(_with_readings(leader.session, offer.observations), candidates, leader.hyper)
        fit = fitter.fit(leader.explanation, leader.theta, leader.best, leader.bad)
        out.append(_fitted(leader, offer, possible.prior(offer.kind), (fitter, fit), 0))
    return out


@dataclass(frozen=True, eq=False)
class _Possible:
    """What may have been entered wrongly, of which each changes more of the fitted cases than a slip does."""

    entries: Entries  # as they were entered
    offers: list[Corrected]  # of labels and units
    changes: list[Change]  # by an amount
    counts: Counter[Kind]  # of each kind, from which its prior follows

    @classmethod
    def of(cls, entries: Entries, more: Sequence[Corrected], by_balance: int) -> _Possible:
        """All of them, with further offers; so many others are shown by balance."""
        fitted, cases = entries.session.fitted, entries.session.fitted_cases
        # What changes the same fitted readings alike is one fault; what changes none is looked for in `unseen_faults`.
        struck = (o for o in reversed([*entries.corrected(), *more]) if _strikes(entries, o.away != entries.away))
        offers = list({o.away[fitted].tobytes(): o for o in struck}.values())
        changed = [c for c in changes(entries.session) if _strikes(entries, c.cases[entries.session.rows // 6])]
        alike = {(c.kind, c.lacks, c.acts[cases].tobytes()): c for c in reversed(changed)}
        changed = list(alike.values())[::-1]
        counts = Counter([*(o.kind for o in offers), *(change.kind for change in changed)])
        return cls(entries, offers, changed, counts + Counter[Kind]({"axes": by_balance, "rows": entries.runs}))

    def prior(self, kind: Kind) -> float:
        """Log prior of a fault of a kind."""
        return _log_share(self.counts[kind])

    def labels(self, fit: Optimum, node: Node, least: float = 0.0) -> list[Corrected]:
        """Faults of labels and units that promise most about a fit there, and more than that."""
        fitted = self.entries.session.fitted
        away = np.array([self.entries.away[fitted], *(o.away[fitted] for o in self.offers)])
        as_entered, *values = fit.log_joints_of(away.T, node)
        gains = {o: self.prior(o.kind) + v - as_entered for o, v in zip(self.offers, values, strict=True)}
        return [o for o in sorted(self.offers, key=lambda o: -gains[o])[:_FITTED] if gains[o] > least]

    def changed(self, fit: Optimum, node: Node, least: float = 0.0) -> dict[str, Corrected]:
        """Changes by an amount that promise most about a fit, and more than that, by what is said of them."""
        promised = told(fit, node, self.changes)
        likely = sorted(((self.prior(change.kind) + gain, change) for change, gain in promised), key=lambda of: -of[0])
        return {c.saying: self.entries.put_right(c) for promise, c in likely[:_FITTED] if promise > least}


def session_faults(
    found: Sequence[PutRight],
    posterior: Posterior,
    checked: Mapping[Explanation, PredictiveCheck],
    trend: Trend | None,
) -> list[tuple[SessionFault, PutRight]]:
    """Weigh faults of the whole session against everything that was found without them.

    Args:
        found: of `put_right` and `put_right_beside`; of one fault the better.
        posterior: of the session as entered.
        checked: validation cases as entered, by explanation, the most probable one among them.
        trend: of what is left as entered, which is no fault.

    Returns:
        What is more probable than not and explains the readings, most probable first, with how well.
    """
    found = list({f.offer.fault: f for f in sorted(found, key=lambda f: f.log_posterior)}.values())
    found = [f for f in found if f.log_posterior >= posterior.leader.log_posterior]
    # As a slip in one case it is weighed by the whole likelihood, not by a power of it; and by the validation cases,
    # too: what makes up for something else in the fitted ones predicts no better for it.
    as_it_is = [posterior.fits[e].log_posterior + c.log_evidence for e, c in checked.items()]
    with_trend = [max(as_it_is) + trend.log_evidence + _log_share(1)] if trend else []
    rest, by_words = [*as_it_is, *with_trend], {f.offer.words: f for f in found}
    offers, values = [f.offer for f in found], [f.of_all for f in found]
    could = [by_words[fault.words] for fault in _probable(offers, values, rest)]
    said = _probable(offers, values, [*rest, *(f.without for f in could)])
    # A fault that leaves more than noise may make up for a part of something else.
    each = [(fault, by_words[fault.words]) for fault in said]
    sound, before = [of for of in each if explains_with_rig_as_stated(of[1].fit)], posterior.nothing
    return [(replace(fault, validation_rmse_N=_unseen_rmse(before, put.fit)), put) for fault, put in sound]


def _unseen_rmse(before: Optimum, after: Optimum) -> tuple[float, float] | None:
    """RMSE [N] of the validation cases in the plane that the finger is judged in, by two fits; None without any."""
    each = [compare(fit.session.model, fit.session.observations, fit.theta) for fit in (before, after)]
    first, second = (one.select(role="validation").errors(one.judged_in).rmse_N for one in each)
    return None if first is None or second is None else (first, second)


def unseen_faults(
    candidates: Candidates, posterior: Posterior, checked: Mapping[Explanation, PredictiveCheck]
) -> list[SessionFault]:
    """Faults that change validation cases alone, by how well these are predicted once one is put right.

    Args:
        candidates: of the diagnosis.
        posterior: of the session as entered.
        checked: validation cases as entered, by explanation, the most probable one among them.

    Returns:
        As `session_faults`; none where the cases are as the most probable explanation predicts them.
    """
    leader = posterior.leader
    session, as_entered = leader.session, checked[leader.explanation]
    if not (as_entered.vetoes or as_entered.bad):
        return []
    entries, fitted = Entries(session, leader.theta), session.fitted
    # A weight that hangs in validation cases alone may be told to weigh whatever makes up for what is new there.
    unseen = [c for c in changes(session) if not c.spread and not c.cases[session.fitted_cases].any()]
    offers = [*entries.corrected(), *(entries.put_right(replace(change, amount=1.0)) for change in unseen)]
    offers = [o for o in offers if np.array_equal(o.away[fitted], entries.away[fitted])]
    offers = [o for o in offers if _count(entries, o.away != entries.away) > OF_A_SLIP]
    precision = np.linalg.inv(as_entered.predictions[0][1].covariance)
    likely = sorted(offers, key=lambda o: float(o.away[~fitted] @ precision @ o.away[~fitted]))[:_FITTED]
    values = list[float]()
    for offer in likely:
        fitter = Fitter(_with_readings(session, offer.observations).seen_from(leader.theta), candidates, leader.hyper)
        again = check(fitter.linearised(leader.explanation, leader.theta, leader.node, leader.bad, leader.log_prior))
        # What leaves these cases unexplained may make up for a part of something else.
        value = posterior.weight(leader) + again.log_evidence + _log_share(len(offers))
        values.append(-np.inf if again.vetoes else value)
    rest = [posterior.weights[e] + c.log_evidence for e, c in checked.items()]
    return _probable(likely, values, rest)


def outdoes(found: Sequence[PutRight], log_posterior: float) -> bool:
    """Whether a fault is sure whatever may act, if nothing that acts has a higher log posterior than this."""
    sure = [f for f in found if f.log_posterior - log_posterior > logit(SURE)]
    return any(
        not f.predicted.vetoes and explains_with_rig_as_stated(f.fit) and f.of_all - f.without > logit(SURE)
        for f in sure
    )


def _probable(found: Sequence[Corrected], log_posterior: Sequence[float], rest: Sequence[float]) -> list[SessionFault]:
    """Faults that are more probable than not, most probable first; `rest` are log posteriors without any fault."""
    total = float(logsumexp([*rest, *log_posterior]))
    each = zip(found, log_posterior, strict=True)
    out = [SessionFault(f.kind, f.words, float(np.exp(v - total)), f.amend) for f, v in each]
    return sorted((f for f in out if f.probability >= 0.5), key=lambda f: -f.probability)


def _strikes(entries: Entries, changed: Mask) -> bool:
    """Whether the readings (n,) that a fault changes are of more cases than a slip, as many as a slip's fitted."""
    return _count(entries, changed) > OF_A_SLIP and _count(entries, changed & entries.session.fitted) >= OF_A_SLIP


def _count(entries: Entries, readings: Mask) -> int:
    """Of how many cases some readings (n,) are."""
    return len(np.unique(entries.session.rows[readings] // 6))


def _of_effects(fit: Optimum, node: Node, candidates: Candidates) -> float:
    """Log posterior that one effect promises to add about the base model."""
    offers = [NOTHING, *candidates.singles]
    alone, *effects = fit.promises(offers, [node]) + [candidates.log_prior(e) for e in offers]
    return float(max(effects, default=alone) - alone)


def _with_readings(session: Session, observations: Observations) -> Session:
    """The session with other observations of the same cases."""
    # The same readings count, whatever they are taken for: what is explained must be the same.
    other = session_of(session.model, observations, session.plane, counted=(session.rows, session.fitted))
    return replace(other, problem=replace(other.problem, free=session.problem.free))


def _log_share(alike: int) -> float:
    """Log prior of a fault: each kind is as probable as any other, and so is each fault of its kind."""
    return float(np.log(P_FAULT / len(get_args(Kind)) / max(alike, 1)))


def _base(candidates: Candidates, nothing: Optimum, offer: Corrected, bad: frozenset[int]) -> tuple[Fitter, Optimum]:
    """Fit the base model with a fault put right; and what fits further effects beside it."""
    node = nothing.hyper.usual
    other = _with_readings(nothing.session, offer.observations)
    fitter, begin = Fitter(other, candidates, nothing.hyper).begun(NOTHING, node, bad)
    return fitter, fitter.fit(NOTHING, begin, node, bad, leader=nothing.log_posterior)


def _fitted(
    nothing: Optimum, offer: Corrected, log_share: float, base: tuple[Fitter, Optimum], rounds: int
) -> PutRight:
    """Weigh the base model with a fault put right; in rounds, while its amount moves, one effect beside it as well."""
    session, (fitter, best) = nothing.session, base
    candidates, log_gain = fitter.candidates, 0.0
    if offer.change:
        ((change, log_gain),) = told(best, best.best, [offer.change])
        moved = (change.amount - offer.change.amount) / offer.change.unit
        if rounds > 1 and change.counts and abs(moved) > _MOVED:
            again = Entries(session, session.problem.centre).put_right(change)
            return _fitted(nothing, again, log_share, _base(candidates, nothing, again, best.bad), rounds - 1)
        offer = replace(offer, words=change.words)
    alone = log_posterior = best.log_posterior
    fitted = float(offer.log_units[session.fitted].sum())
    if rounds and alone + fitted >= nothing.log_posterior:
        # An effect may act as well: the one that the base promises most.
        node = best.hyper.without_smooth(best.best)
        promised = best.promises(candidates.singles, [best.best, node])
        single = candidates.singles[int(np.argmax(promised + [candidates.log_prior(e) for e in candidates.singles]))]
        beside = fitter.fit(single, best.expected(single, node), node, best.bad, leader=nothing.log_posterior)
        log_posterior = float(np.logaddexp(alone, beside.log_posterior))
        best = max(best, beside, key=lambda fit: fit.log_posterior)
    value = log_share + fitted + log_posterior + log_gain
    without = session if offer.sound is None else _with_readings(session, offer.sound)
    return PutRight(offer, value, best, Fitter(without, candidates, nothing.hyper))
