"""What a verdict hangs on: it is asked again under other priors, another budget, and without parts of the data."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from fingermodel.compare import muscles_of
from fingermodel.diagnosis.candidates import log_prior_else
from fingermodel.diagnosis.evidence import Evidence, Weighed, at_budget, other_at_budget
from fingermodel.diagnosis.linear import Linear
from fingermodel.diagnosis.verdict import Verdict
from fingermodel.diagnosis.wildcard import Wildcard
from fingermodel.problems import Problem

Floats = NDArray[np.float64]

# Explanations that are asked again, and multiples of the budget.
ASKED = 4
CLEAR_ODDS = 2.2
MULTIPLES = (1.5, 2.0, 3.0, 4.0, 6.0, 8.0)


@dataclass(frozen=True)
class Robustness:
    """Assumptions under which the verdict would be another.

    Attributes:
        flips_when: assumptions, in words, under which something else would be favoured.
        rests_on: parts of the data without which the verdict loses its ground (but nothing else is favoured).
        budget_multiple_at_which_it_fails: smallest multiple of the budget tried at which it no longer holds; None if it
            holds at all of them.
        sagittal_alone: what is favoured when only the sagittal plane counts.
        rests_on_moments: whether the forces alone would not say so.
    """

    flips_when: tuple[str, ...]
    rests_on: tuple[str, ...]
    budget_multiple_at_which_it_fails: float | None
    sagittal_alone: str | None
    rests_on_moments: bool = False


def robustness(
    problem: Problem,
    evidence: Evidence,
    verdict: Verdict,
    wildcard: Wildcard,
) -> Robustness:
    """Ask the best explanations again.

    Args:
        problem: that was searched.
        evidence: of its explanations.
        verdict: that is questioned.
        wildcard: of the problem.
    """
    named = [w for w in evidence.weighed if w.explanation.size][:ASKED]
    asked = [*named, evidence.nothing]
    root = np.asarray(np.linalg.inv(problem.whitener), dtype=np.float64)
    names = set(verdict.names)
    flips: list[str] = []

    def favours(values: dict[tuple[str, ...] | None, float]) -> tuple[str, ...] | None:
        winner = max(values, key=lambda k: values[k])
        # Another verdict would need nine times the odds; less than that is doubt, not a contradiction.
        kept = [k for k in values if same(k) and values[k] > values[winner] - CLEAR_ODDS]
        return max(kept, key=lambda k: values[k]) if kept else winner

    def same(winner: tuple[str, ...] | None) -> bool:
        if verdict.kind == "nothing_missing":
            return winner == ()
        if winner is None:
            return False
        if verdict.kind == "one_of":
            return bool(names & set(winner))
        return names <= set(winner)

    if verdict.kind == "none_of_catalogue":
        return Robustness((), (), None, _spoken(favours(_without(root, asked, problem.rows % 6 == 2))))
    for nothing in (0.25, 0.75):
        values = {
            names_: np.log(max(p, 1e-300)) + _reweight(names_, nothing) for names_, p in evidence.probability.items()
        }
        if not same(favours(values)):
            flips.append(f"the prior on nothing missing is {nothing:g}")
    for factor, words in ((0.5, "half"), (2.0, "twice")):
        values = {w.explanation.names: w.log_evidence + w.log_prior + _rescaled(w, factor) for w in asked}
        values[None] = evidence.other_log_evidence + log_prior_else()
        if not same(favours(values)):
            flips.append(f"effects are expected {words} as large")
    if verdict.kind != "nothing_missing" and not same(favours(_values_at(evidence, asked, wildcard, 2.0))):
        flips.append("the budget is twice as large")
    rests = []
    for words, rows in left_out(problem):
        winner = favours(_without(root, asked, rows))
        if same(winner):
            continue
        # Fewer names, or none, is ground lost; other names are a contradiction.
        if winner is None or set(winner) < names or not winner:
            rests.append(words)
        else:
            flips.append(f"{words} is left out: then {' and '.join(winner)}")
    fails = None
    if verdict.kind in ("found", "one_of"):
        fails = next((m for m in MULTIPLES if not same(favours(_values_at(evidence, asked, wildcard, m)))), None)
    planar = favours(_without(root, asked, problem.rows % 6 == 2))
    moments = problem.rows % 6 >= 3
    forces = favours(_without(root, asked, moments)) if moments.any() else None
    on_moments = bool(moments.any()) and verdict.kind in ("found", "one_of") and not same(forces)
    return Robustness(tuple(flips), tuple(rests), fails, _spoken(planar), on_moments)


def _reweight(names: tuple[str, ...] | None, nothing: float) -> float:
    return float(np.log(nothing / 0.5)) if names == () else float(np.log((1.0 - nothing) / 0.5))


def _rescaled(weighed: Weighed, factor: float) -> float:
    """Change of the log evidence when the effect's priors are `factor` times as wide."""
    own = weighed.explanation.parameters
    if not own:
        return 0.0
    linear = weighed.fitted.linear
    return linear.gain(own, factor) - linear.gain(own)


