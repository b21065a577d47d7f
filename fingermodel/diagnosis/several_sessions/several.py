"""Several sessions at once: which effects all of them share, each with its own anatomy, budget and effects of its own.

A fault of the rig is the same in every specimen that it held; an anatomical effect is not. What is shared is tried with
one size for all sessions and with a size of its own in each, beside whatever else acts in each, and held against each
session's having its own explanation and nothing in common.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.special import logsumexp

from daq.findings import Finding
from fingermodel.arrays import Floats
from fingermodel.diagnosis.diagnose import Diagnosis, diagnose
from fingermodel.diagnosis.posterior.fitting import Fitter
from fingermodel.diagnosis.posterior.gaussian import Quadratic, log_mass
from fingermodel.diagnosis.posterior.marginals import Posterior, weighed
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.candidates import NOTHING, Candidates, Explanation, Member
from fingermodel.diagnosis.settings import EVIDENCE_POWER, LIVE, P_NOTHING, PERMUTATIONS, SURE
from fingermodel.diagnosis.several_sessions.independence import of_one_specimen, require_apart
from fingermodel.diagnosis.several_sessions.several_verdict import (
    InSession,
    PooledVerdict,
    SharedEffect,
    judge_together,
    to_correct,
)
from fingermodel.diagnosis.several_sessions.shared_finding import SharedFinding, shared_finding
from fingermodel.diagnosis.several_sessions.shared_laws import deciding
from fingermodel.session import Session

# Effects that are fitted in every session: singles, and pairs of the best of them.
_SINGLES, _PAIRS = 6, 3


@dataclass(frozen=True, eq=False)
class Pooled:
    """What several sessions say together."""

    sessions: tuple[str, ...]  # ids
    diagnoses: tuple[Diagnosis, ...]  # of each by itself
    ranking: tuple[SharedEffect, ...]  # what may be shared, best first
    # Probability that nothing is shared: each session has an explanation of its own, or needs none. None where one has
    # a fault, and it was not asked.
    p_apart: float | None
    p_nothing: float | None  # of that, that nothing is missing in any
    p_other: float | None  # of that, that it is something outside the catalogue in each
    verdict: PooledVerdict  # on what is shared
    # A law that nobody listed, that the specimens share; None where their fingers have other tendons, or all sessions
    # are of one specimen.
    shared: SharedFinding | None
    findings: Sequence[Finding]  # of specimens of which there are several sessions
    seconds: float  # of the computation


def diagnose_pooled(
    sessions: Sequence[Session],
    *,
    thorough: bool = False,
    permutations: int = PERMUTATIONS,
    progress: Callable[[float], None] | None = None,
) -> Pooled:
    """Diagnose sessions by themselves, and weigh what all may share.

    Args:
        sessions: whose models hold the candidates at their null.
        thorough: more fits in each.
        permutations: shuffles by which a shared law is held against chance.
        progress: is told the share done.

    Raises:
        InputError: two of the sessions hold the same readings, or have one id.
        SessionError: a force channel that never changes.
    """
    measured = [s.measured for s in sessions]
    require_apart(measured)
    for one in measured:
        one.require_forces()
    names = tuple(s.id for s in sessions)
    began = time.perf_counter()
    tell = progress or (lambda _: None)
    diagnoses = []
    for k, session in enumerate(sessions):
        diagnoses.append(diagnose(session.model, session.observations, thorough=thorough))
        tell(0.5 * (k + 1) / len(sessions))
    findings = of_one_specimen([m.session for m in measured])
    if any(d.faults for d in diagnoses):
        # A wrongly entered session wants many effects that do not act, and the others would have to share them.
        verdict, seconds = to_correct(names, diagnoses), time.perf_counter() - began
        return Pooled(names, tuple(diagnoses), (), None, None, None, verdict, None, findings, seconds)
    specimens = [_Specimen(d) for d in diagnoses]
    pooling = _Pooling(specimens)
    found = pooling.search(lambda done: tell(0.5 + 0.2 * done))
    ranking, p_apart = pooling.normalised(found, range(len(diagnoses)))
    rests_on = pooling.rests_on(names, found, ranking)
    p_nothing = p_apart * float(np.prod([d.posterior.p_nothing for d in diagnoses]))
    p_other = p_apart * float(np.prod([d.posterior.p_beyond for d in diagnoses]))
    verdict = judge_together(names, diagnoses, ranking, (p_apart, p_nothing, p_other), rests_on)
    # What all share by name is known to act in each, too: a law that nobody listed is looked for beside it.
    known = [s.known(verdict.effect.explanation if verdict.effect else None) for s in specimens]
    of = [m.session.specimen.id for m in measured]
    shared = shared_finding(names, of, known, permutations, lambda done: tell(0.7 + 0.3 * done))
    if shared is not None and shared.laws:
        k = int(np.argmax(shared.curve.left_out_gain))
        told, between = deciding(diagnoses[k], known[k], shared.laws)
        shared = replace(shared, deciding=told, decided_between=between, decided_on=names[k])
    seconds = time.perf_counter() - began
    return Pooled(names, tuple(diagnoses), ranking, p_apart, p_nothing, p_other, verdict, shared, findings, seconds)


class _Specimen:
    """One session, asked what it says of an effect that may be shared."""

    def __init__(self, diagnosis: Diagnosis) -> None:
        self.diagnosis, self.posterior = diagnosis, diagnosis.posterior
        self._fits = dict(diagnosis.posterior.fits)
        self._fitter = Fitter(diagnosis.session, diagnosis.candidates, self.posterior.nothing.hyper)

    def here(self, shared: Explanation) -> Explanation | None:
        """The same with this session's own parameters; None where it cannot act."""
        members = []
        for m in shared.members:
            own = self.diagnosis.candidates.by_name.get(m.candidate.name)
            if own is None or len(own.forms) != len(m.candidate.forms):
                return None
            members.append(Member(own, m.form))
        return self.diagnosis.candidates.joined(members)

    def promise(self, shared: Explanation) -> float:
        """Log weight that the leading explanation promises if something shared acts beside it."""
        here, leader = self.here(shared), self.posterior.leader
        both = None if here is None else self._beside(here, leader.explanation)
        if both is None:
            return -np.inf
        values = leader.promises([leader.explanation, both[0]], [leader.best])
        gain = float(values[1] - values[0])
        return self._weight(leader.log_posterior - leader.log_prior + gain, both[1])

    def _weight(self, log_evidence: float, own: Explanation) -> float:
        """Log weight of what acts here alone; the prior of what is shared is counted once for all sessions."""
        prior = self.diagnosis.candidates.log_prior(own)
        return weighed(prior + log_evidence, prior)

    def _beside(self, here: Explanation, other: Explanation) -> tuple[Explanation, Explanation] | None:
        """Something shared and what is left of another explanation beside it; and that rest alone."""
        own = tuple(m for m in other.members if m.candidate.name not in here.names)
        both = self.diagnosis.candidates.joined((*here.members, *own))
        return None if both is None else (both, Explanation(own))

    def acting(self, shared: Explanation) -> tuple[float, InSession] | None:
        """Log weight of something shared acting here, beside nothing or what else does; and what is said of it."""
        here = self.here(shared)
        if here is None:
            return None
        pairs = [self._beside(here, o) for o in (NOTHING, self.posterior.leader.explanation)]
        offers = dict.fromkeys(p for p in pairs if p is not None)
        each = []
        for both, own in offers:
            fit = self._fitted(both)
            each.append((self._weight(fit.log_posterior - fit.log_prior, own), fit, own))
        total = float(logsumexp([v for v, _, _ in each]))
        _, fit, own = max(each, key=lambda e: e[0])
        without = self.posterior.probability(lambda e: not set(here.names) & set(e.explanation.names))
        gain = total - (self.posterior.log_norm + float(np.log(max(without, 1e-300))))
        theta, covariance, index = fit.parameter_posterior(fit.best)
        at = [int(np.flatnonzero(index == i)[0]) for i in here.parameters]
        by_name = Posterior.of({fit.explanation: fit}).of_names(here.names)
        sd = np.sqrt(np.diag(covariance))[at] * fit.session.problem.scale[list(here.parameters)]
        return total, InSession(gain, theta[list(here.parameters)], sd, own.names, by_name, _size(fit, here))

    def known(self, shared: Explanation | None) -> Optimum:
        """What is known to act here: what was found in this session by itself, and what all sessions share."""
        own = self.diagnosis.best if self.diagnosis.verdict.kind == "found" else self.posterior.nothing
        here = None if shared is None else self.here(shared)
        both = None if here is None else self._beside(here, own.explanation)
        return own if both is None else self._fitted(both[0])

    def _fitted(self, explanation: Explanation) -> Optimum:
        known = self._fits.get(explanation)
        if known is None:
            leader, found = self.posterior.leader, list[Optimum]()
            for start in (leader.expected(explanation, leader.best), self.posterior.nothing.theta):
                # Its prior is that of what acts here alone, added by whoever asks.
                found.append(self._fitter.fit(explanation, start, leader.best, leader.bad, 0.0))
                if found[-1].settled:
                    break
            # By their peaks: to sum over hyperparameters takes longer than the fit.
            known = self._fits[explanation] = max(found, key=lambda f: f.log_joint(f.mode))
        return known


