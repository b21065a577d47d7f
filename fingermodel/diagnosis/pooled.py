"""Several sessions at once: one effect shared by all, each session with its own anatomy and small errors.

A fault of the rig is the same in every specimen that it held; an anatomical effect is not. So each candidate is tried
twice: with one size for all sessions, and with a size of its own in each.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from fingermodel.diagnosis.candidates import NOTHING_MISSING, Candidate, log_prior, log_prior_else, single
from fingermodel.diagnosis.diagnose import Diagnosis, diagnose
from fingermodel.diagnosis.evidence import Weighed, weigh_one
from fingermodel.diagnosis.fitter import Fitter
from fingermodel.diagnosis.linear import log_mass
from fingermodel.diagnosis.verdict import SURE
from fingermodel.model import Model
from fingermodel.observations import Observations

Floats = NDArray[np.float64]
# Log evidence that speaks for an effect in one session by itself.
CLEAR_GAIN = 2.3


@dataclass(frozen=True, eq=False)
class SharedEffect:
    """One candidate over all sessions.

    Attributes:
        name: of the candidate.
        effect: its effect.
        parameters: names.
        units: of the parameters.
        value: (k,) shared size, in the parameters' units.
        sd: (k,).
        log_evidence_shared: gain over nothing with one size for all.
        log_evidence_own: gain with a size for each session.
        each: per session: gain, values and standard deviations.
        probability: of this explanation among all pooled ones.
    """

    name: str
    effect: str
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    value: Floats
    sd: Floats
    log_evidence_shared: float
    log_evidence_own: float
    each: tuple[tuple[float, Floats, Floats], ...]
    probability: float

    @property
    def shared(self) -> bool:
        """Whether one size serves all sessions."""
        return self.log_evidence_shared >= self.log_evidence_own


@dataclass(frozen=True, eq=False)
class Pooled:
    """What several sessions say together.

    Attributes:
        sessions: ids.
        diagnoses: of each by itself.
        ranking: candidates, best first.
        p_nothing: probability that nothing is missing in any.
        p_other: that it is something outside the catalogue.
        verdict: found, one_of, none_of_catalogue, nothing_missing or undecided.
        names: candidates that it names.
        probability: of the verdict.
        sentence: in plain words.
        seconds: of the computation.
    """

    sessions: tuple[str, ...]
    diagnoses: tuple[Diagnosis, ...]
    ranking: tuple[SharedEffect, ...]
    p_nothing: float
    p_other: float
    verdict: str
    names: tuple[str, ...]
    probability: float
    sentence: str
    seconds: float


def diagnose_pooled(
    sessions: Sequence[tuple[str, Model, Observations]],
    *,
    thorough: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Pooled:
    """Diagnose sessions by themselves and together.

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
    common = [c for c in diagnoses[0].candidates if all(c.name in {x.name for x in d.candidates} for d in diagnoses)]
    effects = []
    for k, candidate in enumerate(common):
        effects.append(_shared(diagnoses, candidate.name))
        tell(0.6 + 0.4 * (k + 1) / len(common))
    everyone = diagnoses[0].candidates
    total = [
        float(
            logsumexp([e.log_evidence_shared, e.log_evidence_own], b=[0.5, 0.5])
            + log_prior(single(_of(everyone, e.name), 0), everyone)
        )
        for e in effects
    ]
    other = sum(d.evidence.other.log_evidence - d.evidence.nothing.log_evidence for d in diagnoses)
    values = np.array([np.log(0.5), other + log_prior_else(), *total])
    probability = np.exp(values - logsumexp(values))
    ranked = sorted(
        (
            SharedEffect(**{**e.__dict__, "probability": float(p)})
            for e, p in zip(effects, probability[2:], strict=True)
        ),
        key=lambda e: -e.probability,
    )
    kind, names, sure, sentence = _verdict(
        ranked, [s[0] for s in sessions], float(probability[0]), float(probability[1])
    )
    return Pooled(
        tuple(s[0] for s in sessions),
        tuple(diagnoses),
        tuple(ranked),
        float(probability[0]),
        float(probability[1]),
        kind,
        names,
        sure,
        sentence,
        time.perf_counter() - began,
    )


