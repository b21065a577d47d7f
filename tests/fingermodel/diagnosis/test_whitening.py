"""Whitening: the root of the inverse of noise by case and weights that all cases share, whichever is eliminated."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fingermodel.diagnosis.posterior.whitening import Whitening


@given(st.integers(0, 10**6), st.integers(2, 8), st.integers(0, 40), st.floats(1e-3, 1e3))
def test_it_makes_the_covariance_one(seed: int, cases: int, weights: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    rows = np.arange(3 * cases).reshape(cases, 3)
    roots = np.tril(rng.normal(size=(cases, 3, 3))) + 2.0 * np.eye(3)
    shared = size * rng.normal(size=(3 * cases, weights))
    covariance = shared @ shared.T
    for at, root in zip(rows, roots, strict=True):
        covariance[np.ix_(at, at)] += root @ root.T
    made = Whitening.of([(rows, np.asarray(np.linalg.inv(roots), dtype=np.float64))], shared)
    white = made @ np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    np.testing.assert_allclose(white @ white.T, np.eye(3 * cases), atol=1e-6)
    vector = rng.normal(size=3 * cases)
    np.testing.assert_allclose(made @ vector, (made @ vector[:, None])[:, 0], atol=1e-9)
