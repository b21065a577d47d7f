"""What the cases that were never fitted make of the explanations: how probable each would be if they counted too.

They are not fitted for this. Each explanation is straightened out where it stands, and says how probable it finds them:
noise, all that its fit leaves open and the error of its form allowed for.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np
from scipy.special import logsumexp

from fingermodel.diagnosis.candidates import Candidate
from fingermodel.diagnosis.evidence import Evidence, Weighed, change_and_form, other_evidence
from fingermodel.diagnosis.fitted import Fitted
from fingermodel.diagnosis.questioned import Asked, Names, Noise
from fingermodel.diagnosis.wildcard import AMPLITUDES_N, Wildcard, anything
from fingermodel.fingers import Plane
from fingermodel.problems import Problem, map_problem, residual_at
from fingermodel.refit import slopes_of

# What is less probable than this is not asked.
LEAST = 1e-4


def counted_in(
    every: Problem, evidence: Evidence, wildcard: Wildcard, candidates: tuple[Candidate, ...]
) -> Mapping[Names, float]:
    """Probability of each explanation if the cases never fitted counted too; as it was where there are none.

    Args:
        every: what was searched, and with it the readings of the cases never fitted.
        evidence: of the explanations.
        wildcard: of what was searched.
        candidates: that were searched.
    """
    roles = np.array(every.observations.roles)
    unseen = roles[every.rows // 6] == "validation"
    if not unseen.any():
        return evidence.probability
    root = np.asarray(np.linalg.inv(every.whitener), dtype=np.float64)
    noise, without = Noise.of(root @ root.T), Noise.of(root @ root.T, unseen)
    values: dict[Names, list[float]] = {}
    for w in evidence.weighed:
        if evidence.probability[w.explanation.names] >= LEAST:
            asked = Asked.of(_straightened(w, every, candidates), root, noise)
            # It stands for all readings where `w` stood for those that are fitted.
            value = 2.0 * w.log_evidence - asked.value(without)
            values.setdefault(w.explanation.names, []).append(value + w.log_prior)
    if evidence.probability[None] >= LEAST:
        nothing = evidence.nothing
        anything_smooth = Wildcard.of(anything(every), AMPLITUDES_N)
        here, there = nothing.fitted, _straightened(nothing, every, candidates).fitted
        gained = other_evidence(there, anything_smooth).log_evidence - other_evidence(here, wildcard).log_evidence
        # Evidence of whitened readings lacks what their noise adds.
        gained += noise.log_size - without.log_size
        values[None] = [float(np.log(evidence.probability[None])) + evidence.log_norm + gained]
    total = {names: float(logsumexp(several)) for names, several in values.items()}
    norm = float(logsumexp(list(total.values())))
    return {names: float(np.exp(value - norm)) for names, value in total.items()}


def with_every_case(problem: Problem, plane: Plane | None, held: Collection[str]) -> Problem:
    """The problem of `map_problem` with the cases never fitted among those that are, read as far as those are."""
    observations = problem.observations
    roles = tuple("identification" if role == "validation" else role for role in observations.roles)
    components = np.isin(np.arange(6), problem.rows % 6)
    wrench = np.where(components, observations.wrench, np.nan)
    every = map_problem(problem.model, replace(observations, roles=roles, wrench=wrench), plane, held)
    return replace(every, observations=observations)


def _straightened(weighed: Weighed, every: Problem, candidates: tuple[Candidate, ...]) -> Weighed:
    """The same at the same optimum, straightened out for the cases never fitted too."""
    fitted = weighed.fitted
    problem = replace(every, free=fitted.problem.free)
    slopes = problem.whitener @ slopes_of(fitted.problem, fitted.theta, every.rows)
    solution = fitted.solution._replace(residual=residual_at(problem, fitted.theta), jacobian=slopes)
    there = Fitted(fitted.explanation, fitted.theta, fitted.x, fitted.objective, solution, problem)
    return replace(weighed, fitted=there, form=change_and_form(problem, there, candidates)[1])