def _of(candidates: Sequence[Candidate], name: str) -> Candidate:
    return next(c for c in candidates if c.name == name)


def _shared(diagnoses: Sequence[Diagnosis], name: str) -> SharedEffect:
    """Fit one candidate in every session and put the sessions' likelihoods of its size together."""
    options = [
        [_fit(d, name, k) for d in diagnoses] for k in range(len(_of(diagnoses[0].candidates, name).alternatives))
    ]
    fits = max(options, key=lambda each: sum(w.log_evidence for w in each))
    size = len(fits[0].explanation.parameters)
    information, score = np.zeros((size, size)), np.zeros(size)
    constant, own = 0.0, 0.0
    each: list[tuple[float, Floats, Floats]] = []
    for d, w in zip(diagnoses, fits, strict=True):
        index = list(w.explanation.parameters)
        linear = w.fitted.linear
        full, s = linear.information
        gain = w.log_evidence - d.evidence.nothing.log_evidence
        a, b = full[np.ix_(index, index)], s[index]
        own += gain
        constant = constant + gain - linear.gain(index)
        information, score = information + a, score + b
        sd = np.array([w.sd(i) or np.nan for i in index])
        each.append((gain, w.fitted.theta[index], sd))
    first = fits[0].fitted
    index = list(first.explanation.parameters)
    table, scale = first.problem.model.parameters.parameters, first.problem.scale[index]
    hessian = np.eye(len(index)) + information
    mean = np.asarray(np.linalg.solve(hessian, score), dtype=np.float64)
    sided = np.array([table[i].one_sided for i in index])
    pooled = 0.5 * float(score @ mean) - 0.5 * float(np.linalg.slogdet(hessian)[1])
    pooled += log_mass(mean, hessian, sided)
    return SharedEffect(
        name,
        _of(diagnoses[0].candidates, name).effect,
        tuple(table[i].name for i in index),
        tuple(table[i].unit for i in index),
        np.where(sided, np.maximum(mean, 0.0), mean) * scale,
        np.sqrt(np.diag(np.linalg.inv(hessian))) * scale,
        float(constant + pooled),
        float(own),
        tuple(each),
        0.0,
    )


def _fit(d: Diagnosis, name: str, alternative: int) -> Weighed:
    candidate = _of(d.candidates, name)
    explanation = single(candidate, min(alternative, len(candidate.alternatives) - 1))
    known = next((f for f in d.search.fitted if f.explanation == explanation and f.converged), None)
    if known is None:
        fitter, nothing = Fitter(d.problem), d.search.nothing
        fitter.best[NOTHING_MISSING] = nothing
        # From its null there is a fit, should what is expected lead to none.
        known = fitter.fit(explanation, [fitter.expected(nothing, explanation), nothing.theta], 30)
    return weigh_one(d.problem, known, d.candidates)


def _verdict(
    ranked: Sequence[SharedEffect], sessions: Sequence[str], p_nothing: float, p_other: float
) -> tuple[str, tuple[str, ...], float, str]:
    best = ranked[0]
    if p_other >= max(SURE, best.probability):
        return "none_of_catalogue", (), p_other, "Something is missing that no single effect here describes in all."
    if p_nothing >= SURE:
        return "nothing_missing", (), p_nothing, "Taken together, nothing is missing that the sessions share."
    if best.probability >= SURE:
        where = (
            "of one size in all sessions, as a fault of the rig would be"
            if best.shared
            else "of another size in each session, as what belongs to a specimen would be"
        )
        absent = [s for s, (gain, _, _) in zip(sessions, best.each, strict=True) if gain < CLEAR_GAIN]
        if absent and not best.shared:
            text = f"Not shared: {best.name} shows in some sessions, but not in {', '.join(absent)}."
            return "undecided", (), best.probability, text
        return "found", (best.name,), best.probability, f"Found in all sessions together: {best.name}, {where}."
    chosen, total = [], 0.0
    for e in ranked[:4]:
        chosen.append(e.name)
        total += e.probability
        if total >= SURE:
            return (
                "one_of",
                tuple(chosen),
                total,
                f"One of {', '.join(chosen)}; the sessions together do not tell which.",
            )
    return "undecided", (), max(best.probability, p_nothing), "Undecided: together the sessions single out no effect."
