"""What makes readings independent and of variance 1: noise by case, and tares that several cases share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import solve_triangular
from scipy.sparse import csr_array

from fingermodel.arrays import Floats, Ints
from fingermodel.fitting.roots import inverse_of, root_of_one_plus
from fingermodel.fitting.tiles import Tiles

# Readings for each shared weight from which the weights are eliminated, and not the readings.
_MANY = 2


def is_smooth(block: str) -> bool:
    """Whether a block's columns are something smooth (see `ReadingChanges.smooth`)."""
    return ":" in block


@dataclass(frozen=True, eq=False)
class NoiseWhitening:
    """A root of the inverse of N + T Tᵀ: noise N that is block-diagonal by case, and columns T of the tares."""

    roots: list[tuple[Ints, Floats]]  # rows and inverse roots of the noise by case
    # (n, k) and (k, n): their product is what the tares take away after the noise by case. A tare is one of a few
    # cases: hardly anything is not zero.
    left: csr_array
    right: csr_array
    log_det: float  # of N + T Tᵀ

    @classmethod
    def of(cls, roots: list[tuple[Ints, Floats]], log_det: float, tares: Floats) -> NoiseWhitening:
        """Make one.

        Args:
            roots: of the noise by case.
            log_det: of the noise by case.
            tares: (n, k) columns T.
        """
        left, right, more = shared_root(whitened(roots, tares))
        return cls(roots, csr_array(left), csr_array(right), log_det + more)

    def __matmul__(self, other: Floats) -> Floats:
        """Whiten a vector (n,) or columns (n, k)."""
        out = self.of_case(other)
        out -= self.left @ (self.right @ out)
        return out

    def of_case(self, other: Floats) -> Floats:
        """The same in units of the noise by case alone, the tares left aside."""
        return whitened(self.roots, other)

    def by_case(self, rows: Floats) -> Floats:
        """Whitened rows (k, n), or one (n,), in units of the noise by case alone: times what the tares leave."""
        return rows - (rows @ self.left) @ self.right


def shared_root(u: Floats) -> tuple[Floats, Floats, float]:
    """Factors (n, k), (k, n) of which 1 − left right is a root of the inverse of 1 + U Uᵀ, U (n, k); ln det of that."""
    # With L Lᵀ = 1 + Uᵀ U, 1 − U (L + 1)⁻ᵀ L⁻¹ Uᵀ is such a root (Potter; Andrews 1968).
    root = root_of_one_plus(u.T @ u)
    right = solve_triangular(root, u.T, lower=True, check_finite=False)
    log_det = 2.0 * float(np.log(np.diag(root)).sum())
    root.flat[:: len(root) + 1] += 1.0
    return solve_triangular(root, u.T, lower=True, check_finite=False).T, right, log_det


def whitened(roots: list[tuple[Ints, Floats]], columns: Floats) -> Floats:
    """Columns (n, k) or (n,) in units in which the noise by case is independent and of size 1."""
    flat = columns.reshape(len(columns), -1)
    out = np.empty_like(flat)
    for rows, inverse in roots:
        out[rows] = inverse @ flat[rows]
    return out.reshape(columns.shape)


@dataclass(frozen=True, eq=False)
class Whitened:
    """Blocks of columns under one noise."""

    noise: NoiseWhitening  # by case, and of the tares
    part: Callable[[str], Floats]  # (n, k) columns of a block, not whitened
    smooth: Whitened | None = None  # what keeps those of something smooth, for all explanations
    columns: dict[str, Floats] = field(default_factory=dict, repr=False)  # (n, k) whitened ones, by their block
    _inner: dict[tuple[str, str], Floats] = field(default_factory=dict, repr=False)

    def of(self, block: str) -> Floats:
        """(n, k) whitened columns of a block."""
        if self.smooth and is_smooth(block):
            return self.smooth.of(block)
        if block not in self.columns:
            self.columns[block] = self.noise @ self.part(block)
        return self.columns[block]

    def inner(self, a: str, b: str) -> Floats:
        """(k, l) inner products of two blocks."""
        if self.smooth and is_smooth(a) and is_smooth(b):
            return self.smooth.inner(a, b)
        if (b, a) in self._inner:
            return self._inner[b, a].T
        if (a, b) not in self._inner:
            self._inner[a, b] = self.of(a).T @ self.of(b)
        return self._inner[a, b]


@dataclass(frozen=True, eq=False)
class Whitening:
    """A root of the inverse of N + U Uᵀ."""

    noise: NoiseWhitening  # N, of all that no weight describes
    # Either (n, k) and (k, n), whose product is what the shared weights take away after the noise …
    left: Floats | None = None
    right: Floats | None = None
    dense: Tiles | None = None  # … or (n, n) the root of the rest

    @classmethod
    def of(cls, noise: NoiseWhitening, shared: Floats) -> Whitening:
        """Make one.

        Args:
            noise: by case, and of the tares.
            shared: (n, k) columns U of the shared weights.
        """
        u = noise @ shared
        count, weights = u.shape
        if weights * _MANY > count:
            return cls(noise, dense=Tiles.of(inverse_of(root_of_one_plus(u @ u.T))))
        left, right, _ = shared_root(u)
        return cls(noise, left, right)

    def __matmul__(self, other: Floats) -> Floats:
        """Whiten a vector (n,) or columns (n, k)."""
        out = self.noise @ other
        if self.dense is not None:
            return self.dense @ out
        if self.left is not None and self.right is not None:
            out -= self.left @ (self.right @ out)
        return out
