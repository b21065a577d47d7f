"""Plateaus of a recording that nobody marked: where it holds still, without what settles after a change of load."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.recordings.plateaus import LEAST_READINGS, TOLERANCE, Plateau, reduce_window
from daq.recordings.readings import ReadingBlock
from daq.recordings.windows import Span

Floats = NDArray[np.float64]

# Readings are looked at in means of so long, a change of load is waited out for so long, and a plateau is no shorter.
BLOCK_S, GUARD_S, SHORTEST_S = 0.1, 0.3, 1.0
# A level ends beyond so many deviations of the block means, and beyond this share of the tolerance.
_DEVIATIONS, _SHARE = 6.0, 0.25
# A change inside it counts from so many deviations on, if the blocks beside it show this share of it.
_STEP_DEVIATIONS, _SUDDEN, _BESIDE = 6.0, 0.6, 5
# Intervals of which the median is taken.
_MOST_INTERVALS = 1 << 17
# Values of which the interval is told where the readings are gone through once, and values of means that are held.
_FIRST_VALUES, _MOST_MEANS = 1 << 20, 1 << 22
# A plateau of more readings is reduced to its middle ones.
_MOST_READINGS = 1 << 20


@dataclass(frozen=True, eq=False)
class Level:
    """A plateau: its window [s], and its readings reduced."""

    window_s: Span
    plateau: Plateau


def find_levels(readings: Iterable[ReadingBlock]) -> tuple[Level, ...]:
    """Find the plateaus of readings, in order of time.

    Args:
        readings: blocks whose times do not decrease. They are gone through three times, and a plateau's are held, or
            its middle million.
    """
    interval_s = _median_interval(block.t_s for block in readings)
    width = _width(interval_s)
    if not width:
        return ()
    means = _Means(width, interval_s)
    for block in readings:
        means.add(block.t_s, block.wrench)
    longest_s = _MOST_READINGS * interval_s
    return tuple(_reduced(readings, [_middle(span, longest_s) for span in means.still(TOLERANCE)]))


class StillSpans:
    """Spans in which no channel leaves its level, of readings that come once and in blocks.

    The interval between readings is that of the first some ten thousand of them.
    """

    def __init__(self) -> None:
        self._first: list[tuple[Floats, Floats]] = []
        self._values = 0
        self._means: _Means | None = None
        self._begun = False

    def add(self, t_s: Floats, values: Floats) -> None:
        """Take the next readings: times (n,) [s], which do not decrease, and channels (n, k)."""
        if self._begun:
            if self._means is not None:
                self._means.add(t_s, values)
            return
        self._first.append((t_s, values))
        self._values += values.size
        if self._values > _FIRST_VALUES:
            self._begin()

    def spans(self, tolerance: Floats) -> list[Span]:
        """Return the spans [s]; a quarter of the tolerance (k,) is no change of level, however small the noise.

        A channel whose tolerance is 0 never changes, and is not looked at.
        """
        if not self._begun:
            self._begin()
        return [] if self._means is None else self._means.still(tolerance)

    def _begin(self) -> None:
        interval_s = _median_interval(t_s for t_s, _ in self._first)
        self._begun = True
        if width := _width(interval_s):
            self._means = _Means(width, interval_s)
            for t_s, values in self._first:
                self._means.add(t_s, values)
        self._first = []


class _Means:
    """Means of so many readings each; of twice as many as soon as there would be too many means to hold."""

    def __init__(self, width: int, interval_s: float) -> None:
        self._width, self._interval_s = width, interval_s
        self._begins: list[Floats] = []
        self._blocks: list[Floats] = []
        self._count = 0
        self._rest: tuple[Floats, Floats] | None = None

    def add(self, t_s: Floats, values: Floats) -> None:
        """Take the next readings: times (n,) [s] and channels (n, k)."""
        if self._rest is not None:
            t_s, values = np.concatenate([self._rest[0], t_s]), np.concatenate([self._rest[1], values])
        whole = len(t_s) // self._width * self._width
        self._begins.append(t_s[: whole : self._width].copy())
        self._blocks.append(values[:whole].reshape(-1, self._width, values.shape[1]).mean(axis=1))
        self._count += len(self._begins[-1])
        self._rest = t_s[whole:].copy(), values[whole:].copy()
        if self._count * values.shape[1] > _MOST_MEANS:
            self._halve()

    def _halve(self) -> None:
        begins, blocks = np.concatenate(self._begins), np.concatenate(self._blocks)
        pairs = len(begins) // 2
        # An odd one at the end is left out: a tenth of a second in hours.
        self._begins = [begins[: 2 * pairs : 2].copy()]
        self._blocks = [blocks[: 2 * pairs].reshape(pairs, 2, -1).mean(axis=1)]
        self._count, self._width = pairs, 2 * self._width

    def still(self, tolerance: Floats) -> list[Span]:
        """Return the spans of time [s] in which no channel leaves its level."""
        if not self._count:
            return []
        length = self._width * self._interval_s
        changing = tolerance > 0.0
        blocks = np.concatenate(self._blocks)[:, changing]
        return _still(np.concatenate(self._begins), blocks, length, tolerance[changing])


def _middle(span: Span, longest_s: float) -> Span:
    """A span [s], or its middle where it is longer than that."""
    less = 0.5 * (span[1] - span[0] - longest_s)
    return span if less <= 0.0 else (round(span[0] + less, 4), round(span[1] - less, 4))


def _width(interval_s: float) -> int:
    """How many readings a mean is of, 0 where there are too few, or so many that their time is none."""
    width = max(round(BLOCK_S / interval_s), 1) if interval_s > 1e-12 else 0
    return width if width <= _MOST_READINGS else 0


def _median_interval(times: Iterable[Floats]) -> float:
    """Median time between readings [s], 0 of few; of many readings, of every second, fourth … of them."""
    kept: list[Floats] = []
    count, held, every, last = 0, 0, 1, np.nan
    for t_s in times:
        intervals = np.diff(t_s, prepend=last) if count else np.diff(t_s)
        count, last = count + len(t_s), t_s[-1] if len(t_s) else last
        kept.append(intervals[::every])
        held += len(kept[-1])
        if held > _MOST_INTERVALS:
            kept, every = [np.concatenate(kept)[::2]], 2 * every
            held = len(kept[0])
    return float(np.median(np.concatenate(kept))) if count > 2 * LEAST_READINGS else 0.0


def _reduced(readings: Iterable[ReadingBlock], spans: Sequence[Span]) -> Iterator[Level]:
    """Reduce spans, which are in order of time and apart, each as soon as its end has passed."""
    held: list[tuple[Floats, Floats]] = []
    waiting = list(reversed(spans))
    for block in readings:
        while waiting:
            first, last = np.searchsorted(block.t_s, waiting[-1])
            # Copies, so that a plateau does not keep whole blocks.
            held.append((block.t_s[first:last].copy(), block.wrench[first:last].copy()))
            if last == len(block):
                break
            yield from _level(waiting.pop(), held)
            held = []
    if waiting:
        yield from _level(waiting.pop(), held)


def _level(span: Span, held: Sequence[tuple[Floats, Floats]]) -> Iterator[Level]:
    t_s = np.concatenate([t for t, _ in held])
    if len(t_s) >= LEAST_READINGS:
        yield Level(span, reduce_window(t_s, np.concatenate([w for _, w in held])))


def _still(begins: Floats, blocks: Floats, length: float, tolerance: Floats) -> list[Span]:
    """The spans, from means (m, k) of so long [s] that begin at times (m,) [s]."""
    count = len(begins)
    if count < 4:
        return []
    scatter = np.median(np.abs(np.diff(blocks, axis=0)), axis=0) / 0.954
    limit = np.maximum(_DEVIATIONS * scatter, _SHARE * tolerance)
    spans: list[Span] = []
    first = 0
    for i in range(1, count + 1):
        # The level may creep: it is that of the last two seconds.
        still = i < count and begins[i] - begins[i - 1] <= 3.0 * length
        if still and (np.abs(blocks[i] - blocks[max(first, i - 20) : i].mean(axis=0)) <= limit).all():
            continue
        for a, b in _parted(blocks, first, i, np.maximum(scatter, _SHARE * tolerance / _STEP_DEVIATIONS)):
            begin, end = float(begins[a]) + GUARD_S, float(begins[b - 1]) + length - GUARD_S
            if end - begin >= SHORTEST_S:
                spans.append((round(begin, 4), round(end, 4)))
        first = i
    return spans


def _parted(blocks: Floats, first: int, last: int, scatter: Floats) -> list[tuple[int, int]]:
    """Part a span of blocks where its level changes by less than would end it, but suddenly."""
    own = blocks[first:last]
    n, channels = own.shape
    if n < 4 * _BESIDE or not channels:
        return [(first, last)]
    at = np.arange(_BESIDE, n - _BESIDE)
    sums = np.cumsum(own, axis=0)
    before, after = sums[at - 1] / at[:, None], (sums[-1] - sums[at - 1]) / (n - at)[:, None]
    weight = np.sqrt(at * (n - at) / n)[:, None]
    gain = np.abs(after - before) * weight / scatter
    where, channel = np.unravel_index(int(np.argmax(gain)), gain.shape)
    k = int(at[where])
    beside = own[k : k + _BESIDE, channel].mean() - own[k - _BESIDE : k, channel].mean()
    if gain[where, channel] < _STEP_DEVIATIONS or abs(beside) < _SUDDEN * abs((after - before)[where, channel]):
        return [(first, last)]
    return _parted(blocks, first, first + k, scatter) + _parted(blocks, first + k, last, scatter)
