"""How probable it is of each case that it is bad, and what may have been done in it instead."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from scipy.special import logsumexp

from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.bad_cases import LOG_PRIOR_ODDS, Apart
from fingermodel.diagnosis.session_model.slip_odds import Explained, SlipsAbout

# A sound case can make an explanation better by no more than this [nat]: six readings that are known to a mN, not to
# some newtons.
_MOST = 50.0


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
        sound = logsumexp([max(fit.but(bad=without).log_joints(fit.hyper.widened(fit.best))) for fit in near])
        out[case] = float(bad - sound) + (slips[case].gain if case in slips else 0.0)
    return out, slips
