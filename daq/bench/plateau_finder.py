"""Find plateaus in readings as they come: a window that is shown to be steady, after the guard time, without a flag.

The test is made on some fifty block means, which are nearly independent where the readings are not, by equivalence: a
change beyond the tolerance must be ruled out. What is recorded in the end is reduced from the readings themselves.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from daq.cells import at_limit
from daq.recordings.plateaus import LEAST_READINGS, TOLERANCE, Plateau, reduce_window, smallest_step
from daq.recordings.readings import HEADERS
from daq.recordings.windows import Span
from daq.sessions.protocols import Timing

Floats = NDArray[np.float64]

# So many time constants after a change of load a hundredth of it is left.
TIME_CONSTANTS = 5.0
BLOCKS = 48
# A longer silence inside a window may hide a change of load: so many readings, or so long.
GAP_READINGS, GAP_S = 5.0, 0.1
# As in `fingertwin check`: a change of level that is no chance, and of a size that matters.
SHIFT_DEVIATIONS, SHIFT_SHARE = 7.0, 0.5
_MOST_READINGS = 400_000
# Where the readings themselves do not tell which channel it is.
_OVERLOAD = "overload or a status flag"


@dataclass(frozen=True, eq=False)
class PlateauRules:
    """When readings count as a plateau.

    Attributes:
        window_s: least length [s]; most_s: greatest.
        guard_s: waited after each change [s].
        tolerance: (6,) largest change over the window [N, N mm].
        every_s: how often readings are looked at [s].
    """

    window_s: float = 2.0
    most_s: float = 8.0
    guard_s: float = 1.5
    tolerance: Floats = field(default_factory=TOLERANCE.copy)
    every_s: float = 0.2

    @classmethod
    def of(cls, timing: Timing, time_constant_s: float = 0.0) -> Self:
        """Plan windows as long as the protocol's, after its settling time or five time constants of the rig."""
        window = min(timing.load_s, timing.tare_s) - timing.settle_s - timing.guard_s
        return cls(window, max(4.0 * window, 8.0), max(timing.settle_s, TIME_CONSTANTS * time_constant_s))


@dataclass(frozen=True, eq=False)
class Offer:
    """A window that is steady.

    Attributes:
        window_s: its limits, half an interval beyond the outermost readings.
        plateau: of its block means.
    """

    window_s: Span
    plateau: Plateau


