"""An effect that all sessions share: what each says of it, and whether one size serves all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import combinations
from operator import add

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from fingermodel.diagnosis.candidates import Candidate, Explanation, joined, log_prior, members
from fingermodel.diagnosis.linear import Size
from fingermodel.diagnosis.sharing import Beside, Sharer
from fingermodel.parameters import Parameter

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class InSession:
    """What one session says of what is shared.

    Attributes:
        gain: log odds, of the evidence alone, that it acts there.
        values: (k,) of its parameters, in their units, by this session alone.
        sd: (k,) of them; NaN where a value is held at a bound.
        beside: its likeliest fit there.
    """

    gain: float
    values: Floats
    sd: Floats
    beside: Beside


@dataclass(frozen=True, eq=False)
class SharedEffect:
    """One candidate, or two together, that act in all sessions.

    Attributes:
        explanation: what is shared.
        parameters: of what is shared.
        same: candidates that have one size in all sessions; the others have a size of their own in each.
        value: (k,) size by all sessions together, in the parameters' units.
        sd: (k,) of it.
        log_evidence_shared: that it acts in all over that it acts in none, with one size for all.
        log_evidence_own: the same with a size for each session.
        each: by session.
        log_posterior: its prior included.
        probability: of this explanation among all pooled ones.
    """

    explanation: Explanation
    parameters: tuple[Parameter, ...]
    same: tuple[str, ...]
    value: Floats
    sd: Floats
    log_evidence_shared: float
    log_evidence_own: float
    each: tuple[InSession, ...]
    log_posterior: float
    probability: float = 0.0

    @property
    def names(self) -> tuple[str, ...]:
        """Of the candidates."""
        return self.explanation.names

    @property
    def shared(self) -> bool:
        """Whether one size serves all sessions, of all members."""
        return set(self.same) == set(self.names)


class Hypothesis:
    """That something is shared by all sessions, each beside its own."""

    def __init__(self, shared: Explanation, sharers: Sequence[Sharer], candidates: tuple[Candidate, ...]) -> None:
        self.shared = shared
        self._sharers = sharers
        self._members = members(shared, candidates)
        self._prior = log_prior(shared, candidates)
        self._besides = [s.beside(shared) for s in sharers]
        self._each = [float(logsumexp([b.log_posterior for b in found])) for found in self._besides]
        table = sharers[0].diagnosis.problem.model.parameters
        self._table = tuple(table.parameters[i] for i in shared.parameters)
        self._one_sided = table.one_sided
        self._sizes = {same: self._sizes_of(same) for same in self._sames()}

    def _sames(self) -> Iterator[Explanation]:
        """Every choice of members that have one size in all sessions."""
        for count in range(1, len(self._members) + 1):
            for chosen in combinations(self._members, count):
                yield reduce(joined, chosen)

    def _sizes_of(self, same: Explanation) -> list[tuple[Size, float]]:
        """What each session says of some members' size, and what that adds to its log evidence."""
        sided = self._one_sided[list(same.parameters)]
        sizes = [s.size(same, found[0]) for s, found in zip(self._sharers, self._besides, strict=True)]
        return [(size, size.log_evidence(sided)) for size in sizes]

    def _tied(self, same: Explanation, sessions: Sequence[int]) -> float:
        """What is gained by some members' having one size in all."""
        sizes = [self._sizes[same][k] for k in sessions]
        whole = reduce(add, (size for size, _ in sizes))
        return whole.log_evidence(self._one_sided[list(same.parameters)]) - sum(alone for _, alone in sizes)

    def log_posterior_of(self, sessions: Sequence[int]) -> float:
        """By some sessions, whichever members have one size in all of them."""
        ways = [0.0, *(self._tied(same, sessions) for same in self._sizes)]
        own = sum(self._each[k] for k in sessions)
        return self._prior + own + float(logsumexp(ways)) - float(np.log(len(ways)))

    @cached_property
    def log_posterior(self) -> float:
        """By all sessions."""
        return self.log_posterior_of(range(len(self._sharers)))

    @cached_property
    def effect(self) -> SharedEffect:
        """For the answer."""
        everyone = range(len(self._sharers))
        tied = {same: self._tied(same, everyone) for same in self._sizes}
        best = max(tied, key=lambda same: tied[same])
        whole = max(tied, key=lambda same: same.size)
        size = reduce(add, (s for s, _ in self._sizes[whole]))
        problem = self._sharers[0].diagnosis.problem
        scale, centre = problem.scale[list(self.shared.parameters)], problem.centre[list(self.shared.parameters)]
        sided = self._one_sided[list(self.shared.parameters)]
        mean = size.mean
        gains = [each - s.without(self.shared.names) for each, s in zip(self._each, self._sharers, strict=True)]
        own = float(sum(gains))
        return SharedEffect(
            self.shared,
            self._table,
            best.names if tied[best] >= 0.0 else (),
            centre + np.where(sided, np.maximum(mean, 0.0), mean) * scale,
            np.sqrt(np.diag(size.covariance)) * scale,
            own + tied[whole],
            own,
            tuple(
                InSession(gain, *_values(s.here(self.shared), found[0]), found[0])
                for gain, s, found in zip(gains, self._sharers, self._besides, strict=True)
            ),
            self.log_posterior,
        )


def _values(here: Explanation, found: Beside) -> tuple[Floats, Floats]:
    """Values and standard deviations (k,) of what is shared, as one session has them."""
    index = list(here.parameters)
    return found.weighed.fitted.theta[index], np.array([found.weighed.sd(i) or np.nan for i in index])
