"""Fit explanations to convergence, each from what the straightened model expects, and from each other's optima."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fingermodel.diagnosis.candidates import (
    NOTHING_MISSING,
    Candidate,
    Explanation,
    log_prior,
    mask,
    members,
    pair_of,
    pairs_of,
    single,
)
from fingermodel.diagnosis.linear import Linear, log_mass
from fingermodel.fit_report import held_at_bound
from fingermodel.problems import Problem
from fingermodel.refit import drawn_starts, solve
from fingermodel.solver import CONVERGED, STALLED

Floats = NDArray[np.float64]

# Further starts of the base model, drawn from its priors; its optima are several (see docs/decisions/0007).
BASE_STARTS = 3
# How many pairs are refitted, and from how many of the best singles' optima pairs are screened.
PAIRS = 20
HOSTS = 4
# Most fits only have to show that they are not in question; those that are get finished.
FLOOR = 0.03
FIRST, SECOND, LAST = 3, 15, 60
# Log evidence within which singles are taken further, and explanations are finished.
RACE, CONTENDERS = 30.0, 8.0
FINISHED = 12
SWAPS = 4
# An alternative is refitted if its screened evidence is within this much of the best one's.
NEAR = 4.0


@dataclass(frozen=True, eq=False)
class Fitted:
    """An explanation at its optimum.

    Attributes:
        explanation: what is freed.
        theta: (parameters,).
        x: (parameters,) the same in prior widths about the centre.
        objective: χ² plus penalty.
        jacobian: (n, parameters) of the whitened residuals, all columns.
        residual: (n,) whitened.
        converged: whether the solver did.
        problem: that was solved.
    """

    explanation: Explanation
    theta: Floats
    x: Floats
    objective: float
    jacobian: Floats
    residual: Floats
    converged: bool
    problem: Problem = field(repr=False)

    @cached_property
    def _inside(self) -> NDArray[np.bool_]:
        return self.problem.free & ~held_at_bound(self.problem, self.theta)

    @cached_property
    def inner(self) -> NDArray[np.intp]:
        """Free parameters that are not held at any bound."""
        return np.flatnonzero(self._inside)

    @cached_property
    def moving(self) -> NDArray[np.intp]:
        """The same, and the explanation's own one-sided parameters even at their null."""
        at_null = self.theta <= self.problem.lower + 1e-6 * self.problem.scale
        own = mask(self.problem.model, self.explanation)
        return np.flatnonzero(self._inside | (own & _one_sided(self.problem) & at_null))

    @cached_property
    def log_evidence(self) -> float:
        """Laplace evidence; one-sided priors count with their ln 2 and the posterior mass on their side.

        A fit that has not converged counts as it stands.
        """
        return self._laplace(trust_step=self.converged)

    @cached_property
    def promise(self) -> float:
        """The evidence that a further step of the straightened model promises."""
        return self._laplace(trust_step=True)

    @cached_property
    def gaussian_log_evidence(self) -> float:
        """Log of N(y; 0, 1 + HHᵀ) of the straightened model without its constant, over what no bound holds."""
        return self._straight(self.inner, self.inner).log_evidence_base

    def _laplace(self, *, trust_step: bool) -> float:
        free, h = self.moving, -self.jacobian[:, self.moving]
        hessian = np.eye(len(free)) + h.T @ h
        factor = np.linalg.cholesky(hessian)
        gradient = self.x[free] - h.T @ self.residual
        step = np.linalg.solve(factor, gradient)
        objective = self.objective - (float(step @ step) if trust_step else 0.0)
        value = -0.5 * objective - float(np.log(np.diag(factor)).sum())
        one_sided = _one_sided(self.problem)
        own = np.array([i for i in self.explanation.parameters if i in set(free)], dtype=int)
        if not one_sided[own].any():
            return value
        mean = self.x[free] - np.linalg.solve(factor.T, step)
        at = np.searchsorted(free, own)
        covariance = np.linalg.inv(hessian)[np.ix_(at, at)]
        return value + log_mass(mean[at], np.linalg.inv(covariance), one_sided[own])

    @cached_property
    def linear(self) -> Linear:
        """The model straightened out about this optimum."""
        return self._straight(self.moving, np.setdiff1d(self.moving, self.explanation.parameters))

    def _straight(self, free: NDArray[np.intp], base: NDArray[np.intp]) -> Linear:
        y = self.residual - self.jacobian[:, free] @ self.x[free]
        return Linear(y, -self.jacobian, base, _one_sided(self.problem))

    @cached_property
    def covariance(self) -> Floats:
        """(moving, moving) of the parameters in prior widths."""
        h = self.jacobian[:, self.moving]
        return np.asarray(np.linalg.inv(np.eye(h.shape[1]) + h.T @ h), dtype=np.float64)

    def draws(self, count: int, rng: np.random.Generator, width: float = 1.0) -> Floats:
        """Draw parameter vectors (count, parameters) from the posterior, `width` times as wide, within the bounds."""
        free, problem = self.moving, self.problem
        root = np.linalg.cholesky(self.covariance + 1e-12 * np.eye(len(free)))
        x = np.tile(self.x, (count, 1))
        x[:, free] += width * rng.normal(size=(count, len(free))) @ root.T
        out: Floats = np.clip(problem.centre + problem.scale * x, problem.lower, problem.upper)
        return out

    def strength(self, parameters: Sequence[int]) -> float:
        """How many standard deviations some parameters together lie from their null."""
        at = np.flatnonzero(np.isin(self.moving, list(parameters)))
        if len(at) == 0:
            return 0.0
        x = self.x[self.moving[at]]
        return float(np.sqrt(x @ np.linalg.solve(self.covariance[np.ix_(at, at)], x)))

    def sd(self, index: int) -> float | None:
        """Standard deviation of a parameter in its unit; None where it is held."""
        at = np.flatnonzero(self.moving == index)
        return float(np.sqrt(self.covariance[at[0], at[0]]) * self.problem.scale[index]) if len(at) else None


