"""A stand-in for an ATI Axia's console."""

from __future__ import annotations

import numpy as np

from daq.standins.base import Floats, Integers, StandIn

COMMAND = b"c #!ufxyztxyz"


class AtiAxiaStandIn(StandIn):
    """Echoes what it hears, streams lines for the one command it knows, stops at the next carriage return."""

    name = "ati-axia"

    def __init__(self) -> None:
        super().__init__()
        self._heard = b""

    def hear(self, data: bytes) -> bytes:
        """Take commands, each ended by a carriage return."""
        *commands, self._heard = (self._heard + data)[-200:].split(b"\r")
        out = b""
        for command in commands:
            self.streaming = not self.streaming and command == COMMAND
            out += command + b"\r\n" + (b"" if self.streaming else b">")
        return out

    def encode(self, wrench: Floats, sequence: Integers, time_s: Floats, status: Integers | None = None) -> list[bytes]:
        """Return lines with the counter, the status and six values: to 0.001 N and to 0.0001 N m."""
        states = np.zeros(len(wrench), dtype=np.int64) if status is None else status
        lines = []
        for row, count, state in zip(wrench, sequence, states, strict=True):
            forces = " ".join(f"{v:.3f} N" for v in row[:3])
            torques = " ".join(f"{v / 1000.0:.4f} Nm" for v in row[3:])
            lines.append(f"{int(count) % 2**32} {int(state) % 2**32:08x} {forces} {torques}\r\n".encode("ascii"))
        return lines
