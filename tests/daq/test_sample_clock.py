"""Times of samples from bursts, wrong rates, counters and gaps."""

from __future__ import annotations

import numpy as np
import pytest

from daq.drivers.base import Samples, samples
from daq.sample_clock import SampleClock

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


def test_a_gap_that_nobody_counts_is_found_and_said() -> None:
    clock, jumps = SampleClock(RATE), []
    for k in range(600):
        lost = 0.5 if k >= 200 else 0.0
        times = clock.times(taken(16), 0.016 * (k + 1) + lost)
        jumps.append(clock.jumped_s)
    assert sum(j > 0.0 for j in jumps) == 1
    assert max(jumps) == pytest.approx(0.5, abs=0.02)
    assert times[-1] == pytest.approx(0.016 * 600 + 0.5, abs=0.01)


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
