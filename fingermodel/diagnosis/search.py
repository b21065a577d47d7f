"""Fit explanations to convergence, each from what the straightened model expects, and from each other's optima."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fingermodel.diagnosis.candidates import (
    NOTHING_MISSING,
    Candidate,
    Explanation,
    log_prior,
    mask,
    members,
    pairs_of,
    single,
)
from fingermodel.diagnosis.fitted import Fitted, far_off
from fingermodel.diagnosis.fitter import BASE_STARTS, FIRST, LAST, SECOND, WORTHWHILE, Fitter, fit_from, further
from fingermodel.diagnosis.screening import beside, best_form, companions, other_forms, pairs_about
from fingermodel.problems import Problem

Floats = NDArray[np.float64]

# How many pairs are refitted, and from how many of the best singles' optima pairs are screened.
PAIRS = 20
HOSTS = 4
# Log evidence within which singles are taken further, and explanations are finished.
RACE, CONTENDERS = 30.0, 8.0
# Further evaluations of each heat; how many run in it for each that is wanted, and how many whatever they promise where
# nothing fits.
HEATS = ((3, 5, 2.0), (5, 3, 1.5), (9, 2, 1.0))
FINISHED = 12
# Evaluations of the turns in which that is done, and of those that what stays close beside the leader gets besides.
TURNS, LAST_TURNS = (15, 15, 30), (30, 30, 60)
# Readings that are fitted so quickly that every single is taken to its end.
FEW = 100
# χ² per reading from which a fit is far off.
FAR = 2.0
# χ² per reading, and share of what the base model leaves, that all candidates at once must leave for no few of them to
# explain the readings; and evaluations of that fit from either start (see docs/decisions/0002).
HOPELESS, HOPELESS_SHARE, TOGETHER = 30.0, 0.25, 40
# Singles and pairs that are fitted from there where they leave the readings far off.
ABOVE = 12
# Companions of each of the best singles that are, the first of them in all forms.
BESIDE = 2
# Of the leader against its neighbours.
ROUNDS, RIVALS = 3, 8
# Pairs whose members are tried alone.
HALVED = 3
# Explanations of which other forms are tried; twice as many where the leader is far off.
FORMED = 12
# An alternative is refitted if its screened evidence is within this much of the best one's.
NEAR = 4.0


@dataclass(frozen=True)
class Search:
    """Everything that was fitted.

    Attributes:
        nothing: the base model.
        fitted: every explanation's optimum, `nothing` among them.
        searched: how many explanations were screened.
        together: χ² that a fit of all candidates at once left, where that was too much to look for few of them any
            further; None where it was not.
    """

    nothing: Fitted
    fitted: tuple[Fitted, ...]
    searched: int
    together: float | None = None


class Searcher(Fitter):
    """Fits the base model, all singles and the most promising pairs, and finishes those that are in question."""

    def __init__(self, problem: Problem, progress: Callable[[float], None] | None = None) -> None:
        super().__init__(problem)
        self._finished: dict[Explanation, Fitted] = {}
        self._priors: dict[Explanation, float] = {}
        self._tried: set[Fitted] = set()
        self._formed: set[Explanation] = set()
        self._all: Fitted | None = None
        self._lost = False
        self._progress = progress or (lambda _: None)

    def run(self, candidates: tuple[Candidate, ...], start: Floats | None = None, thorough: bool = False) -> Search:
        """Fit nothing, all singles and the best pairs; each from the others' optima too.

        Args:
            candidates: to search.
            start: of the base model besides the priors' centre, such as an earlier fit.
            thorough: more pairs and more starts, whatever hope there is, and every single to its end.
        """
        more = 3 if thorough else 1
        nothing, pairs = self.base(start, BASE_STARTS * more), PAIRS * more
        far = far_off(nothing, FAR)
        self._lost = far and not thorough and self._hopeless(candidates)
        host = self._above(candidates) if far and not self._lost else nothing
        whole = thorough or len(self.problem.rows) <= FEW
        for done, candidate in enumerate(candidates):
            if whole:
                self._wholly(candidate, (host, nothing) if host is not nothing else (host,))
            else:
                self._single(candidate, host)
            self._progress(0.5 * (done + 1) / len(candidates))
        if host is not nothing and far_off(self._leader(candidates), FAR):
            self._from(host, candidates, ABOVE * more)
            pairs -= ABOVE * more
        self._race(HOSTS * more)
        self._nested(HOSTS * more)
        self._pairs(candidates, pairs)
        if host is not nothing and far_off(self._leader(candidates), FAR):
            self._beside(host, candidates, HOSTS * more)
        if not self._lost:
            self._race(HOSTS * more, size=2)
        self._forms(candidates)
        self._polish(candidates)
        self._neighbours(candidates)
        if not self._lost:
            self._anew(candidates)
            self._halves(candidates)
            self._weighable(candidates)
        self._nested(2)
        self._polish(candidates)
        self._progress(1.0)
        searched = 1 + len(candidates) + len(pairs_of(candidates))
        together = self._left_by_all(candidates) if self._lost else None
        return Search(self.best[NOTHING_MISSING], tuple(self.best.values()), searched, together)

    def _left_by_all(self, candidates: tuple[Candidate, ...]) -> float:
        """χ² that all candidates at once leave, fitted as far as what is held against it and at least from there."""
        together = further(self._together(candidates), SECOND, finely=True)
        least = min((f for f in self.best.values() if f.sane), key=lambda f: f.objective)
        if together.objective > least.objective:
            together = fit_from(together.explanation, together.problem, least.theta, SECOND, finely=True)
        return together.chi2

    def _hopeless(self, candidates: tuple[Candidate, ...]) -> bool:
        """Whether even all candidates at once leave the readings far off: then no few of them can do better.

        Both starts may end in a wrong valley, but one that is so far off has been the truth's in no trial.
        """
        limit = max(HOPELESS * len(self.problem.rows), HOPELESS_SHARE * self.best[NOTHING_MISSING].objective)
        if min(f.objective for f in self.best.values()) <= limit:
            return False
        return self._together(candidates).chi2 > limit

    def _together(self, candidates: tuple[Candidate, ...]) -> Fitted:
        """All candidates at once, from the priors' centre and, if that leaves much, from the base model's optimum."""
        if self._all is None:
            own = sorted({i for c in candidates for parameters in c.alternatives for i in parameters})
            every = Explanation(tuple(c.name for c in candidates), (), tuple(own))
            problem = replace(self.problem, free=self.problem.free | mask(self.problem.model, every))
            found = fit_from(every, problem, problem.centre, TOGETHER)
            if found.solution.objective > HOPELESS * len(problem.rows):
                other = fit_from(every, problem, self.best[NOTHING_MISSING].theta, TOGETHER)
                found = min(found, other, key=lambda f: f.solution.objective)
            self._all = found
        return self._all

    def _above(self, candidates: tuple[Candidate, ...]) -> Fitted:
        """Where to begin if the base model is far off: where all candidates together fit.

        What bends the rest to do without an effect hides it. Wherever one or two of them are the truth, all together
        leave little, and the rest is bent the least: what the model, straightened out there, expects of one or two is
        a start in the truth's own valley.
        """
        all_of_them = self._together(candidates)
        return all_of_them if all_of_them.sane else self.best[NOTHING_MISSING]

    def _from(self, host: Fitted, candidates: tuple[Candidate, ...], count: int) -> None:
        """Fit the singles and pairs that promise most about a host's optimum."""
        offers = [*(best_form(host, c) for c in candidates), *pairs_about(host, candidates)]
        for explanation in self._by_promise(host, offers, candidates)[:count]:
            self.fit(explanation, [self.expected(host, explanation)], 2 * FIRST)

    def _by_promise(
        self, host: Fitted, offers: Iterable[Explanation], candidates: tuple[Candidate, ...]
    ) -> list[Explanation]:
        """What promises most about a host's optimum first."""
        return sorted(offers, key=lambda e: -(host.everything.gain(e.parameters) + self._log_prior(e, candidates)))

    def _beside(self, host: Fitted, candidates: tuple[Candidate, ...], count: int) -> None:
        """Fit what promises most beside each of the best singles about a host's optimum.

        From a single's own optimum, which bends the rest to do without the other, that may lie beyond a ridge.
        """
        for kept in self._ranked(1)[:count]:
            chosen = self._by_promise(host, beside(host, kept.explanation, candidates), candidates)[:BESIDE]
            for pair in (*chosen, *(other_forms(chosen[0], candidates) if chosen else ())):
                if pair not in self.best or far_off(self.best[pair], FAR):
                    self.fit(pair, [self.expected(host, pair)], SECOND)

    def _single(self, candidate: Candidate, host: Fitted) -> None:
        gains = [host.everything.gain(parameters) for parameters in candidate.alternatives]
        for k, gain in enumerate(gains):
            if gain >= max(gains) - NEAR:
                explanation = single(candidate, k)
                self.fit(explanation, [self.expected(host, explanation)])

    def _wholly(self, candidate: Candidate, hosts: Sequence[Fitted]) -> None:
        """Take every form of a candidate to its end from each host: some valleys look no better until far down."""
        for k in range(len(candidate.alternatives)):
            explanation = single(candidate, k)
            self.fit(explanation, [self.expected(host, explanation) for host in hosts], LAST, finely=True)

    def _race(self, count: int, size: int = 1) -> None:
        """Take those of a size further that may still win: in each heat longer, and fewer."""
        for evaluations, share, at_least in HEATS[:1] if self._lost else HEATS:
            runners = [f for f in self.best.values() if f.explanation.size == size]
            ranked = sorted(runners, key=lambda f: -f.promise)
            if not runners:
                return
            best = max(self.best.values(), key=lambda f: f.log_evidence)
            unsure = far_off(best, FAR) and not self._lost
            forced = at_least * count if unsure else count if size == 1 else 0
            for place, one in enumerate(ranked[: count * share]):
                deeper = self.deeper.pop(one.explanation, None)
                for valley in (one, deeper):
                    if valley is None or valley.converged:
                        continue
                    if place < forced or valley.promise > best.log_evidence - RACE / size:
                        self.go_on(valley, evaluations)

    def _log_prior(self, explanation: Explanation, candidates: tuple[Candidate, ...]) -> float:
        """Asked for thousands of times in a search."""
        if explanation not in self._priors:
            self._priors[explanation] = log_prior(explanation, candidates)
        return self._priors[explanation]

    def _leader(self, candidates: tuple[Candidate, ...]) -> Fitted:
        return max(self.best.values(), key=lambda f: self._value(f.explanation, candidates))

    def _neighbours(self, candidates: tuple[Candidate, ...]) -> None:
        """Hold the leader against all that differ from it in one member, from where it stands, until it stays ahead.

        A rival that was left in another valley would make the leader look sure.
        """
        for _ in range(1 if self._lost else ROUNDS):
            leader = self._leader(candidates)
            for explanation in self._rivals(leader, candidates)[:RIVALS]:
                self.fit(explanation, [self.expected(leader, explanation)], 2 * FIRST)
            self._forms(candidates)
            self._polish(candidates)
            if self._leader(candidates) is leader:
                break

    def _rivals(self, leader: Fitted, candidates: tuple[Candidate, ...]) -> list[Explanation]:
        """What one exchange leads to from a leader, and promises more than it has; the most promising first."""
        if not leader.explanation.size:
            return []
        base = leader.log_evidence - leader.everything.gain(leader.explanation.parameters)
        own = members(leader.explanation, candidates)
        if leader.explanation.size > 1:
            offers = list(own)
        else:
            offers = [best_form(leader, c) for c in candidates if c.name not in leader.explanation.names]
        for kept in own:
            offers += companions(leader, kept, candidates)
        promised = {
            e: base + leader.everything.gain(e.parameters) + self._log_prior(e, candidates)
            for e in dict.fromkeys(offers)
        }
        limit = self._value(leader.explanation, candidates) - 2.0 * CONTENDERS
        new = [e for e, v in promised.items() if v > max(self._value(e, candidates) + WORTHWHILE, limit)]
        return sorted(new, key=lambda e: -promised[e])

    def _forms(self, candidates: tuple[Candidate, ...]) -> None:
        """Try other forms of the best explanations from where they stand.

        Where an effect does not act its forms are all alike, so none of them promises more than another. The right
        effect in a wrong form need not be near the leader.
        """
        count = 2 * FORMED if far_off(self._leader(candidates), FAR) else FORMED
        for explanation in self._in_question(candidates, np.inf)[:count]:
            host = self.best[explanation]
            offers = [e for e in other_forms(explanation, candidates) if e not in self._formed]
            if not offers:
                continue
            base = host.log_evidence - host.everything.gain(explanation.parameters)
            limit = self._limit(candidates, 2.0 * CONTENDERS)
            for offer in offers:
                promised = base + host.everything.gain(offer.parameters) + self._log_prior(offer, candidates)
                if promised > max(self._value(offer, candidates) + WORTHWHILE, limit):
                    self._formed.add(offer)
                    self.fit(offer, [self.expected(host, offer)], 2 * FIRST)

    def _anew(self, candidates: tuple[Candidate, ...]) -> None:
        """Begin a leading pair and each of its members alone from the priors' centre, and take them to their end.

        What all candidates together led to may be another valley for fewer of them, and a companion would then make up
        for that.
        """
        leader, nothing = self._leader(candidates), self.best[NOTHING_MISSING]
        if leader.explanation.size < 2:
            return
        far = far_off(leader, FAR)
        for explanation in (leader.explanation, *members(leader.explanation, candidates)):
            starts = [self.problem.centre, *([self.expected(nothing, explanation)] if far else [])]
            self.fit(explanation, starts, LAST, finely=True)

    def _halves(self, candidates: tuple[Candidate, ...]) -> None:
        """Fit each member of the best pairs alone from where the pair stands: what it can do without is no member.

        An error of its form may yet decide for the single, which these evidences do not know.
        """
        for pair in self._ranked(2)[:HALVED]:
            for alone in members(pair.explanation, candidates):
                known = self.best.get(alone)
                if known is None or known.objective > pair.objective + 20.0:
                    self.fit(alone, [pair.theta], SECOND)

    def _weighable(self, candidates: tuple[Candidate, ...]) -> None:
        """Take what will be weighed further where much is left: an error of its form may turn the order then.

        The true effects in another form than ours may leave more than others that were bent to the readings.
        """
        if not far_off(self._leader(candidates), FAR):
            return
        for fitted in sorted(self._ranked(2), key=lambda f: -f.promise)[:FINISHED]:
            if not fitted.converged:
                self.go_on(fitted, SECOND, finely=True)

    def _polish(self, candidates: tuple[Candidate, ...]) -> None:
        """Finish the fits that are still in question, and the base model's.

        In turns: what one fit gains puts others out of the question.
        """
        # Where even the leader is far off, the others need no finish; where nothing can be found, none needs much.
        off = far_off(self._leader(candidates), FAR)
        count = FINISHED // 3 if off else FINISHED
        taken: set[Explanation] = set()
        for evaluations in TURNS[:1] if self._lost else TURNS:
            for explanation in self._in_question(candidates, CONTENDERS)[:count]:
                if self._finished.get(explanation) is not self.best[explanation]:
                    taken.add(explanation)
                    self._turn(explanation, candidates, CONTENDERS, evaluations)
        for evaluations in () if self._lost else LAST_TURNS:
            for explanation in self._in_question(candidates, 0.5 * CONTENDERS):
                if explanation in taken and (not off or self._would_lead(explanation, candidates)):
                    self._turn(explanation, candidates, 0.5 * CONTENDERS, evaluations)
        self._finished.update((explanation, self.best[explanation]) for explanation in taken)

    def _in_question(self, candidates: tuple[Candidate, ...], margin: float) -> list[Explanation]:
        """What may still come within a margin of the leader, and nothing; those with most evidence so far first."""
        limit = self._limit(candidates, margin)
        hopeful = [e for e in self.best if self._may_reach(limit, e, candidates)]
        return sorted(hopeful, key=lambda e: -self._value(e, candidates))

    def _turn(
        self, explanation: Explanation, candidates: tuple[Candidate, ...], margin: float, evaluations: int
    ) -> None:
        """Take a fit further unless it is out of the question by now."""
        if self._may_reach(self._limit(candidates, margin), explanation, candidates):
            self.go_on(self.best[explanation], evaluations, finely=True)

    def _may_reach(self, limit: float, explanation: Explanation, candidates: tuple[Candidate, ...]) -> bool:
        return explanation.size == 0 or self._hope(explanation, candidates) > limit

    def _hope(self, explanation: Explanation, candidates: tuple[Candidate, ...]) -> float:
        return self.best[explanation].promise + self._log_prior(explanation, candidates)

    def _limit(self, candidates: tuple[Candidate, ...], margin: float) -> float:
        return self._value(self._leader(candidates).explanation, candidates) - margin

    def _would_lead(self, explanation: Explanation, candidates: tuple[Candidate, ...]) -> bool:
        """Whether a fit that is not done promises more than anything else has."""
        best = max(self._value(e, candidates) for e in self.best if e != explanation)
        return self._hope(explanation, candidates) > best + CONTENDERS

    def _ranked(self, size: int) -> list[Fitted]:
        """Best optimum of each different set of names of a size, best first."""
        best: dict[tuple[str, ...], Fitted] = {}
        of_size = [f for f in self.best.values() if f.explanation.size == size]
        for fitted in sorted(of_size, key=lambda f: -f.log_evidence):
            best.setdefault(fitted.explanation.names, fitted)
        return list(best.values())

    def _nested(self, count: int) -> None:
        """Try to fit without what the best explanations have: an effect that a base optimum can do without is none."""
        for rival in [*self._ranked(1)[:count], *self._ranked(2)[:2]]:
            if rival not in self._tried:
                self._tried.add(rival)
                self.fit(NOTHING_MISSING, [rival.theta])
        nothing = self.best[NOTHING_MISSING]
        singles = self._ranked(1)
        best = singles[0].log_evidence if singles else 0.0
        for rival in singles:
            # Freeing a parameter cannot make the optimum worse: such a fit sits in another valley.
            if rival.objective > nothing.objective + 1e-3:
                hope = nothing.log_evidence + nothing.everything.gain(rival.explanation.parameters)
                if hope > best - RACE:
                    self.fit(rival.explanation, [self.expected(nothing, rival.explanation)])

    def _pairs(self, candidates: tuple[Candidate, ...], count: int) -> None:
        """Screen all pairs from nothing's optimum and from the best singles', and fit the best."""
        hosts = self._ranked(1)[:HOSTS]
        offers: dict[tuple[str, ...], tuple[float, Fitted, Explanation]] = {}
        nothing = self.best[NOTHING_MISSING]

        def offer(host: Fitted, base: float, pair: Explanation) -> None:
            value = base + host.everything.gain(pair.parameters) + self._log_prior(pair, candidates)
            old = offers.get(pair.names)
            if old is None or value > old[0]:
                offers[pair.names] = (value, host, pair)

        for pair in pairs_about(nothing, candidates):
            offer(nothing, nothing.log_evidence, pair)
        for host in hosts:
            base = host.log_evidence - host.linear.gain(host.explanation.parameters)
            for pair in companions(host, host.explanation, candidates):
                offer(host, base, pair)
        new = [o for o in offers.values() if o[0] > self._value(o[2], candidates) + WORTHWHILE]
        chosen = sorted(new, key=lambda o: -o[0])[:count]
        for done, (_, host, pair) in enumerate(chosen):
            self.fit(pair, [self.expected(host, pair)])
            self._progress(0.5 + 0.5 * done / len(chosen))

    def _value(self, explanation: Explanation, candidates: tuple[Candidate, ...]) -> float:
        known = self.best.get(explanation)
        return -np.inf if known is None else known.log_evidence + self._log_prior(explanation, candidates)
