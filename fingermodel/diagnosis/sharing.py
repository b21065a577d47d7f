"""What one session says of an effect that several share: fitted beside whatever else acts there alone.

A rig's fault acts in every specimen that the rig held, each of which may have something of its own. By itself the fault
then explains none of them; beside each one's own effect it does.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from fingermodel.diagnosis.candidates import (
    NOTHING_MISSING,
    Explanation,
    log_prior,
    log_prior_else,
    members,
    single,
    together,
)
from fingermodel.diagnosis.diagnose import Diagnosis
from fingermodel.diagnosis.evidence import Weighed, estimates_of, other_evidence, scales, struck_out, weigh_one
from fingermodel.diagnosis.fitted import Fitted
from fingermodel.diagnosis.fitter import LAST, SECOND, Fitter
from fingermodel.diagnosis.linear import Size
from fingermodel.diagnosis.wildcard import AMPLITUDES_N, Wildcard, anything

Floats = NDArray[np.float64]
Names = tuple[str, ...] | None

# How many of a session's own explanations something is tried beside, and from which probability.
HOSTS, LIKELY = 2, 0.05


@dataclass(frozen=True, eq=False)
class Beside:
    """What is shared, fitted in one session beside what is its own.

    Attributes:
        weighed: the fit of both.
        own: candidates that act in this session alone; None is something that the catalogue does not hold.
        log_posterior: log evidence, and the prior of what is its own.
    """

    weighed: Weighed
    own: Names
    log_posterior: float


class Sharer:
    """One session, asked what may be shared with others.

    Attributes:
        diagnosis: of the session by itself.
    """

    def __init__(self, diagnosis: Diagnosis) -> None:
        self.diagnosis = diagnosis
        self._candidates = diagnosis.candidates
        self._fitter = Fitter(diagnosis.problem)
        self._fitter.best.update((f.explanation, f) for f in diagnosis.search.fitted)
        self._weighed = {w.explanation: w for w in diagnosis.evidence.weighed}

    @cached_property
    def _wildcard(self) -> Wildcard:
        return Wildcard.of(anything(self.diagnosis.problem), AMPLITUDES_N)

    @cached_property
    def _values(self) -> dict[Names, float]:
        """Log posteriors of the session's own explanations."""
        evidence = self.diagnosis.evidence
        return {names: float(np.log(max(p, 1e-300))) + evidence.log_norm for names, p in evidence.probability.items()}

    @cached_property
    def hosts(self) -> tuple[Weighed, ...]:
        """What acts here by the session's own diagnosis; the likeliest first."""
        evidence = self.diagnosis.evidence
        likely = [w for w in evidence.weighed if evidence.probability[w.explanation.names] >= LIKELY]
        best = list({w.explanation.names: w for w in reversed(likely)}.values())[::-1][:HOSTS]
        return tuple(best) or (evidence.nothing,)

    @property
    def log_posterior(self) -> float:
        """Of whatever may act here, if nothing is shared."""
        return self.diagnosis.evidence.log_norm

    def without(self, names: Collection[str]) -> float:
        """Log posterior of all that acts without some candidates."""
        return float(logsumexp([v for n, v in self._values.items() if not set(n or ()) & set(names)]))

    def here(self, shared: Explanation) -> Explanation:
        """The same with this session's own indices of its parameters: sessions differ in their settings."""
        by_name = {c.name: c for c in self._candidates}
        parts = zip(shared.names, shared.alternative, strict=True)
        return together([single(by_name[name], k) for name, k in parts], self._candidates)

    def promise(self, shared: Explanation) -> float:
        """What the straightened model expects `beside` to come to, about the likeliest of what acts here."""
        shared, host = self.here(shared), self.hosts[0]
        own = self._own(host.explanation, shared)
        if own is None:
            return -np.inf
        everything = host.fitted.everything
        gain = everything.gain((*own.parameters, *shared.parameters)) - everything.gain(host.explanation.parameters)
        return host.log_evidence + gain + log_prior(own, self._candidates)

    def beside(self, shared: Explanation) -> tuple[Beside, ...]:
        """Fit what is shared alone, beside what else acts here, and beside something unknown; the likeliest first."""
        shared = self.here(shared)
        owns = [NOTHING_MISSING, *(self._own(w.explanation, shared) for w in self.hosts)]
        found = [self._beside(shared, own) for own in dict.fromkeys(owns) if own is not None]
        alone = found[0].weighed
        unknown = other_evidence(alone.fitted, self._wildcard).log_evidence + log_prior_else()
        kept = [f for f in found if not struck_out(f.weighed, self.diagnosis.evidence.nothing)]
        return tuple(sorted([*kept, Beside(alone, None, unknown)], key=lambda b: -b.log_posterior))

    def size(self, shared: Explanation, found: Beside) -> Size:
        """What a fit says of the size of what is shared; errors of form and the budget's size are allowed for."""
        weighed, index = found.weighed, list(self.here(shared).parameters)
        fitted = weighed.fitted
        free, scale = scales(fitted, weighed.budget_factor, fitted.moving)
        _, values, covariance = estimates_of(fitted.linear, free, scale, weighed.form, weighed.form_error)
        information, score = np.zeros((len(index), len(index))), np.zeros(len(index))
        # What a bound holds says nothing more of itself.
        known = [k for k, i in enumerate(index) if i in set(free)]
        at = np.searchsorted(free, [index[k] for k in known])
        precision = np.linalg.inv(covariance[np.ix_(at, at)])
        information[np.ix_(known, known)] = precision - np.eye(len(known))
        score[known] = precision @ values[at]
        return Size(information, score)

    def _own(self, explanation: Explanation, shared: Explanation) -> Explanation | None:
        """What is left of an explanation as the session's own; None if it frees the same parameters."""
        kept = [m for m in members(explanation, self._candidates) if m.names[0] not in shared.names]
        own = together(kept, self._candidates)
        return None if set(own.parameters) & set(shared.parameters) else own

    def _beside(self, shared: Explanation, own: Explanation) -> Beside:
        both = together([*members(shared, self._candidates), *members(own, self._candidates)], self._candidates)
        weighed = self._weighed.get(both)
        if weighed is None:
            weighed = weigh_one(self.diagnosis.problem, self._fitted(both, own), self._candidates)
        return Beside(weighed, own.names, weighed.log_evidence + log_prior(own, self._candidates))

    def _fitted(self, both: Explanation, own: Explanation) -> Fitted:
        known = self._fitter.best.get(both)
        if known is not None and known.converged:
            return known
        hosts = [w.fitted for w in self.hosts if set(own.names) <= set(w.explanation.names)]
        near = hosts[0] if hosts else self.diagnosis.search.nothing
        starts = [self._fitter.expected(near, both), near.theta, *([] if known is None else [known.theta])]
        found = self._fitter.fit(both, starts, SECOND)
        return found if found.converged else self._fitter.go_on(found, LAST, finely=True)
