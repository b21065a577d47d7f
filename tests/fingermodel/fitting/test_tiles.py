"""A matrix in tiles multiplies as the whole does, whatever is zero in it."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from fingermodel.fitting.tiles import Floats, Tiles


@given(
    size=st.integers(1, 70),
    band=st.integers(0, 70),
    columns=st.sampled_from([None, 1, 5]),
    seed=st.integers(0, 1000),
)
def test_the_product_is_that_of_the_whole_matrix(size: int, band: int, columns: int | None, seed: int) -> None:
    rng = np.random.default_rng(seed)
    matrix: Floats = np.asarray(np.tril(np.triu(rng.normal(size=(size, size)), -band), band // 2), dtype=np.float64)
    matrix[rng.random(size) < 0.2] = 0.0
    other: Floats = rng.normal(size=size if columns is None else (size, columns))
    assert_allclose(Tiles.of(matrix) @ other, matrix @ other, atol=1e-12)


def test_only_what_is_not_zero_is_kept() -> None:
    blocks: Floats = np.asarray(np.kron(np.eye(20), np.ones((4, 4))), dtype=np.float64)
    assert sum(block.size for *_, block in Tiles.of(blocks).tiles) < 0.25 * 80 * 80
