"""How often this very protocol would be misread: verdicts by probability on simulated, straightened sessions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from fingermodel.diagnosis.candidates import Candidate, log_prior, single
from fingermodel.diagnosis.linear import Linear

Floats = NDArray[np.float64]

DRAWS = 400
SEED = 20191107
SURE = 0.9


@dataclass(frozen=True)
class Calibration:
    """What a diagnosis of this protocol is worth, effects being as large as their priors.

    Attributes:
        false_finding_rate: share of sessions without an effect in which one is named with probability 0.9 or more.
        named: share of sessions with one effect in which something is named so.
        right: share of those in which it is the true one.
        reliability: (stated probability, share that came true, count) by bin of the leading name's probability.
        draws: simulated sessions of each kind.
    """

    false_finding_rate: float
    named: float
    right: float | None
    reliability: tuple[tuple[float, float, int], ...]
    draws: int

    def as_dict(self) -> dict[str, object]:
        """As the answer gives it."""
        return {
            "false_finding_rate": self.false_finding_rate,
            "named": self.named,
            "right": self.right,
            "reliability": [{"stated": a, "came_true": b, "sessions": n} for a, b, n in self.reliability],
            "draws": self.draws,
        }


def calibrate(linear: Linear, candidates: tuple[Candidate, ...], draws: int = DRAWS) -> Calibration:
    """Draw effects, base parameters and noise from the priors, and rank the singles of each session.

    The base model and the noise only ever enter through s = GᵀC₀⁻¹y, so a session is a handful of numbers.

    Args:
        linear: the base model straightened out.
        candidates: that would be searched.
        draws: sessions without an effect, and as many with one.
    """
    rng = np.random.default_rng(SEED)
    full, _ = linear.information
    index = linear.effects
    information = full[np.ix_(index, index)]
    values, vectors = np.linalg.eigh(information)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    at = {int(p): k for k, p in enumerate(index)}
    own = [[at[p] for p in c.alternatives[0] if p in at] for c in candidates]
    noise = rng.normal(size=(2 * draws, len(index))) @ root.T
    truth = np.full(2 * draws, -1)
    for d in range(draws, 2 * draws):
        k = int(rng.integers(len(candidates)))
        truth[d] = k
        phi = rng.normal(size=len(own[k]))
        sided = linear.one_sided[index][own[k]]
        noise[d] += information[:, own[k]] @ np.where(sided, np.abs(phi), phi)
    scores = np.column_stack(
        [_gains(noise[:, own[k]], information[np.ix_(own[k], own[k])], linear, index[own[k]]) for k in range(len(own))]
    )
    priors = np.array([log_prior(single(c, 0), candidates) for c in candidates])
    total = np.column_stack([np.full(2 * draws, np.log(0.5)), scores + priors])
    probability = np.exp(total - total.max(axis=1, keepdims=True))
    probability /= probability.sum(axis=1, keepdims=True)
    leader = probability[:, 1:].argmax(axis=1)
    stated = probability[:, 1:].max(axis=1)
    right = leader == truth
    with_one, sure = np.arange(2 * draws) >= draws, stated >= SURE
    named = with_one & sure
    bins = []
    for low, high in ((0.5, 0.7), (0.7, 0.9), (0.9, 0.99), (0.99, 1.01)):
        chosen = (stated >= low) & (stated < high)
        if chosen.any():
            bins.append((float(stated[chosen].mean()), float(right[chosen].mean()), int(chosen.sum())))
    return Calibration(
        float((~with_one & sure).sum() / draws),
        float(named.sum() / draws),
        float(right[named].mean()) if named.any() else None,
        tuple(bins),
        draws,
    )


def _gains(s: Floats, a: Floats, linear: Linear, parameters: NDArray[np.intp]) -> Floats:
    """Log evidence gained by one candidate in every session (draws,)."""
    hessian = np.eye(len(a)) + a
    mean = np.linalg.solve(hessian, s.T).T
    out: Floats = 0.5 * (s * mean).sum(axis=1) - 0.5 * np.linalg.slogdet(hessian)[1]
    sided = linear.one_sided[parameters]
    if sided.any():
        sd = np.sqrt(np.diag(np.linalg.inv(hessian)))
        out = out + (np.log(2.0) + log_ndtr(mean[:, sided] / sd[sided])).sum(axis=1)
    return out
