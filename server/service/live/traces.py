"""Traces: least, most, mean and latest of what a load cell said, at any rate, so that no peak is ever lost.

Envelopes are rows of one NumPy table, in the order of their time, so that many of them become one at once: the least
of the leasts, the greatest of the greatest. The last minutes of each stream are held in coarser rows for who comes new.
"""

from __future__ import annotations

import math
import struct
from collections import OrderedDict, deque
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.acquisition.blocks import Chunk
from daq.uplink.live_tail import WINDOW_S
from server.service.ingest.envelopes import starts_of
from server.service.live.bodies import MOST, LiveMessage

# (n,) envelopes.
Rows = NDArray[np.void]

ENVELOPE = np.dtype(
    [
        ("from_s", "f8"), ("to_s", "f8"), ("count", "i8"), ("least", "f8", (6,)), ("most", "f8", (6,)),
        ("latest", "f8", (6,)), ("mean", "f8", (6,)), ("overload", "?"),
    ]
)  # fmt: skip
# The same for one of them: NumPy takes several times as long to make a row of lists.
_PACKED = struct.Struct("=ddq24d?")
# How long streams are held, and how finely.
RECENT_S, RECENT_BIN_S = 180.0, 0.3
_FRESH = 128
# Streams that are held; one that says nothing for so long is let go.
MOST_STREAMS, IDLE_S = 64, 600.0
# The live path may bring later what the stored chunks have shown already; what lies further back is a new time.
LATE_S = 5.0
# Envelopes of one stream in one frame: a stream that plays faster than time gets coarser.
MOST_IN_FRAME = 8


def rows_of(message: LiveMessage) -> dict[str, Rows]:
    """Return a message's envelopes by stream; without a mean, the latest reading stands for it."""
    found: dict[str, list[bytes]] = {}
    for e in message.envelopes:
        numbers = (*e.least, *e.most, *e.latest, *(e.mean or e.latest))
        if None in numbers:
            numbers = tuple(math.nan if n is None else n for n in numbers)
        found.setdefault(e.stream, []).append(_PACKED.pack(e.from_s, e.to_s, e.count, *numbers, e.overload))
    return {stream: np.frombuffer(b"".join(rows), dtype=ENVELOPE) for stream, rows in found.items()}


def rows_of_chunk(chunk: Chunk, after_s: float = -np.inf) -> Rows:
    """Return envelopes of those samples of a chunk that are later than a time; a status flag counts as overload."""
    wanted = (chunk.t_s > after_s) & (np.abs(chunk.t_s) <= MOST)
    t, flagged = chunk.t_s[wanted], (chunk.overload | (chunk.status != 0))[wanted]
    if not len(t):
        return np.empty(0, ENVELOPE)
    wrench = chunk.wrench[wanted]
    wrench = np.where(np.abs(wrench) <= MOST, wrench, np.nan)
    each = {"from_s": t, "to_s": t, "count": np.ones(len(t), np.int64), "overload": flagged}
    each |= dict.fromkeys(("least", "most", "latest", "mean"), wrench)
    return merged(each, starts_of(np.floor(t / WINDOW_S)))


def merged(rows: Rows | Mapping[str, NDArray[Any]], starts: NDArray[np.intp]) -> Rows:
    """Return one envelope of the rows, or of columns by name, from each start to the next."""
    out = np.empty(len(starts), ENVELOPE)
    out["from_s"], out["to_s"] = np.minimum.reduceat(rows["from_s"], starts), np.maximum.reduceat(rows["to_s"], starts)
    out["count"] = np.add.reduceat(rows["count"], starts)
    out["least"] = np.fmin.reduceat(rows["least"], starts, axis=0)
    out["most"] = np.fmax.reduceat(rows["most"], starts, axis=0)
    out["latest"] = rows["latest"][np.append(starts[1:], len(rows["latest"])) - 1]
    out["mean"] = _means(rows["mean"], rows["count"].astype(float), starts)
    out["overload"] = np.logical_or.reduceat(rows["overload"], starts)
    return out


def decimated(rows: Rows, rate_hz: float, most: int = MOST_IN_FRAME) -> Rows:
    """Return as many envelopes as a rate has room for in the time of these (at least 1), but not more than `most`."""
    if len(rows) < 2:
        return rows
    first_s = float(rows["from_s"].min())
    span = float(rows["to_s"].max()) - first_s
    room = min(max(round(min(span * rate_hz, 1e6)), 1), most)
    if room == 1:
        return merged(rows, np.zeros(1, dtype=np.intp))
    middle = 0.5 * (rows["from_s"] + rows["to_s"]) - first_s
    place = np.maximum.accumulate(np.minimum(np.floor(middle * (room / span)), room - 1))
    return merged(rows, starts_of(place))


