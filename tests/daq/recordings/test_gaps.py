"""Gaps by the times of readings: lost ones are found and counted, late ones are not, in portions of any size."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.recordings.gaps import Gap, GapFinder

Floats = NDArray[np.float64]
LOST = (500, 505, 700, 701, 702, 1500, 2999)


def gaps_of(t_s: Floats, portion: int = 100_000, stated_hz: float | None = None) -> tuple[list[Gap], GapFinder]:
    finder, out = GapFinder(stated_hz), list[Gap]()
    for a in range(0, len(t_s), portion):
        out += finder.take(t_s[a : a + portion])
    return out + finder.finish(), finder


def even(n: int = 3999, rate_hz: float = 100.0) -> Floats:
    return np.asarray(np.arange(n) / rate_hz + 3.0)


def jittering(t_s: Floats, by: float = 0.15) -> Floats:
    """Late by up to a share of an interval, in order."""
    return np.sort(t_s + np.random.default_rng(5).uniform(0.0, by, len(t_s)) * (t_s[1] - t_s[0]))


def in_bursts(t_s: Floats) -> Floats:
    """Held back until a multiple of 70 ms, then all at nearly once; the last of 3999 readings end a burst."""
    return np.ceil(t_s / 0.07) * 0.07 + 1e-6 * np.arange(len(t_s))


def stalled(t_s: Floats) -> Floats:
    """Held back for 0.9 s, four times, by a machine that was busy."""
    out = t_s.copy()
    for at in (4.0, 15.1, 20.0, 34.3):
        out[(out > at) & (out < at + 0.9)] = at + 0.9
    return out + 1e-6 * np.arange(len(t_s))


ARRIVALS: dict[str, Callable[[Floats], Floats]] = {"even": np.array, "jittering": jittering, "stalled": stalled}


@pytest.mark.parametrize("arrive", ARRIVALS.values(), ids=ARRIVALS)
@pytest.mark.parametrize("portion", [1, 7, 100_000])
def test_lost_readings_are_counted_and_late_ones_are_not(arrive: Callable[[Floats], Floats], portion: int) -> None:
    t_s = even()
    assert gaps_of(arrive(t_s), portion)[0] == []
    found, finder = gaps_of(arrive(np.delete(t_s, LOST)), portion)
    assert [g.lost for g in found] == [1, 1, 3, 1, 1]
    assert [round((g.start_s - 3.0) * 100.0) for g in found] == pytest.approx([499, 504, 699, 1499, 2998], abs=1)
    assert finder.interval_s == pytest.approx(0.01, rel=0.01)


def test_a_pulled_cable_is_one_gap_however_the_readings_arrive() -> None:
    t_s = even()
    left = t_s[(t_s <= 12.04) | (t_s >= 21.0)]
    for arrive in (*ARRIVALS.values(), in_bursts):
        [gap] = gaps_of(arrive(left), 10)[0]
        assert gap.lost == pytest.approx(895, abs=7)
        assert gap.start_s == pytest.approx(12.04, abs=0.02)
        assert gap.end_s >= 21.0


def test_bursts_of_an_adapter_are_late_and_their_rate_is_told_right() -> None:
    found, finder = gaps_of(in_bursts(even()))
    assert found == []
    assert finder.late == pytest.approx(40.0 / 0.07, abs=2)
    assert finder.interval_s == pytest.approx(0.01, rel=0.02)


def test_a_recording_of_the_windows_alone_keeps_its_stated_rate_and_shows_its_pauses() -> None:
    windows = [start + np.arange(40) / 10.0 for start in np.cumsum([60.0, 7.0, 15.0, 7.0, 15.0, 7.0])]
    found, finder = gaps_of(np.concatenate(windows), stated_hz=10.0)
    assert finder.interval_s == pytest.approx(0.1)
    assert [round(gap.end_s - gap.start_s, 3) for gap in found] == [3.1, 11.1, 3.1, 11.1, 3.1]


def test_no_jitter_makes_a_gap() -> None:
    for by in (0.9, 1.9):
        found, finder = gaps_of(jittering(even(), by), 10)
        assert found == []
        assert finder.interval_s == pytest.approx(0.01, rel=0.01)
    assert finder.late > 100


def test_times_that_are_rounded_hide_no_rate_and_make_no_gap() -> None:
    found, finder = gaps_of(np.round(even(rate_hz=400.0), 3))
    assert found == []
    assert finder.late == 0
    assert finder.interval_s == pytest.approx(0.0025, rel=0.001)


def test_arrivals_in_steps_of_a_timer_hide_no_rate_and_no_gap() -> None:
    """Most intervals are then shorter than the mean, and alike."""
    ticks = np.ceil(even() / 0.0042) * 0.0042
    for portion in (10, 100_000):
        found, finder = gaps_of(np.delete(ticks, LOST), portion)
        assert sum(g.lost for g in found) == len(LOST)
        assert finder.interval_s == pytest.approx(0.01, rel=0.005)


def test_a_third_of_all_readings_lost_at_random_is_told() -> None:
    kept = even()[np.random.default_rng(0).uniform(size=3999) > 1.0 / 3.0]
    found, finder = gaps_of(kept)
    assert finder.interval_s == pytest.approx(0.01, rel=1e-6)
    assert sum(g.lost for g in found) == round((kept[-1] - kept[0]) * 100.0) + 1 - len(kept)


@pytest.mark.parametrize("rate_hz", [98.5, 101.5])
def test_a_clock_that_runs_off_hides_no_gap(rate_hz: float) -> None:
    t_s = np.concatenate([even(1000), 12.99 + np.arange(1, 1000) / rate_hz])
    assert gaps_of(t_s, 100)[0] == []
    assert [g.lost for g in gaps_of(np.delete(t_s, (300, 1010, 1500)), 100)[0]] == [1, 1, 1]


def test_few_readings_or_equal_times_are_judged_without_a_fault() -> None:
    assert gaps_of(np.zeros(0))[0] == gaps_of(np.zeros(1))[0] == gaps_of(np.zeros(50))[0] == []
    assert gaps_of(np.array([0.0, 1.0, 2.0, 3.0, 7.0]), 1)[0] == [Gap(3.0, 7.0, 3)]
    assert gaps_of(np.array([0.0, 1.0, 2.0, 9.0, 10.0]), 2)[0] == [Gap(2.0, 9.0, 6)]


def polled(rng: np.random.Generator, wait_s: float) -> tuple[Floats, Floats]:
    """Times of 4000 readings at 200 Hz (n,), and when a busy machine takes them (n,) [s]: at times it is stalled."""
    taken, now = [], 0.0
    while now < 20.1:
        stall_s = rng.exponential(0.3) if rng.random() < 0.002 else 0.0
        now += rng.exponential(wait_s) + stall_s
        taken.append(now)
    read = np.arange(4000) / 200.0
    return read, np.array(taken)[np.searchsorted(taken, read)]


@pytest.mark.parametrize("wait_s", [0.005, 0.02, 0.05])
def test_readings_that_a_busy_machine_takes_late_are_hardly_ever_called_lost_and_a_lost_second_always_is(
    wait_s: float,
) -> None:
    false = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        read, taken = polled(rng, wait_s)
        false += len(gaps_of(taken, 20)[0])
        found, _ = gaps_of(taken[(read < 8.0) | (read >= 9.0)], 20)
        assert 100 <= max(g.lost for g in found) <= 250
    assert false <= 1


def test_a_poll_a_little_faster_than_the_readings_loses_none_of_them() -> None:
    """At each poll there is one reading or none: most intervals are the poll's, the others twice as long."""
    polls = np.cumsum(np.random.default_rng(1).uniform(0.00403, 0.00431, 6000))
    read = np.arange(4000) / 200.0
    found, finder = gaps_of(polls[np.searchsorted(polls, read)], 20)
    assert found == []
    assert finder.interval_s == pytest.approx(0.005, rel=0.01)
