"""A stand-in for a Robotiq FT300."""

from __future__ import annotations

import numpy as np

from daq.drivers.frames import crc16_modbus
from daq.drivers.robotiq import HEADER, START, STARTED, STOP, with_crc
from daq.standins.base import Floats, Integers, StandIn


class RobotiqStandIn(StandIn):
    """Streams after register 410 was set, until it hears FF bytes."""

    name = "robotiq-ft300"

    def __init__(self) -> None:
        super().__init__()
        self._heard = b""

    def hear(self, data: bytes) -> bytes:
        """Start on the Modbus message, stop on FF bytes."""
        self._heard = (self._heard + data)[-64:]
        if self._heard.endswith(STOP[:8]):
            self.streaming = False
        if with_crc(START) in self._heard:
            self._heard = b""
            self.streaming = True
            return with_crc(STARTED)
        return b""

    def encode(self, wrench: Floats, sequence: Integers, time_s: Floats, status: Integers | None = None) -> list[bytes]:
        """Return frames with a checksum; the device has no count, clock or status."""
        counts = np.clip(np.rint(wrench * np.array([100.0, 100.0, 100.0, 1.0, 1.0, 1.0])), -32768, 32767)
        body = np.frombuffer(counts.astype("<i2").tobytes(), np.uint8).reshape(-1, 12)
        start = np.tile(np.frombuffer(HEADER, np.uint8), (len(body), 1))
        frames = np.concatenate([start, body], axis=1)
        crc = np.frombuffer(crc16_modbus(frames).astype("<u2").tobytes(), np.uint8).reshape(-1, 2)
        return [bytes(row) for row in np.concatenate([frames, crc], axis=1)]
