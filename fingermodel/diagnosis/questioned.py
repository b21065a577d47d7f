"""The best explanations of a session, asked again under other assumptions.

They are asked on their straightened models; what those would turn is refitted before it is believed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dtrtri
from scipy.special import logsumexp

from fingermodel.diagnosis.candidates import Candidate, Names, log_prior_else
from fingermodel.diagnosis.evidence import (
    BUDGET_FACTORS,
    Evidence,
    Weighed,
    budget_log_weight,
    evidence_as_stated,
    other_at_budget,
    weigh_one,
)
from fingermodel.diagnosis.fitter import Fitter
from fingermodel.diagnosis.linear import log_mass
from fingermodel.diagnosis.verdict import Verdict
from fingermodel.diagnosis.wildcard import Wildcard
from fingermodel.problems import Problem
from fingermodel.tiles import Tiles

Floats = NDArray[np.float64]
# Log posteriors of several explanations.
Values = dict[Names, float]

# Explanations that are asked again.
ASKED = 4
# Odds, by logarithm, from which another verdict contradicts: nine times; less than that is doubt.
CLEAR_ODDS = 2.2
# Evaluations of a refit under another assumption.
REFIT = 40


@dataclass(frozen=True, eq=False)
class Questioned:
    """A verdict and the best explanations, which are asked again.

    Attributes:
        problem: that was searched.
        evidence: of its explanations.
        verdict: that is questioned.
        wildcard: of the problem.
        candidates: that were searched.
        covariance: (n, n) of the readings.
        noise: of all of them.
        asked: the best explanations, and the model without any effect.
    """

    problem: Problem
    evidence: Evidence
    verdict: Verdict
    wildcard: Wildcard
    candidates: tuple[Candidate, ...]
    covariance: Floats
    noise: Noise
    asked: tuple[Asked, ...]

    @classmethod
    def of(
        cls,
        problem: Problem,
        evidence: Evidence,
        verdict: Verdict,
        wildcard: Wildcard,
        candidates: tuple[Candidate, ...],
    ) -> Questioned:
        """Straighten the best out."""
        named = [w for w in evidence.weighed if w.explanation.size][:ASKED]
        root = np.asarray(np.linalg.inv(problem.whitener), dtype=np.float64)
        covariance = root @ root.T
        noise = Noise.of(covariance)
        asked = tuple(Asked.of(w, root, noise) for w in (*named, evidence.nothing))
        return cls(problem, evidence, verdict, wildcard, candidates, covariance, noise, asked)

    def says(self, winner: Names) -> bool:
        """Whether that is what the verdict says."""
        if self.verdict.kind == "nothing_missing":
            return winner == ()
        if winner is None:
            return False
        if self.verdict.kind == "one_of":
            return bool(set(self.verdict.names) & set(winner))
        return set(self.verdict.names) <= set(winner)

    def favours(self, values: Values) -> Names:
        """What is favoured by log posteriors."""
        winner = max(values, key=lambda k: values[k])
        kept = [k for k in values if self.says(k) and values[k] > values[winner] - CLEAR_ODDS]
        return max(kept, key=lambda k: values[k]) if kept else winner

    def favoured(self, values: Values, refit: Callable[[Sequence[Weighed]], Values]) -> Names:
        """The same; what would turn the verdict, and what it says, are refitted before that is believed."""
        values, refitted = dict(values), set[Names]()
        while not self.says(winner := self.favours(values)):
            own = max((names for names in values if self.says(names)), key=lambda n: values[n], default=winner)
            # Something else is measured by what the model without any effect leaves.
            again = {own, winner or ()} - refitted
            if not again:
                break
            values.update(refit([one.weighed for one in self.asked if one.weighed.explanation.names in again]))
            refitted |= again
        return winner

    def favoured_without(self, gone: NDArray[np.bool_], *, thorough: bool) -> Names:
        """What is favoured without some readings (n,)."""
        part = _part(self.problem, self.covariance, gone)
        if thorough:
            return self.favours(_refitted(part, [one.weighed for one in self.asked], self.candidates))
        kept = Noise.of(self.covariance, gone)
        # Of whitened readings: what the noise of those left out would have added lacks in all refits alike.
        lacks = kept.log_size - self.noise.log_size

        def refit(again: Sequence[Weighed]) -> Values:
            return {names: value + lacks for names, value in _refitted(part, again, self.candidates).items()}

        return self.favoured(self.values(kept), refit)

    def favoured_at(self, multiple: float) -> Names:
        """What is favoured with the budget so many times as large."""
        return self.favoured(
            self.values_at(multiple),
            lambda again: _refitted_at(self.problem, again, self.wildcard, self.candidates, multiple),
        )

    def without(self, gone: NDArray[np.bool_]) -> Values:
        """Log posteriors without some readings (n,), on the straightened models."""
        return self.values(Noise.of(self.covariance, gone))

    def values(self, noise: Noise | None = None, budget: float | None = None, effect: float = 1.0) -> Values:
        """Log posteriors under another assumption; explanations of the same names add up."""
        return _by_names((one.weighed, one.value(noise, budget, effect)) for one in self.asked)

    def values_at(self, multiple: float) -> Values:
        """Log posteriors with the budget so many times as large, on the straightened models."""
        other = other_at_budget(self.evidence.nothing.fitted, self.wildcard, multiple)[0]
        return {None: other + log_prior_else(), **self.values(budget=multiple)}


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of the readings that are kept.

    Attributes:
        kept: (n,) bool.
        covariance: (kept, kept) of them.
        whitener: (kept, kept) of them.
        log_size: what it adds to a log evidence.
    """

    kept: NDArray[np.bool_]
    covariance: Floats
    whitener: Tiles
    log_size: float

    @classmethod
    def of(cls, covariance: Floats, gone: NDArray[np.bool_] | None = None) -> Noise:
        """Of some readings' covariance (n, n) less those that are gone."""
        kept = np.ones(len(covariance), dtype=bool) if gone is None else ~gone
        own = covariance[np.ix_(kept, kept)]
        factor = np.linalg.cholesky(own)
        return cls(kept, own, Tiles.of(dtrtri(factor, lower=1)[0]), -float(np.log(np.diag(factor)).sum()))


