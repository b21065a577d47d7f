"""What a verdict hangs on: it is asked again under other priors, another budget, and without parts of the data."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dtrtri
from scipy.special import logsumexp

from fingermodel.compare import muscles_of
from fingermodel.diagnosis.candidates import Candidate, log_prior_else
from fingermodel.diagnosis.evidence import (
    BUDGET_FACTORS,
    Evidence,
    Weighed,
    budget_log_weight,
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

# Explanations that are asked again, and multiples of the budget.
ASKED = 4
CLEAR_ODDS = 2.2
# Evaluations of a refit without a part of the data.
REFIT = 40
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
    refitted: tuple[Candidate, ...] = (),
) -> Robustness:
    """Ask the best explanations again.

    Args:
        problem: that was searched.
        evidence: of its explanations.
        verdict: that is questioned.
        wildcard: of the problem.
        refitted: all candidates, where every part of the data that is left out shall be by a refit, not on the
            straightened models.
    """
    named = [w for w in evidence.weighed if w.explanation.size][:ASKED]
    root = np.asarray(np.linalg.inv(problem.whitener), dtype=np.float64)
    covariance = root @ root.T
    noise = _Noise.of(covariance)
    asked = [_Asked.of(w, root, noise) for w in (*named, evidence.nothing)]
    names = set(verdict.names)
    flips: list[str] = []

    def favours(values: dict[tuple[str, ...] | None, float]) -> tuple[str, ...] | None:
        winner = max(values, key=lambda k: values[k])
        # Another verdict would need nine times the odds; less than that is doubt, not a contradiction.
        kept = [k for k in values if same(k) and values[k] > values[winner] - CLEAR_ODDS]
        return max(kept, key=lambda k: values[k]) if kept else winner

    def without(gone: NDArray[np.bool_]) -> dict[tuple[str, ...] | None, float]:
        return _values(asked, _Noise.of(covariance, gone))

    def same(winner: tuple[str, ...] | None) -> bool:
        if verdict.kind == "nothing_missing":
            return winner == ()
        if winner is None:
            return False
        if verdict.kind == "one_of":
            return bool(names & set(winner))
        return names <= set(winner)

    if verdict.kind == "none_of_catalogue":
        return Robustness((), (), None, _spoken(favours(without(problem.rows % 6 == 2))))
    for nothing in (0.25, 0.75):
        values = {
            names_: np.log(max(p, 1e-300)) + _reweight(names_, nothing) for names_, p in evidence.probability.items()
        }
        if not same(favours(values)):
            flips.append(f"the prior on nothing missing is {nothing:g}")
    for factor, words in ((0.5, "half"), (2.0, "twice")):
        values = _values(asked, effect=factor)
        values[None] = evidence.other.log_evidence + log_prior_else()
        if not same(favours(values)):
            flips.append(f"effects are expected {words} as large")
    if verdict.kind != "nothing_missing" and not same(favours(_values_at(evidence, asked, wildcard, 2.0))):
        flips.append("the budget is twice as large")
    rests = []
    for words, rows, whole_mount in left_out(problem):
        winner = favours(_refitted(problem, covariance, asked, rows, refitted) if refitted else without(rows))
        if same(winner):
            continue
        # Fewer names, or none, is ground lost; other names are a contradiction. Not so without a whole mount: it may be
        # all that tells what the tendons pull with from what the finger makes of it.
        if winner is None or set(winner) < names or not winner or whole_mount:
            rests.append(words)
        else:
            flips.append(f"{words} is left out: then {' and '.join(winner)}")
    fails = None
    if verdict.kind in ("found", "one_of"):
        fails = next((m for m in MULTIPLES if not same(favours(_values_at(evidence, asked, wildcard, m)))), None)
    planar = favours(without(problem.rows % 6 == 2))
    moments = problem.rows % 6 >= 3
    forces = favours(without(moments)) if moments.any() else None
    on_moments = bool(moments.any()) and verdict.kind in ("found", "one_of") and not same(forces)
    return Robustness(tuple(flips), tuple(rests), fails, _spoken(planar), on_moments)


def _reweight(names: tuple[str, ...] | None, nothing: float) -> float:
    return float(np.log(nothing / 0.5)) if names == () else float(np.log((1.0 - nothing) / 0.5))


@dataclass(frozen=True, eq=False)
class _Noise:
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
    def of(cls, covariance: Floats, gone: NDArray[np.bool_] | None = None) -> _Noise:
        """Of some readings' covariance (n, n) less those that are gone."""
        kept = np.ones(len(covariance), dtype=bool) if gone is None else ~gone
        own = covariance[np.ix_(kept, kept)]
        factor = np.linalg.cholesky(own)
        return cls(kept, own, Tiles.of(dtrtri(factor, lower=1)[0]), -float(np.log(np.diag(factor)).sum()))


