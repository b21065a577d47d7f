"""Where a search begins: the base model and all candidates at once, fitted beside the cases taken for bad.

Gross ones are taken before any fit, others with all effects free, and one after the search.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from fingermodel.arrays import Floats
from fingermodel.diagnosis.posterior.fitting import Fitter
from fingermodel.diagnosis.posterior.hyper import Hyperparameters, Node
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.bad_cases import LOG_PRIOR_ODDS, Apart, Explained, SlipsAbout, chance_of
from fingermodel.diagnosis.session_model.candidates import NOTHING, Candidate, Candidates, Explanation, Member
from fingermodel.diagnosis.session_model.session import Session
from fingermodel.diagnosis.settings import P_UNLIKE, P_VALUE

# One slip after another: the case that is bad, or the two that were exchanged.
Slipped = tuple[frozenset[int], ...]

# Share of the work that is left by every fit, as far as anybody knows: most searches take some 14.
_LEFT_PER_FIT = 0.87
# A sound case can make an explanation better by no more than this [nat]: six readings that are known to a mN, not to
# some newtons.
_MOST = 50.0


def bad_in(slips: Slipped) -> frozenset[int]:
    """Cases that are bad by some slips."""
    return frozenset().union(*slips)


@dataclass(frozen=True, eq=False)
class Beginning:
    """Two fits beside some cases that are taken for bad."""

    slips: Slipped  # one after another: the case that is bad, or the two that were exchanged
    fitter: Fitter  # for further fits; scatter changes a reading as it does the finger that all candidates fit
    every: Optimum  # all candidates at once
    nothing: Optimum  # the base model
    beginner: Beginner  # that made it, and counts fits

    @property
    def bad(self) -> frozenset[int]:
        """Cases that are taken for bad."""
        return bad_in(self.slips)

    @cached_property
    def nothing_but_one(self) -> Optimum:
        """The base model where what is smooth is of one tendon or rotation, or in one posture, if that is better."""
        return self.fitter.of_one(self.nothing)

    @property
    def plain(self) -> Node:
        """Where a refit counts: scatter and noise as the readings have them with all candidates free."""
        return self.fitter.hyper.as_stated(self.every.best)


class Beginner:
    """Makes beginnings of one session: takes cases for bad, and back.

    Args:
        session: to search.
        candidates: that may act.
        start: (parameters,) of an earlier fit of the base model, tried besides the priors' centre.
        progress: is told the share done.

    Attributes:
        made: fits so far.
    """

    def __init__(
        self,
        session: Session,
        candidates: Candidates,
        start: Floats | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        self.session, self.hyper = session, Hyperparameters.of(session)
        self._candidates, self._start, self._progress, self.made = candidates, start, progress, 0
        self._about_centre = Fitter(session, candidates, self.hyper)

    def count_fit(self) -> None:
        """Count one more fit."""
        self.made += 1
        if self._progress:
            self._progress(self.share)

    @property
    def share(self) -> float:
        """Share of a search that is done."""
        return 1.0 - _LEFT_PER_FIT**self.made

    @cached_property
    def _every(self) -> Explanation:
        parameters = sorted({i for c in self._candidates.all for form in c.forms for i in form})
        all_of_them = Candidate("all candidates", "", (tuple(parameters),), 1.0)
        return Explanation((Member(all_of_them),))

    def beside(self, slips: Slipped) -> Beginning:
        """Fit all candidates at once, and the base model from there and from the priors' centre."""
        problem, explanation = self.session.problem, self._every
        node, bad = self.hyper.usual, bad_in(slips)
        fitter, begin = self._about_centre.begun(explanation, node, bad)
        every = fitter.fit(explanation, begin, node, bad, 0.0)
        starts = [problem.centre, np.where(problem.free, every.theta, problem.centre)]
        found = []
        for start in [*starts, *([] if self._start is None else [self._start])]:
            found.append(fitter.fit(NOTHING, start, every.mode, bad))
            self.count_fit()
        base = max(found, key=lambda fit: fit.log_posterior)
        if every.misfit(base.best) + every.unkept > base.misfit(base.best) + base.unkept:
            # With more free it fits no worse: the solver went astray.
            again = fitter.fit(explanation, base.theta, base.best, bad, 0.0)
            every = max(every, again, key=lambda fit: fit.log_posterior)
        return Beginning(slips, fitter, every, base, self)

    @cached_property
    def most(self) -> int:
        """So many slips may have happened; that there were more is out of the question."""
        cases = len(np.unique(self.session.fitted_noise.cases))
        return int(np.sum(chance_of(np.arange(1, cases + 1), cases) >= P_VALUE))

    def grossly(self) -> Beginning:
        """Begin beside the cases that are grossly off, less those that turn out to be sound."""
        begun = self.beside(self.gross())
        sound = self._sound(begun)
        slips = tuple(cases for cases in self._paired(begun) if not cases & sound)[: self.most]
        return replace(begun, slips=slips) if bad_in(slips) == begun.bad else self.beside(slips)

    def all_out(self, begun: Beginning) -> Beginning:
        """Take cases for bad, the worst first, until none is; then those back that the later ones had made so."""
        taken: list[frozenset[int]] = []
        while len(begun.slips) < self.most and (worst := _worst(self._least_odds(begun))):
            if worst in taken:
                break
            taken.append(worst)
            begun = self.beside((*begun.slips, worst))
            sound = self._sound(begun) - worst
            slips = tuple(cases for cases in begun.slips if not cases & sound)
            begun = begun if slips == begun.slips else self.beside(slips)
        return begun

    def overlooked(self, begun: Beginning, fits: Mapping[Explanation, Optimum]) -> frozenset[int]:
        """A case (or two exchanged) that would make an explanation more probable than the leader if it were bad.

        What a slip does may have been taken for an effect, or for a bent budget, while all candidates were free.
        """
        if len(begun.slips) >= self.most:
            return frozenset()
        leader = max(fit.log_posterior for fit in fits.values())
        best, found = leader, frozenset[int]()
        for fit in fits.values():
            about = SlipsAbout(fit.session.changes, fit.theta)
            for node, without, apart in _asked(fit, begun.bad, leader):
                scatter = fit.hyper.values(node).errors.scatter
                for case, one in slips_of(apart, about, scatter).items():
                    value = without + apart[case].anything + one.gain
                    if value > best:
                        best, found = value, _worst({case: (value, one.partner)})
        return found or self._instead_of_member(begun, fits)

    def _instead_of_member(self, begun: Beginning, fits: Mapping[Explanation, Optimum]) -> frozenset[int]:
        """A case whose slip a member of the leader explains, and less well: both are fitted without the member.

        A slip of many times the load bends that fit too much to be read where it is linearised.
        """
        leader = max(fits.values(), key=lambda fit: fit.log_posterior)
        for less in leader.explanation.less_one:
            bent = fits.get(less)
            apart = bent.left_out(bent.best) if bent else {}
            worst = max(apart.keys() - begun.bad, key=lambda case: apart[case].misfit, default=None)
            if worst is None or apart[worst].misfit <= -2.0 * LOG_PRIOR_ODDS:
                continue
            fit = begun.fitter.fit(less, leader.theta, leader.best, begun.bad | {worst})
            slip = explained(fit, [worst]).get(worst)
            if slip and fit.log_posterior + LOG_PRIOR_ODDS + slip.gain > leader.log_posterior:
                return frozenset({worst})
        return frozenset()

    def most_of_any(self, begun: Beginning) -> float:
        """Log posterior that no explanation exceeds: fitted as well as with all candidates, at the base model's price.

        As many cases as may be slips are explained entirely.
        """
        base, every = begun.nothing, begun.every
        # What the nodes have together that the best one has not.
        rest = base.log_posterior - base.log_joint(base.best)
        gains = (rest + base.log_joint(n) + 0.5 * (base.misfit(n) - every.misfit(n)) for n in {base.best, every.best})
        apart = every.left_out(every.best).items()
        worst = sorted((one.misfit for case, one in apart if case not in every.bad), reverse=True)
        further = self.most - len(begun.slips)
        slips = sum(max(LOG_PRIOR_ODDS + 0.5 * misfit, 0.0) for misfit in worst[:further])
        return max(base.log_posterior, *gains) + slips

    def gross(self) -> Slipped:
        """Cases so far off that no fit is needed to see it, and any fit would be bent by them; the worst first.

        They are bad although all candidates are free, cases scatter much, and budget and anatomy are as wide as can be.
        """
        node, centre, taken = self.hyper.lenient, self.session.problem.centre, list[int]()
        host = self._about_centre.linearised(self._every, centre, node, frozenset(), 0.0)
        # A slip may be of two cases.
        while len(taken) < 2 * self.most:
            gains = replace(host, bad=frozenset(taken)).log_odds_bad(node)
            odds = {case: LOG_PRIOR_ODDS + gain for case, gain in gains.items() if case not in taken}
            worst = max(odds, key=lambda case: odds[case], default=None)
            if worst is None or odds[worst] < 0.0:
                break
            taken.append(worst)
        return tuple(frozenset({case}) for case in taken)

    def _sound(self, begun: Beginning) -> frozenset[int]:
        """Cases taken for bad that are not where all candidates act, or where none does."""
        hosts = (begun.every, begun.nothing) if begun.bad else ()
        odds = [odds_of_taken(begun.bad, [host], host)[0] for host in hosts]
        return frozenset(case for of_host in odds for case, value in of_host.items() if value < 0.0)

    def _paired(self, begun: Beginning) -> Slipped:
        """The slips so far, two bad cases that were exchanged as one."""
        hosts = (begun.every, begun.nothing) if len(begun.slips) > 1 else ()
        found = [(case, one.partner) for h in hosts for case, one in explained(h, begun.bad).items()]
        pairs = dict.fromkeys(frozenset({case, other}) for case, other in found if other in begun.bad)
        paired = bad_in(tuple(pairs))
        return (*pairs, *(cases for cases in begun.slips if not cases <= paired))

    def _least_odds(self, begun: Beginning) -> dict[int, tuple[float, int | None]]:
        """Log odds of cases probably bad whether all candidates act or none, and what each was swapped with."""
        cases = range(len(self.session.observations.ids))
        least: dict[int, float] = {c: np.inf for c in cases if c not in begun.bad}
        partners: dict[int, int | None] = {}
        for host in (begun.every, begun.nothing, begun.nothing_but_one):
            odds = odds_of_each(host)
            slips = explained(host, least)
            least = {c: min(o, odds[c] + (slips[c].gain if c in slips else 0.0)) for c, o in least.items() if c in odds}
            partners |= {c: e.partner for c, e in slips.items()}
            least = {c: o for c, o in least.items() if o >= 0.0}
        return {c: (o, partners.get(c)) for c, o in least.items()}


