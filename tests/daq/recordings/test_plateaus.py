from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from daq.recordings.plateaus import (
    Plateau,
    largest_shift,
    quantisation_variance,
    reduce_window,
    smallest_step,
    variance_of_mean,
)
from tests.daq.benches import Floats


def autoregression(phi: float, n: int, channels: int, rng: np.random.Generator) -> Floats:
    """(channels, n) of unit variance."""
    noise = rng.normal(size=(channels, n + 300))
    out: Floats = lfilter([1.0], [1.0, -phi], noise, axis=1)[:, 300:] * np.sqrt(1.0 - phi**2)
    return out


def window(y: Floats, dt: float = 0.01) -> Plateau:
    t_s: Floats = np.arange(y.shape[1], dtype=float) * dt
    return reduce_window(t_s, np.ascontiguousarray(y.T))


@pytest.mark.parametrize("phi", [0.0, 0.6, 0.9])
@pytest.mark.parametrize(("n", "windows"), [(80, 400), (300, 300), (3000, 150)])
def test_the_interval_covers_the_truth(phi: float, n: int, windows: int) -> None:
    rng = np.random.default_rng(7)
    inside = 0
    for _ in range(windows):
        low, high = window(autoregression(phi, n, 6, rng)).interval()
        inside += int(((low < 0.0) & (high > 0.0)).sum())
    share, tries = inside / (6 * windows), 6 * windows
    chance = 2.0 * np.sqrt(0.95 * 0.05 / tries)
    assert 0.93 - chance < share < 0.97 + chance


@pytest.mark.parametrize(("phi", "tau"), [(0.0, 1.0), (0.6, 4.0), (0.9, 19.0)])
def test_effective_number_of_a_long_autoregression(phi: float, tau: float) -> None:
    y = autoregression(phi, 200_000, 6, np.random.default_rng(3))
    variance, time = variance_of_mean(y - y.mean(axis=1, keepdims=True))
    np.testing.assert_allclose(time, tau, rtol=0.15)
    assert np.all(variance >= 0.8 * tau / 200_000)


def test_correlation_between_axes_is_kept() -> None:
    rng = np.random.default_rng(5)
    common = autoregression(0.5, 4000, 1, rng)
    y = autoregression(0.5, 4000, 6, rng) + 2.0 * common
    C = window(y).covariance
    sd = np.sqrt(np.diag(C))
    np.testing.assert_allclose((C / np.outer(sd, sd))[np.triu_indices(6, 1)], 0.8, atol=0.05)
    assert np.linalg.eigvalsh(C).min() > 0.0


def test_the_covariance_is_positive_definite_whatever_the_readings() -> None:
    rng = np.random.default_rng(0)
    constant = np.full((6, 50), 3.0)
    same = np.repeat(rng.normal(size=(1, 50)), 6, axis=0)
    some = np.where(np.arange(6)[:, None] < 3, constant, same)
    for y in (constant, same, some, np.round(same), rng.normal(size=(6, 5))):
        C = window(y).covariance
        np.linalg.cholesky(C)
        np.testing.assert_allclose(C, C.T)


def test_steps_are_seen_and_rounding_counts_only_where_noise_does_not_spread_it() -> None:
    rng = np.random.default_rng(2)
    step = np.array([1 / 160] * 3 + [1 / 32] * 3)
    y = np.round(rng.normal(size=(6, 500)) * 0.03 / step[:, None]) * step[:, None]
    np.testing.assert_allclose(smallest_step(y), step, rtol=1e-6)
    np.testing.assert_allclose(smallest_step(np.ones((6, 10))), 0.0)
    undithered = quantisation_variance(step, np.zeros(6))
    np.testing.assert_allclose(undithered, step**2 / 12.0, rtol=0.03)
    # Widrow: beyond half a step of noise nothing is left to speak of.
    assert np.all(quantisation_variance(step, 0.7 * step) < 0.001 * step**2)


def test_rounding_errors_of_means_are_as_large_as_said() -> None:
    rng = np.random.default_rng(11)
    for sd in (0.05, 0.2, 0.3):
        levels = rng.uniform(0, 1, 2000)
        means = np.array([np.round(x + sd * rng.normal(size=2000)).mean() - x for x in levels])
        # What remains after the sampling noise of the mean, which the plateau counts apart.
        rounded_sd = np.sqrt(sd**2 + 1 / 12)
        expected = float(quantisation_variance(np.array([1.0]), np.array([rounded_sd]))[0])
        assert means.var() - sd**2 / 2000 == pytest.approx(expected, rel=0.15, abs=3e-4)


def test_creep_is_reported_with_its_uncertainty() -> None:
    rng = np.random.default_rng(4)
    t: Floats = np.arange(1000, dtype=float) * 0.01
    slope = np.array([0.1, -0.05, 0.0, 0.0, 0.0, 2.0])
    misses = []
    for _ in range(200):
        y = slope[:, None] * t + 0.05 * autoregression(0.6, 1000, 6, rng)
        p = reduce_window(t, y.T)
        misses.append((p.slope_per_s - slope) / p.slope_sd_per_s)
    assert np.std(misses) == pytest.approx(1.0, abs=0.12)


@pytest.mark.parametrize(
    ("creep_N", "noise_N", "steady"),
    [(0.0, 0.02, True), (0.05, 0.02, True), (0.5, 0.02, False), (0.0, 0.8, None), (0.15, 0.15, None)],
)
def test_steadiness_is_shown_refuted_or_open(creep_N: float, noise_N: float, steady: bool | None) -> None:
    rng = np.random.default_rng(1)
    t = np.linspace(0, 4, 200)
    y = noise_N * rng.normal(size=(6, 200))
    y[0] += creep_N * t / 4
    assert reduce_window(t, y.T).steady is steady
    assert reduce_window(t, y.T, flagged=1).steady is False


def test_a_bend_that_a_line_does_not_see_is_not_steady() -> None:
    t = np.linspace(0, 4, 400)
    y = 0.01 * np.random.default_rng(1).normal(size=(6, 400))
    y[1, 200:] += 0.4
    p = reduce_window(t, y.T)
    assert p.steady is False
    assert p.shift[1] == pytest.approx(0.4, abs=0.01)
    assert p.shift_gain[1] > p.line_gain[1]


def test_the_largest_shift_is_found_where_it_is() -> None:
    y = np.zeros((2, 100))
    y[0, 30:] = 2.0
    y[1, 95:] = -1.0
    centred = y - y.mean(axis=1, keepdims=True)
    shift, gain, course = largest_shift(centred)
    np.testing.assert_allclose(course, centred, atol=1e-12)
    np.testing.assert_allclose(shift, [2.0, -1.0])
    np.testing.assert_allclose(gain, [4.0 * 30 * 70 / 100, 95 * 5 / 100])


def test_too_few_readings() -> None:
    with pytest.raises(ValueError, match="4 readings"):
        window(np.zeros((6, 4)))
