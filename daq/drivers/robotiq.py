"""Robotiq FT300 and FT300-S in their streaming mode, over RS-485."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daq.drivers.base import BOOT_S, LoadCell, Samples, Transport, samples
from daq.drivers.frames import FrameStream, crc16_modbus
from daq.errors import DriverError

HEADER = b"\x20\x4e"
LENGTH = 16
# Of Modbus: device 9 is told (function 16) that register 410 is 0x0200.
START = bytes.fromhex("0910019a0001020200")
STARTED = bytes.fromhex("0910019a0001")
STOP = b"\xff" * 50
# After so many without a frame it is another device.
MOST_BYTES = 100 * LENGTH
# It is asked again while it may still be starting up.
ANSWER_S = 2.0
TRIES = int(BOOT_S / ANSWER_S)


def with_crc(message: bytes) -> bytes:
    """Return a Modbus message with its checksum, the low byte first."""
    crc = int(crc16_modbus(np.frombuffer(message, np.uint8)[None, :])[0])
    return message + crc.to_bytes(2, "little")


def _valid(frames: NDArray[np.uint8]) -> NDArray[np.bool_]:
    stated = frames[:, 14].astype(np.uint16) | (frames[:, 15].astype(np.uint16) << np.uint16(8))
    return np.asarray(crc16_modbus(frames[:, :14]) == stated)


class RobotiqDecoder:
    """Frames of `20 4E`, six int16 (N × 100, N m × 1000) and a CRC, all little-endian."""

    def __init__(self) -> None:
        self._stream = FrameStream(LENGTH, HEADER, _valid, ahead=True)

    def feed(self, data: bytes) -> Samples:
        """Take bytes and return the readings that they complete."""
        found = self._stream.feed(data)
        counts = np.ascontiguousarray(found.frames[:, 2:14]).view("<i2").astype(np.float64)
        # N × 100 to N; N m × 1000 is N mm.
        wrench = counts * np.array([0.01, 0.01, 0.01, 1.0, 1.0, 1.0])
        return samples(wrench, rejected=found.rejected, skipped=found.skipped)


class Robotiq(LoadCell):
    """Robotiq FT300: 19200 baud, 100 readings a second, no counter."""

    name = "robotiq-ft300"
    title = "Robotiq FT300, FT300-S (serial stream)"
    link = "serial"
    baud = 19200
    example = "fingertwin log --driver robotiq-ft300 --port COM3 --protocol levels --out DIR"
    source = "frame and start register as in public driver code; CRC-16/MODBUS checked on golden bytes"
    checksum = True
    held_back = 1

    @property
    def rate_hz(self) -> float:
        """100 readings a second."""
        return 100.0

    def decoder(self) -> RobotiqDecoder:
        """Return a fresh decoder."""
        return RobotiqDecoder()

    def start(self, transport: Transport) -> None:
        """Stop what may be streaming, then start the stream and see its first bytes."""
        answer, said = with_crc(STARTED), b""
        for _ in range(TRIES):
            transport.write(STOP)
            transport.write(with_crc(START))
            decoder, heard = self.decoder(), b""
            while data := transport.read(ANSWER_S):
                heard += data
                if answer in heard or len(decoder.feed(data)):
                    return
                if len(heard) > MOST_BYTES:
                    break
            said = said or heard
            if len(heard) > MOST_BYTES:
                break
        raise DriverError(
            f"the device says {said[:16].hex(' ')}" if said else "no answer",
            "a Robotiq FT300 (Modbus device 9 at 19200 baud)",
            "Check power, cable and port; is another device there?",
        )

    def stop(self, transport: Transport) -> None:
        """End the stream with fifty FF bytes."""
        transport.write(STOP)
