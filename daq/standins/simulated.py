"""A simulated load cell: what a real one adds to the wrench on it (noise, quantisation, ringing, drift, saturation)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.recordings.readings import ReadingBlock

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SimulatedCell:
    """Properties of a six-axis cell; six-vectors are Fx Fy Fz [N], Tx Ty Tz [N mm].

    Attributes:
        rate_hz: of the readings.
        noise_sd: white noise of one reading.
        noise_correlation: lag-one correlation of that noise (electronics and filters; 0 is white).
        resolution: step of the converter, 0 for none.
        full_scale: readings clip here.
        ringing_hz: of the clamp and weight after a change of load.
        ringing_decay_s: time constant of the ringing.
        ringing_share: its amplitude as a share of the change.
        drift_per_sqrt_hour: random walk of the zero.
    """

    rate_hz: float = 1000.0
    noise_sd: tuple[float, ...] = (0.03, 0.03, 0.03, 0.2, 0.2, 0.2)
    noise_correlation: float = 0.0
    resolution: tuple[float, ...] = (1 / 160, 1 / 160, 1 / 160, 1 / 32, 1 / 32, 1 / 32)
    full_scale: tuple[float, ...] = (25.0, 25.0, 35.0, 250.0, 250.0, 250.0)
    ringing_hz: float = 6.0
    ringing_decay_s: float = 0.25
    ringing_share: float = 0.15
    drift_per_sqrt_hour: tuple[float, ...] = (0.01, 0.01, 0.01, 0.05, 0.05, 0.05)


@dataclass(frozen=True)
class LoadStep:
    """From `start_s` on, this wrench rests on the cell (in the cell's axes; N, N mm)."""

    start_s: float
    wrench: Floats


def readings(
    cell: SimulatedCell, steps: Sequence[LoadStep], end_s: float, seed: int, block_s: float = 60.0
) -> Iterator[ReadingBlock]:
    """Yield what the cell reports while the load steps follow each other, in blocks of bounded size.

    Args:
        cell: its properties.
        steps: in order of time; the first one starts at 0.
        end_s: length of the record.
        seed: of the noise and the drift.
        block_s: length of one block.
    """
    rng = np.random.default_rng(seed)
    starts = np.array([s.start_s for s in steps])
    wrenches = np.array([s.wrench for s in steps])
    jumps = np.diff(wrenches, axis=0, prepend=wrenches[:1])
    noise_sd, resolution = np.array(cell.noise_sd), np.array(cell.resolution)
    full_scale, drift_rate = np.array(cell.full_scale), np.array(cell.drift_per_sqrt_hour) / 60.0
    phi = cell.noise_correlation
    last_noise, drift = rng.normal(size=6) * noise_sd, np.zeros(6)
    total = round(end_s * cell.rate_hz)
    per_block = max(round(block_s * cell.rate_hz), 1)
    for first in range(0, total, per_block):
        n = min(per_block, total - first)
        t = (first + np.arange(n)) / cell.rate_hz
        at = np.searchsorted(starts, t, side="right") - 1
        since = t - starts[at]
        ringing = np.exp(-since / cell.ringing_decay_s) * np.cos(2 * np.pi * cell.ringing_hz * since)
        signal = wrenches[at] - cell.ringing_share * ringing[:, None] * jumps[at]
        walk = drift + np.cumsum(rng.normal(size=(n, 6)) * drift_rate / np.sqrt(cell.rate_hz), axis=0)
        drift = walk[-1]
        noise = _autoregressive(rng.normal(size=(n, 6)) * noise_sd, phi, last_noise)
        last_noise = noise[-1]
        signal = np.clip(signal + walk + noise, -full_scale, full_scale)
        quantised = np.where(
            resolution > 0, np.round(signal / np.where(resolution > 0, resolution, 1.0)) * resolution, signal
        )
        yield ReadingBlock(t_s=t, wrench=quantised, status=None)


def _autoregressive(white: Floats, phi: float, before: Floats) -> Floats:
    """Return first-order autoregressive noise with the variance of the white noise it is made of."""
    if phi == 0.0:
        return white
    from scipy.signal import lfilter

    gain = np.sqrt(1.0 - phi**2)
    out: Floats = lfilter([gain], [1.0, -phi], white, axis=0, zi=(phi * before)[None, :])[0]
    return out
