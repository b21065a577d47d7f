"""Rows of an array, as slices and products with constants: slopes of an index are scattered case by case."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray


def picked(array: Array, rows: Sequence[int]) -> Array:
    """Some rows (k, …) of an array (n, …), known when it is compiled: each run of neighbours is one slice."""
    if len(rows) == 0:
        return array[:0]
    starts = [0, *(i for i in range(1, len(rows)) if rows[i] != rows[i - 1] + 1), len(rows)]
    runs = [array[rows[a] : rows[b - 1] + 1] for a, b in pairwise(starts)]
    return runs[0] if len(runs) == 1 else jnp.concatenate(runs)


def spread(rows: Sequence[int], length: int) -> NDArray[np.float64]:
    """Return the (k, length) matrix that puts k values in their places, with zeros elsewhere."""
    return np.eye(length)[np.array(rows, int)]


def chosen(rows: Array, index: Array) -> Array:
    """One row (k,) of rows (n, k), known only case by case."""
    return (jnp.arange(rows.shape[0]) == index).astype(rows.dtype) @ rows