@dataclass(frozen=True, eq=False)
class _Asked:
    """An explanation straightened out about its optimum, the error of its form allowed for.

    Attributes:
        weighed: the explanation.
        columns: (n, 1 + parameters) in the readings' units, side by side: the readings, the constant part of the model
            taken off; slopes of its own parameters, then of the base, in prior widths.
        error: (n, n) covariance that the error of its form makes; None if there is none.
        own: how many parameters are its own.
        one_sided: (own,).
        whole: what `_read` makes of all readings.
        rest: what the straightened model leaves out of the log evidence.
    """

    weighed: Weighed
    columns: Floats
    error: Floats | None
    own: int
    one_sided: NDArray[np.bool_]
    whole: tuple[Floats, float]
    rest: float

    @classmethod
    def of(cls, weighed: Weighed, root: Floats, noise: _Noise) -> _Asked:
        """Straighten out; `root` (n, n) takes whitened readings back to their units."""
        fitted, linear = weighed.fitted, weighed.fitted.linear
        own = [i for i in weighed.explanation.parameters if i in set(fitted.moving)]
        base = np.setdiff1d(fitted.inner, own)
        columns = root @ np.concatenate([linear.y[:, None], linear.h[:, own], linear.h[:, base]], axis=1)
        error = None
        if weighed.explanation.size and weighed.form_error:
            of_form = root @ (weighed.form.root * weighed.form_error)
            error = of_form @ of_form.T
        whole = cls._read(columns, error, noise)
        straight = cls(weighed, columns, error, len(own), linear.one_sided[own], whole, 0.0)
        return replace(straight, rest=weighed.log_evidence - straight.value())

    @staticmethod
    def _read(columns: Floats, error: Floats | None, noise: _Noise) -> tuple[Floats, float]:
        """[y, A]ᵀ [y, A] of what is read with some noise, whitened; and what the noise adds to a log evidence."""
        kept = columns[noise.kept]
        if error is None:
            white, log_size = noise.whitener @ kept, noise.log_size
        else:
            factor = np.linalg.cholesky(noise.covariance + error[np.ix_(noise.kept, noise.kept)])
            white, log_size = solve_triangular(factor, kept, lower=True), -float(np.log(np.diag(factor)).sum())
        return white.T @ white, log_size

    def value(self, noise: _Noise | None = None, budget: float | None = None, effect: float = 1.0) -> float:
        """Log evidence from what is read with some noise, with another budget, or an effect expected larger or smaller.

        Unless they are given, it is from all readings, and the budget's size is left open.
        """
        gram, log_size = self.whole if noise is None else self._read(self.columns, self.error, noise)
        if budget is None:
            each = [self._at(gram, float(b), effect) for b in BUDGET_FACTORS]
            return float(logsumexp(np.array(each) + budget_log_weight())) + log_size + self.rest
        return self._at(gram, budget, effect) + log_size + self.rest

    def _at(self, gram: Floats, budget: float, effect: float) -> float:
        """Ln N(y; 0, 1 + A Aᵀ) without its constant, from [y, A]ᵀ [y, A] before the priors are widened."""
        width = np.full(len(gram) - 1, budget)
        width[: self.own] = effect
        right = gram[1:, 0] * width
        factor = np.linalg.cholesky(np.eye(len(width)) + gram[1:, 1:] * np.outer(width, width))
        explained = solve_triangular(factor, np.column_stack([right, np.eye(len(width), self.own)]), lower=True)
        value = float(-0.5 * (gram[0, 0] - explained[:, 0] @ explained[:, 0]) - np.log(np.diag(factor)).sum())
        if not self.one_sided.any():
            return value
        spread = explained[:, 1:].T @ explained[:, 1:]
        return value + log_mass(explained[:, 1:].T @ explained[:, 0], np.linalg.inv(spread), self.one_sided)


def _values(
    asked: Iterable[_Asked], noise: _Noise | None = None, budget: float | None = None, effect: float = 1.0
) -> dict[tuple[str, ...] | None, float]:
    """Log posteriors under another assumption; explanations of the same names add up."""
    return _by_names((one.weighed, one.value(noise, budget, effect)) for one in asked)


def _by_names(evidences: Iterable[tuple[Weighed, float]]) -> dict[tuple[str, ...] | None, float]:
    out: dict[tuple[str, ...] | None, float] = {}
    for weighed, log_evidence in evidences:
        names, value = weighed.explanation.names, log_evidence + weighed.log_prior
        out[names] = float(np.logaddexp(out[names], value)) if names in out else value
    return out


def _refitted(
    problem: Problem,
    covariance: Floats,
    asked: Iterable[_Asked],
    gone: NDArray[np.bool_],
    candidates: tuple[Candidate, ...],
) -> dict[tuple[str, ...] | None, float]:
    """Log posteriors without some readings, every explanation refitted from where it stood."""
    kept = np.ix_(~gone, ~gone)
    # Readings that are left out weigh nothing, so that no new program is compiled.
    whitener = np.zeros_like(problem.whitener)
    whitener[kept] = np.linalg.inv(np.linalg.cholesky(covariance[kept]))
    part = replace(problem, whitener=whitener)
    fitter = Fitter(part)
    fits = ((w, fitter.fit(w.explanation, [w.fitted.theta], REFIT)) for w in (one.weighed for one in asked))
    values = ((w, weigh_one(part, fitted, candidates).log_evidence if fitted.sane else -np.inf) for w, fitted in fits)
    return _by_names(values)


def _values_at(
    evidence: Evidence, asked: Iterable[_Asked], wildcard: Wildcard, multiple: float
) -> dict[tuple[str, ...] | None, float]:
    """Log posteriors with the budget so many times as large."""
    other = other_at_budget(evidence.nothing.fitted, wildcard, multiple)[0]
    return {None: other + log_prior_else(), **_values(asked, budget=multiple)}


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


def _spoken(winner: tuple[str, ...] | None) -> str:
    if winner is None:
        return "none_of_catalogue"
    return " and ".join(winner) if winner else "nothing_missing"