def unlike_sound(session: Session, slips: Mapping[int, Explained]) -> tuple[int, ...]:
    """Cases taken for bad that no slip explains, and no sound fitted case is like: something may act there alone.

    Alike are cases at one mount in which the same tendons are loaded together, as much or more.
    """
    taken = np.array(list(slips), dtype=np.intp)
    sound = session.as_loaded(taken) & ~np.isin(session.fitted_cases, taken)
    alone, out = taken[~sound.any(axis=1)], list[int]()
    for of_set in np.unique(session.load_sets[alone]):
        cases = alone[session.load_sets[alone] == of_set].tolist()
        if sum(LOG_PRIOR_ODDS + slips[case].gain for case in cases) < np.log(P_UNLIKE):
            out += cases
    return tuple(out)


def _asked(fit: Optimum, bad: frozenset[int], leader: float) -> Iterator[tuple[Node, float, dict[int, Apart]]]:
    """Nodes at which a slip might make an explanation more probable than the leader.

    With the log posterior of a slip there before the reading is asked, and each case against all others. What is far
    from the leader at the best node is not looked at more closely.
    """
    # As much as there is beside the best node.
    rest = fit.log_posterior - fit.log_joint(fit.best) + LOG_PRIOR_ODDS
    for node in fit.hyper.narrowed(fit.best):
        without = rest + fit.log_joint(node)
        apart = {case: one for case, one in fit.left_out(node).items() if case not in bad}
        # However well a slip of two cases explains them, it gains no more than half their misfit.
        if without + 0.5 * sum(sorted(one.misfit for one in apart.values())[-2:]) > leader:
            yield node, without, apart
        elif node == fit.best:
            return