def binned(rows: Rows, bin_s: float) -> Rows:
    """Return one envelope for each interval of time in which any begins."""
    return merged(rows, starts_of(np.floor(rows["from_s"] / bin_s))) if len(rows) else rows


def as_columns(rows: Rows) -> dict[str, Any]:
    """Return plain data by column; components in single precision, a 10⁻⁷ of what they are."""
    out: dict[str, Any] = {name: np.ascontiguousarray(rows[name]) for name in ("from_s", "to_s", "count", "overload")}
    return out | {name: rows[name].astype(np.float32) for name in ("least", "most", "latest", "mean")}


def _means(values: NDArray[np.float64], weight: NDArray[np.float64], starts: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return (k, 6) weighted means of the components that are numbers, NaN where none is."""
    known = np.isfinite(values)
    weights = np.where(known, weight[:, None], 0.0)
    total = np.add.reduceat(np.where(known, values, 0.0) * weights, starts, axis=0)
    count = np.add.reduceat(weights, starts, axis=0)
    return np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0.0)


class Trace:
    """The last minutes of one stream.

    Attributes:
        shown_s: time of the latest reading that was shown [s].
        arrived_s: when anything arrived last, by the caller's clock.
    """

    def __init__(self) -> None:
        self.shown_s, self.arrived_s = -np.inf, -np.inf
        self._past: deque[Rows] = deque()
        self._fresh: list[Rows] = []
        self._count = 0

    def add(self, rows: Rows, now_s: float, live: bool = True) -> Rows:
        """Take envelopes; return those that were not shown yet.

        Args:
            rows: of this stream, in order.
            now_s: by the caller's clock.
            live: whether they came by the live path; stored chunks never turn time back.
        """
        if not len(rows):
            return rows
        self.arrived_s = now_s
        to_s = rows["to_s"].tolist()
        if live and to_s[-1] < self.shown_s - LATE_S:
            self.shown_s = -np.inf
            self._past.clear()
            self._fresh, self._count = [], 0
        # Most often it is one envelope, or several new ones: nothing is picked out then.
        if min(to_s) <= self.shown_s:
            rows = rows[rows["to_s"] > self.shown_s]
        if len(rows):
            self.shown_s = max(to_s)
            self._fresh.append(rows)
            self._count += len(rows)
            if self._count >= _FRESH:
                self._condense()
        return rows

    def recent(self) -> Rows:
        """Return the last minutes."""
        rows = [*self._past, *self._fresh]
        return binned(np.concatenate(rows), RECENT_BIN_S) if rows else np.empty(0, ENVELOPE)

    def _condense(self) -> None:
        rows = binned(np.concatenate(self._fresh), RECENT_BIN_S)
        # The last interval may go on.
        if len(rows) > 1:
            self._past.append(rows[:-1])
        self._fresh, self._count = [rows[-1:]], 1
        while self._past and self._past[0]["to_s"][-1] < self.shown_s - RECENT_S:
            self._past.popleft()


class Traces:
    """The last minutes of all streams; those that say nothing are let go."""

    def __init__(self) -> None:
        self._streams: OrderedDict[tuple[str, str], Trace] = OrderedDict()

    def __len__(self) -> int:
        return len(self._streams)

    def add(self, session: str, stream: str, rows: Rows, now_s: float, live: bool = True) -> Rows:
        """Take envelopes of a stream; return those that were not shown yet."""
        key = (session, stream)
        trace = self._streams.get(key)
        if trace is None:
            trace = self._streams[key] = Trace()
        self._streams.move_to_end(key)
        while len(self._streams) > MOST_STREAMS:
            self._streams.popitem(last=False)
        return trace.add(rows, now_s, live)

    def shown_s(self, session: str, stream: str) -> float:
        """Return the time of the latest reading that was shown; from any thread."""
        trace = self._streams.get((session, stream))
        return -np.inf if trace is None else trace.shown_s

    def of(self, sessions: frozenset[str] | None) -> Iterator[tuple[str, str, Trace]]:
        """Yield the streams of some sessions, or of all."""
        for (session, stream), trace in self._streams.items():
            if sessions is None or session in sessions:
                yield session, stream, trace

    def let_go(self, now_s: float) -> None:
        """Forget streams that have said nothing for long."""
        for key in [k for k, t in self._streams.items() if t.arrived_s < now_s - IDLE_S]:
            del self._streams[key]
