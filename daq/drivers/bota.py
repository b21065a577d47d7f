"""Bota SensONE in its binary mode, over RS-422 or USB."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.drivers.base import BOOT_S, LoadCell, Samples, Setting, Transport, Unwrap, samples, told
from daq.drivers.frames import FrameStream, crc16_x25
from daq.errors import DriverError

HEADER = b"\xaa"
FRAME = np.dtype(
    [("header", "u1"), ("status", "<u2"), ("wrench", "<f4", (6,)), ("us", "<u4"), ("deg_C", "<f4"), ("crc", "<u2")]
)
# Bits of the status word: the measuring range was exceeded; the six numbers are gauges instead of forces.
OVERRANGE, RAW = 0x2, 0x8
GREETING = b"App Init"
CONFIGURE, RUN = b"C", b"R"
CONFIGURING, CONFIGURED, RUNNING = b"r,0,C,0", b"r,0,c,0", b"r,0,R,0"
# Of the configuration line: calibrated forces, binary frames, 460800 baud.
CALIBRATED, BINARY, BAUD_CODE = 1, 0, 4
# It greets in this time; it answers in that, and is asked again while it may still be starting up.
GREETS_S, ANSWER_S = 2.5, 1.0
TRIES = int(BOOT_S / ANSWER_S)
# An answer may come after what was still streaming, but not after more than a second of that.
MOST_BYTES = 1 << 16


def _valid(frames: NDArray[np.uint8]) -> NDArray[np.bool_]:
    stated = frames[:, 35].astype(np.uint16) | (frames[:, 36].astype(np.uint16) << np.uint16(8))
    return np.asarray(crc16_x25(frames[:, 1:35]) == stated)


class BotaDecoder:
    """Frames of `AA`, status, six float32 (N, N m), microseconds, degrees C and a CRC, all little-endian.

    A frame whose status says that it holds gauges, or with what no cell can tell, is refused: it is no wrench.
    """

    def __init__(self) -> None:
        self._stream = FrameStream(FRAME.itemsize, HEADER, _valid, ahead=True)
        self._unwrap = Unwrap(1 << 32)

    def feed(self, data: bytes) -> Samples:
        """Take bytes and return the readings that they complete."""
        found = self._stream.feed(data)
        table = np.ascontiguousarray(found.frames).view(FRAME)[:, 0]
        # N m to N mm.
        wrench = table["wrench"].astype(np.float64) * np.array([1.0, 1.0, 1.0, 1e3, 1e3, 1e3])
        sound = told(wrench) & ((table["status"] & RAW) == 0)
        status = table["status"][sound].astype(np.int64)
        return samples(
            wrench[sound],
            status,
            (status & OVERRANGE) != 0,
            device_s=self._unwrap(table["us"][sound]).astype(np.float64) * 1e-6,
            rejected=found.rejected + int(np.count_nonzero(~sound)),
            skipped=found.skipped,
        )


class Bota(LoadCell):
    """Bota SensONE: 460800 baud, with its own clock; how often it measures is set in its filter, and left alone."""

    name = "bota-sensone"
    title = "Bota Systems SensONE (serial, binary)"
    link = "serial"
    baud = 460800
    settings = (
        Setting("temperature_compensation", "on or off, as the maker advises for the cell", "off", ("off", "on")),
    )
    example = "fingertwin log --driver bota-sensone --port COM3 --protocol levels --out DIR"
    source = "frame, status bits and answers as in public driver code; CRC-16/X-25 checked on golden bytes"
    checksum = True
    held_back = 1
    clock = "device"

    def __init__(self, given: Mapping[str, Any] | None = None) -> None:
        super().__init__(given)
        compensated = int(self.text("temperature_compensation") == "on")
        self._line = f"c,{compensated},{CALIBRATED},{BINARY},{BAUD_CODE}".encode()

    @property
    def rate_hz(self) -> None:
        """None: the device does not say."""
        return

    def decoder(self) -> BotaDecoder:
        """Return a fresh decoder."""
        return BotaDecoder()

    def start(self, transport: Transport) -> None:
        """Wait until it has started up, set what it sends, and let it run."""
        self._wait_for_start_up(transport)
        self._ask(transport, CONFIGURE, CONFIGURING)
        self._ask(transport, self._line, CONFIGURED)
        self._ask(transport, RUN, RUNNING)

    def stop(self, transport: Transport) -> None:
        """Stop the stream by starting its configuration."""
        transport.write(CONFIGURE)

    def _wait_for_start_up(self, transport: Transport) -> None:
        """Return once it has greeted, streams, or stays quiet: one that was on already never greets."""
        decoder, heard = self.decoder(), b""
        while GREETING not in heard and len(heard) < MOST_BYTES:
            data = transport.read(GREETS_S)
            heard += data
            if not data or len(decoder.feed(data)):
                return

    def _ask(self, transport: Transport, message: bytes, answer: bytes) -> None:
        """Send until it answers: it may miss what comes while it starts up. A running stream says `RUNNING` too."""
        decoder, first = self.decoder(), b""
        for _ in range(TRIES):
            transport.write(message)
            heard = b""
            while len(heard) < MOST_BYTES:
                data = transport.read(ANSWER_S)
                heard += data
                if answer in heard or (answer == RUNNING and len(decoder.feed(data))):
                    return
                if not data:
                    break
            first = first or heard
        raise DriverError(
            f"after {message.decode()} the device says {first[:16]!r}" if first else f"no answer to {message.decode()}",
            f"{answer.decode()} of a Bota SensONE at {self.baud} baud",
            "Check power, cable and port; switch it off and on",
        )