class PlateauFinder:
    """Holds the latest readings and looks for a plateau in those since a mark.

    Args:
        rules: when readings count as one.
        full_scale: (6,) of the cell, None where it is not known.

    Attributes:
        offer: what was found and still holds.
        reason: why nothing is found, for the user.
        overloaded: what was at its limit among the readings taken last; nothing where nothing was.
    """

    def __init__(self, rules: PlateauRules, full_scale: Floats | None = None) -> None:
        self._rules = rules
        self._full_scale = np.full(6, np.inf) if full_scale is None else full_scale
        self._held: deque[tuple[Floats, Floats]] = deque()
        self._count = 0
        self._from_s: float | None = None
        self._last_s = -np.inf
        self._interval_s = 0.0
        self._looked_s = -np.inf
        self.offer: Offer | None = None
        self.reason = ""
        self.overloaded = ""

    @property
    def interval_s(self) -> float:
        """Time between readings, 0 before there are any."""
        return self._interval_s

    def restart(self, at_s: float) -> None:
        """Forget what was found, and look from here on."""
        self._from_s, self.offer, self.reason = at_s + self._rules.guard_s, None, "settling"

    def rest(self) -> None:
        """Look for nothing."""
        self._from_s, self.offer, self.reason = None, None, ""

    def take(self, t_s: Floats, wrench: Floats, flagged: NDArray[np.bool_]) -> str | None:
        """Take readings (n,), (n, 6), (n,); return why an offer was withdrawn or readings do not count, else None."""
        if not len(t_s):
            return None
        over = at_limit(wrench, self._full_scale)
        axes = [HEADERS[1 + k][:2] for k in np.flatnonzero(over.any(axis=0))]
        self.overloaded = f"overload of {', '.join(axes)}" if axes else _OVERLOAD if flagged.any() else ""
        lost = self._interrupted(t_s, flagged | over.any(axis=1))
        self._held.append((t_s, wrench))
        self._count += len(t_s)
        self._last_s = float(t_s[-1])
        # Twice the longest window, so that a window being looked at is never cut.
        while len(self._held) > 1 and (
            self._held[0][0][-1] < self._last_s - 2.0 * self._rules.most_s or self._count > _MOST_READINGS
        ):
            self._count -= len(self._held.popleft()[0])
        if self._from_s is not None and self._last_s - self._looked_s >= self._rules.every_s:
            self._looked_s = self._last_s
            lost = self._look(self._from_s) or lost
        return lost

    def readings(self, window_s: Span) -> tuple[Floats, Floats]:
        """Return the readings (n,), (n, 6) of a window."""
        t = np.concatenate([t for t, _ in self._held]) if self._held else np.zeros(0)
        wrench = np.concatenate([w for _, w in self._held]) if self._held else np.zeros((0, 6))
        inside = slice(*np.searchsorted(t, window_s))
        return t[inside], wrench[inside]

    def _interrupted(self, t_s: Floats, flagged: NDArray[np.bool_]) -> str | None:
        """Move the mark behind flags and gaps."""
        steps = np.diff(t_s, prepend=self._last_s if np.isfinite(self._last_s) else t_s[0])
        if len(t_s) > 1:
            self._interval_s = float(np.median(steps[1:]))
        if (steps < 0.0).any():
            # Another time has begun: what is held has no place in it.
            self._held.clear()
            self._count = 0
        gaps = np.flatnonzero((steps > max(GAP_READINGS * self._interval_s, GAP_S)) | (steps < 0.0))
        at, why = None, ""
        if len(gaps):
            at, why = float(t_s[gaps[-1]]), f"no readings for {abs(steps[gaps[-1]]):.2g} s"
        if flagged.any():
            over = float(t_s[np.flatnonzero(flagged)[-1]]) + self._rules.guard_s
            at, why = max(over, at or over), self.overloaded
        if self._from_s is None or at is None or at <= self._from_s:
            return None
        self._from_s, self.reason = at, why
        withdrawn, self.offer = self.offer, None
        return why if withdrawn is not None or flagged.any() else None

    def _look(self, from_s: float) -> str | None:
        rules = self._rules
        if self._last_s - from_s < rules.window_s:
            return None
        if self.offer is not None:
            return self._look_again(self.offer)
        # Noise may hide steadiness in a short window that a longer one shows.
        length = rules.window_s
        while True:
            offer, self.reason = self._judge((self._last_s - length, self._last_s))
            if offer is not None:
                self.offer = offer
                return None
            if self.reason != "noise" or length >= min(rules.most_s, self._last_s - from_s):
                return None
            length = min(2.0 * length, rules.most_s, self._last_s - from_s)

    def _look_again(self, before: Offer) -> str | None:
        """Carry the offer on to now, where it stays steady; withdraw it where it does not."""
        start = max(before.window_s[0], self._last_s - self._rules.most_s)
        offer, why = self._judge((start, self._last_s))
        if offer is not None:
            self.offer = offer
        elif why != "noise":
            self.restart(self._last_s)
            return why
        return None

    def _judge(self, span: Span) -> tuple[Offer | None, str]:
        """Return what a window offers, or why it offers nothing."""
        t, wrench = self.readings((span[0] - 1e-9, span[1] + 1e-9))
        if len(t) < 2 * LEAST_READINGS:
            return None, "too few readings"
        width = max(len(t) // BLOCKS, 1)
        used = slice(len(t) % width, None)
        blocks = wrench[used].reshape(-1, width, 6).mean(axis=1)
        plateau = reduce_window(t[used].reshape(-1, width).mean(axis=1), blocks, tolerance=self._rules.tolerance)
        step = np.abs(plateau.shift)
        scatter = np.median(np.abs(np.diff(blocks, axis=0)), axis=0) / 0.954
        scatter = np.maximum(scatter, smallest_step(wrench.T) / np.sqrt(12.0))
        sudden = plateau.shift_gain > np.maximum((SHIFT_DEVIATIONS * scatter) ** 2, plateau.line_gain)
        sudden &= step > SHIFT_SHARE * self._rules.tolerance
        if sudden.any():
            k = int(np.argmax(np.where(sudden, step / self._rules.tolerance, 0.0)))
            return None, _said("jumps", k, plateau.shift[k])
        if plateau.steady:
            half = 0.5 * self._interval_s
            return Offer((round(float(t[0]) - half, 6), round(float(t[-1]) + half, 6)), plateau), ""
        if plateau.steady is None:
            return None, "noise"
        creep = plateau.slope_per_s * (span[1] - span[0])
        k = int(np.argmax(np.maximum(np.abs(creep), np.abs(plateau.halves)) / self._rules.tolerance))
        return None, _said("creeps", k, creep[k])


def _said(what: str, axis: int, change: float) -> str:
    return f"{HEADERS[axis + 1][:2]} {what} by {change:+.2g} {'N' if axis < 3 else 'N mm'}"
