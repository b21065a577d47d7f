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
# So many readings on each side, and of so long, tell how much time is missing: a busy machine delays them by less.
AROUND, AROUND_S = 24, 0.25
# So few are enough where all are evenly spaced.
NEAR = 4
# Late ones follow each other faster than usual: in less than this share of the usual time.
CATCHING_UP = 0.5
# The usual interval of late readings is known within this share.
PACE_OFF = 0.05
# So many readings tell the usual interval; a recording of fewer than these is not judged.
LEARNT_FROM, ENOUGH, FEW = 1000, 20, 5
# It is the median where this share of intervals are multiples of it within this tolerance; else the mean over so many.
EVEN_SHARE, EVEN, SPAN, SPAN_OFF = 0.75, 0.1, 100, 0.25
# The same tolerance where the mean is longer than that, as where many readings are lost.
EXACT = 0.01


class Gap(NamedTuple):
    """Limits of a gap [s]: the last reading before it and the first after it; and how many readings are missing."""

    start_s: float
    end_s: float
    lost: int


class GapFinder:
    """Takes the times of a recording in order, and finds the gaps in them.

    A wide interval is judged by the readings around it. Where those after it make up for the time, none is missing.

    Args:
        stated_hz: rate at which readings should come, None where it is not known.

    Attributes:
        interval_s: usual time between readings [s], NaN before it is known.
        late: wide intervals so far in which no reading is missing.
    """

    def __init__(self, stated_hz: float | None = None) -> None:
        self.interval_s = np.nan
        self.late = 0
        self._stated_s = 1.0 / stated_hz if stated_hz else np.nan
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
        if len(t) < FEW:
            return out
        steps = np.diff(t)
        self.interval_s, evenly = _usual(t, steps, self._stated_s)
        upto = len(t)
        if self.interval_s > 0.0:
            around = max(AROUND, int(AROUND_S / self.interval_s))
            even = np.abs(steps - self.interval_s) <= EVEN * self.interval_s if evenly else None
            # By how much each reading comes later than after as many usual intervals.
            late_s = t - self.interval_s * np.arange(len(t))
            wide = np.flatnonzero(steps[self._judged - 1 :] > GAP_INTERVALS * self.interval_s) + self._judged
            for i in wide.tolist():
                missing_s = self._missing_s(late_s, even, i, around, ended=ended)
                if missing_s is None:
                    upto = i
                    break
                lost = int(missing_s / self.interval_s + 1.0 - MISSING)
                if lost > 0:
                    out.append(Gap(float(t[i - 1]), float(t[i]), lost))
                    self._since = i
                else:
                    self.late += 1
            dropped = min(upto - around - 1, len(t) - LEARNT_FROM)
        else:
            dropped = len(t) - LEARNT_FROM
        dropped = max(dropped, 0)
        self._held, self._judged, self._since = t[dropped:], upto - dropped, max(self._since - dropped, 0)
        return out

    def _missing_s(
        self, late_s: Floats, even: NDArray[np.bool_] | None, i: int, around: int, *, ended: bool
    ) -> float | None:
        """Return how much time is missing before reading i [s]; 0 where it may be late alone, None where none can tell.

        Args:
            late_s: by how much each reading comes later than after as many usual intervals (n,) [s].
            even: which steps are the usual interval (n - 1,); None where the times are not even.
            i: the first reading after a wide interval.
            around: readings on each side that tell.
            ended: whether no more readings come.
        """
        near = () if even is None else (*even[max(i - 1 - NEAR, self._since) : i - 1], *even[i : i + NEAR])
        if even is not None and i + NEAR < len(late_s) and all(near):
            # Even times need no others; a pace that is a little off would count with more of them.
            return float(late_s[i] - late_s[i - 1])
        after = self._after(late_s, i, around, ended=ended)
        if after is None:
            return None
        before, (after_s, caught_up_s) = late_s[max(i - around, self._since) : i], after
        missing_s = after_s - float(before.min())
        # As much as readings come late anyway may be more of that: a machine is busy for a while.
        return missing_s if missing_s >= max(float(np.ptp(before)), PACE_OFF * caught_up_s) else 0.0

    def _after(self, late_s: Floats, i: int, around: int, *, ended: bool) -> tuple[float, float] | None:
        """Return how late the readings from i on are at least [s], once they come at the usual pace; else None.

        Beside it is how long [s] the readings were taken for which came faster until then.
        """
        at, last, slow_s = i, len(late_s) - 1, CATCHING_UP * self.interval_s
        while at + around <= last:
            end = at + around
            if late_s[at] - late_s[end] <= around * slow_s:
                return float(late_s[i : end + 1].min()), (at - i) * self.interval_s
            at = end
        if not ended:
            return None
        # Readings that were still catching up when the recording ended tell of nothing that is missing.
        still = late_s[at] - late_s[last] > (last - at) * slow_s
        return -np.inf if still else float(late_s[i:].min()), (at - i) * self.interval_s


def _usual(t_s: Floats, steps: Floats, stated_s: float) -> tuple[float, bool]:
    """Return the usual interval [s] of times (n,) with n - 1 steps between them, and whether they are even."""
    middle = float(np.median(steps))
    if len(t_s) < ENOUGH:
        return middle, True
    # Of a recording of the windows alone most intervals are as stated, and none of the pauses is.
    if abs(middle - stated_s) <= EVEN * stated_s and np.mean(np.abs(steps - middle) <= EVEN * middle) >= EVEN_SHARE:
        return middle, True
    count = min(SPAN, len(t_s) // 2)
    spans = t_s[count:] - t_s[:-count]
    # Spans that hold a long gap, or many readings that came late together, tell nothing of the pace.
    usual = np.quantile(spans, 0.5, method="lower")
    mean = float(spans[np.abs(spans - usual) <= SPAN_OFF * usual].mean()) / count
    # Even times are multiples of one interval. So are those that a timer makes of another pace, or a burst of late
    # readings, but less exactly; and that interval is shorter than the mean.
    multiples = np.maximum(np.rint(steps / middle), 1.0) if middle > 0.0 else np.inf
    off = np.abs(steps - multiples * middle)
    within = EVEN if mean <= (1.0 + EVEN) * middle else EXACT
    alike = np.count_nonzero(off <= within * middle)
    even = bool(alike >= EVEN_SHARE * len(steps) and mean < 2.0 * middle)
    return (middle, True) if even else (mean, False)