@dataclass(frozen=True, eq=False)
class Asked:
    """An explanation straightened out about its optimum, the error of its form allowed for.

    Attributes:
        weighed: the explanation.
        columns: (n, 1 + parameters) in the readings' units, side by side: what the optimum leaves of the readings;
            slopes of its own parameters, then of the base, in prior widths.
        x: (parameters,) the optimum, in prior widths.
        error: (n, n) covariance that the error of its form makes; None if there is none.
        own: how many parameters are its own.
        one_sided: (own,).
        whole: what `_read` makes of all readings.
        rest: what the straightened model leaves out of the log evidence.
    """

    weighed: Weighed
    columns: Floats
    x: Floats
    error: Floats | None
    own: int
    one_sided: NDArray[np.bool_]
    whole: tuple[Floats, float]
    rest: float

    @classmethod
    def of(cls, weighed: Weighed, root: Floats, noise: Noise) -> Asked:
        """Straighten out; `root` (n, n) takes whitened readings back to their units."""
        fitted, linear = weighed.fitted, weighed.fitted.linear
        own = [i for i in weighed.explanation.parameters if i in set(fitted.moving)]
        base = np.setdiff1d(fitted.inner, own)
        columns = root @ np.concatenate([linear.residual[:, None], linear.h[:, own], linear.h[:, base]], axis=1)
        error = None
        if weighed.explanation.size and weighed.form_error:
            of_form = root @ (weighed.form.root * weighed.form_error)
            error = of_form @ of_form.T
        whole = cls._read(columns, error, noise)
        x = linear.x[[*own, *base]]
        straight = cls(weighed, columns, x, error, len(own), linear.one_sided[own], whole, 0.0)
        return replace(straight, rest=weighed.log_evidence - straight.value())

    @staticmethod
    def _read(columns: Floats, error: Floats | None, noise: Noise) -> tuple[Floats, float]:
        """[r, A]ᵀ [r, A] of what is read with some noise, whitened; and what the noise adds to a log evidence."""
        kept = columns[noise.kept]
        if error is None:
            white, log_size = noise.whitener @ kept, noise.log_size
        else:
            factor = np.linalg.cholesky(noise.covariance + error[np.ix_(noise.kept, noise.kept)])
            white, log_size = solve_triangular(factor, kept, lower=True), -float(np.log(np.diag(factor)).sum())
        return white.T @ white, log_size

    def value(self, noise: Noise | None = None, budget: float | None = None, effect: float = 1.0) -> float:
        """Log evidence from what is read with some noise, with another budget, or an effect expected larger or smaller.

        Unless they are given, it is from all readings, and the budget's size is left open.
        """
        gram, log_size = self.whole if noise is None else self._read(self.columns, self.error, noise)
        if budget is None:
            each = [self._at(gram, float(b), effect) for b in BUDGET_FACTORS]
            return float(logsumexp(np.array(each) + budget_log_weight())) + log_size + self.rest
        return self._at(gram, budget, effect) + log_size + self.rest

    def expected(self, noise: Noise, given: NDArray[np.bool_], budget: float) -> tuple[Floats, Floats]:
        """How far the other readings are from what those given (n,) make it expect, and their covariance, in units."""
        slopes = self.columns[:, 1:]
        wide = slopes * np.where(np.arange(len(self.x)) < self.own, 1.0, budget)
        covariance = noise.covariance + wide @ wide.T + (0.0 if self.error is None else self.error)
        # From the priors' centre.
        away = self.columns[:, 0] + slopes @ self.x
        across = np.linalg.solve(covariance[np.ix_(given, given)], covariance[np.ix_(given, ~given)]).T
        return (
            away[~given] - across @ away[given],
            covariance[np.ix_(~given, ~given)] - across @ covariance[np.ix_(given, ~given)],
        )

    def _at(self, gram: Floats, budget: float, effect: float) -> float:
        """Ln N(r + A x; 0, 1 + A Aᵀ) without its constant, from [r, A]ᵀ [r, A] before the priors are widened."""
        width = np.full(len(gram) - 1, budget)
        width[: self.own] = effect
        x = self.x / width
        right = gram[1:, 0] * width - x
        factor = np.linalg.cholesky(np.eye(len(width)) + gram[1:, 1:] * np.outer(width, width))
        explained = solve_triangular(factor, np.column_stack([right, np.eye(len(width), self.own)]), lower=True)
        misfit = gram[0, 0] + x @ x - explained[:, 0] @ explained[:, 0]
        value = float(-0.5 * misfit - np.log(np.diag(factor)).sum())
        if not self.one_sided.any():
            return value
        spread = explained[:, 1:].T @ explained[:, 1:]
        mean = x[: self.own] + explained[:, 1:].T @ explained[:, 0]
        return value + log_mass(mean, spread, self.one_sided)


