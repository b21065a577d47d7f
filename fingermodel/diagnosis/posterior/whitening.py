"""What makes readings independent and of variance 1: noise by case, and weights that all cases share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from fingermodel.diagnosis.session_model.case_noise import Rows, whitened
from fingermodel.fitting.roots import inverse_of, root_of_one_plus
from fingermodel.fitting.tiles import Tiles

Floats = NDArray[np.float64]

# Readings for each shared weight from which the weights are eliminated, and not the readings.
_MANY = 2


@dataclass(frozen=True, eq=False)
class Whitening:
    """A root of the inverse of N + U Uᵀ, of which N is block-diagonal by case.

    Attributes:
        roots: rows and inverse roots of the noise by case.
        left: (n, k) and
        right: (k, n) what the shared weights take away after it; or else
        dense: (n, n) the root of the rest.
    """

    roots: list[tuple[Rows, Floats]]
    left: Floats | None = None
    right: Floats | None = None
    dense: Tiles | None = None

    @classmethod
    def of(cls, roots: list[tuple[Rows, Floats]], shared: Floats) -> Whitening:
        """Make one.

        Args:
            roots: of the noise by case.
            shared: (n, k) columns U of the shared weights.
        """
        u = whitened(roots, shared)
        count, weights = u.shape
        if weights * _MANY > count:
            return cls(roots, dense=Tiles.of(inverse_of(root_of_one_plus(u @ u.T))))
        root = root_of_one_plus(u.T @ u)
        # With L Lᵀ = 1 + Uᵀ U, 1 − U (L + 1)⁻ᵀ L⁻¹ Uᵀ is a root of the inverse of 1 + U Uᵀ (Potter; Andrews 1968).
        right = solve_triangular(root, u.T, lower=True, check_finite=False)
        root.flat[:: weights + 1] += 1.0
        left = solve_triangular(root, u.T, lower=True, check_finite=False).T
        return cls(roots, np.ascontiguousarray(left), np.ascontiguousarray(right))

    def __matmul__(self, other: Floats) -> Floats:
        """Whiten a vector (n,) or columns (n, k)."""
        out = whitened(self.roots, other)
        if self.dense is not None:
            return self.dense @ out
        if self.left is not None and self.right is not None:
            out -= self.left @ (self.right @ out)
        return out
