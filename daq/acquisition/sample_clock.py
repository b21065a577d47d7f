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
# Later than this, samples were lost that nobody counted: with the first ones after a silence, or for a whole window.
# By as much a device's account may not jump ahead of the bytes that tell it.
LOST_S = 0.25
# A read of this length may be a part of what waits to be read: how late it is tells nothing.
FULL_READ_BYTES = 4000
# A datagram may be overtaken by so many; who counts by more than that from before has begun anew.
OVERTAKEN = 100
# So many samples tell how fast they come, where the device does not.
ENOUGH = 5.0


class SampleClock:
    """Gives samples their time since the stream began [s], ever later.

    Attributes:
        breaks: of the last samples: place and length [s] of each gap that nobody counted.
        restarted: of the last samples: places from which on the device's clock or counter began anew.
        jumped_s: how far time was set forward after them, because some long before are missing; else 0.
        pace: seconds that pass here while the device counts one.
    """

    def __init__(self, rate_hz: float | None, last_s: float = -np.inf, held_back: int = 0) -> None:
        """Start without an origin.

        Args:
            rate_hz: nominal rate of the records; None where the device does not say.
            last_s: time of the last sample of the same stream, where there was one before.
            held_back: samples that come only with the bytes of so many after them.
        """
        self._held_back = held_back
        self._period_s = None if not rate_hz else 1.0 / rate_hz
        self._trend = 1.0
        self._last_s = last_s
        # Where nothing else tells the period: what was waited for how many samples.
        self._waited_s = self._waited_for = 0.0
        self.pace = 1.0
        self.breaks: list[tuple[int, float]] = []
        self.restarted: list[int] = []
        self.jumped_s = 0.0
        self.restart()

    def restart(self) -> None:
        """Forget the device's account, as after a reconnection; the pace is kept, and time goes on."""
        self._known = False
        self._sequence: int | None = None
        self._device_s: float | None = None
        self._arrival_s: float | None = None
        self._window_from_s: float | None = None
        self._least_late_s, self._usual_late_s = np.inf, 0.0
        # Of those that were held back before a silence.
        self._late_ones = 0

    def times(self, samples: Samples, arrival_s: float, read_bytes: int = 0) -> Floats:
        """Return the times (n,) of samples whose last byte arrived now.

        Args:
            samples: (n,) as decoded.
            arrival_s: since the stream began.
            read_bytes: length of the read that completed them.
        """
        self.breaks, self.restarted, self.jumped_s = [], [], 0.0
        if len(samples) == 1 and self._device_s is not None and self._follows(samples, self._device_s):
            return self._alone(samples, self._device_s, arrival_s)
        out, at = np.zeros(len(samples)), 0
        while at < len(out):
            last_s, anew = self._last_s, at in self.restarted
            times = self._part(samples, at, arrival_s, read_bytes < FULL_READ_BYTES)
            if anew:
                self.breaks.append((at, float(times[0]) - last_s))
            out[at : at + len(times)] = times
            at += len(times)
            if at < len(out):
                self.restart()
                self.restarted.append(at)
        if len(out):
            self._arrival_s = arrival_s
        return out

    def _follows(self, samples: Samples, device_s: float) -> bool:
        """Return whether one sample comes next by the device's clock: most datagrams of a fast stream do, one each."""
        if samples.device_s is None or not 0.0 < samples.device_s[0] - device_s <= LOST_S:
            return False
        return samples.sequence is None or self._sequence is None or bool(samples.sequence[0] > self._sequence)

    def _alone(self, samples: Samples, device_s: float, arrival_s: float) -> Floats:
        """Do as `_part` for a single sample, in plain numbers: NumPy's take longer than the datagram."""
        now_s = float(samples.device_s[0]) if samples.device_s is not None else device_s
        told_s = self._last_s + max((now_s - device_s) * self.pace, 1e-6)
        self._last_s = told_s + self._learn(arrival_s, told_s)
        self._device_s, self._arrival_s = now_s, arrival_s
        self._sequence = None if samples.sequence is None else int(samples.sequence[0])
        return np.array([self._last_s])

    def _part(self, samples: Samples, at: int, arrival_s: float, alone: bool) -> Floats:
        """Return times from one sample on, as far as the device's account is unbroken; none where it breaks at once."""
        waited_s = 0.0 if self._arrival_s is None else arrival_s - self._arrival_s
        steps, upto = self._steps(samples, at, waited_s, alone)
        if self._known:
            times = self._last_s + np.cumsum(steps)
            ahead = (steps > LOST_S) & (times > arrival_s + LOST_S)
            times = times[: min(upto, int(np.argmax(ahead)) if ahead.any() else upto)]
            if len(times) == len(steps):
                late_s = arrival_s - float(times[-1]) - self._usual_late_s
                if samples.device_s is None and alone and late_s > LOST_S:
                    # Nothing was waiting to be read but these: the device was silent meanwhile.
                    held = min(max(self._held_back - self._late_ones, 0), len(times))
                    self._late_ones += len(times)
                    if held < len(times):
                        times[held:] += late_s
                        self.breaks.append((at + held, late_s))
                else:
                    self._late_ones = 0
                times += self._learn(arrival_s, float(times[-1]))
        else:
            # The last one was just taken when it arrived, the others before it, but after all that was before.
            steps = steps[:upto]
            behind = steps[1:].sum() - np.concatenate([[0.0], np.cumsum(steps[1:])])
            times = np.maximum(arrival_s - behind, self._last_s + 1e-6 * np.arange(1, len(steps) + 1))
        if len(times):
            end = at + len(times) - 1
            self._known, self._last_s = True, float(times[-1])
            self._sequence = None if samples.sequence is None else int(samples.sequence[end])
            self._device_s = None if samples.device_s is None else float(samples.device_s[end])
        out: Floats = times
        return out

    def _steps(self, samples: Samples, at: int, waited_s: float, alone: bool) -> tuple[Floats, int]:
        """Return each sample's time since the one before [s], by the device's account, and how many are unbroken."""
        upto = len(samples) - at
        units = np.ones(upto)
        counted = samples.device_s if samples.sequence is None else samples.sequence
        if counted is not None:
            last = self._device_s if samples.sequence is None else self._sequence
            units = steps_from(counted[at] if last is None else last, counted[at:]).astype(np.float64)
            back = units < (0.0 if samples.sequence is None else -OVERTAKEN)
            back[0] |= units[0] < 0.0 and waited_s > LOST_S
            upto = int(np.argmax(back)) if back.any() else upto
        if samples.device_s is not None:
            steps = steps_from(
                samples.device_s[at] if self._device_s is None else self._device_s, samples.device_s[at:]
            )
            return np.maximum(steps * self.pace, 1e-6), upto
        units = np.maximum(units, 1.0)
        if self._period_s is not None:
            return units * (self._period_s * self.pace), upto
        return units * self._learnt_s(float(units[:upto].sum()), waited_s, alone), upto

    def _learnt_s(self, count: float, waited_s: float, alone: bool) -> float:
        """Return the duration of a sample [s], learnt from arrivals: they are spread over the wait for them.

        Args:
            count: of samples, lost ones too.
            waited_s: for them; 0 for the first ones.
            alone: whether no more were waiting to be read.
        """
        usual_s = self._waited_s / self._waited_for if self._waited_for >= ENOUGH else None
        if not self._known or count == 0.0 or waited_s <= 0.0:
            return usual_s or 1e-6
        if usual_s is not None and alone and waited_s - count * usual_s > max(LOST_S, 3.0 * usual_s):
            # The device was silent, or is slower now, which the next ones tell.
            self._waited_s = self._waited_for = 0.0
            return usual_s
        self._waited_s, self._waited_for = self._waited_s + waited_s, self._waited_for + count
        if self._waited_s > WINDOW_S and self._waited_for > 2.0 * ENOUGH:
            self._waited_s, self._waited_for = 0.5 * self._waited_s, 0.5 * self._waited_for
        return max(waited_s / count, 1e-6)

    def _learn(self, arrival_s: float, told_s: float) -> float:
        """Correct the pace by how late the least delayed bytes were; return what time must be set forward by."""
        if self._window_from_s is None:
            self._window_from_s = arrival_s
        self._least_late_s = min(self._least_late_s, arrival_s - told_s)
        if arrival_s - self._window_from_s < WINDOW_S:
            return 0.0
        late, self._least_late_s, self._window_from_s = self._least_late_s, np.inf, arrival_s
        self._usual_late_s = 0.0 if late > LOST_S else float(late)
        if late > LOST_S:
            self.jumped_s = float(late)
            return self.jumped_s
        self._trend = float(np.clip(self._trend + FOR_GOOD * late, 1.0 - MOST_OFF_PACE, 1.0 + MOST_OFF_PACE))
        self.pace = float(np.clip(self._trend + AT_ONCE * late, 1.0 - MOST_OFF_PACE, 1.0 + MOST_OFF_PACE))
        return 0.0
