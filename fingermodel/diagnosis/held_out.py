"""What the cases that were never fitted say: which of them is missed, and what they make of the explanations.

They are not fitted for this. Each explanation is straightened out where it stands, and says what it expects of them:
noise, all that its fit leaves open and the error of its form allowed for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, logsumexp

from fingermodel.compare import muscles_of
from fingermodel.diagnosis.candidates import Candidate, Names
from fingermodel.diagnosis.evidence import Evidence, Weighed, best_form, change_and_form, other_evidence
from fingermodel.diagnosis.fitted import Fitted
from fingermodel.diagnosis.questioned import Asked, Noise
from fingermodel.diagnosis.wildcard import AMPLITUDES_N, FORM_ERRORS, Wildcard, anything
from fingermodel.problems import Problem, map_problem, residual_at
from fingermodel.refit import slopes_of

Floats = NDArray[np.float64]

# One chance in ten thousand, for all cases together.
SURPRISING = 1e-4
# What is less probable than this is not asked.
LEAST = 1e-4


@dataclass(frozen=True)
class Missed:
    """The case never fitted that an explanation misses most.

    Attributes:
        p_value: that any case would be missed so far, all of them paid for.
        text: which case, and by how much; empty where there is none.
    """

    p_value: float
    text: str

    @property
    def surprising(self) -> bool:
        """Whether noise, what the fit leaves open and an error of the form do not explain it."""
        return self.p_value < SURPRISING


@dataclass(frozen=True, eq=False)
class HeldOut:
    """The cases that were never fitted, beside those that were.

    Attributes:
        problem: that was searched.
        candidates: that were searched.
    """

    problem: Problem
    candidates: tuple[Candidate, ...]

    @cached_property
    def every(self) -> Problem:
        """What was searched, with the readings of these cases among the others.

        They are read as far as the others are, and as far as their uncertainty is known.
        """
        observations = self.problem.observations
        roles = tuple("identification" if role == "validation" else role for role in observations.roles)
        known = np.diagonal(observations.covariance).reshape(-1, 6) > 0.0
        wrench = np.where(known & np.isin(np.arange(6), self.problem.rows % 6), observations.wrench, np.nan)
        every = map_problem(self.problem.model, replace(observations, roles=roles, wrench=wrench), "space")
        return replace(every, observations=observations)

    @cached_property
    def unseen(self) -> NDArray[np.bool_]:
        """(n,) which readings are those of cases never fitted."""
        out: NDArray[np.bool_] = np.array(self.problem.observations.roles)[self.every.rows // 6] == "validation"
        return out

    @cached_property
    def root(self) -> Floats:
        """(n, n) takes whitened readings back to their units."""
        return np.asarray(np.linalg.inv(self.every.whitener), dtype=np.float64)

    @cached_property
    def noise(self) -> Noise:
        """Of all readings."""
        return Noise.of(self.root @ self.root.T)

    def counted_in(self, evidence: Evidence, wildcard: Wildcard) -> Mapping[Names, float]:
        """Probability of each explanation if these cases counted too; as it was where there are none.

        Args:
            evidence: of the explanations.
            wildcard: of what was searched.
        """
        if not self.unseen.any():
            return evidence.probability
        without = Noise.of(self.noise.covariance, self.unseen)
        values: dict[Names, float] = {}
        for names, probability in evidence.probability.items():
            # Of each the form that stands: others find these cases hardly more or less probable.
            form = best_form(evidence, names or ())
            if form is not None and probability >= LEAST:
                other = None if names is not None else wildcard
                values[names] = float(np.log(probability)) + self._gained(form, other, without)
        norm = float(logsumexp(list(values.values())))
        return {names: float(np.exp(value - norm)) for names, value in values.items()}

    def most_missed(self, weighed: Weighed) -> Missed:
        """Find the case that an explanation misses most, the largest error of its form that is tried allowed for."""
        if not self.unseen.any():
            return Missed(1.0, "")
        error = float(FORM_ERRORS[-1]) if weighed.explanation.size else 0.0
        asked = self._asked(replace(self._straightened(weighed), form_error=error))
        away, spread = asked.expected(self.noise, ~self.unseen, weighed.budget_factor)
        observations, rows = self.every.observations, self.every.rows[self.unseen]
        each = []
        for i in np.unique(rows // 6):
            force = (rows // 6 == i) & (rows % 6 < 3)
            if force.any():
                surprise = float(away[force] @ np.linalg.solve(spread[np.ix_(force, force)], away[force]))
                each.append((float(chdtrc(force.sum(), surprise)), -surprise, i, float(np.linalg.norm(away[force]))))
        if not each:
            return Missed(1.0, "")
        p_value, _, i, missed_N = min(each)
        load = f"{muscles_of(observations.masses_g[i])} in {observations.postures[i]}"
        text = f"{load} at the {observations.locations[i]}, never fitted, is missed by {missed_N:.2f} N"
        return Missed(min(1.0, len(each) * p_value), text)

    def _gained(self, weighed: Weighed, wildcard: Wildcard | None, without: Noise) -> float:
        """Log evidence that an explanation gains by the cases never fitted, or something else by what is smooth of it.

        Args:
            weighed: the explanation; for something else the model without any effect.
            wildcard: of what was searched, for something else.
            without: noise of the other cases alone.
        """
        straight = self._straightened(weighed)
        if wildcard is None:
            # For all readings it stands where it stood for those that are fitted.
            return weighed.log_evidence - self._asked(straight).value(without)
        every = other_evidence(straight.fitted, Wildcard.of(anything(self.every), AMPLITUDES_N))
        gained = every.log_evidence - other_evidence(weighed.fitted, wildcard).log_evidence
        # Evidence of whitened readings lacks what their noise adds.
        return gained + self.noise.log_size - without.log_size

    def _asked(self, weighed: Weighed) -> Asked:
        return Asked.of(weighed, self.root, self.noise)

    def _straightened(self, weighed: Weighed) -> Weighed:
        """The same at the same optimum, straightened out for the cases never fitted too."""
        fitted = weighed.fitted
        problem = replace(self.every, free=fitted.problem.free)
        slopes = problem.whitener @ slopes_of(fitted.problem, fitted.theta, problem.rows)
        solution = fitted.solution._replace(residual=residual_at(problem, fitted.theta), jacobian=slopes)
        there = Fitted(fitted.explanation, fitted.theta, fitted.x, fitted.objective, solution, problem)
        return replace(weighed, fitted=there, form=change_and_form(problem, there, self.candidates)[1])
