"""What a load case tells of the explanations: drawn, and what it cannot exceed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from fingermodel.diagnosis.next_cases.next_cases import information, most_information

Floats = NDArray[np.float64]


def drawn(means: Floats, covariances: Floats, prior: Floats) -> float:
    each = list(zip(means, covariances, strict=True))
    return information(each, prior, np.random.default_rng(0), 4000)[0]


@given(st.integers(0, 10**6), st.integers(2, 5), st.integers(1, 4), st.floats(0.01, 10.0))
@settings(max_examples=40, deadline=None)
def test_what_is_drawn_does_not_exceed_the_bound(seed: int, laws: int, components: int, apart: float) -> None:
    rng = np.random.default_rng(seed)
    means = apart * rng.normal(size=(2, laws, components))
    roots = rng.normal(size=(2, laws, components, components))
    covariances = np.eye(components) + roots @ roots.swapaxes(2, 3)
    prior = rng.dirichlet(np.ones(laws))
    for mean, covariance, most in zip(means, covariances, most_information(means, covariances, prior), strict=True):
        # Four standard errors of the draws: what one draw tells spreads by a nat or so.
        assert drawn(mean, covariance, prior) <= most + 0.06


def test_the_bound_is_reached_where_readings_part_entirely_and_where_they_are_alike() -> None:
    prior, noise = np.array([0.2, 0.3, 0.5]), np.broadcast_to(np.eye(2), (1, 3, 2, 2))
    far = 100.0 * np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]])
    entropy = float(-(prior * np.log(prior)).sum())
    assert most_information(far, noise, prior) == pytest.approx([entropy])
    assert drawn(far[0], noise[0], prior) == pytest.approx(entropy)
    assert most_information(0.0 * far, noise, prior) == pytest.approx([0.0])
