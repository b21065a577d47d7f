"""Gather the readings of many time windows in one pass, holding only those that are open."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.errors import OutsideError, ReadingsError
from daq.recordings.plateaus import LEAST_READINGS, Plateau, reduce_window
from daq.recordings.readings import ReadingBlock

Floats = NDArray[np.float64]
Span = tuple[float, float]


@dataclass(frozen=True)
class Recording:
    """Summary of a recording that was read once.

    Attributes:
        readings: their number.
        start_s: time of the first; end_s: of the last.
        plateaus: each window, reduced.
    """

    readings: int
    start_s: float
    end_s: float
    plateaus: Mapping[Span, Plateau]


def stop(error: ReadingsError) -> None:
    """Raise a fault."""
    raise error


def require_increasing(t: Floats, last: float, rows: int, file: str) -> None:
    """Refuse times (n,) [s] that do not rise.

    Args:
        t: of consecutive readings, at least one.
        last: time of the reading before them; -inf where there is none.
        rows: how many readings come before them.
        file: name of the readings, for messages.

    Raises:
        ReadingsError: they do not; the line names the row.
    """
    steps = np.diff(t, prepend=last)
    if steps.min() > 0.0:
        return
    at = int(np.argmin(steps > 0.0))
    before = last if at == 0 else float(t[at - 1])
    raise ReadingsError(
        f"time goes from {before:.6g} s to {t[at]:.6g} s in row {rows + at + 1} of {file}",
        "time that increases from row to row",
        "Join recordings in order, each with its own session, or remove repeated rows",
    )


def gather(
    blocks: Iterable[ReadingBlock],
    windows: Mapping[Span, str],
    file: str,
    progress: Callable[[float], None] | None = None,
    fault: Callable[[ReadingsError], None] = stop,
) -> Recording:
    """Reduce every window of a recording, each as soon as it is complete.

    Args:
        blocks: the readings in order.
        windows: [start, end] in s, both ends included, and a name for messages.
        file: name of the readings, for messages.
        progress: is told the share of the windows' time that has passed.
        fault: is told of each fault and raises it by default. Where it returns, the windows concerned are left out;
            after a fault of the readings themselves, those that were not complete by then.

    Raises:
        ReadingsError: the readings cannot be used, time does not increase, a window lies outside the recording or has
            too few readings.
    """
    waiting = sorted(windows, reverse=True)
    last_end = max((end for _, end in windows), default=0.0)
    pieces: dict[Span, list[ReadingBlock]] = {}
    plateaus: dict[Span, Plateau] = {}
    rows, first, last, broken = 0, np.nan, -np.inf, False

    def close(window: Span) -> None:
        held = pieces.pop(window)
        if window[1] < first or window[0] > last:
            return  # reported below, once the recording's span is known
        try:
            plateaus[window] = _reduce(held, window, windows[window], file)
        except ReadingsError as error:
            fault(error)

    try:
        for block in blocks:
            if not len(block):
                continue
            require_increasing(block.t_s, last, rows, file)
            first = float(block.t_s[0]) if rows == 0 else first
            rows += len(block)
            last = float(block.t_s[-1])
            while waiting and waiting[-1][0] <= last:
                pieces[waiting.pop()] = []
            for window in list(pieces):
                _take(pieces[window], block, window)
                if window[1] < last:
                    close(window)
            if progress is not None:
                progress(1.0 if last >= last_end else max((last - first) / max(last_end - first, 1e-9), 0.0))
    except ReadingsError as error:
        fault(error)
        broken = True
    if not broken:
        rate = (rows - 1) / max(last - first, 1e-12)
        missed = [w for w in windows if w[0] < first - 1.5 / max(rate, 1e-9) or w[1] > last + 1.5 / max(rate, 1e-9)]
        for window in missed:
            pieces.pop(window, None)
            plateaus.pop(window, None)
            fault(outside(window, windows[window], first, last, file))
        for window in list(pieces):
            close(window)
    return Recording(rows, first, last, plateaus)


def _take(held: list[ReadingBlock], block: ReadingBlock, window: Span) -> None:
    begin = int(np.searchsorted(block.t_s, window[0], side="left"))
    end = int(np.searchsorted(block.t_s, window[1], side="right"))
    if end > begin:
        status = None if block.status is None else block.status[begin:end].copy()
        # Copies, so that a window does not keep whole blocks alive.
        held.append(ReadingBlock(block.t_s[begin:end].copy(), block.wrench[begin:end].copy(), status))


def _reduce(held: list[ReadingBlock], window: Span, name: str, file: str) -> Plateau:
    count = sum(len(p) for p in held)
    if count < LEAST_READINGS:
        raise ReadingsError(
            f"{name} [{window[0]:g}, {window[1]:g}] s of {file} holds {count} readings",
            f"at least {LEAST_READINGS}",
            "Widen the window, or look for a gap in the recording",
        )
    t = np.concatenate([p.t_s for p in held])
    wrench = np.concatenate([p.wrench for p in held])
    flagged = sum(int(np.count_nonzero(p.status)) for p in held if p.status is not None)
    return reduce_window(t, wrench, flagged)


def outside(window: Span, name: str, first: float, last: float, file: str) -> OutsideError:
    """Return the fault of a window that lies outside its recording.

    Args:
        window: [start, end] in s.
        name: of the window.
        first: time of the recording's first reading [s].
        last: time of its last reading [s].
        file: name of the readings.
    """
    return OutsideError(
        f"{name} [{window[0]:g}, {window[1]:g}] s lies outside the recording, which runs from {first:g} to {last:g} s "
        f"({file})",
        "windows inside it",
        "Correct the window, or look whether the recording was cut off",
    )
