"""What a verdict hangs on: it is asked again under other priors, another budget, and without parts of the data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fingermodel.compare import muscles_of
from fingermodel.diagnosis.candidates import Candidate, Names, log_prior_else
from fingermodel.diagnosis.evidence import Evidence
from fingermodel.diagnosis.questioned import Questioned
from fingermodel.diagnosis.verdict import Verdict
from fingermodel.diagnosis.wildcard import Wildcard
from fingermodel.problems import Problem

# Multiples of the budget.
MULTIPLES = (1.5, 2.0, 3.0, 4.0, 6.0, 8.0)


@dataclass(frozen=True)
class Robustness:
    """Assumptions under which the verdict would be another.

    Attributes:
        flips_when: assumptions, in words, under which something else would be favoured.
        rests_on: parts of the data without which the verdict loses its ground (but nothing else is favoured,
            unless they are all that a mount reads).
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
    candidates: tuple[Candidate, ...],
    *,
    thorough: bool = False,
) -> Robustness:
    """Ask the best explanations again: on the straightened models, and what these would turn by refits.

    Args:
        problem: that was searched.
        evidence: of its explanations.
        verdict: that is questioned.
        wildcard: of the problem.
        candidates: that were searched.
        thorough: whether all is refitted without each part of the data, whatever the straightened models say.
    """
    asked = Questioned.of(problem, evidence, verdict, wildcard, candidates)
    if verdict.kind == "none_of_catalogue":
        return Robustness((), (), None, _spoken(asked.favours(asked.without(problem.rows % 6 == 2))))
    flips: list[str] = []
    for nothing in (0.25, 0.75):
        values = {n: np.log(max(p, 1e-300)) + _reweight(n, nothing) for n, p in evidence.probability.items()}
        if not asked.says(asked.favours(values)):
            flips.append(f"the prior on nothing missing is {nothing:g}")
    for factor, words in ((0.5, "half"), (2.0, "twice")):
        values = asked.values(effect=factor)
        values[None] = evidence.other.log_evidence + log_prior_else()
        if not asked.says(asked.favours(values)):
            flips.append(f"effects are expected {words} as large")
    if verdict.kind != "nothing_missing" and not asked.says(asked.favoured_at(2.0)):
        flips.append("the budget is twice as large")
    rests = []
    for words, rows, whole_mount in left_out(problem):
        winner = asked.favoured_without(rows, thorough=thorough)
        if asked.says(winner):
            continue
        # Fewer names, or none, is ground lost; other names are a contradiction. Not so without a whole mount: it may be
        # all that tells what the tendons pull with from what the finger makes of it.
        if winner is None or set(winner) < set(verdict.names) or not winner or whole_mount:
            rests.append(words)
        else:
            flips.append(f"{words} is left out: then {' and '.join(winner)}")
    fails = None
    if verdict.kind in ("found", "one_of"):
        fails = next((m for m in MULTIPLES if not asked.says(asked.favours(asked.values_at(m)))), None)
    planar = asked.favours(asked.without(problem.rows % 6 == 2))
    moments = problem.rows % 6 >= 3
    on_moments = (
        bool(moments.any())
        and verdict.kind in ("found", "one_of")
        and not asked.says(asked.favours(asked.without(moments)))
    )
    return Robustness(tuple(flips), tuple(rests), fails, _spoken(planar), on_moments)


def _reweight(names: Names, nothing: float) -> float:
    return float(np.log(nothing / 0.5)) if names == () else float(np.log((1.0 - nothing) / 0.5))


def left_out(problem: Problem) -> list[tuple[str, NDArray[np.bool_], bool]]:
    """Parts of the data to leave out: in words, which readings go with them, and whether that is all of a mount's."""
    observations = problem.observations
    cases = problem.rows // 6
    out = []
    postures = dict.fromkeys(observations.postures[i] for i in cases if observations.postures[i])
    if len(postures) > 1:
        out += [(f"posture {p}", np.array([observations.postures[i] == p for i in cases]), False) for p in postures]
    muscles = dict.fromkeys(m for i in cases for m in observations.masses_g[i])
    if len(muscles) > 1:
        for muscle in muscles:
            loaded = np.array([muscle in muscles_of(observations.masses_g[i]).split("+") for i in cases])
            out.append((f"tendon {muscle}", loaded, False))
    places = dict.fromkeys(observations.locations[i] for i in cases)
    if len(places) > 1:
        out += [(f"the {p} readings", np.array([observations.locations[i] == p for i in cases]), True) for p in places]
    return [(words, rows, mount) for words, rows, mount in out if rows.sum() < 0.8 * len(rows)]


def _spoken(winner: Names) -> str:
    if winner is None:
        return "none_of_catalogue"
    return " and ".join(winner) if winner else "nothing_missing"
