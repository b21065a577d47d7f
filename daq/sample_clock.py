"""When each sample was taken, told from the device's clock or counter and from when its bytes arrived.

Bytes arrive late and in bursts (an FTDI adapter holds them back for up to 16 ms), never early. So samples are spaced by
the device's own account, and only the pace and the origin of that account are learnt from arrivals: the earliest ones.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daq.drivers.base import Samples, steps_from

Floats = NDArray[np.float64]

# The least delayed arrival of so many seconds tells where the account stands.
WINDOW_S = 2.0
# What a lateness of a second changes the pace by at once, and for good with every window.
AT_ONCE, FOR_GOOD = 0.1, 0.01
# How far the pace may leave the device's own: quartz is a thousand times better, nominal rates are not.
MOST_OFF_PACE = 0.02
# Later than this through a whole window: samples were lost that nobody counted, or the device's clock was set anew.
LOST_S = 0.25


class SampleClock:
    """Gives samples their time since the stream began [s], ever later.

    Attributes:
        jumped_s: how far time was set forward with the last samples, because some before them are missing; else 0.
        pace: seconds that pass here while the device counts one.
    """

    def __init__(self, rate_hz: float | None, last_s: float = -np.inf) -> None:
        """Start without an origin.

        Args:
            rate_hz: nominal rate of the records; None where the device does not say.
            last_s: time of the last sample of the same stream, where there was one before.
        """
        self._period_s = None if not rate_hz else 1.0 / rate_hz
        self._trend = 1.0
        self._last_s = last_s
        self.pace = 1.0
        self.jumped_s = 0.0
        self.restart()

    def restart(self) -> None:
        """Forget the device's account, as after a reconnection; the pace is kept, and time goes on."""
        self._account_s: float | None = None
        self._sequence: int | None = None
        self._device_s: float | None = None
        self._arrival_s: float | None = None
        self._window_from_s: float | None = None
        self._least_late_s = np.inf

    def times(self, samples: Samples, arrival_s: float) -> Floats:
        """Return the times (n,) of samples whose last byte arrived now.

        Args:
            samples: (n,) as decoded.
            arrival_s: since the stream began.
        """
        self.jumped_s = 0.0
        if len(samples) == 0:
            return np.zeros(0)
        steps = self._steps(samples, arrival_s)
        if self._account_s is None:
            # The last one was just taken when it arrived, the others before it, but after all that was before.
            behind = steps[1:].sum() - np.concatenate([[0.0], np.cumsum(steps[1:])])
            times = np.maximum(arrival_s - behind, self._last_s + 1e-6 * np.arange(1, len(steps) + 1))
        else:
            times = self._last_s + np.cumsum(steps * self.pace)
            times = times + self._learn(arrival_s, float(times[-1]))
        self._account_s = (self._account_s or 0.0) + float(steps.sum())
        self._last_s, self._arrival_s = float(times[-1]), arrival_s
        out: Floats = times
        return out

    def _steps(self, samples: Samples, arrival_s: float) -> Floats:
        """Time of each sample since the one before (n,), by the device's own account [s]."""
        if samples.device_s is not None:
            before = samples.device_s[0] if self._device_s is None else self._device_s
            self._device_s = float(samples.device_s[-1])
            return np.maximum(steps_from(before, samples.device_s), 1e-6)
        if self._period_s is None:
            # Nothing is known but when this burst arrived, and the one before.
            waited = 0.0 if self._arrival_s is None else arrival_s - self._arrival_s
            return np.full(len(samples), max(waited / len(samples), 1e-6))
        if samples.sequence is None:
            return np.full(len(samples), self._period_s)
        first = samples.sequence[0] - 1 if self._sequence is None else self._sequence
        self._sequence = int(samples.sequence[-1])
        return np.maximum(steps_from(first, samples.sequence), 1) * self._period_s

    def _learn(self, arrival_s: float, told_s: float) -> float:
        """Correct the pace by how late the least delayed bytes were; return what time must be set forward by."""
        if self._window_from_s is None:
            self._window_from_s = arrival_s
        self._least_late_s = min(self._least_late_s, arrival_s - told_s)
        if arrival_s - self._window_from_s < WINDOW_S:
            return 0.0
        late, self._least_late_s, self._window_from_s = self._least_late_s, np.inf, arrival_s
        if late > LOST_S:
            self.jumped_s = float(late)
            return self.jumped_s
        self._trend = float(np.clip(self._trend + FOR_GOOD * late, 1.0 - MOST_OFF_PACE, 1.0 + MOST_OFF_PACE))
        self.pace = float(np.clip(self._trend + AT_ONCE * late, 1.0 - MOST_OFF_PACE, 1.0 + MOST_OFF_PACE))
        return 0.0