def _values_at(
    evidence: Evidence, asked: Iterable[Weighed], wildcard: Wildcard, multiple: float
) -> dict[tuple[str, ...] | None, float]:
    """Log posteriors with the budget so many times as large."""
    other = other_at_budget(evidence.nothing.fitted, wildcard, multiple)[0]
    values: dict[tuple[str, ...] | None, float] = {None: other + log_prior_else()}
    for w in asked:
        values[w.explanation.names] = at_budget(w.fitted, w.form, multiple)[0] + w.log_prior
    return values


def left_out(problem: Problem) -> list[tuple[str, NDArray[np.bool_]]]:
    """Parts of the data to leave out, in words, and which readings go with them."""
    observations = problem.observations
    cases = problem.rows // 6
    out = []
    postures = dict.fromkeys(observations.postures[i] for i in cases if observations.postures[i])
    if len(postures) > 1:
        out += [(f"posture {p}", np.array([observations.postures[i] == p for i in cases])) for p in postures]
    muscles = dict.fromkeys(m for i in cases for m in observations.masses_g[i])
    if len(muscles) > 1:
        for muscle in muscles:
            loaded = np.array([muscle in muscles_of(observations.masses_g[i]).split("+") for i in cases])
            out.append((f"tendon {muscle}", loaded))
    places = dict.fromkeys(observations.locations[i] for i in cases)
    if len(places) > 1:
        out += [(f"the {p} readings", np.array([observations.locations[i] == p for i in cases])) for p in places]
    return [(words, rows) for words, rows in out if rows.sum() < 0.8 * len(rows)]


def _without(root: Floats, asked: Iterable[Weighed], gone: NDArray[np.bool_]) -> dict[tuple[str, ...] | None, float]:
    """Log posteriors with some readings left out, on the straightened models; a smooth rest is allowed for as noise.

    Args:
        root: (n, n) takes whitened readings back to their units.
        asked: explanations.
        gone: (n,) readings that are left out.
    """
    part = root[~gone]
    factor = np.linalg.cholesky(part @ part.T)
    thin = np.linalg.solve(factor, part)
    out: dict[tuple[str, ...] | None, float] = {}
    for w in asked:
        linear = w.fitted.linear
        columns = np.concatenate([linear.base, np.array(w.explanation.parameters, dtype=np.intp)])
        h, y = thin @ linear.h[:, columns], thin @ linear.y
        # The effect's form is allowed to be off by what it left over in all the readings.
        left = max(w.fitted.objective / max(len(gone), 1), 1.0) if w.explanation.size else 1.0
        small = Linear(
            y / np.sqrt(left),
            h / np.sqrt(left),
            np.arange(len(linear.base)),
            linear.one_sided[columns],
        )
        value = small.log_evidence_base - 0.5 * len(y) * np.log(left)
        own = range(len(linear.base), len(columns))
        value += small.gain(list(own)) if w.explanation.size else 0.0
        key = w.explanation.names
        out[key] = float(logsumexp([out[key], value + w.log_prior])) if key in out else value + w.log_prior
    return out


def _spoken(winner: tuple[str, ...] | None) -> str:
    if winner is None:
        return "none_of_catalogue"
    return " and ".join(winner) if winner else "nothing_missing"