def _by_names(evidences: Iterable[tuple[Weighed, float]]) -> Values:
    out: Values = {}
    for weighed, log_evidence in evidences:
        names, value = weighed.explanation.names, log_evidence + weighed.log_prior
        out[names] = float(np.logaddexp(out[names], value)) if names in out else value
    return out


def _part(problem: Problem, covariance: Floats, gone: NDArray[np.bool_]) -> Problem:
    """A problem without some readings: they weigh nothing, so that no new program is compiled."""
    kept = np.ix_(~gone, ~gone)
    whitener = np.zeros_like(problem.whitener)
    whitener[kept] = np.linalg.inv(np.linalg.cholesky(covariance[kept]))
    return replace(problem, whitener=whitener)


def _refitted(part: Problem, again: Iterable[Weighed], candidates: tuple[Candidate, ...]) -> Values:
    """Log posteriors without some readings, each explanation refitted from where it stood."""
    fitter = Fitter(part)
    fits = ((w, fitter.fit(w.explanation, [w.fitted.theta], REFIT, finely=True)) for w in again)
    values = ((w, weigh_one(part, fitted, candidates).log_evidence if fitted.sane else -np.inf) for w, fitted in fits)
    return _by_names(values)


def _refitted_at(
    problem: Problem, again: Iterable[Weighed], wildcard: Wildcard, candidates: tuple[Candidate, ...], multiple: float
) -> Values:
    """Log posteriors with the budget so many times as large, each explanation refitted from where it stood."""
    wide = replace(problem, sd=np.where(problem.free, multiple * problem.sd, problem.sd))
    fitter = Fitter(wide)
    out: Values = {}
    evidences: list[tuple[Weighed, float]] = []
    for w in again:
        fitted = fitter.fit(w.explanation, [w.fitted.theta], REFIT, finely=True)
        evidences.append((w, evidence_as_stated(wide, fitted, candidates) if fitted.sane else -np.inf))
        if fitted.sane and not w.explanation.size:
            out[None] = other_at_budget(fitted, wildcard, 1.0)[0] + log_prior_else()
    return {**out, **_by_names(evidences)}
