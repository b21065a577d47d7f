"""How probable it is of each case that it is bad, and what may have been done in it instead."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from scipy.special import logsumexp

from fingermodel.diagnosis.posterior.hyper import Hyperparameters, Node
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.bad_cases import LOG_PRIOR_ODDS, Apart
from fingermodel.diagnosis.session_model.session import Session
from fingermodel.diagnosis.session_model.slips import Explained, Slips, SlipsAbout

# A sound case can make an explanation better by no more than this [nat]: six readings that are known to a mN, not to
# some newtons.
_MOST = 50.0


class CaseOdds:
    """Log odds of the cases of one session.

    Args:
        session: whose cases.
        hyper: axes of the hyperparameters.
    """

    def __init__(self, session: Session, hyper: Hyperparameters) -> None:
        self._hyper, self.slips = hyper, Slips(session)

    def explained(self, host: Optimum, cases: Collection[int]) -> dict[int, Explained]:
        """Slips of the cases that any could make probable enough, two at once included."""
        apart = {c: a for c, a in host.left_out(host.best).items() if c in cases}
        return self.slips_of(apart, self.slips.about(host.theta), host.best)

    def slips_of(self, apart: Mapping[int, Apart], about: SlipsAbout, node: Node) -> dict[int, Explained]:
        """The same of cases held against all others already, at a node."""
        asked = {c: a for c, a in apart.items() if a.misfit > -LOG_PRIOR_ODDS}
        return about.explain(asked, self._hyper.values(node).errors.scatter)

    def of_each(self, host: Optimum) -> dict[int, float]:
        """Log odds of each case to be bad, summed over nodes in which scatter, noise and smooth explain less."""
        nodes = self._hyper.narrowed(host.best)
        joint = np.array([host.log_joint(node) for node in nodes])
        total = float(logsumexp([host.log_posterior, *joint]))
        gains = [host.log_odds_bad(node) for node in nodes]
        return {
            c: LOG_PRIOR_ODDS + float(logsumexp([j + g[c] for j, g in zip(joint, gains, strict=True)])) - total
            for c in gains[0]
        }

    def of_taken(
        self, bad_cases: frozenset[int], fits: Collection[Optimum], leader: Optimum
    ) -> tuple[dict[int, float], dict[int, Explained]]:
        """Log odds of the cases taken for bad, by some explanations; and what may have been done instead."""
        near = [fit for fit in fits if fit.log_posterior >= leader.log_posterior - _MOST] if bad_cases else []
        # Of one node each: how many others are hardly less probable is alike.
        bad = LOG_PRIOR_ODDS + logsumexp([fit.log_joint(fit.best) for fit in near]) if near else 0.0
        out = {}
        for case in bad_cases:
            without = [fit.but(bad=bad_cases - {case}) for fit in near]
            sound = [max(fit.log_joints(self._hyper.widened(fit.best))) for fit in without]
            out[case] = float(bad - logsumexp(sound))
        slips = self.explained(leader, bad_cases) if bad_cases else {}
        return {case: odds + (slips[case].gain if case in slips else 0.0) for case, odds in out.items()}, slips
