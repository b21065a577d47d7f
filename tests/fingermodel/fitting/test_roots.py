"""Roots of covariances, and what weights absorb: whatever rounding makes of steep and nearly collinear columns."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from fingermodel.fitting.roots import absorbed_by, root_of, root_of_one_plus

Floats = NDArray[np.float64]
SIZES = st.integers(2, 12)
SEEDS = st.integers(0, 2**32 - 1)
SPREADS = st.floats(0.0, 9.0)


def nearly_collinear(size: int, seed: int, log_scale: float, log_spread: float) -> Floats:
    """Columns (40, size) of a scale, that differ by a power of ten less."""
    rng = np.random.default_rng(seed)
    first = rng.normal(size=(40, 1)) * 10.0**log_scale
    return first + rng.normal(size=(40, size)) * 10.0 ** (log_scale - log_spread)


@given(SIZES, SEEDS, st.floats(-8.0, 8.0), SPREADS)
def test_steep_and_nearly_collinear_columns_end_no_factorisation(
    size: int, seed: int, log_scale: float, log_spread: float
) -> None:
    columns = nearly_collinear(size, seed, log_scale, log_spread)
    gram = columns.T @ columns
    found = root_of_one_plus(gram.copy())
    assert found @ found.T == pytest.approx(gram + np.eye(size), abs=1e-12 * size * (1.0 + np.trace(gram)))
    # Whatever rounding has made of it, and of several at once.
    several = np.stack([gram, gram - 1e-15 * np.trace(gram) * np.eye(size), 0.0 * gram])
    for root in root_of_one_plus(several):
        assert np.isfinite(root).all()
        assert np.log(np.diag(root)).sum() > -1e-9
    covariance = columns @ columns.T
    root = root_of(covariance)
    assert root @ root.T == pytest.approx(covariance, abs=1e-5 * np.trace(covariance))


def test_a_covariance_that_is_not_finite_is_refused() -> None:
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        root_of(np.array([[1.0, np.nan], [np.nan, 1.0]]))


@given(SIZES, SEEDS, st.floats(-3.0, 7.0), SPREADS)
def test_of_a_further_column_no_more_is_absorbed_than_there_is(
    size: int, seed: int, log_scale: float, log_spread: float
) -> None:
    columns = nearly_collinear(size, seed, log_scale, log_spread)
    across, log_det = absorbed_by(columns.copy())
    # The same by an orthogonal factor of the columns themselves.
    basis, root = np.linalg.qr(np.concatenate([columns, np.eye(size)]))
    assert log_det == pytest.approx(2.0 * np.log(np.abs(np.diag(root))).sum(), rel=1e-6, abs=1e-6)
    further = np.random.default_rng(seed + 1).normal(size=(40, 3))
    left = further.T @ further - (across @ further).T @ (across @ further)
    expected = further.T @ further - (basis[:40].T @ further).T @ (basis[:40].T @ further)
    np.testing.assert_allclose(left, expected, atol=1e-4)
    assert np.linalg.eigvalsh(left).min() > -1e-9
