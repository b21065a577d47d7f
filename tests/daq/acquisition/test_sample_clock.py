"""Times of samples from bursts, wrong rates, counters and gaps."""

from __future__ import annotations

import numpy as np
import pytest

from daq.acquisition.sample_clock import SampleClock
from daq.drivers.base import Samples, samples

RATE = 1000.0


def taken(count: int, first: int = 0, *, counted: bool = False, clock: float | None = None) -> Samples:
    """`count` samples; with the device's count, or its clock (the time of the first)."""
    return samples(
        np.zeros((count, 6)),
        sequence=np.arange(first, first + count) if counted else None,
        device_s=None if clock is None else clock + np.arange(count) / RATE,
    )


def bursts(seconds: float, rate: float, seed: int, held_s: float = 0.016) -> list[tuple[int, int, float]]:
    """(first, count, arrival) of reads from an adapter that holds bytes back, with a few delays of the host."""
    rng = np.random.default_rng(seed)
    out, first, now = [], 0, 0.0
    while now < seconds:
        now += held_s
        done = int(now * rate)
        late = rng.exponential(0.001) + (0.2 if rng.random() < 0.002 else 0.0)
        out.append((first, done - first, now + late))
        first = done
    return out


@pytest.mark.parametrize(("counted", "off"), [(False, 0.0), (False, 0.004), (True, 0.004), (True, -0.01)])
def test_bursts_and_a_wrong_rate_are_smoothed_out(counted: bool, off: float) -> None:
    true_rate = RATE * (1.0 + off)
    clock, told, truth = SampleClock(RATE), [], []
    for first, count, arrival in bursts(240.0, true_rate, 1):
        told.append(clock.times(taken(count, first, counted=counted), arrival))
        truth.append((first + np.arange(count)) / true_rate)
    times, true = np.concatenate(told), np.concatenate(truth)
    assert (np.diff(times) > 0.0).all()
    settled = true > 120.0
    error = times[settled] - true[settled]
    # Arrival cannot tell a constant delay; its wander is what matters, far below the burst's own 16 ms.
    assert np.ptp(error) < 0.006
    assert abs(error.mean()) < 0.02
    assert 1.0 / clock.pace == pytest.approx(1.0 + off, abs=2e-3)


def test_a_gap_that_the_device_counts_leaves_the_time_right() -> None:
    clock = SampleClock(RATE)
    clock.times(taken(100, 0, counted=True), 0.1)
    after = clock.times(taken(100, 600, counted=True), 0.7)
    assert after[0] == pytest.approx(0.6, abs=0.002)


def test_a_gap_that_nobody_counts_is_found_and_said_where_it_is() -> None:
    clock = SampleClock(RATE)
    for k in range(600):
        lost = 0.5 if k >= 200 else 0.0
        times = clock.times(taken(16), 0.016 * (k + 1) + lost)
        # Each is right at once, the first one after the gap too.
        assert times == pytest.approx(0.016 * k + lost + np.arange(1, 17) / RATE, abs=0.002)
        assert [place for place, _ in clock.breaks] == ([0] if k == 200 else [])
        if k == 200:
            assert clock.breaks[0][1] == pytest.approx(0.5, abs=0.002)
    assert clock.restarted == []


def test_a_gap_behind_a_read_that_may_not_be_all_is_found_later() -> None:
    clock, jumps = SampleClock(RATE), []
    for k in range(600):
        clock.times(taken(16), 0.016 * (k + 1) + (0.5 if k >= 200 else 0.0), read_bytes=4095)
        assert clock.breaks == []
        jumps.append(clock.jumped_s)
    assert sum(j > 0.0 for j in jumps) == 1
    assert max(jumps) == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("split", [0, 5, 15])
