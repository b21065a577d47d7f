"""Fit an explanation under the very covariance by which it is judged: optimum and hyperparameters in turns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from fingermodel.arrays import Floats
from fingermodel.diagnosis.posterior.hyper import FORMS, Hyperparameters, Node
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.candidates import Candidates, Explanation, free_mask
from fingermodel.diagnosis.session_model.session import Session
from fingermodel.diagnosis.session_model.whitening import Whitening
from fingermodel.fitting.identification import reading_slopes, solve
from fingermodel.fitting.problems import Problem

# Rounds of optimum and hyperparameters, and units of chi-square that a step must promise.
_ROUNDS, _FLOOR = 3, 0.02
# The same at which the columns of scatter are made.
_BEGUN = 2.0
# Evaluations of a round whose hyperparameters may still move, and of one whose stand.
_ROUGH, _EVALUATIONS = 40, 80
# What is far from fitting need not be known to the last digit (see `minimise`).
_CRAWL = 3e-3


@dataclass(frozen=True, eq=False)
class Fitter:
    """Fits explanations of one session."""

    session: Session  # with its readings
    candidates: Candidates  # that explanations are made of
    hyper: Hyperparameters  # axes of the hyperparameters

    def begun(self, explanation: Explanation, node: Node, bad: frozenset[int]) -> tuple[Fitter, Floats]:
        """Fits whose scatter changes a reading as the finger does that is roughly fitted, not the normative one.

        Returns:
            Them, and (parameters,) of that finger, fitted from the priors' centre.
        """
        rough = self.fit_at(explanation, [self.session.problem.centre], node, bad, _BEGUN)
        return replace(self, session=self.session.seen_from(rough.theta)), rough.theta

    def fit(
        self,
        explanation: Explanation,
        start: Floats,
        node: Node,
        bad: frozenset[int] = frozenset(),
        log_prior: float | None = None,
        leader: float = -np.inf,
    ) -> Optimum:
        """Fit from a start, alternating with the hyperparameters until both stand.

        Args:
            explanation: what is free besides the base model.
            start: (parameters,).
            node: hyperparameters to begin with; those of other members' forms are replaced.
            bad: cases whose reading may be anything.
            log_prior: of the explanation; by default the candidates'.
            leader: log posterior of the leader so far (see `Optimum`).
        """
        forms = [m for m in explanation.members if m.candidate.has_form]
        at = node if len(node) == FORMS + len(forms) else (*node[:FORMS], *[self.hyper.form.mode] * len(forms))
        prior = self.candidates.log_prior(explanation) if log_prior is None else log_prior
        found, most = None, _ROUGH
        for left in reversed(range(_ROUNDS)):
            theta, unkept = self._solved(explanation, start, at, bad, found, most if left else _EVALUATIONS)
            found = replace(self.linearised(explanation, theta, at, bad, prior, unkept), leader=leader)
            stands = self.hyper.near(at, found.mode)
            if stands and found.settled:
                break
            start, at, most = found.theta, found.mode, _EVALUATIONS if stands else _ROUGH
        assert found is not None  # noqa: S101 - there is at least one round
        return found

    def of_one(self, fit: Optimum) -> Optimum:
        """The same explanation where what is smooth is of one tendon or of one rotation alone, if that is better."""
        if fit.of_one == fit.mode:
            return fit
        other = self.fit(fit.explanation, fit.theta, fit.of_one, fit.bad, fit.log_prior)
        return max(fit, other, key=lambda f: f.log_posterior)

    def fit_at(
        self,
        explanation: Explanation,
        starts: Sequence[Floats],
        node: Node,
        bad: frozenset[int],
        floor: float = _FLOOR,
    ) -> Optimum:
        """Fit from some starts under the hyperparameters of one node, which stay as they are; the least misfit.

        Done once a step promises less than `floor` units of chi-square.
        """
        found = []
        for start in starts:
            theta, unkept = self._solved(explanation, start, node, bad, None, _EVALUATIONS, floor)
            found.append(self.linearised(explanation, theta, node, bad, 0.0, unkept))
        return min(found, key=lambda f: f.misfit(node))

    def log_evidence_without_smooth(self, fit: Optimum) -> float:
        """Of an explanation with nothing smooth; fitted without it where it was fitted with something smooth."""
        if fit.hyper.smooth_blocks(fit.best):
            node = fit.hyper.without_smooth(fit.best)
            for _ in range(_ROUNDS - 1):
                fit = self.fit_at(fit.explanation, [fit.theta], node, fit.bad)
                node = max(fit.plain_nodes, key=lambda n: fit.plain_nodes[n])
            return float(logsumexp(list(fit.plain_nodes.values())))
        plain = [value for node, value in fit.nodes.items() if not fit.hyper.smooth_blocks(node)]
        return float(logsumexp(plain)) - fit.log_prior

    def _solved(
        self,
        explanation: Explanation,
        start: Floats,
        node: Node,
        bad: frozenset[int],
        before: Optimum | None,
        most: int,
        floor: float = _FLOOR,
    ) -> tuple[Floats, float]:
        """(parameters,) of the optimum under a node's covariance, and the misfit promised beyond it.

        It has so many evaluations at most. Errors of form are those found before.
        """
        weighed = self.problem(explanation, node, bad, before)
        lower, upper = weighed.lower, weighed.upper
        begin = np.where(weighed.free, np.clip(start, lower, upper), weighed.centre)
        solution = solve(weighed, begin, floor, most, crawl=_CRAWL)
        theta = np.where(weighed.free, np.clip(weighed.centre + weighed.scale * solution.x, lower, upper), begin)
        return theta, solution.decrement

    def problem(
        self, explanation: Explanation, node: Node, bad: frozenset[int] = frozenset(), before: Optimum | None = None
    ) -> Problem:
        """What is minimised in fitting an explanation under a node's covariance.

        Args:
            explanation: what is free besides the base model.
            node: of the hyperparameters.
            bad: cases whose reading may be anything.
            before: where its errors of form are found; without, there are none.
        """
        problem, session, widths = self.session.problem, self.session, self.hyper.block_widths(node)
        columns = session.columns if before is None else before.other_columns
        blocks = [width * columns(name)[session.fitted] for name, width in widths.items()]
        noise = session.whitened_smooth(self.hyper.values(node).errors, bad).noise
        whitening = Whitening.of(noise, np.concatenate(blocks, axis=1))
        multiple = np.array([widths.get(p.kind, 1.0) for p in problem.model.parameters.parameters])
        free = problem.free | free_mask(problem.model, explanation)
        return replace(problem, whitener=whitening, sd=multiple * problem.sd, free=free)

    def linearised(
        self,
        explanation: Explanation,
        theta: Floats,
        node: Node,
        bad: frozenset[int],
        log_prior: float,
        unkept: float = 0.0,
    ) -> Optimum:
        """The session's model linearised about a parameter vector (parameters,)."""
        session, problem = self.session, self.session.problem
        model = problem.model
        reading = session.changes.readings(theta)
        changes = []
        for member in explanation.members:
            without = theta.copy()
            without[list(member.parameters)] = model.parameters.initial[list(member.parameters)]
            changes.append(reading - session.changes.readings(without))
        rows = session.rows[session.fitted]
        residual = np.nan_to_num(problem.observations.wrench).reshape(-1)[rows] - reading.reshape(-1)[rows]
        slopes = -reading_slopes(problem, theta)
        return Optimum(
            session, self.hyper, explanation, theta, residual, slopes, tuple(changes), bad, log_prior, node, unkept
        )
