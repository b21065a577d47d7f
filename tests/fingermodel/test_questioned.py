"""Explanations asked again: exact on a straight model, and refitted where that would turn a verdict."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from fingermodel.diagnosis.candidates import Names
from fingermodel.diagnosis.evidence import Weighed
from fingermodel.diagnosis.linear import Linear
from fingermodel.diagnosis.questioned import Asked, Noise, Questioned, Values
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import multivariate_normal

from fingermodel.diagnosis.verdict import Verdict
from tests.settings import load_profile

load_profile()
Floats = NDArray[np.float64]


@given(st.integers(0, 10_000), st.sampled_from([1.0, 2.0]), st.sampled_from([0.5, 1.0, 2.0]))
def test_what_is_asked_again_is_the_density_of_what_is_kept(seed: int, budget: float, effect: float) -> None:
    """Of a straight model with four parameters of the base and one of an effect, about any of its points."""
    rng = np.random.default_rng(seed)
    n, base = 20, 4
    root = np.tril(rng.normal(size=(n, n))) * 0.3 + np.eye(n)
    covariance, h = root @ root.T, rng.normal(size=(n, base + 1))
    readings, x = rng.normal(size=n) * 2.0, rng.normal(size=base + 1)
    white = np.linalg.inv(root)
    gone = np.zeros(n, dtype=bool)
    gone[: int(rng.integers(1, 8))] = True

    def log_density(kept: NDArray[np.bool_], budget: float, effect: float) -> float:
        wide = h * np.array([budget] * base + [effect])
        whole = (covariance + wide @ wide.T)[np.ix_(kept, kept)]
        return float(multivariate_normal(np.zeros(int(kept.sum())), whole).logpdf(readings[kept]))

    linear = Linear(white @ (readings - h @ x), white @ h, np.arange(base), np.zeros(base + 1, dtype=bool), x)
    weighed = SimpleNamespace(
        fitted=SimpleNamespace(linear=linear, moving=np.arange(base + 1), inner=np.arange(base + 1)),
        explanation=SimpleNamespace(parameters=(base,), size=1),
        form_error=0.0,
        log_evidence=-7.0,
    )
    asked = Asked.of(cast("Any", weighed), root, Noise.of(covariance))
    assert asked.value() == pytest.approx(-7.0)
    part = asked.value(Noise.of(covariance, gone), budget, effect) - asked.value(budget=1.0)
    expected = log_density(~gone, budget, effect) - log_density(np.ones(n, dtype=bool), 1.0, 1.0)
    # Constants of 2π apart.
    assert part == pytest.approx(expected - 0.5 * gone.sum() * np.log(2.0 * np.pi), abs=1e-7)
    # What those kept make it expect of the others is what both together are more probable by.
    away, spread = asked.expected(Noise.of(covariance), ~gone, budget)
    more = log_density(np.ones(n, dtype=bool), budget, 1.0) - log_density(~gone, budget, 1.0)
    assert multivariate_normal(np.zeros(int(gone.sum())), spread).logpdf(away) == pytest.approx(more, abs=1e-7)


@pytest.mark.parametrize(
    ("refits", "favoured", "asked"),
    [
        # The straightened models would turn the verdict, and refits do not.
        ({("a",): 0.0, ("b",): -4.0}, ("a",), [{("a",), ("b",)}]),
        ({("a",): -9.0, ("b",): 0.0}, ("b",), [{("a",), ("b",)}]),
        # What comes next is refitted as well before it counts.
        ({("a",): -9.0, ("b",): -20.0, ("c",): -8.0}, ("a",), [{("a",), ("b",)}, {("c",)}]),
        ({("a",): -9.0, ("b",): -20.0, ("c",): -6.0}, ("c",), [{("a",), ("b",)}, {("c",)}]),
    ],
)
def test_what_would_turn_a_verdict_is_refitted_before_it_does(
    refits: Values, favoured: Names, asked: list[set[Names]]
) -> None:
    straight: Values = {("a",): -10.0, ("b",): 0.0, ("c",): -6.0, (): -50.0}
    explanations = [SimpleNamespace(weighed=SimpleNamespace(explanation=SimpleNamespace(names=n))) for n in straight]
    unused = cast("Any", None)
    verdict = Verdict("found", ("a",), ("a",), 0.97)
    questioned = Questioned(unused, unused, verdict, unused, unused, unused, unused, cast("Any", tuple(explanations)))
    calls: list[set[Names]] = []

    def refit(again: Sequence[Weighed]) -> Values:
        calls.append({w.explanation.names for w in again})
        return {w.explanation.names: refits[w.explanation.names] for w in again}

    assert questioned.favoured(straight, refit) == favoured
    assert calls == asked
    # What does not turn it costs no refit.
    assert questioned.favoured({**straight, ("a",): -1.0}, refit) == ("a",)
    assert calls == asked