@pytest.mark.parametrize("began_s", [3.0, 3000.0])
def test_a_device_clock_that_begins_anew_is_seen_with_the_first_reading(split: int, began_s: float) -> None:
    clock = SampleClock(None)
    for k in range(100):
        clock.times(taken(16, clock=began_s + 0.016 * k), 0.016 * (k + 1))
    # It is away for a second; a read may hold what came before and after.
    device_s = np.concatenate([began_s + 1.6 + np.arange(split) / RATE, np.arange(16 - split) / RATE])
    times = clock.times(samples(np.zeros((16, 6)), device_s=device_s), 2.616)
    assert clock.restarted == [split]
    [(place, lost_s)] = clock.breaks
    assert place == split
    assert lost_s == pytest.approx(times[split] - (times[split - 1] if split else 1.599), abs=0.002)
    assert times[split:] == pytest.approx(2.616 - np.arange(15 - split, -1, -1) / RATE, abs=1e-6)
    assert times[:split] == pytest.approx(1.6 + np.arange(1, split + 1) / RATE, abs=0.002)
    after = clock.times(taken(16, clock=(16 - split) / RATE), 2.632)
    assert clock.breaks == []
    assert after == pytest.approx(2.616 + np.arange(1, 17) / RATE, abs=0.002)


def test_a_clock_that_jumps_ahead_of_the_bytes_that_tell_it_began_anew() -> None:
    # As one of 32 bits of microseconds does, after more than half an hour: its step back looks like one ahead.
    clock = SampleClock(None)
    for k in range(100):
        clock.times(taken(16, clock=0.016 * k), 0.016 * (k + 1))
    times = clock.times(taken(16, clock=1294.0), 2.616)
    assert clock.restarted == [0]
    assert times[-1] == pytest.approx(2.616)


@pytest.mark.parametrize("rate", [RATE, None])
def test_a_counter_that_begins_anew_is_seen_with_the_first_reading(rate: float | None) -> None:
    clock = SampleClock(rate)
    for k in range(100):
        clock.times(taken(16, 16 * k, counted=True), 0.016 * (k + 1))
    times = clock.times(taken(16, 0, counted=True), 2.616)
    assert clock.restarted == [0]
    assert clock.breaks[0][1] == pytest.approx(1.0, abs=0.005)
    assert times == pytest.approx(2.616 - np.arange(15, -1, -1) / RATE, abs=1e-4)


def test_a_datagram_that_was_overtaken_is_no_beginning() -> None:
    clock = SampleClock(RATE)
    for k in (*range(50), 52, 51, *range(53, 90)):
        times = clock.times(taken(1, k, counted=True, clock=k / RATE), 0.001 * (k + 1))
        assert (clock.restarted, clock.breaks) == ([], [])
    assert times[-1] == pytest.approx(0.09, abs=0.003)


def test_where_arrivals_alone_tell_the_time_a_silence_is_a_gap() -> None:
    clock = SampleClock(None)
    for k in range(100):
        clock.times(taken(2), 0.02 * (k + 1))
    times = clock.times(taken(2), 5.0)
    [(place, lost_s)] = clock.breaks
    assert place == 0
    assert lost_s == pytest.approx(2.98, abs=0.001)
    assert times == pytest.approx([4.99, 5.0])
    # Nor is one that is slower from now on a gap each time.
    found = [bool(clock.times(taken(1), 6.0 + k) is not None and clock.breaks) for k in range(30)]
    assert sum(found) <= 2
    # And what waited to be read while the host was held up is none.
    assert clock.times(taken(3), 38.0) == pytest.approx([36.0, 37.0, 38.0], abs=0.05)
    assert clock.breaks == []


def test_a_stalled_host_is_no_gap() -> None:
    clock = SampleClock(RATE)
    for k in range(300):
        clock.times(taken(16), 0.016 * (k + 1))
    # 600 ms nobody reads; then everything is there.
    times = clock.times(taken(600), 4.8 + 0.6)
    assert clock.jumped_s == 0.0
    assert times[-1] == pytest.approx(5.4, abs=0.005)


def test_a_reconnected_device_counts_anew_and_time_goes_on() -> None:
    clock = SampleClock(RATE)
    before = clock.times(taken(100, clock=50.0), 0.1)
    clock.restart()
    after = clock.times(taken(100, clock=0.0), 3.0)
    assert after[0] > before[-1]
    assert after[-1] == pytest.approx(3.0)


def test_without_a_rate_a_burst_is_spread_over_the_wait_for_it() -> None:
    clock = SampleClock(None)
    clock.times(taken(1), 1.0)
    assert clock.times(taken(4), 1.4) == pytest.approx([1.1, 1.2, 1.3, 1.4], abs=1e-5)
