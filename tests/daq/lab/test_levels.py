"""Plateaus of a recording that nobody marked."""

from __future__ import annotations

import numpy as np
import pytest

from daq.lab.levels import find_levels
from daq.recordings.readings import open_readings
from daq.sessions import read_session


@pytest.mark.parametrize("name", ["DEV-01", "DEV-02"])
def test_every_load_of_a_recorded_session_is_one_plateau(name: str) -> None:
    session = read_session(name)
    assert session.readings_path is not None
    blocks = list(open_readings(session.readings_path).blocks())
    levels = find_levels(np.concatenate([b.t_s for b in blocks]), np.concatenate([b.wrench for b in blocks]))
    tares = {case.unloaded_s for case in session.cases}
    assert len(levels) == len(session.cases) + len(tares)
    for window in [*tares, *(case.loaded_s for case in session.cases)]:
        assert window is not None
        held = [s.window_s for s in levels if s.window_s[0] < window[1] and s.window_s[1] > window[0]]
        assert len(held) == 1


def test_small_steps_are_parted_and_creep_is_not() -> None:
    rng = np.random.default_rng(4)
    t_s = np.arange(0.0, 12.0, 0.01)
    wrench = rng.normal(0.0, 0.02, (len(t_s), 6)) * [1, 1, 1, 20, 20, 20]
    wrench[t_s >= 6.0, 1] += 0.05  # two and a half deviations of one reading
    ends = [level.window_s for level in find_levels(t_s, wrench)]
    assert len(ends) == 2
    assert ends[0][1] == pytest.approx(5.7, abs=0.2)
    assert ends[1][0] == pytest.approx(6.3, abs=0.2)
    wrench[:, 1] += 0.1 * (1.0 - np.exp(-t_s / 6.0)) - 0.05 * (t_s >= 6.0)
    assert len(find_levels(t_s, wrench)) == 1


def test_what_never_holds_still_or_is_too_short_has_no_plateau() -> None:
    t_s = np.arange(0.0, 5.0, 0.01)
    moving = np.outer(np.sin(3.0 * t_s), [4.0] * 6)
    assert find_levels(t_s, moving) == ()
    assert find_levels(t_s[:3], moving[:3]) == ()
    assert find_levels(np.zeros(50), np.zeros((50, 6))) == ()
