"""Several sessions at once: what all of them share, each with its own anatomy, small errors and effects of its own.

A fault of the rig is the same in every specimen that it held; an anatomical effect is not. So what is shared is tried
with one size for all sessions and with a size of its own in each, beside whatever else acts in each (see `sharing`),
and held against each session's having its own explanation and nothing in common.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from fingermodel.diagnosis.candidates import Explanation, log_prior, single, together
from fingermodel.diagnosis.diagnose import Diagnosis, diagnose
from fingermodel.diagnosis.pooled_verdict import PooledVerdict, judge_together
from fingermodel.diagnosis.shared import Hypothesis, SharedEffect
from fingermodel.diagnosis.sharing import Sharer
from fingermodel.model import Model
from fingermodel.observations import Observations

# What promises most is refitted: at least so many, and as long as one that is not leads, up to so many.
SINGLES, PAIRS, MOST = 6, 4, 12
# Log evidence within which other forms of an effect are refitted, and below the best from which pairs are.
NEAR, HOPE = 4.0, 10.0


@dataclass(frozen=True, eq=False)
class Pooled:
    """What several sessions say together.

    Attributes:
        sessions: ids.
        diagnoses: of each by itself.
        ranking: what may be shared, best first.
        p_apart: probability that nothing is shared: each session has an explanation of its own, or needs none.
        p_nothing: of that, that nothing is missing in any.
        p_other: of that, that it is something outside the catalogue in each.
        verdict: on what is shared.
        seconds: of the computation.
    """

    sessions: tuple[str, ...]
    diagnoses: tuple[Diagnosis, ...]
    ranking: tuple[SharedEffect, ...]
    p_apart: float
    p_nothing: float
    p_other: float
    verdict: PooledVerdict
    seconds: float


def diagnose_pooled(
    sessions: Sequence[tuple[str, Model, Observations]],
    *,
    thorough: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Pooled:
    """Diagnose sessions by themselves, and weigh what all may share.

    Args:
        sessions: id, model with the catalogue at its null, and observations of each.
        thorough: more starts and pairs in each.
        progress: is told the share done.
    """
    began = time.perf_counter()
    tell = progress or (lambda _: None)
    diagnoses = []
    for k, (_, model, observations) in enumerate(sessions):
        diagnoses.append(diagnose(model, observations, thorough=thorough))
        tell(0.6 * (k + 1) / len(sessions))
    pooling = _Pooling([Sharer(d) for d in diagnoses])
    found = pooling.search(lambda done: tell(0.6 + 0.4 * done))
    log_total = float(logsumexp([pooling.apart, *(e.log_posterior for e in found)]))
    ranking = sorted(
        (replace(e, probability=float(np.exp(e.log_posterior - log_total))) for e in found),
        key=lambda e: -e.log_posterior,
    )
    p_apart = float(np.exp(pooling.apart - log_total))
    p_nothing = p_apart * float(np.prod([d.evidence.probability.get((), 0.0) for d in diagnoses]))
    p_other = p_apart * float(np.prod([d.evidence.probability[None] for d in diagnoses]))
    names = tuple(s[0] for s in sessions)
    without = [pooling.favoured_without(k, ranking) for k in range(len(diagnoses))] if len(diagnoses) > 2 else []
    verdict = judge_together(names, diagnoses, ranking, (p_apart, p_nothing, p_other), without)
    return Pooled(
        names,
        tuple(diagnoses),
        tuple(ranking),
        p_apart,
        p_nothing,
        p_other,
        verdict,
        time.perf_counter() - began,
    )


class _Pooling:
    """What may be shared, weighed over sessions."""

    def __init__(self, sharers: Sequence[Sharer]) -> None:
        self._sharers = sharers
        self._candidates = sharers[0].diagnosis.candidates
        # In another plane, or of another finger, an effect may have other parameters.
        declared = [_declared(s.diagnosis) for s in sharers]
        common = set.intersection(*map(set, declared))
        self._common = [c for c, own in zip(self._candidates, declared[0], strict=True) if own in common]
        self._found: dict[Explanation, Hypothesis] = {}

    @cached_property
    def apart(self) -> float:
        """Log posterior of nothing being shared."""
        return self._apart(range(len(self._sharers)))

    def search(self, tell: Callable[[float], None]) -> list[SharedEffect]:
        """Fit the singles that promise most, and the pairs about the best of them; the best form of each."""
        singles = [single(c, k) for c in self._common for k in range(len(c.alternatives))]
        self._refit(singles, SINGLES, lambda done: tell(0.6 * done))
        leader = max(self._found.values(), key=lambda h: h.log_posterior)
        # A fault that leads by itself may have another beside it, in all of them.
        if leader.log_posterior > self.apart - HOPE:
            beside = [e for e in singles if not set(e.parameters) & set(leader.shared.parameters)]
            offers = [together((leader.shared, e), self._candidates) for e in beside if e.names != leader.shared.names]
            pairs = [p for p in offers if self._promise(p) > leader.log_posterior - HOPE]
            self._refit(pairs, PAIRS, lambda done: tell(0.6 + 0.4 * done))
        tell(1.0)
        best: dict[tuple[str, ...], Hypothesis] = {}
        for found in self._found.values():
            names = found.shared.names
            if names not in best or found.log_posterior > best[names].log_posterior:
                best[names] = found
        return [h.effect for h in best.values()]

    def favoured_without(self, session: int, ranking: Sequence[SharedEffect]) -> tuple[tuple[str, ...], float]:
        """What is favoured without a session, and by how much more than what leads with it."""
        kept = [k for k in range(len(self._sharers)) if k != session]
        values = {e.names: self._found[e.explanation].log_posterior_of(kept) for e in ranking}
        values[()] = self._apart(kept)
        winner = max(values, key=lambda names: values[names])
        return winner, values[winner] - values[ranking[0].names]

    def _apart(self, sessions: Sequence[int]) -> float:
        return float(np.log(0.5)) + sum(self._sharers[k].log_posterior for k in sessions)

    def _promise(self, shared: Explanation) -> float:
        return sum(s.promise(shared) for s in self._sharers) + log_prior(shared, self._candidates)

    def _refit(self, offers: Sequence[Explanation], count: int, tell: Callable[[float], None]) -> None:
        """Refit what promises most, until what leads has been."""
        values = {e: self._promise(e) for e in offers}
        best = {names: max(v for e, v in values.items() if e.names == names) for names in {e.names for e in offers}}
        waiting = {e: v for e, v in values.items() if np.isfinite(v) and v >= best[e.names] - NEAR}
        fitted: set[tuple[str, ...]] = set()
        lead = -np.inf
        for offer in sorted(waiting, key=lambda e: -waiting[e]):
            enough = len(fitted) >= MOST or (len(fitted) >= count and waiting[offer] < lead)
            if enough and offer.names not in fitted:
                continue
            self._found[offer] = Hypothesis(offer, self._sharers, self._candidates)
            lead = max(lead, self._found[offer].log_posterior)
            fitted.add(offer.names)
            tell(min(len(fitted) / count, 1.0))


def _declared(diagnosis: Diagnosis) -> list[tuple[str, tuple[tuple[str, ...], ...]]]:
    """Each candidate's name and the parameters of its forms."""
    table = diagnosis.problem.model.parameters.names
    return [(c.name, tuple(tuple(table[i] for i in form) for form in c.alternatives)) for c in diagnosis.candidates]
