"""Live view of a load cell's stream: traces, rate, gaps, saturation; bounded in memory at any rate."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from daq.acquisition.blocks import Chunk
from daq.acquisition.records import Record, StreamEvent

Floats = NDArray[np.float64]

# A point of a trace, and so many of them.
POINT_S, POINTS = 0.25, 240
RATE_S = 2.0


class StreamMeter:
    """Counts what a stream does.

    Args:
        full_scale: (6,) of the cell [N, N mm], None where it is not known.

    Attributes:
        samples: so far; gaps: how many; lost: samples that nobody got, by the device's count or by the others' times.
        overloads: how often the cell was beyond its range; damaged: records or bytes that were refused.
        state: streaming, silent, not understood, lost or ended; why: of the last change.
        alarm: what is wrong with the journal or its way to a service; empty where nothing is.
    """

    def __init__(self, full_scale: Floats | None = None) -> None:
        self.full_scale = full_scale
        self.samples = self.gaps = self.lost = self.overloads = self.damaged = 0
        self.state, self.why, self.alarm = "waiting", "", ""
        self._points: deque[Floats] = deque(maxlen=POINTS)
        self._point_from_s, self._sum, self._count = -np.inf, np.zeros(6), 0
        self._recent: deque[tuple[float, int]] = deque()
        self._latest, self._worst = np.full(6, np.nan), 0.0

    def take(self, record: Record) -> None:
        """Take what the sampling thread handed on."""
        for event in record.events:
            self._happened(event)
        if record.chunk is not None and len(record.chunk):
            self._read(record.chunk)

    @property
    def rate_hz(self) -> float | None:
        """Samples a second in the last two, None before there are enough."""
        if len(self._recent) < 2:
            return None
        span = self._recent[-1][0] - self._recent[0][0]
        return sum(n for _, n in list(self._recent)[1:]) / span if span > 0.0 else None

    @property
    def latest(self) -> Floats:
        """(6,) mean of the latest chunk [N, N mm], NaN before there is one."""
        return self._latest

    @property
    def saturation(self) -> Floats | None:
        """(6,) share of the full scale that the latest chunk uses; None where the range is not known."""
        return None if self.full_scale is None else np.abs(self._latest) / self.full_scale

    @property
    def worst(self) -> float | None:
        """The greatest share of the full scale that any reading ever used; None where the range is not known."""
        return None if self.full_scale is None else self._worst

    def traces(self, points: int = POINTS) -> Floats:
        """Return the latest points (up to n, 6) of each axis."""
        return np.array(list(self._points)[-points:]).reshape(-1, 6)

    def _read(self, chunk: Chunk) -> None:
        n, now = len(chunk), float(chunk.t_s[-1])
        self.samples += n
        self.state = "streaming"
        self._latest = chunk.wrench.mean(axis=0)
        if self.full_scale is not None:
            self._worst = max(self._worst, float((np.abs(chunk.wrench) / self.full_scale).max()))
        self._recent.append((now, n))
        while self._recent[0][0] < now - RATE_S:
            self._recent.popleft()
        self._sum, self._count = self._sum + chunk.wrench.sum(axis=0), self._count + n
        if now - self._point_from_s >= POINT_S:
            self._points.append(self._sum / self._count)
            self._point_from_s, self._sum, self._count = now, np.zeros(6), 0

    def _happened(self, event: StreamEvent) -> None:
        value = event.value
        if event.kind in ("gap", "overrun"):
            self.gaps += 1
            self.lost += int(value.get("lost_samples", 0))
        elif event.kind == "overload":
            self.overloads += 1
        elif event.kind == "damaged":
            self.damaged += int(value.get("rejected", 0)) or 1
        elif event.kind == "undecoded":
            self.state, self.why = "not understood", str(value.get("looks", ""))
        elif event.kind == "stale":
            self.state = "streaming" if value.get("ended") else "silent"
        elif event.kind == "disconnected":
            self.state, self.why = "lost", str(value.get("why", ""))
        elif event.kind in ("started", "reconnected", "ended"):
            self.state = "ended" if event.kind == "ended" else "waiting"
