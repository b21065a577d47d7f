"""A stand-in for a Bota SensONE."""

from __future__ import annotations

import numpy as np

from daq.drivers.bota import CONFIGURED, CONFIGURING, FRAME, GREETING, HEADER, RUNNING
from daq.drivers.frames import crc16_x25
from daq.standins.base import Floats, Integers, StandIn

END = b"\r\n"
LINE_LENGTH = len(b"c,0,1,0,4")


class BotaStandIn(StandIn):
    """Greets once when first heard from (with nothing, too), then is configured and runs."""

    name = "bota-sensone"

    def __init__(self) -> None:
        super().__init__()
        self._heard = b""
        self._greeted = self._configuring = False

    def hear(self, data: bytes) -> bytes:
        """Answer `C`, the configuration line while it is being configured, and `R`."""
        out = b"" if self._greeted else GREETING + END
        self._greeted = True
        self._heard += data
        while self._heard:
            if self._heard[:1] == b"C":
                self.streaming, self._configuring = False, True
                out, self._heard = out + CONFIGURING + END, self._heard[1:]
            elif self._heard[:1] == b"R":
                self.streaming, self._configuring = self._configuring or self.streaming, False
                out, self._heard = out + RUNNING + END, self._heard[1:]
            elif self._heard[:1] == b"c" and self._configuring:
                if len(self._heard) < LINE_LENGTH:
                    break
                out, self._heard = out + CONFIGURED + END, self._heard[LINE_LENGTH:]
            else:
                self._heard = self._heard[1:]
        return out

    def encode(self, wrench: Floats, sequence: Integers, time_s: Floats, status: Integers | None = None) -> list[bytes]:
        """Return frames with a checksum and the time in microseconds; the device has no count."""
        table = np.zeros(len(wrench), dtype=FRAME)
        table["header"] = HEADER[0]
        table["status"] = 0 if status is None else status
        table["wrench"] = wrench * np.array([1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3])
        table["us"] = np.rint(time_s * 1e6).astype(np.int64) & 0xFFFFFFFF
        table["deg_C"] = 25.5
        octets = np.frombuffer(table.tobytes(), np.uint8).reshape(-1, FRAME.itemsize)
        table["crc"] = crc16_x25(octets[:, 1:35])
        return [row.tobytes() for row in table]
