"""Whitening: the root of the inverse of noise, tares and weights that all cases share, whichever is eliminated."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fingermodel.diagnosis.session_model.whitening import NoiseWhitening, Whitening


@given(st.integers(0, 10**6), st.integers(2, 8), st.integers(0, 6), st.integers(0, 40), st.floats(1e-3, 1e3))
def test_it_makes_the_covariance_one(seed: int, cases: int, tares: int, weights: int, size: float) -> None:
    rng, count = np.random.default_rng(seed), 3 * cases
    rows = np.arange(count).reshape(cases, 3)
    roots = np.tril(rng.normal(size=(cases, 3, 3))) + 2.0 * np.eye(3)
    tared, shared = rng.normal(size=(count, tares)), size * rng.normal(size=(count, weights))
    noise = tared @ tared.T
    for at, root in zip(rows, roots, strict=True):
        noise[np.ix_(at, at)] += root @ root.T
    log_det = 2.0 * float(np.log(np.abs(np.diagonal(roots, axis1=1, axis2=2))).sum())
    of_noise = NoiseWhitening.of([(rows, np.asarray(np.linalg.inv(roots), dtype=np.float64))], log_det, tared)
    np.testing.assert_allclose(of_noise.log_det, np.linalg.slogdet(noise)[1], atol=1e-8)
    for made, covariance in (
        (of_noise, noise),
        (Whitening.of(of_noise, shared), noise + shared @ shared.T),
    ):
        white = made @ np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
        np.testing.assert_allclose(white @ white.T, np.eye(count), atol=1e-6)
        vector = rng.normal(size=count)
        np.testing.assert_allclose(made @ vector, (made @ vector[:, None])[:, 0], atol=1e-9)
    # Rows that multiply what is whitened, multiply in the noise's own units what the tares leave.
    row, column = rng.normal(size=count), rng.normal(size=count)
    np.testing.assert_allclose(of_noise.by_case(row) @ of_noise.of_case(column), row @ (of_noise @ column), atol=1e-8)
