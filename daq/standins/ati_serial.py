"""A stand-in for an ATI F/T controller."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from daq.drivers.ati_serial import PROMPT
from daq.standins.base import Floats, Integers, StandIn

COUNTS_PER_N, COUNTS_PER_NMM = 100.0, 10.0


class AtiSerialStandIn(StandIn):
    """Echoes and answers commands, streams after QS, stops at the next carriage return."""

    name = "ati-serial"
    settings: ClassVar[dict[str, float | int | str]] = {"counts_per_N": COUNTS_PER_N, "counts_per_Nmm": COUNTS_PER_NMM}

    def __init__(self) -> None:
        super().__init__()
        self.binary = False
        self._heard = b""

    def hear(self, data: bytes) -> bytes:
        """Take commands, each ended by a carriage return."""
        *commands, self._heard = (self._heard + data)[-200:].split(b"\r")
        out = b""
        for command in commands:
            out += command
            if self.streaming or command != b"QS":
                self.streaming = False
                out += PROMPT
            else:
                self.streaming = True
                out += b"\r\n"
            if command in {b"CD A", b"CD B"}:
                self.binary = command == b"CD B"
        return out

    def encode(self, wrench: Floats, sequence: Integers, time_s: Floats, status: Integers | None = None) -> list[bytes]:
        """Return ASCII or binary records, as asked for; the device has no count or clock, and one digit of status."""
        scale = np.array([COUNTS_PER_N] * 3 + [COUNTS_PER_NMM] * 3)
        counts = np.clip(np.rint(wrench * scale), -32768, 32767).astype(np.int64)
        errors = np.clip(np.zeros(len(counts), dtype=np.int64) if status is None else status, 0, 9)
        if self.binary:
            body = counts.astype(">i2")
            return [bytes([int(e)]) + row.tobytes() for e, row in zip(errors, body, strict=True)]
        return [
            (str(int(e)) + "".join(f",{int(c):6d}" for c in row) + "\r\n").encode("ascii")
            for e, row in zip(errors, counts, strict=True)
        ]
