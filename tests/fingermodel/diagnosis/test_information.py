"""What a load case tells of the explanations: all where readings part them entirely, nothing where they are alike."""

from __future__ import annotations

import numpy as np
import pytest

from fingermodel.diagnosis.next_cases.next_cases import information


@pytest.mark.parametrize(("apart", "share"), [(100.0, 1.0), (0.0, 0.0)])
def test_information_lies_between_nothing_and_all_that_is_open(apart: float, share: float) -> None:
    prior = np.array([0.2, 0.3, 0.5])
    means = apart * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    entropy = -float(prior @ np.log(prior))
    told = information([(mean, np.eye(2)) for mean in means], prior, np.random.default_rng(0), 4000)[0]
    assert told == pytest.approx(share * entropy, abs=1e-9)


def test_readings_that_overlap_tell_a_part() -> None:
    prior, means = np.array([0.5, 0.5]), np.array([[0.0], [1.0], [2.0]])
    told = [
        information([(mean, np.eye(1)) for mean in (means[0], other)], prior, np.random.default_rng(0), 4000)[0]
        for other in means[1:]
    ]
    assert 0.0 < told[0] < told[1] < np.log(2.0)
