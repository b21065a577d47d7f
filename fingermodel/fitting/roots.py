"""Triangular roots of covariances, which nothing positive semidefinite can make fail."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotrf, dtrtri

Floats = NDArray[np.float64]

# Of what is 1 or more but for rounding.
_LEAST = 1.0 - 1e-6


def root_of_one_plus(gram: Floats) -> Floats:
    """Lower triangular root (…, k, k) of 1 + G, which is what inner products G are left as.

    No eigenvalue of 1 + G is below 1, and so is nothing on the root's diagonal. Where slopes are steep, rounding errors
    of G are larger than 1 and may say otherwise: what they have taken below 1 is raised to it.
    """
    k = gram.shape[-1]
    gram[..., np.arange(k), np.arange(k)] += 1.0
    if gram.ndim == 2:
        factor, failed = dpotrf(gram, lower=1, clean=1)
        if not failed and (np.diagonal(factor) > _LEAST).all():
            return np.asarray(factor, dtype=np.float64)
    else:
        try:
            factor = np.asarray(np.linalg.cholesky(gram))
            if (np.diagonal(factor, axis1=-2, axis2=-1) > _LEAST).all():
                return factor
        except np.linalg.LinAlgError:
            pass
    if not np.isfinite(gram).all():
        raise np.linalg.LinAlgError("inner products are not finite")
    values, vectors = np.linalg.eigh(gram)
    half = vectors * np.sqrt(np.maximum(values, 1.0))[..., None, :]
    upper: Floats = np.asarray(np.linalg.qr(half.swapaxes(-1, -2), mode="r"))
    signs = np.where(np.diagonal(upper, axis1=-2, axis2=-1) < 0.0, -1.0, 1.0)
    return np.asarray((upper * signs[..., None]).swapaxes(-1, -2))


def absorbed_by(columns: Floats) -> tuple[Floats, float]:
    """What weights with N(0, 1) priors absorb, of columns C (n, k).

    By Cholesky factors twice (CholeskyQR2; Yamamoto, Nakatsukasa, Yanagisawa & Fukaya 2015): with one alone rounding
    grows with the square of the largest column, and may leave more of a further column than there is of it.

    Returns:
        V (k, n), such that the inverse of 1 + C Cᵀ is 1 - Vᵀ V, and ln det(1 + C Cᵀ).
    """
    count, weights = columns.shape
    first = root_of_one_plus(columns.T @ columns)
    basis = np.concatenate([columns.T, np.eye(weights)], axis=1)
    basis = solve_triangular(first, basis, lower=True, overwrite_b=True, check_finite=False)
    again = root_of(basis @ basis.T)
    across = np.asarray(solve_triangular(again, basis[:, :count], lower=True, check_finite=False), dtype=np.float64)
    return across, 2.0 * float(np.log(np.diag(first) * np.diag(again)).sum())


def root_of(covariance: Floats) -> Floats:
    """Lower triangular root (…, k, k) of positive semidefinite covariances, however nearly singular.

    What rounding has made negative, and directions without any variance, get a variance of rounding's size.

    Raises:
        LinAlgError: one is not finite.
    """
    k = covariance.shape[-1]
    size = np.maximum(np.trace(covariance, axis1=-2, axis2=-1) / max(k, 1), 1e-300)[..., None, None]
    symmetric = 0.5 * (covariance + covariance.swapaxes(-1, -2))
    if not np.isfinite(symmetric).all():
        raise np.linalg.LinAlgError("a covariance is not finite")
    jitter = 1e-12
    while True:
        try:
            return np.asarray(np.linalg.cholesky(symmetric + jitter * size * np.eye(k)))
        except np.linalg.LinAlgError:
            # Of a covariance this ends: once the jitter exceeds what rounding took away.
            jitter *= 100.0


def inverse_of(root: Floats) -> Floats:
    """Inverse (k, k) of a lower triangular root."""
    inverse, failed = dtrtri(root, lower=1)
    if failed:
        raise np.linalg.LinAlgError("a root of a covariance has nothing on its diagonal")
    return np.asarray(inverse, dtype=np.float64)
