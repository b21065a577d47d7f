"""Which explanations are fitted: from the base and from where all candidates fit, until no neighbour promises more.

The model linearised about an optimum promises every other explanation a log posterior. Promises order the work; what
is said is read from fits, and from promises only of what they leave far behind.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fingermodel.diagnosis.case_odds import CaseOdds
from fingermodel.diagnosis.offers import Offer, best_forms, better
from fingermodel.diagnosis.posterior.fitting import Fitter
from fingermodel.diagnosis.posterior.hyper import CARRIER, FORMS, NOISE, SCATTER, SMOOTH, Hyperparameters, Node
from fingermodel.diagnosis.posterior.marginals import Promise
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.bad_cases import LOG_PRIOR_ODDS, SUSPECT_LOG_ODDS, chance_of
from fingermodel.diagnosis.session_model.candidates import NOTHING, Candidate, Candidates, Explanation, Member
from fingermodel.diagnosis.session_model.session import Session
from fingermodel.diagnosis.session_model.slips import Explained
from fingermodel.diagnosis.settings import MOST_FITS, P_VALUE, WITHIN

Floats = NDArray[np.float64]

# Singles that are fitted whatever they promise about the base, and from which pairs are made; most pairs that are
# fitted first; and singles that are fitted whatever they promise about where all candidates fit.
_FIRST, _FIRST_OF_ALL = 8, 3
# Units of chi-square that a step of the fit must promise at which the columns of scatter are made.
_ROUGH = 2.0
# Share of the work that is left by every fit, as far as anybody knows: most searches take some 14.
_LEFT_PER_FIT = 0.87
# Prior widths from its null at which a parameter is tried that has no slope there.
_SHAPES = (-1.6, -1.0, -0.4, 0.4, 1.0, 1.6)
# A little of something smooth [N].
_SMOOTH = 0.08
# Log posterior by which a promise must exceed what a fit has, for it to be fitted anew.
_MORE = 1.0


@dataclass(frozen=True, eq=False)
class Searched:
    """Everything that was fitted, and what the rest promises.

    Attributes:
        hyper: axes of the hyperparameters.
        fits: the best optimum of each explanation.
        promised: to explanations that were not fitted.
        plain: node at which a refit counts, scatter and noise as the readings have them with all candidates free.
        bad: log odds of each case that is taken for a bad one, by index of the case.
        slips: what may have been done in these instead of what was entered.
    """

    hyper: Hyperparameters
    fits: dict[Explanation, Optimum]
    promised: dict[Explanation, Promise]
    plain: Node
    bad: dict[int, float] = field(default_factory=dict)
    slips: dict[int, Explained] = field(default_factory=dict)

    @property
    def nothing(self) -> Optimum:
        """The base model."""
        return self.fits[NOTHING]


class Searcher:
    """Searches one session: `begin`, then `run`.

    Args:
        session: to search.
        candidates: that may act.
        start: (parameters,) of an earlier fit of the base model, tried besides the priors' centre.
        progress: is told the share done.
    """

    def __init__(
        self,
        session: Session,
        candidates: Candidates,
        start: Floats | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        self._start = start
        self._candidates, self._hyper = candidates, Hyperparameters.of(session)
        self._fitter = self._about_centre = Fitter(session, candidates, self._hyper)
        self._tell = progress or (lambda _: None)
        self._odds = CaseOdds(session, self._hyper)
        self._fits: dict[Explanation, Optimum] = {}
        # What was fitted because a leader promised it.
        self._asked: set[tuple[Explanation, Optimum]] = set()
        # One slip after another: the case that is bad, or the two that were exchanged.
        self._slipped: tuple[frozenset[int], ...] = ()
        self._singles = candidates.singles
        self._prior: dict[Explanation, float] = {}
        self._kept = 0

    def begin(self) -> float:
        """Fit the base model and all candidates at once beside the cases that are grossly off.

        Returns:
            A log posterior that no explanation exceeds.
        """
        self._slipped = self._gross()
        every = self._begun()
        sound, taken = self._sound(every), self._bad
        self._slipped = tuple(cases for cases in self._paired(every) if not cases & sound)[: self._most_slips]
        self._all = every if self._bad == taken else self._begun()
        return self._most_of_any(self._all)

    def settled(self) -> tuple[Fitter, Optimum, Node]:
        """Begin, and take all bad cases out; return what fits beside them, the base model, and the node of a refit."""
        self.begin()
        self._all = self._without_bad_cases(self._all)
        return self._fitter, self.nothing, self._plain

    @property
    def _plain(self) -> Node:
        return self._hyper.as_stated(self._all.best)

    @property
    def nothing(self) -> Optimum:
        """The base model, as far as it is fitted."""
        return self._fits[NOTHING]

    def unsearched(self) -> Searched:
        """The base model alone, and what it promises the rest."""
        return Searched(self._hyper, self._fits, self._rest(), self._plain)

    def run(self, most: int = MOST_FITS) -> Searched:
        """Search on, with so many fits at most."""
        self._all = self._without_bad_cases(self._all)
        self._explain(self._all, most)
        while len(self._slipped) < self._most_slips and (cases := self._overlooked()):
            kept, before = (self._slipped, self._fitter, self._fits), self._leader.log_posterior
            self._slipped, self._fits = (*self._slipped, cases), {}
            self._explain(self._begun(), most)
            found = self._odds.explained(self._leader, cases)
            gain = max((one.gain for one in found.values()), default=0.0)
            if self._leader.log_posterior + LOG_PRIOR_ODDS + gain <= before:
                self._slipped, self._fitter, self._fits = kept
                break
        odds = self._odds.of_taken(self._bad, self._fits.values(), self._leader)
        return Searched(self._hyper, self._fits, self._rest(), self._plain, *odds)

    def _explain(self, every: Optimum, most: int) -> None:
        """Fit explanations, the cases taken for bad as they are."""
        self._first_fits(every)
        self._until_none_promises(most)
        self._finish(every)
        self._until_none_promises(most)
        # What is left may be of one tendon, or of one rotation.
        asked: set[Explanation] = set()
        while new := [f for e, f in self._fits.items() if e not in asked and self._near(f.promise_of_one)]:
            asked.update(fit.explanation for fit in new)
            for fit in new:
                if fit.promise_of_one > fit.log_posterior + _MORE:
                    self._keep(self._fitter.of_one(fit))
            self._until_none_promises(most)

    def _overlooked(self) -> frozenset[int]:
        """A case (or two exchanged) that would make an explanation more probable than the leader if it were bad.

        What a slip does may have been taken for an effect, or for a bent budget, while all candidates were free.
        """
        best, found = self._leader.log_posterior, frozenset[int]()
        for fit in self._fits.values():
            apart = {c: a for c, a in fit.left_out(fit.best).items() if c not in self._bad}
            # However well a slip of two cases explains them, it gains no more than half their misfit.
            most = 0.5 * sum(sorted(a.misfit for a in apart.values())[-2:])
            if fit.log_posterior + LOG_PRIOR_ODDS + most <= self._leader.log_posterior:
                continue
            for case, one in self._odds.slips_of(apart, fit).items():
                value = fit.log_posterior + LOG_PRIOR_ODDS + apart[case].anything + one.gain
                if value > best:
                    best, found = value, self._worst({case: (value, one.partner)})
        return found

    def _most_of_any(self, every: Optimum) -> float:
        """Log posterior that no explanation exceeds: fitted as well as with all candidates, at the base model's price.

        As many cases as may be slips are explained entirely.
        """
        base = self.nothing
        gains = (base.log_joint(n) + 0.5 * (base.misfit(n) - every.misfit(n)) for n in {base.best, every.best})
        apart = every.left_out(every.best).items()
        worst = sorted((one.misfit for case, one in apart if case not in every.bad), reverse=True)
        further = self._most_slips - len(self._slipped)
        slips = sum(max(LOG_PRIOR_ODDS + 0.5 * misfit, 0.0) for misfit in worst[:further])
        return max(base.log_posterior, *gains) + slips

    def _gross(self) -> tuple[frozenset[int], ...]:
        """Cases so far off that no fit is needed to see it, and any fit would be bent by them; the worst first.

        They are bad although all candidates are free, cases scatter much, and budget and anatomy are as wide as can be.
        """
        node = self._hyper.lenient
        host = self._fitter.linearised(self._every, self._session.problem.centre, node, frozenset(), 0.0)
        taken: list[int] = []
        # A slip may be of two cases.
        while len(taken) < 2 * self._most_slips:
            gains = replace(host, bad=frozenset(taken)).log_odds_bad(node)
            odds = {case: LOG_PRIOR_ODDS + gain for case, gain in gains.items() if case not in taken}
            worst = max(odds, key=lambda case: odds[case], default=None)
            if worst is None or odds[worst] < SUSPECT_LOG_ODDS:
                break
            taken.append(worst)
        return tuple(frozenset({case}) for case in taken)

    def _sound(self, every: Optimum) -> frozenset[int]:
        """Cases taken for bad that are not where all candidates act, or where none does."""
        hosts = (every, self.nothing) if self._bad else ()
        odds = [self._odds.of_taken(self._bad, [host], host)[0] for host in hosts]
        return frozenset(case for of_host in odds for case, value in of_host.items() if value < SUSPECT_LOG_ODDS)

    def _paired(self, every: Optimum) -> tuple[frozenset[int], ...]:
        """The slips so far, two bad cases that were exchanged as one."""
        hosts = (every, self.nothing) if len(self._slipped) > 1 else ()
        found = [(case, one.partner) for h in hosts for case, one in self._odds.explained(h, self._bad).items()]
        pairs = dict.fromkeys(frozenset({case, other}) for case, other in found if other in self._bad)
        paired = frozenset[int]().union(*pairs)
        return (*pairs, *(cases for cases in self._slipped if not cases <= paired))

    def _without_bad_cases(self, every: Optimum) -> Optimum:
        """Take cases for bad, the worst first, until none is; then those back that the later ones had made so."""
        taken: list[frozenset[int]] = []
        while len(self._slipped) < self._most_slips and (worst := self._worst(self._least_odds(every))):
            if worst in taken:
                break
            taken.append(worst)
            self._slipped = (*self._slipped, worst)
            every = self._begun()
            for cases in [t for t in taken[:-1] if t in self._slipped]:
                kept = self._slipped, self._fitter, self._fits, every
                self._slipped, self._fits = tuple(s for s in self._slipped if s != cases), {}
                every = self._begun()
                if cases & self._least_odds(every).keys():
                    self._slipped, self._fitter, self._fits, every = kept
        return every

    @property
    def _bad(self) -> frozenset[int]:
        return frozenset().union(*self._slipped)

    @property
    def _most_slips(self) -> int:
        """So many slips may have happened; that there were more is out of the question."""
        cases = len(np.unique(self._session.fitted_noise.cases))
        return int(np.sum(chance_of(np.arange(1, cases + 1), cases) >= P_VALUE))

    @property
    def _session(self) -> Session:
        return self._fitter.session

    @cached_property
    def _every(self) -> Explanation:
        """All candidates at once."""
        parameters = sorted({i for c in self._candidates.all for form in c.forms for i in form})
        all_of_them = Candidate("all candidates", "", (tuple(parameters),), 1.0)
        return Explanation((Member(all_of_them),))

    def _begun(self) -> Optimum:
        """Fit all candidates at once, and the base model from there and from the priors' centre."""
        problem = self._session.problem
        node, explanation = self._hyper.usual, self._every
        rough = self._about_centre.fit_at(explanation, [problem.centre], node, self._bad, _ROUGH)
        # Scatter changes a reading as the fitted finger does, not as the normative one.
        self._fitter = replace(self._about_centre, session=self._session.seen_from(rough.theta))
        every = self._fitter.fit(explanation, rough.theta, node, self._bad, 0.0)
        self._fits.clear()
        self._asked.clear()
        for one in [
            problem.centre,
            np.where(problem.free, every.theta, problem.centre),
            *([] if self._start is None else [self._start]),
        ]:
            self._keep(self._fitter.fit(NOTHING, one, every.mode, self._bad))
        base = self.nothing
        if every.misfit(base.best) + every.unkept > base.misfit(base.best) + base.unkept:
            # With more free it fits no worse: the solver went astray.
            again = self._fitter.fit(explanation, base.theta, base.best, self._bad, 0.0)
            every = max(every, again, key=lambda fit: fit.log_posterior)
        return every

    def _keep(self, found: Optimum) -> None:
        self._kept += 1
        self._tell(1.0 - _LEFT_PER_FIT**self._kept)
        known = self._fits.get(found.explanation)
        if known is None or found.log_posterior > known.log_posterior:
            self._fits[found.explanation] = found
        leader = self._leader
        for fit in self._fits.values():
            if fit is not leader and fit.explanation.size:
                _ = fit.promise_of_one
                fit.forget()

    def _least_odds(self, every: Optimum) -> dict[int, tuple[float, int | None]]:
        """Log odds of cases probably bad whether all candidates act or none, and what each was swapped with."""
        least: dict[int, float] = {c: np.inf for c in range(len(self._session.observations.ids)) if c not in self._bad}
        partners: dict[int, int | None] = {}
        for host in (every, self.nothing, self._fitter.of_one(self.nothing)):
            odds = self._odds.of_each(host)
            slips = self._odds.explained(host, least)
            least = {c: min(o, odds[c] + (slips[c].gain if c in slips else 0.0)) for c, o in least.items() if c in odds}
            partners |= {c: e.partner for c, e in slips.items()}
            least = {c: o for c, o in least.items() if o >= SUSPECT_LOG_ODDS}
        return {c: (o, partners.get(c)) for c, o in least.items()}

    @staticmethod
    def _worst(odds: dict[int, tuple[float, int | None]]) -> frozenset[int]:
        """The case (or the two exchanged) most probably bad."""
        if not odds:
            return frozenset()
        worst = max(odds, key=lambda c: odds[c][0])
        partner = odds[worst][1]
        return frozenset({worst} | ({partner} if partner is not None else set()))

    def _log_prior(self, explanation: Explanation) -> float:
        if explanation not in self._prior:
            self._prior[explanation] = self._candidates.log_prior(explanation)
        return self._prior[explanation]

    def _promised(
        self, host: Optimum, offers: Sequence[Explanation], nodes: Sequence[Node]
    ) -> dict[Explanation, float]:
        """Log posterior that a host promises; counted so that the host's own is what it has."""
        if not offers:
            return {}
        given = [host.explanation, *offers] if host.log_prior < 0.0 else list(offers)
        values = host.promises(given, nodes)
        if host.log_prior < 0.0:
            lacking = host.log_posterior - (values[0] + host.log_prior)
            values = values[1:] + max(lacking, 0.0)
        return {e: float(v) + self._log_prior(e) for e, v in zip(offers, values, strict=True)}

    def _nodes(self, host: Optimum) -> list[Node]:
        """A host's best node, and others at which less of what an effect may explain is explained already.

        With little of what is smooth, without it, and without more than usual scatter or noise.
        """
        little = int(np.argmin(np.abs(self._hyper.axes[SMOOTH].values - _SMOOTH)))
        best, usual = host.best, self._hyper.usual
        less = (*best[:SMOOTH], *(min(little, i) for i in best[SMOOTH:CARRIER]), 0, *best[FORMS:])
        plain = (min(best[SCATTER], usual[SCATTER]), usual[NOISE], *self._hyper.without_smooth(best)[2:])
        return list(dict.fromkeys([best, self._hyper.of_all(best), self._hyper.without_smooth(best), less, plain]))

    def _first_fits(self, every: Optimum) -> None:
        """Fit what promises to come near the leader about the base, and about where all candidates fit."""
        about_base = better(self._offered(self.nothing, self._singles), self._shaped(self.nothing))
        about_all = self._offered(every, self._singles)
        pairs: dict[Explanation, Offer] = {}
        for host, offers, most in ((self.nothing, about_base, _FIRST), (every, about_all, _FIRST_OF_ALL)):
            firsts = best_forms(offers)[:_FIRST]
            # The best are fitted whatever they promise: the base is bent to do without them.
            for explanation in firsts[:most]:
                self._fit(explanation, offers[explanation].host)
            pairs = better(pairs, self._offered(host, self._candidates.pairs(firsts)))
        self._fit_singles(better(about_base, about_all))
        for explanation in best_forms(pairs)[:_FIRST]:
            if not self._near(pairs[explanation].value):
                break
            self._fit(explanation, pairs[explanation].host)

    def _fit_singles(self, offers: Mapping[Explanation, Offer]) -> None:
        """Fit singles until the next one's promise would not do, however far promises have fallen short here.

        A straight line from the base falls short where the model bends, or where an effect has a form of its own.
        """
        for explanation in sorted(offers, key=lambda e: -offers[e].value):
            short = max(0.0, *(fit.log_posterior - offers[e].value for e, fit in self._fits.items() if e in offers))
            if not self._near(offers[explanation].value + short):
                break
            # One form of an effect may do where another does not, by as much.
            forms = [fit.log_posterior for e, fit in self._fits.items() if e.names == explanation.names]
            if explanation not in self._fits and self._near(max(forms, default=np.inf) + short):
                self._fit(explanation, offers[explanation].host)

    def _offered(self, host: Optimum, explanations: Sequence[Explanation]) -> dict[Explanation, Offer]:
        """What a host promises."""
        promised = self._promised(host, explanations, self._nodes(host))
        return {e: Offer(value, host) for e, value in promised.items()}

    def _near(self, log_posterior: float) -> bool:
        return log_posterior >= self._leader.log_posterior - WITHIN

    @property
    def _leader(self) -> Optimum:
        return max(self._fits.values(), key=lambda o: o.log_posterior)

    def _shaped(self, base: Optimum) -> dict[Explanation, Offer]:
        """What forms promise that have a parameter without slope at its null (a moment, a time constant).

        Such a parameter says where or how an effect acts, so the base is linearised with it at several values.
        """
        flat = ~base.slopes.any(axis=0) & (self._session.problem.sd > 0.0) & ~self._session.problem.free
        offers = [e for e in self._singles if flat[list(e.parameters)].any()]
        best: dict[Explanation, Offer] = {}
        problem = self._session.problem
        for widths in _SHAPES if offers else ():
            theta = np.where(
                flat, np.clip(problem.centre + widths * problem.scale, problem.lower, problem.upper), base.theta
            )
            host = self._fitter.linearised(NOTHING, theta, base.best, self._bad, base.log_prior)
            values = host.promises(offers, self._nodes(base))
            best = better(
                best, {e: Offer(float(v) + self._log_prior(e), host) for e, v in zip(offers, values, strict=True)}
            )
        return best

    def _fit(self, explanation: Explanation, host: Optimum) -> None:
        best = host.best if host in self._fits.values() else self.nothing.best
        node = self._hyper.without_smooth(best)
        self._keep(self._fitter.fit(explanation, host.expected(explanation, node), node, self._bad))

    def _until_none_promises(self, most: int) -> None:
        """Fit neighbours of the leader that promise to come near it, and more than they have, until none is left."""
        while self._kept < most:
            leader = self._leader
            offers = [e for e in self._candidates.neighbours(leader.explanation) if (e, leader) not in self._asked]
            promised = self._offered(leader, offers)
            limit = leader.log_posterior - WITHIN
            known = {e: self._fits[e].log_posterior + _MORE for e in promised if e in self._fits}
            chosen = [e for e in best_forms(promised) if promised[e].value > max(limit, known.get(e, -np.inf))][:3]
            if not chosen:
                break
            for explanation in chosen:
                self._asked.add((explanation, leader))
                self._fit(explanation, leader)

    def _finish(self, every: Optimum) -> None:
        """Begin the leader and its members anew, and what comes near it from where the leader expects that."""
        problem, node = self._session.problem, self._hyper.without_smooth(every.mode)
        leader = self._leader
        for members in dict.fromkeys([leader.explanation.members, *((m,) for m in leader.explanation.members)]):
            explanation = Explanation(members)
            for start in (problem.centre, every.expected(explanation, node)) if members else ():
                self._keep(self._fitter.fit(explanation, start, leader.best, self._bad))
        leader = self._leader
        others = [f for f in self._fits.values() if f is not leader]
        promised = self._promised(leader, [f.explanation for f in others], self._nodes(leader))
        for fit in others:
            if self._near(promised[fit.explanation]) and promised[fit.explanation] > fit.log_posterior + _MORE:
                start = leader.expected(fit.explanation, leader.best)
                self._keep(self._fitter.fit(fit.explanation, start, fit.best, self._bad))

    def _rest(self) -> dict[Explanation, Promise]:
        """What the leader promises explanations that were not fitted.

        No more than would have had them fitted: a straight line from far off may promise anything.
        """
        leader = self._leader
        most = leader.log_posterior - WITHIN
        offers = dict.fromkeys([*self._candidates.neighbours(leader.explanation), *self._singles])
        promised = self._promised(leader, [e for e in offers if e not in self._fits], [leader.best])
        return {e: Promise.of(e, leader, min(value, most), self._log_prior(e)) for e, value in promised.items()}
