"""Cross products and rows by number: values and slopes of what a fit is compiled from."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

import fingermodel.model  # noqa: F401 # double precision
from fingermodel.rows import chosen, picked, spread
from fingermodel.vectors import cross

RNG = np.random.default_rng(5)


@pytest.mark.parametrize(
    ("a", "b"), [((3,), (3,)), ((4, 3), (3,)), ((3,), (4, 3)), ((2, 1, 3), (4, 3))], ids=["one", "many", "few", "grid"]
)
def test_the_cross_product_is_that_of_numpy_and_so_are_its_slopes(a: tuple[int, ...], b: tuple[int, ...]) -> None:
    first, second = RNG.normal(size=a), RNG.normal(size=b)
    np.testing.assert_allclose(np.asarray(cross(first, second)), np.cross(first, second), atol=1e-15)
    np.testing.assert_allclose(np.asarray(jax.jit(cross)(first, second)), np.cross(first, second), atol=1e-15)
    # Both ways, twice: a study asks for slopes forwards, a fit backwards.
    check_grads(cross, (first, second), order=2, modes=["fwd", "rev"])


@pytest.mark.parametrize("axes", [(0, 0), (0, None), (None, 1), (1, 0)], ids=str)
def test_a_batch_of_cross_products_is_each_of_them(axes: tuple[int | None, int | None]) -> None:
    one, many = RNG.normal(size=3), RNG.normal(size=(5, 3))
    given = [one if axis is None else np.moveaxis(many + k, 0, axis) for k, axis in enumerate(axes)]
    first, second = (np.broadcast_to(one if axis is None else many + k, (5, 3)) for k, axis in enumerate(axes))
    np.testing.assert_allclose(np.asarray(jax.vmap(cross, axes)(*given)), np.cross(first, second), atol=1e-15)
    slopes = jax.vmap(jax.grad(lambda a, b: jnp.sum(cross(a, b) * jnp.arange(3.0))), axes)(*given)
    np.testing.assert_allclose(np.asarray(slopes), np.cross(second, np.arange(3.0)), atol=1e-15)


@pytest.mark.parametrize("rows", [(), (2,), (0, 1, 2), (4, 1, 2), (3, 3, 0)], ids=str)
def test_picked_rows_are_those_of_an_index(rows: tuple[int, ...]) -> None:
    values = RNG.normal(size=(5, 2))
    np.testing.assert_array_equal(picked(jnp.asarray(values), rows), values[list(rows)])
    np.testing.assert_array_equal(spread(rows, 5) @ values, values[list(rows)])


def test_a_chosen_row_is_that_of_an_index() -> None:
    values = RNG.normal(size=(5, 2))
    for k in range(5):
        np.testing.assert_array_equal(chosen(jnp.asarray(values), jnp.asarray(k)), values[k])
