"""A stand-in for an ATI Net F/T."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from daq.drivers.ati_netft import BUFFERED_CODE, START_CODE, STOP_CODE, request
from daq.standins.base import Floats, Integers, StandIn

COUNTS_PER_N, COUNTS_PER_NMM = 1_000_000.0, 1000.0
RATE_HZ = 1000.0
# Records that the box gathers for one datagram.
BUFFERED = 40


class AtiNetftStandIn(StandIn):
    """Streams after a request: one record a datagram, or many where buffered records were asked for."""

    name = "ati-netft"
    datagrams = True
    settings: ClassVar[dict[str, float | int | str]] = {
        "counts_per_N": COUNTS_PER_N,
        "counts_per_Nmm": COUNTS_PER_NMM,
        "rate_hz": RATE_HZ,
    }

    def hear(self, data: bytes) -> bytes:
        """Take requests; the answer to a start is the stream itself."""
        if data == request(STOP_CODE):
            self.streaming = False
        if data in {request(START_CODE), request(BUFFERED_CODE)}:
            self.streaming = True
            self.per_datagram = BUFFERED if data == request(BUFFERED_CODE) else 1
        return b""

    def encode(self, wrench: Floats, sequence: Integers, time_s: Floats, status: Integers | None = None) -> list[bytes]:
        """Return records with both counters and the status."""
        scale = np.array([COUNTS_PER_N] * 3 + [COUNTS_PER_NMM] * 3)
        limit = 2.0**31
        words = np.zeros((len(wrench), 9), dtype=np.int64)
        words[:, 0] = words[:, 1] = sequence
        words[:, 2] = 0 if status is None else status
        words[:, 3:] = np.clip(np.rint(wrench * scale), -limit, limit - 1.0)
        return [record.tobytes() for record in (words % 2**32).astype(">u4")]
