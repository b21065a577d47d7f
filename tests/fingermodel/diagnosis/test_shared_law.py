"""The algebra of a curve that sessions share: it is that of the joint Gaussian, and does not heed how it is counted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from fingermodel.diagnosis.posterior.curves import gain
from fingermodel.diagnosis.posterior.gaussian import Quadratic
from fingermodel.diagnosis.several_sessions.shared_law import p_value

Floats = NDArray[np.float64]


def sessions(seed: int, count: int, weights: int) -> tuple[list[Quadratic], list[Floats], list[Floats], list[Floats]]:
    rng = np.random.default_rng(seed)
    said, columns, covariances, readings = [], [], [], []
    for _ in range(count):
        n = int(rng.integers(weights, 2 * weights + 3))
        root = rng.normal(size=(n, n)) + 2.0 * np.eye(n)
        c, v, y = rng.normal(size=(n, weights)), root @ root.T, rng.normal(size=n)
        inverse = np.linalg.inv(v)
        said.append(Quadratic(0.0, c.T @ inverse @ y, c.T @ inverse @ c, 0.0))
        columns.append(c)
        covariances.append(v)
        readings.append(y)
    return said, columns, covariances, readings


def log_normal(y: Floats, v: Floats) -> float:
    return float(-0.5 * y @ np.linalg.solve(v, y) - 0.5 * np.linalg.slogdet(v)[1])


@given(st.integers(0, 10**6), st.integers(1, 3), st.integers(1, 4), st.floats(0.01, 10.0))
def test_the_gain_is_that_of_the_joint_gaussian(seed: int, count: int, weights: int, size: float) -> None:
    said, columns, covariances, readings = sessions(seed, count, weights)
    c, y = np.concatenate(columns), np.concatenate(readings)
    v = np.zeros((len(y), len(y)))
    at = 0
    for block in covariances:
        v[at : at + len(block), at : at + len(block)] = block
        at += len(block)
    expected = log_normal(y, v + size**2 * c @ c.T) - log_normal(y, v)
    assert gain(said, size) == pytest.approx(expected, rel=1e-6, abs=1e-6)


@given(st.integers(0, 10**6), st.floats(0.01, 10.0))
def test_weights_turned_alike_in_all_sessions_gain_the_same(seed: int, size: float) -> None:
    said, *_ = sessions(seed, 3, 4)
    rng = np.random.default_rng(seed)
    order, sign = rng.permutation(4), rng.choice([-1.0, 1.0], 4)
    assert gain([s.turned(order, sign) for s in said], size) == pytest.approx(gain(said, size), abs=1e-9)


def test_no_weights_gain_nothing() -> None:
    said, *_ = sessions(1, 2, 3)
    assert gain(said, 0.0) == gain([], 1.0) == 0.0
    assert gain(said, 1.0, np.zeros(0, dtype=np.intp)) == 0.0


def test_the_sessions_as_they_are_count_as_a_shuffle() -> None:
    assert p_value(5.0, np.array([1.0, 2.0, 3.0])) == 0.25
    assert p_value(2.0, np.array([1.0, 2.0, 3.0])) == 0.75
