"""What makes readings independent and of variance 1 in a fit: the noise, and all weights that are integrated out."""

from __future__ import annotations

from dataclasses import dataclass

from fingermodel.arrays import Floats
from fingermodel.diagnosis.session_model.whitening import NoiseWhitening, shared_root
from fingermodel.fitting.roots import inverse_of, root_of_one_plus
from fingermodel.fitting.tiles import Tiles

# Readings for each shared weight from which the weights are eliminated, and not the readings.
_MANY = 2


@dataclass(frozen=True, eq=False)
class Whitening:
    """A root of the inverse of N + U Uᵀ.

    Attributes:
        noise: N, of all that no weight describes.
        left: (n, k) and
        right: (k, n) what the shared weights take away after it; or else
        dense: (n, n) the root of the rest.
    """

    noise: NoiseWhitening
    left: Floats | None = None
    right: Floats | None = None
    dense: Tiles | None = None

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
