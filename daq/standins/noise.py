"""Simulated noise of a rig's cell: gauges and electronics, and a zero that drifts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daq.errors import InputError
from daq.standins.base import Floats


@dataclass(frozen=True)
class Disturbance:
    """Disturbance added to readings; 0 is nothing.

    Attributes:
        noise_N: standard deviation of the noise in each force [N].
        noise_Nmm: in each torque [N mm].
        noise_correlation: of the noise in a reading with that in the next, below 1; 0 is white noise.
        drift_N_per_min: of the zero of each force [N/min].
        drift_Nmm_per_min: of the zero of each torque [N mm/min].

    Raises:
        InputError: one is out of its range.
    """

    noise_N: float = 0.0
    noise_Nmm: float = 0.0
    noise_correlation: float = 0.0
    drift_N_per_min: float = 0.0
    drift_Nmm_per_min: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not np.isfinite(value) or (value < 0.0 and not name.startswith("drift")):
                raise InputError(f"{name.replace('_', '-')} is {value:g}", "a number, 0 or more of noise")
        if self.noise_correlation >= 1.0:
            raise InputError(f"noise-correlation is {self.noise_correlation:g}", "0 to below 1")


class Disturber:
    """Adds noise and drift to readings as they come, always the same for one seed, in whatever portions."""

    def __init__(self, disturbance: Disturbance, seed: int = 0) -> None:
        self._sd = np.repeat([disturbance.noise_N, disturbance.noise_Nmm], 3)
        self._drift_per_s = np.repeat([disturbance.drift_N_per_min, disturbance.drift_Nmm_per_min], 3) / 60.0
        self._correlation = disturbance.noise_correlation
        # Another sequence than that of the faults on the wire.
        self._rng = np.random.default_rng((seed, 1))
        self._last = self._rng.normal(size=6)

    def added(self, t_s: Floats) -> Floats:
        """Return the disturbance of the next readings (n, 6) at their times since the start (n,)."""
        drift: Floats = t_s[:, None] * self._drift_per_s
        if not self._sd.any():
            return drift
        return drift + self._sd * self._noise(len(t_s))

    def _noise(self, count: int) -> Floats:
        """Return noise of unit variance (count, 6), autoregressive of first order."""
        white = self._rng.normal(size=(count, 6))
        phi = self._correlation
        if phi == 0.0 or not count:
            return white
        from scipy.signal import lfilter

        before = (phi * self._last)[None, :]
        out: Floats = lfilter([np.sqrt(1.0 - phi**2)], [1.0, -phi], white, axis=0, zi=before)[0]
        self._last = out[-1]
        return out