def _one_sided(problem: Problem) -> NDArray[np.bool_]:
    return np.array([p.one_sided for p in problem.model.parameters])


@dataclass(frozen=True)
class Search:
    """Everything that was fitted.

    Attributes:
        nothing: the base model.
        fitted: every explanation's optimum, `nothing` among them.
        searched: how many explanations were screened.
    """

    nothing: Fitted
    fitted: tuple[Fitted, ...]
    searched: int


class Searcher:
    """Fits and remembers the best optimum of each explanation."""

    def __init__(self, problem: Problem, progress: Callable[[float], None] | None = None) -> None:
        self.problem = problem
        self.best: dict[Explanation, Fitted] = {}
        self._finished: dict[Explanation, Fitted] = {}
        self._tried: set[Fitted] = set()
        self._progress = progress or (lambda _: None)

    def fit(self, explanation: Explanation, starts: Iterable[Floats], evaluations: int = FIRST) -> Fitted:
        """Solve from each start (parameters,) and keep the best optimum ever found of this explanation."""
        problem = replace(self.problem, free=self.problem.free | mask(self.problem.model, explanation))
        for start in starts:
            guess = np.where(problem.free, np.clip(start, problem.lower, problem.upper), problem.centre)
            solution = solve(problem, guess, FLOOR if evaluations < LAST else FLOOR / 10.0, evaluations)
            x = np.asarray(solution.x)
            found = Fitted(
                explanation,
                problem.centre + problem.scale * x,
                x,
                float(solution.objective),
                np.asarray(solution.jacobian),
                np.asarray(solution.residual),
                int(solution.status) in (CONVERGED, STALLED),
                problem,
            )
            old = self.best.get(explanation)
            if np.isfinite(found.objective) and (old is None or found.objective < old.objective - 1e-6):
                self.best[explanation] = found
        return self.best[explanation]

    def run(self, candidates: tuple[Candidate, ...], start: Floats | None = None, thorough: bool = False) -> Search:
        """Fit nothing, all singles and the best pairs; each from the others' optima too.

        Args:
            candidates: to search.
            start: of the base model besides the priors' centre, such as an earlier fit.
            thorough: more pairs and more starts.
        """
        problem = self.problem
        more = 3 if thorough else 1
        starts = [problem.centre] if start is None else [start, problem.centre]
        nothing = self.fit(NOTHING_MISSING, [*starts, *drawn_starts(problem, BASE_STARTS * more)], SECOND)
        nothing = self.fit(NOTHING_MISSING, [nothing.theta], LAST)
        for done, candidate in enumerate(candidates):
            self._single(candidate, nothing)
            self._progress(0.5 * (done + 1) / len(candidates))
        self._race(HOSTS * more)
        self._nested(HOSTS * more)
        self._exchange(HOSTS * more)
        self._pairs(candidates, PAIRS * more)
        self._race(HOSTS * more, size=2)
        self._swap(candidates)
        self._halves(candidates)
        self._polish(candidates)
        self._nested(2)
        self._polish(candidates)
        self._progress(1.0)
        searched = 1 + len(candidates) + len(pairs_of(candidates))
        return Search(self.best[NOTHING_MISSING], tuple(self.best.values()), searched)

    def _single(self, candidate: Candidate, host: Fitted) -> None:
        gains = [host.linear.gain(parameters) for parameters in candidate.alternatives]
        for k, gain in enumerate(gains):
            if gain >= max(gains) - NEAR:
                explanation = single(candidate, k)
                self.fit(explanation, [self.expected(host, explanation)])

    def expected(self, host: Fitted, explanation: Explanation) -> Floats:
        """Where the straightened model about an optimum expects another explanation's optimum."""
        free, mean = host.linear.mean(explanation.parameters)
        expected = host.x.copy()
        expected[free] = mean
        # A straight line is not to be trusted further than the priors reach.
        x: Floats = np.clip(expected, -4.0, 4.0)
        out: Floats = self.problem.centre + self.problem.scale * x
        return out

    def _race(self, count: int, size: int = 1) -> None:
        """Take those of a size further that may still win."""
        singles = [f for f in self.best.values() if f.explanation.size == size]
        if not singles:
            return
        ranked = sorted(singles, key=lambda f: -f.promise)
        best = max(f.log_evidence for f in singles)
        for one in ranked:
            if not one.converged and (one in ranked[:count] or (size == 1 and one.promise > best - RACE)):
                self.fit(one.explanation, [one.theta], SECOND)

    def _swap(self, candidates: tuple[Candidate, ...]) -> None:
        """Keep one member of each of the best pairs and look for a better companion from where that pair stands."""
        for pair in self._ranked(2)[:2]:
            offers = []
            for kept in members(pair.explanation, candidates):
                for candidate in candidates:
                    if candidate.name not in pair.explanation.names:
                        other, gain = _best_form(pair, kept, candidate)
                        offers.append((gain, pair_of(kept, other, candidates)))
            for _, explanation in sorted(offers, key=lambda o: -o[0])[:SWAPS]:
                if explanation not in self.best:
                    self.fit(explanation, [self.expected(pair, explanation)], 2 * FIRST)

    def _halves(self, candidates: tuple[Candidate, ...]) -> None:
        """Fit each member of the best pairs alone from where the pair stands: what it can do without is no member."""
        for pair in self._ranked(2)[:3]:
            for alone in members(pair.explanation, candidates):
                known = self.best.get(alone)
                if known is None or known.objective > pair.objective + 20.0:
                    self.fit(alone, [pair.theta], SECOND)

    def _polish(self, candidates: tuple[Candidate, ...]) -> None:
        """Finish the fits that are still in question, and the base model's."""
        value = {e: f.log_evidence + log_prior(e, candidates) for e, f in self.best.items()}
        limit = max(value.values()) - CONTENDERS
        hopeful = [e for e, f in self.best.items() if f.promise + log_prior(e, candidates) > limit or e.size == 0]
        for explanation in sorted(hopeful, key=lambda e: -value[e])[:FINISHED]:
            found = self.best[explanation]
            if self._finished.get(explanation) is not found:
                found = self.fit(explanation, [found.theta], LAST)
                if not found.converged and value[explanation] > limit + 0.5 * CONTENDERS:
                    found = self.fit(explanation, [found.theta], 4 * LAST)
                self._finished[explanation] = found

    def _ranked(self, size: int) -> list[Fitted]:
        """Best optimum of each different set of names of a size, best first."""
        of_size = [f for f in self.best.values() if f.explanation.size == size]
        ranked = sorted(of_size, key=lambda f: -f.log_evidence)
        return list({f.explanation.names: f for f in reversed(ranked)}.values())[::-1]

    def _nested(self, count: int) -> None:
        """Try to fit without what the best explanations have: an effect that a base optimum can do without is none."""
        for rival in [*self._ranked(1)[:count], *self._ranked(2)[:2]]:
            if rival not in self._tried:
                self._tried.add(rival)
                self.fit(NOTHING_MISSING, [rival.theta])
        nothing = self.best[NOTHING_MISSING]
        for rival in self._ranked(1):
            # Freeing a parameter cannot make the optimum worse: such a fit sits in another valley.
            if rival.objective > nothing.objective + 1e-3:
                self.fit(rival.explanation, [nothing.theta])

    def _exchange(self, count: int) -> None:
        """Fit the best singles from each other's base parameters."""
        best = self._ranked(1)[:count]
        for one in best:
            for other in best[:2]:
                if other is not one:
                    self.fit(one.explanation, [self.expected(other, one.explanation)])

    def _pairs(self, candidates: tuple[Candidate, ...], count: int) -> None:
        """Screen all pairs from nothing's optimum and from the best singles', and fit the best."""
        hosts = self._ranked(1)[:HOSTS]
        offers: dict[tuple[str, ...], tuple[float, Fitted, Explanation]] = {}
        nothing = self.best[NOTHING_MISSING]

        def offer(host: Fitted, first: Explanation, second: Explanation) -> None:
            pair = pair_of(first, second, candidates)
            if set(first.parameters) & set(second.parameters):
                return
            base = nothing.log_evidence if host is nothing else host.log_evidence - host.linear.gain(first.parameters)
            value = base + host.linear.gain(pair.parameters) + log_prior(pair, candidates)
            old = offers.get(pair.names)
            if old is None or value > old[0]:
                offers[pair.names] = (value, host, pair)

        best_form = {c.name: _best_form(nothing, NOTHING_MISSING, c)[0] for c in candidates}
        for a, b in pairs_of(candidates):
            offer(nothing, best_form[a.name], best_form[b.name])
        for host in hosts:
            for candidate in candidates:
                if candidate.name not in host.explanation.names:
                    offer(host, host.explanation, _best_form(host, host.explanation, candidate)[0])
        chosen = sorted(offers.values(), key=lambda o: -o[0])[:count]
        for done, (_, host, pair) in enumerate(chosen):
            self.fit(pair, [self.expected(host, pair)])
            self._progress(0.5 + 0.5 * done / len(chosen))


def _best_form(host: Fitted, kept: Explanation, candidate: Candidate) -> tuple[Explanation, float]:
    """The alternative of a candidate that gains most beside what is kept, and that gain, about a host's optimum."""
    gains = [host.linear.gain((*kept.parameters, *p)) for p in candidate.alternatives]
    return single(candidate, int(np.argmax(gains))), max(gains)