def _worst(odds: Mapping[int, tuple[float, int | None]]) -> frozenset[int]:
    """The case (or the two exchanged) most probably bad."""
    if not odds:
        return frozenset()
    worst = max(odds, key=lambda c: odds[c][0])
    partner = odds[worst][1]
    return frozenset({worst} | ({partner} if partner is not None else set()))


def explained(host: Optimum, cases: Collection[int]) -> dict[int, Explained]:
    """Slips of the cases that any could make probable enough, two at once included."""
    apart = {c: a for c, a in host.left_out(host.best).items() if c in cases}
    return slips_of(apart, SlipsAbout(host.session.changes, host.theta), host.hyper.values(host.best).errors.scatter)


def slips_of(apart: Mapping[int, Apart], about: SlipsAbout, scatter: float) -> dict[int, Explained]:
    """The same of cases held against all others already, where tensions scatter so much from case to case, relative."""
    return about.explain({c: a for c, a in apart.items() if a.misfit > -LOG_PRIOR_ODDS}, scatter)


def odds_of_each(host: Optimum) -> dict[int, float]:
    """Log odds of each case to be bad, summed over nodes in which scatter, noise and smooth explain less."""
    nodes = host.hyper.narrowed(host.best)
    joint = np.array([host.log_joint(node) for node in nodes])
    total = float(logsumexp([host.log_posterior, *joint]))
    gains = [host.log_odds_bad(node) for node in nodes]
    return {
        c: LOG_PRIOR_ODDS + float(logsumexp([j + g[c] for j, g in zip(joint, gains, strict=True)])) - total
        for c in gains[0]
    }


def odds_of_taken(
    bad_cases: frozenset[int], fits: Collection[Optimum], leader: Optimum
) -> tuple[dict[int, float], dict[int, Explained]]:
    """Log odds of the cases taken for bad, by some explanations; and what may have been done instead."""
    if not bad_cases:
        return {}, {}
    near = [fit for fit in fits if fit.log_posterior >= leader.log_posterior - _MOST]
    # Of one node each: how many others are hardly less probable is alike.
    bad, slips = LOG_PRIOR_ODDS + logsumexp([fit.log_joint(fit.best) for fit in near]), explained(leader, bad_cases)
    out = {}
    for case in bad_cases:
        without = bad_cases - {case}
        others = [fit.but(bad=without) for fit in near]
        sound = logsumexp([max(map(f.log_joint, f.hyper.widened(g.best))) for f, g in zip(others, near, strict=True)])
        out[case] = float(bad - sound) + (slips[case].gain if case in slips else 0.0)
    return out, slips
