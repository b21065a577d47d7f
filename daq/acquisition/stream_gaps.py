"""Gaps of a stream: by the device's own count, else by the times of its readings, as `check` finds them."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.acquisition.sample_clock import SampleClock
from daq.drivers.base import Samples, steps_from
from daq.recordings.gaps import Gap, GapFinder

Floats = NDArray[np.float64]
# When a gap was [s], and what is told of it.
Told = tuple[float, dict[str, Any]]

# So many gaps and connections are remembered until the times of readings tell of them.
REMEMBERED = 1000


class StreamGaps:
    """Finds the gaps of one stream.

    Where a device counts, times tell only of the first reading of a connection, and of where time was set forward.
    """

    def __init__(self) -> None:
        self._finder = GapFinder()
        self._last_sequence: int | None = None
        self._counts = False
        self._joined_s: deque[float] = deque(maxlen=REMEMBERED)
        self._told_s: deque[float] = deque(maxlen=REMEMBERED)

    def go_on_from(self, last_s: float) -> None:
        """Begin after a reading of the stream that broke off [s]."""
        self._finder.take(np.array([last_s]))

    def reconnected(self) -> None:
        """Forget the device's count: it may begin anew."""
        self._last_sequence = None

    def counted(self, decoded: Samples, times: Floats, clock: SampleClock) -> list[Told]:
        """Return gaps by the device's own count, and where that count or the device's clock began anew.

        Args:
            decoded: samples.
            times: of them (n,) [s].
            clock: that gave these times.
        """
        told: list[Told] = [
            (float(times[at]), {"lost_s": round(lost_s, 4), "counted": False, "restarted": True})
            for at, lost_s in clock.breaks
            if at in clock.restarted
        ]
        self._told_s.extend(at_s for at_s, _ in told)
        if clock.jumped_s:  # which no count tells: the device is slower than its stated rate
            self._joined_s.append(float(times[0]))
        if decoded.sequence is not None:
            if self._last_sequence is None:
                self._counts = True
                self._joined_s.append(float(times[0]))
            before = decoded.sequence[0] - 1 if self._last_sequence is None else self._last_sequence
            missing = steps_from(before, decoded.sequence) - 1
            if clock.restarted:
                missing[clock.restarted] = 0  # a count that begins anew tells nothing of what was lost
            self._last_sequence = int(decoded.sequence[-1])
            told += [
                (float(times[at]), {"lost_samples": int(missing[at]), "counted": True})
                for at in np.flatnonzero(missing > 0)
            ]
        return told

    def timed(self, times: Floats) -> list[Told]:
        """Return gaps that the next times (n,) [s] settle, where the device tells nothing of them."""
        return self._untold(self._finder.take(times))

    def finish(self) -> list[Told]:
        """Return the gaps that are left, once no more readings come."""
        return self._untold(self._finder.finish())

    def _untold(self, gaps: list[Gap]) -> list[Told]:
        untold = [g for g in gaps if (g.end_s in self._joined_s if self._counts else g.end_s not in self._told_s)]
        return [
            (
                g.end_s,
                {
                    "lost_s": round(g.end_s - g.start_s - self._finder.interval_s, 4),
                    "lost_samples": g.lost,
                    "counted": False,
                    "restarted": False,
                },
            )
            for g in untold
        ]