def _size(fit: Optimum, here: Explanation) -> Quadratic:
    """What a fit says of some of its parameters, in prior widths, without their prior: a Gaussian likelihood."""
    freed = fit.freed(fit.best)
    at = [fit.explanation.parameters.index(i) for i in here.parameters]
    precision = np.linalg.inv(freed.covariance[np.ix_(at, at)])
    information = precision - np.eye(len(at))
    values, vectors = np.linalg.eigh(0.5 * (information + information.T))
    return Quadratic(0.0, precision @ freed.mean[at], (vectors * np.maximum(values, 0.0)) @ vectors.T, 0.0)


class _Pooling:
    """What may be shared, weighed over sessions."""

    def __init__(self, sessions: Sequence[_Specimen]) -> None:
        self._sessions = sessions
        first = sessions[0].diagnosis
        self._candidates: Candidates = first.candidates
        self._table = first.session.model.parameters
        self._scale = first.session.problem.scale
        self._each: dict[Explanation, list[tuple[float, InSession]]] = {}

    def search(self, tell: Callable[[float], None]) -> list[Explanation]:
        """Fit the singles that promise most in all sessions together, and pairs of the best of them."""
        everyone = range(len(self._sessions))
        self._fit(self._candidates.singles, _SINGLES)
        tell(0.6)
        weights = {e: self.log_weight(e, everyone) for e in self._each}
        best = sorted(weights, key=lambda e: -weights[e])[:_PAIRS]
        pairs = [self._candidates.joined((*a.members, *b.members)) for a, b in combinations(best, 2)]
        live = max(self.apart(everyone), *weights.values()) + float(np.log(LIVE))
        self._fit([p for p in pairs if p is not None], _PAIRS, live)
        tell(1.0)
        return list(self._each)

    def _fit(self, offers: Sequence[Explanation], most: int, least: float = -np.inf) -> None:
        """Fit those that promise most, and more than the least, in every session."""
        inside = [e for e in offers if not any(m.candidate.outside for m in e.members)]
        promise = {e: sum(s.promise(e) for s in self._sessions) + self._candidates.log_prior(e) for e in inside}
        ranked = [e for e in sorted(promise, key=lambda e: -promise[e]) if promise[e] > least]
        chosen: dict[tuple[str, ...], Explanation] = {}
        for explanation in ranked:
            chosen.setdefault(explanation.names, explanation)
        for explanation in list(chosen.values())[:most]:
            found = [s.acting(explanation) for s in self._sessions]
            if all(f is not None for f in found):
                self._each[explanation] = [f for f in found if f is not None]

    def apart(self, sessions: Sequence[int]) -> float:
        """Log weight of nothing being shared."""
        return float(np.log(P_NOTHING)) + sum(self._sessions[k].posterior.log_norm for k in sessions)

    def tied(self, explanation: Explanation, sessions: Sequence[int]) -> tuple[float, Floats, Floats]:
        """What is gained by one size in all of some sessions, that size (k,) and its sd (k,), in prior widths."""
        sizes = [self._each[explanation][k][1].size for k in sessions]
        sided = self._table.one_sided[list(explanation.parameters)]

        def evidence(q: Quadratic) -> tuple[float, Floats, Floats]:
            freed = q.of_size(1.0, len(sided))
            value = freed.log_evidence + log_mass(freed.mean, freed.covariance, sided)
            return value, freed.mean, np.sqrt(np.diag(freed.covariance))

        whole, mean, sd = evidence(Quadratic.of_all(sizes))
        gained = EVIDENCE_POWER * (whole - sum(evidence(q)[0] for q in sizes))
        return gained, np.where(sided, np.maximum(mean, 0.0), mean), sd

    def log_weight(self, explanation: Explanation, sessions: Sequence[int]) -> float:
        """Log weight of one thing shared by some sessions, with one size or with one in each."""
        own = sum(self._each[explanation][k][0] for k in sessions)
        ways = float(np.logaddexp(0.0, self.tied(explanation, sessions)[0]) - np.log(2.0))
        return self._candidates.log_prior(explanation) + own + ways

    def normalised(
        self, found: Sequence[Explanation], sessions: Sequence[int]
    ) -> tuple[tuple[SharedEffect, ...], float]:
        """The ranking by some sessions, and the probability that they share nothing."""
        values = {e: self.log_weight(e, sessions) for e in found}
        total = float(logsumexp([self.apart(sessions), *values.values()]))
        out = []
        for e, value in values.items():
            (tied, mean, sd), at = self.tied(e, sessions), list(e.parameters)
            size, spread = self._table.centre[at] + mean * self._scale[at], sd * self._scale[at]
            parameters = tuple(self._table.parameters[i] for i in at)
            each, p = tuple(self._each[e][k][1] for k in sessions), float(np.exp(value - total))
            own = sum(s.gain for s in each)
            out.append(SharedEffect(e, parameters, tied >= 0.0, size, spread, own + tied, own, each, p))
        out.sort(key=lambda s: -s.probability)
        return tuple(out), float(np.exp(self.apart(sessions) - total))

    def rests_on(
        self, names: Sequence[str], found: Sequence[Explanation], ranking: Sequence[SharedEffect]
    ) -> tuple[str, ...]:
        """Sessions without which what leads would not be sure; none where there are too few to leave any out."""
        if len(names) < 3 or not ranking:
            return ()
        out, lead = [], set(ranking[0].names)
        for k, name in enumerate(names):
            less, _ = self.normalised(found, [i for i in range(len(names)) if i != k])
            if sum(s.probability for s in less if lead <= set(s.names)) < SURE:
                out.append(name)
        return tuple(out)
