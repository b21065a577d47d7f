"""Plateaus of a recording that nobody marked."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.lab.levels import StillSpans, find_levels
from daq.recordings.readings import ReadingBlock, open_readings
from daq.recordings.windows import Span
from daq.sessions import read_session


@pytest.mark.parametrize("name", ["DEV-01", "DEV-02"])
def test_every_load_of_a_recorded_session_is_one_plateau(name: str) -> None:
    session = read_session(name)
    assert session.readings_path is not None
    levels = find_levels(list(open_readings(session.readings_path).blocks()))
    tares = {case.unloaded_s for case in session.cases}
    assert len(levels) == len(session.cases) + len(tares)
    for window in [*tares, *(case.loaded_s for case in session.cases)]:
        assert window is not None
        held = [s.window_s for s in levels if s.window_s[0] < window[1] and s.window_s[1] > window[0]]
        assert len(held) == 1


@pytest.mark.parametrize("size", [7, 100, 1150])
def test_readings_in_small_blocks_have_the_same_plateaus(size: int) -> None:
    rng = np.random.default_rng(1)
    t_s = np.arange(0.0, 23.0, 0.01)
    wrench = rng.normal(0.0, 0.02, (len(t_s), 6)) + np.where((t_s // 3.0) % 2, 2.0, 0.0)[:, None]
    whole = find_levels([ReadingBlock(t_s, wrench)])
    parted = find_levels([ReadingBlock(t_s[i : i + size], wrench[i : i + size]) for i in range(0, len(t_s), size)])
    assert len(whole) == 8
    assert [level.window_s for level in parted] == [level.window_s for level in whole]
    for one, other in zip(parted, whole, strict=True):
        np.testing.assert_array_equal(one.plateau.covariance, other.plateau.covariance)


def test_a_long_recording_in_blocks_is_never_held_whole() -> None:
    class Long:
        """Readings for 40 minutes at 500 Hz, made as they are asked for."""

        def __iter__(self) -> Iterator[ReadingBlock]:
            rng = np.random.default_rng(2)
            for first in range(0, 1_200_000, 10_000):
                t_s = np.arange(first, first + 10_000) / 500.0
                level = np.where((t_s // 20.0) % 2, 2.0, 0.0)[:, None]
                yield ReadingBlock(t_s, level + rng.normal(0.0, 0.02, (10_000, 6)))

    tracemalloc.start()
    try:
        levels = find_levels(Long())
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(levels) == 120
    assert most < 20e6  # the readings are 67 MB


def test_a_plateau_of_hours_is_reduced_to_its_middle(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daq.lab.levels._MOST_READINGS", 2000)
    t_s = np.arange(0.0, 120.0, 0.01)
    wrench = np.random.default_rng(5).normal(0.0, 0.02, (len(t_s), 6)) + np.where(t_s < 100.0, 0.0, 2.0)[:, None]
    long, short = find_levels([ReadingBlock(t_s, wrench)])
    assert long.window_s == pytest.approx((40.0, 60.0), abs=0.2)
    assert long.plateau.readings == pytest.approx(2000, abs=1)
    assert short.window_s == pytest.approx((100.3, 119.7), abs=0.2)


def test_small_steps_are_parted_and_creep_is_not() -> None:
    rng = np.random.default_rng(4)
    t_s = np.arange(0.0, 12.0, 0.01)
    wrench = rng.normal(0.0, 0.02, (len(t_s), 6)) * [1, 1, 1, 20, 20, 20]
    wrench[t_s >= 6.0, 1] += 0.05  # two and a half deviations of one reading
    ends = [level.window_s for level in find_levels([ReadingBlock(t_s, wrench)])]
    assert len(ends) == 2
    assert ends[0][1] == pytest.approx(5.7, abs=0.2)
    assert ends[1][0] == pytest.approx(6.3, abs=0.2)
    wrench[:, 1] += 0.1 * (1.0 - np.exp(-t_s / 6.0)) - 0.05 * (t_s >= 6.0)
    assert len(find_levels([ReadingBlock(t_s, wrench)])) == 1


def test_what_never_holds_still_or_is_too_short_has_no_plateau() -> None:
    t_s = np.arange(0.0, 5.0, 0.01)
    moving = np.outer(np.sin(3.0 * t_s), [4.0] * 6)
    assert find_levels([ReadingBlock(t_s, moving)]) == ()
    assert find_levels([ReadingBlock(t_s[:3], moving[:3])]) == ()
    assert find_levels([ReadingBlock(np.zeros(50), np.zeros((50, 6)))]) == ()


@pytest.mark.parametrize("constant", [0.0, 23.5, -0.1])
def test_a_channel_that_never_changes_says_nothing_of_plateaus(constant: float) -> None:
    rng = np.random.default_rng(6)
    t_s = np.arange(0.0, 60.0, 0.01)
    force = rng.normal(0.0, 0.02, (len(t_s), 1)) + np.where((t_s // 10.0) % 2, 2.0, 0.0)[:, None]

    def plateaus(values: NDArray[np.float64]) -> list[Span]:
        still = StillSpans()
        still.add(t_s, values)
        return still.spans(4e-3 * np.ptp(values, axis=0))

    steady = np.full_like(force, constant)
    assert len(plateaus(force)) == 6
    assert plateaus(np.hstack([force, steady])) == plateaus(force)
    assert plateaus(steady) == [pytest.approx((0.3, 59.7), abs=0.1)]
