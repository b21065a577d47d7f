"""Noise and drift of a stand-in: as large, as correlated and as steep as was asked for, and the same for one seed."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq import drivers, standins
from daq.errors import InputError
from daq.recordings.readings import ReadingBlock
from daq.standins.faults import Faults
from daq.standins.noise import Disturbance, Disturber
from daq.standins.run import Player
from tests.daq.standins.heard import Heard

Floats = NDArray[np.float64]
RATE = 1000.0
LOAD: Floats = np.array([0.0, 0.0, 10.0, 0.0, 0.0, 0.0])


def played(seconds: float, portions: int = 7, **given: Any) -> Floats:
    """What a host reads of ten newtons that rest on a cell, and of nothing else."""
    n = int(seconds * RATE)
    t_s, wrench = 100.0 + np.arange(n) / RATE, np.tile(LOAD, (n, 1))
    cuts = np.linspace(0, n, portions + 1).astype(int)
    blocks = [ReadingBlock(t_s[a:b], wrench[a:b]) for a, b in pairwise(cuts.tolist())]
    device, wire, now = standins.stand_in("gauge-volts")(), Heard(), [0.0]
    player = Player(device, wire, blocks, clock=lambda: now[0], **given)
    while player.turn():
        now[0] += 0.5
    got = drivers.driver("gauge-volts")(device.driver_settings).decoder().feed(b"\n" + wire.data).wrench
    assert len(got) == n
    return got


def lag_one(noise: Floats) -> Floats:
    out: Floats = (noise[1:] * noise[:-1]).sum(axis=0) / (noise**2).sum(axis=0)
    return out


@pytest.mark.parametrize("phi", [0.0, 0.6, 0.95])
def test_noise_is_as_large_and_as_correlated_as_was_asked_for(phi: float) -> None:
    given = Disturbance(noise_N=0.2, noise_Nmm=1.5, noise_correlation=phi)
    noise = played(40.0, disturbance=given, seed=3) - LOAD
    n = len(noise)
    # Correlated readings tell of their variance as so many free ones do; four errors off is one in ten thousand.
    of_variance = n * (1.0 - phi**2) / (1.0 + phi**2)
    error = 4.0 / np.sqrt(2.0 * of_variance)
    assert noise.std(axis=0) / np.repeat([0.2, 1.5], 3) == pytest.approx(1.0, abs=error)
    assert lag_one(noise) == pytest.approx(phi, abs=4.0 * np.sqrt((1.0 - phi**2) / n))
    # No axis knows of another.
    among = np.asarray(np.corrcoef(noise.T))[np.triu_indices(6, 1)]
    assert np.abs(among).max() < 4.5 / np.sqrt(of_variance)


@pytest.mark.parametrize("phi", [0.0, 0.7])
def test_the_spectrum_is_that_of_a_first_order_filter(phi: float) -> None:
    disturber = Disturber(Disturbance(noise_N=1.0, noise_correlation=phi), seed=8)
    n = 1 << 16
    noise = disturber.added(np.arange(n) / RATE)[:, :3]
    power = (np.abs(np.fft.rfft(noise, axis=0)) ** 2 / n)[1:-1]
    w = 2.0 * np.pi * np.arange(1, n // 2) / n
    expected = (1.0 - phi**2) / (1.0 - 2.0 * phi * np.cos(w) + phi**2)
    bands = np.array_split(power.mean(axis=1) / expected, 16)
    # Each band averages 3 × 2047 exponential variables of mean 1.
    error = 4.0 / np.sqrt(3.0 * len(bands[0]))
    assert [b.mean() for b in bands] == pytest.approx([1.0] * 16, abs=error)


def test_drift_is_as_steep_as_was_asked_for() -> None:
    given = Disturbance(noise_N=0.05, noise_Nmm=0.5, drift_N_per_min=0.6, drift_Nmm_per_min=-3.0)
    got = played(30.0, disturbance=given, seed=1)
    t_min = np.arange(len(got)) / RATE / 60.0
    slope, start = np.linalg.lstsq(np.stack([t_min, np.ones(len(t_min))], axis=1), got)[0]
    error = 4.0 * np.repeat([0.05, 0.5], 3) / (t_min.std() * np.sqrt(len(t_min)))
    assert (np.abs(slope - np.repeat([0.6, -3.0], 3)) < error).all()
    # It begins at nothing, whatever the recording's clock says then.
    assert (np.abs(start - LOAD) < error).all()


def test_a_seed_gives_the_same_again_in_whatever_portions_and_another_gives_other_noise() -> None:
    given = Disturbance(noise_N=0.2, noise_correlation=0.5, drift_N_per_min=1.0)
    one, same, other = (played(2.0, k, disturbance=given, seed=s) for k, s in ((1, 5), (9, 5), (1, 6)))
    assert one == pytest.approx(same, abs=1e-4)
    assert np.abs(one - other).std() > 0.1


def test_nothing_is_added_unless_it_is_asked_for_and_a_saturated_axis_stays_so() -> None:
    quiet = played(1.0, disturbance=Disturbance())
    assert (quiet == quiet[0]).all()
    full = played(3.0, disturbance=Disturbance(noise_N=0.2), faults=Faults(saturated_every_s=2.0))
    # The three gauges that see this axis are at their end, with nothing on top.
    assert full[1500:1900, 2].min() > 200.0
    assert np.ptp(full[1500:1900, 2]) < 0.1
    assert np.ptp(full[:900, 2]) > 0.5


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"noise_N": -0.1}, "noise-N is -0.1"),
        ({"noise_Nmm": float("nan")}, "noise-Nmm is nan"),
        ({"noise_correlation": 1.0}, "noise-correlation is 1"),
        ({"drift_N_per_min": float("inf")}, "drift-N-per-min is inf"),
    ],
)
def test_what_is_no_noise_is_said_in_one_line(given: dict[str, float], said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        Disturbance(**given)
    assert "\n" not in str(caught.value)
