"""Buffer of a connection until a chunk of it is handed on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from daq.acquisition.records import StreamEvent
from daq.drivers.base import Samples, Transport


class Listening:
    """A transport as a driver's start uses it; what came since the host last wrote begins the stream.

    Attributes:
        heard: bytes of each read, and when they arrived.
    """

    def __init__(self, transport: Transport, now: Callable[[], float]) -> None:
        self.heard: list[tuple[bytes, float]] = []
        self._transport, self._now = transport, now

    def write(self, data: bytes) -> None:
        """Send bytes; what was heard before them is forgotten."""
        self.heard.clear()
        self._transport.write(data)

    def read(self, timeout_s: float) -> bytes:
        """Return what came within a time [s]."""
        data = self._transport.read(timeout_s)
        if data:
            self.heard.append((data, self._now()))
        return data

    def close(self) -> None:
        """Close the transport."""
        self._transport.close()


@dataclass(eq=False)
class Gathered:
    """Data since the last chunk: raw bytes, and the samples decoded from them.

    Attributes:
        since_s: when the gathering began [s].
        raw: bytes, read by read.
        reads: length and arrival [s] of each read.
        samples: that were decoded, read by read.
        times: of these samples [s].
        events: that happened meanwhile.
        rejected: records that were refused.
        skipped: bytes that belong to no record.
    """

    since_s: float
    raw: list[bytes] = field(default_factory=list)
    reads: list[tuple[int, float]] = field(default_factory=list)
    samples: list[Samples] = field(default_factory=list)
    times: list[Any] = field(default_factory=list)
    events: list[StreamEvent] = field(default_factory=list)
    rejected: int = 0
    skipped: int = 0

    def waited_s(self, now: float) -> float:
        """Return how long the first bytes have waited [s]."""
        return now - self.reads[0][1] if self.reads else 0.0
