"""The least and the greatest readings of each stretch of a recording, which is gone through once and never held."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Of a recording, more than there are columns of pixels; as soon as there are so many, each two become one.
STRETCHES = 3000


class Envelope:
    """Channels over time, each by the least and the greatest value of some thousand stretches.

    Attributes:
        readings: that were taken so far.
        lows: (k,) least values; highs: (k,) greatest.
    """

    def __init__(self, channels: int) -> None:
        self.readings = 0
        self.lows, self.highs = np.full(channels, np.inf), np.full(channels, -np.inf)
        self._width = 1
        # Of each whole stretch (n, 2, k), the least first: number of the reading, its time and its value.
        self._picks = np.empty((3, 0, 2, channels))
        self._rest: tuple[Floats, Floats] = np.empty(0), np.empty((0, channels))

    def add(self, t: Floats, values: Floats) -> None:
        """Take the next readings: times (n,) and channels (n, k)."""
        self.readings += len(t)
        self.lows = np.minimum(self.lows, values.min(axis=0, initial=np.inf))
        self.highs = np.maximum(self.highs, values.max(axis=0, initial=-np.inf))
        t, values = np.concatenate([self._rest[0], t]), np.concatenate([self._rest[1], values])
        first = self.readings - len(t)
        while len(t) >= self._width:
            count = min(len(t) // self._width, STRETCHES - self._picks.shape[1])
            taken = count * self._width
            self._picks = np.concatenate([self._picks, _stretches(first, t[:taken], values[:taken], count)], axis=1)
            first, t, values = first + taken, t[taken:], values[taken:]
            if self._picks.shape[1] == STRETCHES:
                self._picks, self._width = _paired(self._picks), 2 * self._width
        self._rest = t.copy(), values.copy()

    def lines(self) -> tuple[tuple[Floats, Floats], ...]:
        """Return each channel's times (n,) and values (n,), some thousands: all of them where they are few."""
        t, values = self._rest
        last = _stretches(self.readings - len(t), t, values, 1) if len(t) else self._picks[:, :0]
        picks = np.concatenate([self._picks, last], axis=1)
        flat = picks.reshape(3, -1, picks.shape[-1])
        out = []
        for channel in range(flat.shape[-1]):
            _, places = np.unique(flat[0, :, channel], return_index=True)
            out.append((flat[1, places, channel], flat[2, places, channel]))
        return tuple(out)


def _stretches(first: int, t: Floats, values: Floats, count: int) -> Floats:
    """Return the picks (3, count, 2, k) of readings in so many stretches of equal length."""
    width, channels = len(t) // count, values.shape[1]
    blocks = values.reshape(count, width, channels)
    rows = np.stack([blocks.argmin(axis=1), blocks.argmax(axis=1)], axis=1) + np.arange(count)[:, None, None] * width
    return np.stack([first + rows.astype(np.float64), t[rows], np.take_along_axis(values, rows.reshape(-1, channels), 0)
                     .reshape(rows.shape)])  # fmt: skip


def _paired(picks: Floats) -> Floats:
    """Return picks (3, n/2, 2, k) of stretches twice as long, of an even number of them."""
    lows, highs = picks[:, :, 0].reshape(3, -1, 2, picks.shape[-1]), picks[:, :, 1].reshape(3, -1, 2, picks.shape[-1])
    low = np.take_along_axis(lows, lows[2].argmin(axis=1)[None, :, None], 2)
    high = np.take_along_axis(highs, highs[2].argmax(axis=1)[None, :, None], 2)
    return np.concatenate([low, high], axis=2)
