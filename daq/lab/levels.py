"""Plateaus of a recording that nobody marked: where it holds still, without what settles after a change of load."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.recordings.plateaus import LEAST_READINGS, TOLERANCE, Plateau, reduce_window
from daq.recordings.windows import Span

Floats = NDArray[np.float64]

# Readings are looked at in means of so long, a change of load is waited out for so long, and a plateau is no shorter.
BLOCK_S, GUARD_S, SHORTEST_S = 0.1, 0.3, 1.0
# A level ends beyond so many deviations of the block means, and beyond this share of the tolerance.
_DEVIATIONS, _SHARE = 6.0, 0.25
# A change inside it counts from so many deviations on, if the blocks beside it show this share of it.
_STEP_DEVIATIONS, _SUDDEN, _BESIDE = 6.0, 0.6, 5


@dataclass(frozen=True, eq=False)
class Level:
    """A plateau: its window [s], and its readings reduced."""

    window_s: Span
    plateau: Plateau


def find_levels(t_s: Floats, wrench: Floats) -> tuple[Level, ...]:
    """Find plateaus in readings: times (n,) [s], not decreasing, and wrench (n, 6) [N, N mm]; in order of time."""
    out = []
    for begin, end in still_spans(t_s, wrench, TOLERANCE):
        first, last = np.searchsorted(t_s, (begin, end))
        if last - first >= LEAST_READINGS:
            out.append(Level((begin, end), reduce_window(t_s[first:last], wrench[first:last])))
    return tuple(out)


def still_spans(t_s: Floats, values: Floats, tolerance: Floats) -> list[Span]:
    """Spans of time [s] in which no channel leaves its level.

    Args:
        t_s: (n,) not decreasing [s].
        values: (n, k) channels.
        tolerance: (k,) of each channel; a quarter of it is no change of level, however small the noise.
    """
    interval = float(np.median(np.diff(t_s))) if len(t_s) > 2 * LEAST_READINGS else 0.0
    width = max(round(BLOCK_S / interval), 1) if interval > 0.0 else 0
    count = len(t_s) // width if width else 0
    if count < 4:
        return []
    blocks = values[: count * width].reshape(count, width, -1).mean(axis=1)
    begins = t_s[: count * width : width]
    length = width * interval
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
    n = len(own)
    if n < 4 * _BESIDE:
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
