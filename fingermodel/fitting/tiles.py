"""A matrix that is mostly zero away from its diagonal, multiplied tile by tile.

What whitens a session's readings couples only readings that share a setting: a tenth of it is not zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Rows of a tile: few hold few zeros, many are multiplied faster. Of 284 readings 8 to 32 take the same time.
ROWS = 16


@dataclass(frozen=True, eq=False)
class Tiles:
    """A square matrix as rows of tiles, each from its first column that is not zero to its last.

    Attributes:
        tiles: rows, columns and the block (rows, columns) there.
    """

    tiles: tuple[tuple[slice, slice, Floats], ...]

    @classmethod
    def of(cls, matrix: Floats) -> Tiles:
        """Cut a matrix (n, n) up."""
        tiles = []
        for first in range(0, len(matrix), ROWS):
            rows = slice(first, first + ROWS)
            used = np.flatnonzero(matrix[rows].any(axis=0))
            columns = slice(int(used[0]), int(used[-1]) + 1) if len(used) else slice(0, 0)
            tiles.append((rows, columns, np.ascontiguousarray(matrix[rows, columns])))
        return cls(tuple(tiles))

    def __matmul__(self, other: Floats) -> Floats:
        """Multiply with a vector (n,) or a matrix (n, columns)."""
        out = np.empty_like(other)
        for rows, columns, block in self.tiles:
            np.matmul(block, other[columns], out=out[rows])
        return out
