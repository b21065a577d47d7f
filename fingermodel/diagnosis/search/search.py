"""Which explanations are fitted: from the base and from where all candidates fit, until no neighbour promises more.

The model linearised about an optimum promises every other explanation a log posterior. Promises order the work; what
is said is read from fits, and from promises only of what they leave far behind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fingermodel.arrays import Floats
from fingermodel.diagnosis.posterior.hyper import BUDGET, CARRIER, FORMS, NOISE, SCATTER, SMOOTH, Node
from fingermodel.diagnosis.posterior.marginals import Promise
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.search.beginning import Beginner, Beginning, explained, odds_of_taken
from fingermodel.diagnosis.session_model.bad_cases import LOG_PRIOR_ODDS, Explained
from fingermodel.diagnosis.session_model.candidates import NOTHING, Explanation
from fingermodel.diagnosis.settings import FAR, WITHIN

# Most fits of a search.
MOST_FITS = 30
# Singles from which pairs are made, and most pairs that are fitted first; and singles that are fitted whatever they
# promise, about the base and about where all candidates fit.
_FIRST, _ALWAYS = 8, 3
# Prior widths from its null at which a parameter is tried that has no slope there.
_SHAPES = (-1.6, -1.0, -0.4, 0.4, 1.0, 1.6)
# A little of something smooth [N].
_SMOOTH = 0.08
# Log posterior by which a promise must exceed what a fit has, for it to be fitted anew.
_MORE = 1.0


class Offer(NamedTuple):
    """Log posterior that an explanation that is not fitted yet is promised, and where the session was linearised."""

    value: float
    host: Optimum


@dataclass(frozen=True, eq=False)
class Searched:
    """Everything that was fitted, and what the rest promises."""

    fits: dict[Explanation, Optimum]  # the best optimum of each explanation
    promised: dict[Explanation, Promise]  # to explanations that were not fitted
    plain: Node  # node at which a refit counts, scatter and noise as the readings have them with all candidates free
    bad: dict[int, float]  # log odds of each case that is taken for a bad one, by index of the case
    slips: dict[int, Explained]  # what may have been done in these instead of what was entered


def search(beginner: Beginner, begun: Beginning, most: int = MOST_FITS) -> Searched:
    """Search on from a beginning, with so many fits at most."""
    found = _Search(beginner.all_out(begun)).explained(most)
    while cases := beginner.overlooked(found.begun, found.fits):
        other = _Search(beginner.beside((*found.begun.slips, cases))).explained(most, found.fits)
        slips = explained(other.leader, cases)
        gain = max((one.gain for one in slips.values()), default=0.0)
        if other.leader.log_posterior + LOG_PRIOR_ODDS + gain <= found.leader.log_posterior:
            break
        found = other
    odds = odds_of_taken(found.begun.bad, found.fits.values(), found.leader)
    return found.searched(*odds)


def unsearched(begun: Beginning) -> Searched:
    """The base model alone, and what it promises the rest."""
    return _Search(begun).searched({}, {})


class _Search:
    """The search beside the cases that one beginning takes for bad.

    Attributes:
        begun: the fits from which it begins.
        fits: the best optimum of each explanation that was fitted.
    """

    def __init__(self, begun: Beginning) -> None:
        self.begun, self.fits = begun, {NOTHING: begun.nothing}
        self._fitter, self._candidates, self._hyper = begun.fitter, begun.fitter.candidates, begun.fitter.hyper
        self._singles = self._candidates.singles
        # What was fitted because a leader promised it.
        self._asked: set[tuple[Explanation, Optimum]] = set()
        self._prior: dict[Explanation, float] = {}

    @property
    def leader(self) -> Optimum:
        """The most probable explanation that was fitted."""
        return max(self.fits.values(), key=lambda o: o.log_posterior)

    def searched(self, bad: dict[int, float], slips: dict[int, Explained]) -> Searched:
        """What was found, with what is known of the cases taken for bad."""
        return Searched(self.fits, self._rest(), self.begun.plain, bad, slips)

    def explained(self, most: int, before: Mapping[Explanation, Optimum] | None = None) -> _Search:
        """The same once explanations are fitted; no further ones once there were so many fits.

        It begins with those of fits beside fewer bad cases, where there are some, that come near the best.
        """
        # What is smooth may explain so much by one tendon or in one posture that few effects come near it.
        self._keep(self.begun.nothing_but_one)
        if before is None:
            self._first_fits(self.begun.every)
        else:
            least = max(fit.log_posterior for fit in before.values()) - FAR
            for explanation, fit in before.items():
                if explanation.size and fit.log_posterior >= least:
                    self._fit_from(explanation, fit.theta, fit.best)
        self._until_none_promises(most)
        self._finish(self.begun.every)
        self._until_none_promises(most)
        # What is left may be of one tendon, or of one rotation.
        asked: set[Explanation] = set()
        while new := [f for e, f in self.fits.items() if e not in asked and self._near(f.promise_of_one)]:
            asked.update(fit.explanation for fit in new)
            for fit in new:
                if fit.promise_of_one > fit.log_posterior + _MORE:
                    self._keep(self._fitter.of_one(fit))
            self._until_none_promises(most)
        return self

    def _keep(self, found: Optimum) -> None:
        self.begun.beginner.count_fit()
        known = self.fits.get(found.explanation)
        if known is None or found.log_posterior > known.log_posterior:
            self.fits[found.explanation] = found
        leader = self.leader
        for fit in self.fits.values():
            if fit is not leader and fit.explanation.size:
                _ = fit.promise_of_one
                fit.forget()

    def _log_prior(self, explanation: Explanation) -> float:
        if explanation not in self._prior:
            self._prior[explanation] = self._candidates.log_prior(explanation)
        return self._prior[explanation]

    def _promised(
        self, host: Optimum, offers: Sequence[Explanation], nodes: Sequence[Node] | None = None
    ) -> dict[Explanation, Offer]:
        """What a host promises, by default at all of `_nodes`; counted so that its own log posterior is what it has."""
        if not offers:
            return {}
        nodes = self._nodes(host) if nodes is None else nodes
        given = [host.explanation, *offers] if host.log_prior < 0.0 else list(offers)
        values = host.promises(given, nodes)
        if host.log_prior < 0.0:
            lacking = host.log_posterior - (values[0] + host.log_prior)
            values = values[1:] + max(lacking, 0.0)
        return {e: Offer(float(v) + self._log_prior(e), host) for e, v in zip(offers, values, strict=True)}

    def _nodes(self, host: Optimum) -> list[Node]:
        """A host's best node, and others at which less of what an effect may explain is explained already.

        With little of what is smooth, without it, and without more than usual scatter or noise.
        """
        little = int(np.argmin(np.abs(self._hyper.axes[SMOOTH].values - _SMOOTH)))
        best, usual = host.best, self._hyper.usual
        less = (*best[:SMOOTH], *(min(little, i) for i in best[SMOOTH:CARRIER]), 0, *best[FORMS:])
        plain = (min(best[SCATTER], usual[SCATTER]), *usual[NOISE:BUDGET], *self._hyper.without_smooth(best)[BUDGET:])
        return list(dict.fromkeys([best, self._hyper.of_all(best), self._hyper.without_smooth(best), less, plain]))

    def _first_fits(self, every: Optimum) -> None:
        """Fit what promises to come near the leader about the base, and about where all candidates fit."""
        about_base = better(self._promised(self.begun.nothing, self._singles), self._shaped(self.begun.nothing))
        about_all = self._promised(every, self._singles)
        pairs = list[dict[Explanation, Offer]]()
        for host, offers in ((self.begun.nothing, about_base), (every, about_all)):
            firsts = best_forms(offers)[:_FIRST]
            # The best are fitted whatever they promise: the base is bent to do without them.
            for explanation in firsts[:_ALWAYS]:
                self._fit(explanation, offers[explanation].host)
            pairs.append(self._promised(host, self._candidates.pairs(firsts)))
        self._fit_singles(better(about_base, about_all))
        # Two that hide each other are seen where all candidates fit, and no single would lead to them.
        hidden, both = best_forms(pairs[-1])[:1], better(*pairs)
        for explanation in hidden:
            self._fit(explanation, every)
        for explanation in best_forms(both)[:_FIRST]:
            if not self._near(both[explanation].value):
                break
            if explanation not in hidden or both[explanation].host is not every:
                self._fit(explanation, both[explanation].host)

    def _fit_singles(self, offers: Mapping[Explanation, Offer]) -> None:
        """Fit singles that promise to come near the leader, the most promising first."""
        for explanation in sorted(offers, key=lambda e: -offers[e].value):
            if not self._near(offers[explanation].value):
                break
            if explanation not in self.fits:
                self._fit(explanation, offers[explanation].host)

    def _near(self, log_posterior: float) -> bool:
        return log_posterior >= self.leader.log_posterior - WITHIN

    def _shaped(self, base: Optimum) -> dict[Explanation, Offer]:
        """What forms promise that have a parameter without slope at its null (a moment, a time constant).

        Such a parameter says where or how an effect acts, so the base is linearised with it at several values.
        """
        problem = self._fitter.session.problem
        flat = ~base.slopes.any(axis=0) & (problem.sd > 0.0) & ~problem.free
        offers = [e for e in self._singles if flat[list(e.parameters)].any()]
        best: dict[Explanation, Offer] = {}
        for widths in _SHAPES if offers else ():
            theta = np.where(
                flat, np.clip(problem.centre + widths * problem.scale, problem.lower, problem.upper), base.theta
            )
            host = self._fitter.linearised(NOTHING, theta, base.best, self.begun.bad, base.log_prior)
            values = host.promises(offers, self._nodes(base))
            best = better(
                best, {e: Offer(float(v) + self._log_prior(e), host) for e, v in zip(offers, values, strict=True)}
            )
        return best

    def _fit(self, explanation: Explanation, host: Optimum) -> None:
        best = host.best if host in self.fits.values() else self.begun.nothing.best
        node = self._hyper.without_smooth(best)
        self._fit_from(explanation, host.expected(explanation, node), node)

    def _fit_from(self, explanation: Explanation, start: Floats, node: Node) -> None:
        leader = self.leader.log_posterior
        self._keep(self._fitter.fit(explanation, start, node, self.begun.bad, leader=leader))

    def _until_none_promises(self, most: int) -> None:
        """Fit neighbours of the leader that promise to come near it, and more than they have, until none is left."""
        while self.begun.beginner.made < most:
            leader = self.leader
            offers = [e for e in self._candidates.neighbours(leader.explanation) if (e, leader) not in self._asked]
            promised = self._promised(leader, offers)
            limit = leader.log_posterior - WITHIN
            known = {e: self.fits[e].log_posterior + _MORE for e in promised if e in self.fits}
            chosen = [e for e in best_forms(promised) if promised[e].value > max(limit, known.get(e, -np.inf))][:3]
            if not chosen:
                break
            for explanation in chosen:
                self._asked.add((explanation, leader))
                self._fit(explanation, leader)

    def _finish(self, every: Optimum) -> None:
        """Begin the leader anew, and it less each member, and what comes near it from where the leader expects that.

        What it has over itself less a member is how sure that member is.
        """
        problem, leader = self._fitter.session.problem, self.leader
        less = leader.explanation.less_one
        for explanation, host in [(leader.explanation, every), *((e, leader) for e in less)]:
            node = self._hyper.without_smooth(host.mode)
            for start in (problem.centre, host.expected(explanation, node)) if explanation.size else ():
                self._fit_from(explanation, start, leader.best)
        # Instead of a member another may act, which the session linearised where that member acts hardly shows.
        for host in [self.fits[e] for e in less if e.size]:
            offers = [e for e in self._candidates.neighbours(host.explanation) if e.size > host.explanation.size]
            promised = self._promised(host, [e for e in offers if e not in self.fits])
            for explanation in best_forms(promised)[:_ALWAYS]:
                if self._near(promised[explanation].value):
                    self._fit(explanation, host)
        leader = self.leader
        others = [f for f in self.fits.values() if f is not leader]
        promised = self._promised(leader, [f.explanation for f in others])
        for fit in others:
            promise = promised[fit.explanation].value
            if self._near(promise) and promise > fit.log_posterior + _MORE:
                self._fit_from(fit.explanation, leader.expected(fit.explanation, leader.best), fit.best)

    def _rest(self) -> dict[Explanation, Promise]:
        """What the leader promises explanations that were not fitted.

        No more than would have had them fitted: a straight line from far off may promise anything.
        """
        leader = self.leader
        most = leader.log_posterior - WITHIN
        offers = dict.fromkeys([*self._candidates.neighbours(leader.explanation), *self._singles])
        promised = self._promised(leader, [e for e in offers if e not in self.fits], [leader.best])
        return {e: Promise.of(e, leader, min(o.value, most), self._log_prior(e)) for e, o in promised.items()}


def better(some: Mapping[Explanation, Offer], others: Mapping[Explanation, Offer]) -> dict[Explanation, Offer]:
    """Of each explanation what promises more."""
    new = {e: offer for e, offer in others.items() if e not in some or offer.value > some[e].value}
    return {**some, **new}


def best_forms(promised: Mapping[Explanation, Offer]) -> list[Explanation]:
    """Of each set of names the form that promises most; the most promising first."""
    best: dict[tuple[str, ...], Explanation] = {}
    for explanation in sorted(promised, key=lambda e: -promised[e].value):
        best.setdefault(explanation.names, explanation)
    return list(best.values())
