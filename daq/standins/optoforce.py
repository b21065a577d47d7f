"""A stand-in for a six-axis OptoForce."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from daq.drivers.optoforce import FRAME, HEADER, LENGTH, SUMMED
from daq.standins.base import Floats, Integers, StandIn

COUNTS_PER_N, COUNTS_PER_NMM = 100.0, 2.0


class OptoForceStandIn(StandIn):
    """Streams from when it is switched on, and hears nothing."""

    name = "optoforce"
    unasked = True
    settings: ClassVar[dict[str, float | int | str]] = {
        "counts_per_N": COUNTS_PER_N,
        "counts_per_Nmm": COUNTS_PER_NMM,
        "rate_hz": "1000",
    }

    def hear(self, data: bytes) -> bytes:
        """Say nothing."""
        return b""

    def encode(self, wrench: Floats, sequence: Integers, time_s: Floats, status: Integers | None = None) -> list[bytes]:
        """Return frames with a count and a byte sum."""
        scale = np.repeat([COUNTS_PER_N, COUNTS_PER_NMM], 3)
        table = np.zeros(len(wrench), dtype=FRAME)
        table["header"] = int.from_bytes(HEADER, "big")
        table["count"] = sequence & 0xFFFF
        table["status"] = 0 if status is None else status
        table["counts"] = np.clip(np.rint(wrench * scale), -32768, 32767)
        octets = np.frombuffer(table.tobytes(), np.uint8).reshape(-1, LENGTH)
        table["sum"] = octets[:, :SUMMED].sum(axis=1, dtype=np.uint32) & 0xFFFF
        return [row.tobytes() for row in table]
