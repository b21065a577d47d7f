"""Find where readings are missing from a recording, by their times alone. A reading that comes late is not missing.

The bench and `check` use the same rule, so that both count the same gaps in one recording.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# An interval of twice the usual one may have lost a reading; jitter of the clock stays below.
GAP_INTERVALS = 1.8
# A reading is missing where at least this share of an interval is not made up for.
MISSING = 0.7
# So many readings on each side tell how much time is missing; late ones follow each other faster than usual.
AROUND = 24
# So few are enough where they are evenly spaced.
NEAR = 4
CATCHING_UP = 0.5
# So many readings tell the usual interval.
LEARNT_FROM, ENOUGH = 1000, 20
# It is the median where this share of intervals is as long within this tolerance; else the mean over so many readings.
EVEN_SHARE, EVEN, SPAN, MOST_SPAN = 0.6, 0.1, 100, 1.25


class Gap(NamedTuple):
    """Limits of a gap [s]: the last reading before it and the first after it; and how many readings are missing."""

    start_s: float
    end_s: float
    lost: int


class GapFinder:
    """Takes the times of a recording in order, and finds the gaps in them.

    A wide interval is judged by the readings around it. Where those after it make up for the time, none is missing.

    Attributes:
        interval_s: usual time between readings [s], NaN before it is known.
        late: wide intervals so far in which no reading is missing.
    """

    def __init__(self) -> None:
        self.interval_s = np.nan
        self.late = 0
        self._held = np.zeros(0)
        # Places in what is held: of the first reading that is not judged, and of the first one after the last gap.
        self._judged, self._since = 1, 0

    def take(self, t_s: Floats) -> list[Gap]:
        """Take the next times (n,) [s]; return the gaps that they settle."""
        self._held = np.concatenate([self._held, t_s])
        return self._judge(ended=False) if len(self._held) >= ENOUGH else []

    def finish(self) -> list[Gap]:
        """Return the gaps that are left, once no more readings come."""
        return self._judge(ended=True)

    def _judge(self, *, ended: bool) -> list[Gap]:
        t, out = self._held, list[Gap]()
        if len(t) < 2:
            return out
        steps = np.diff(t)
        self.interval_s = _usual(t, steps)
        upto = len(t)
        if self.interval_s > 0.0:
            even = np.abs(steps - self.interval_s) <= EVEN * self.interval_s
            # By how much each reading comes later than after as many usual intervals.
            late_s = t - self.interval_s * np.arange(len(t))
            wide = np.flatnonzero(steps[self._judged - 1 :] > GAP_INTERVALS * self.interval_s) + self._judged
            for i in wide.tolist():
                if (
                    i + NEAR < len(t)
                    and even[max(i - 1 - NEAR, self._since) : i - 1].all()
                    and even[i : i + NEAR].all()
                ):
                    # Even times need no others; a pace that is a little off would count with more of them.
                    missing_s = steps[i - 1] - self.interval_s
                elif (after_s := self._after(late_s, i, ended=ended)) is not None:
                    missing_s = after_s - late_s[max(i - AROUND, self._since) : i].min()
                else:
                    upto = i
                    break
                lost = int(max(missing_s, 0.0) / self.interval_s + 1.0 - MISSING)
                if lost > 0:
                    out.append(Gap(float(t[i - 1]), float(t[i]), lost))
                    self._since = i
                else:
                    self.late += 1
        dropped = max(min(upto - AROUND - 1, len(t) - LEARNT_FROM), 0)
        self._held, self._judged, self._since = t[dropped:], upto - dropped, max(self._since - dropped, 0)
        return out

    def _after(self, late_s: Floats, i: int, *, ended: bool) -> float | None:
        """Return how late the readings from i on are at least [s], once they come at the usual pace; else None."""
        at, last = i, len(late_s) - 1
        while at + AROUND <= last:
            end = at + AROUND
            if late_s[at] - late_s[end] <= CATCHING_UP * AROUND * self.interval_s:
                return float(late_s[i : end + 1].min())
            at = end
        if not ended:
            return None
        # Readings that were still catching up when the recording ended tell of nothing that is missing.
        still = late_s[at] - late_s[last] > CATCHING_UP * (last - at) * self.interval_s
        return -np.inf if still else float(late_s[i:].min())


def _usual(t_s: Floats, steps: Floats) -> float:
    """Return the usual interval of times (n,) with n - 1 steps between them [s]."""
    count = min(SPAN, len(t_s) // 2)
    middle, spans = float(np.median(steps)), t_s[count:] - t_s[:-count]
    # Spans that hold a long gap tell nothing of the pace.
    mean = float(spans[spans <= MOST_SPAN * np.median(spans)].mean()) / count
    # Within a burst of late readings all intervals are alike too, and far shorter than the mean.
    even = np.count_nonzero(np.abs(steps - middle) <= EVEN * middle) >= EVEN_SHARE * len(steps) and mean < 2.0 * middle
    return middle if even else mean
