"""Records of one length in a stream of bytes: found, checked, and found again after bytes were lost or damaged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Octets = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Found:
    """Frames (n, length) in order, and what was not one."""

    frames: Octets
    rejected: int
    skipped: int


class FrameStream:
    """Finds frames by their header and their check.

    A header may occur inside a payload, and a check may hold by chance. So as long as frames follow each other, each
    needs only its own check; but once that chain is broken a frame counts only when the next one follows it without a
    gap.

    Where bytes are lost or added on the way, the frame that the chain leads to is made of parts of two, and a check of
    16 bits holds for one in 65,536 of these. With `ahead` a frame therefore waits for the beginning of the next: it
    counts where a header stands right behind it or, that one being damaged, one frame further.

    Args:
        length: of a frame [bytes].
        header: that every frame begins with.
        valid: tells of frames (n, length) which have a check that holds.
        ahead: whether a frame waits for the next one's header. The last one of a stream is then never returned.
    """

    def __init__(
        self, length: int, header: bytes, valid: Callable[[Octets], NDArray[np.bool_]], *, ahead: bool = False
    ) -> None:
        self._length = length
        self._header = header
        self._valid = valid
        self._ahead = ahead
        self._held = b""
        self._chained = False

    def feed(self, data: bytes) -> Found:
        """Take bytes and return the frames that they complete."""
        buffer, length = self._held + data, self._length
        out: list[Octets] = []
        at = rejected = skipped = 0
        while len(buffer) - at >= length:
            run = self._run(buffer, at)
            followed = not self._ahead or (run > 0 and self._followed(buffer, at + run * length))
            # All but the last are followed by what is valid itself.
            sure = run if followed else max(run - 1, 0)
            if sure and (self._chained or run > 1):
                out.append(np.frombuffer(buffer, np.uint8, sure * length, at).reshape(sure, length))
                at += sure * length
                self._chained = True
                continue
            if run and (followed is None if self._chained else self._may_be_followed(buffer, at + length)):
                break  # the next frame will tell
            # A run of one is over here, and so is a chain: this frame is none.
            rejected += int(self._chained)
            self._chained = False
            next_at = buffer.find(self._header, at + 1)
            if next_at < 0:
                next_at = max(len(buffer) - len(self._header) + 1, at + 1)
            skipped += next_at - at
            at = next_at
        self._held = buffer[at:]
        frames = np.concatenate(out) if out else np.zeros((0, length), dtype=np.uint8)
        return Found(frames, rejected, skipped)

    def _run(self, buffer: bytes, at: int) -> int:
        """Count the valid frames that follow each other from here."""
        count = (len(buffer) - at) // self._length
        frames = np.frombuffer(buffer, np.uint8, count * self._length, at).reshape(count, self._length)
        header = np.frombuffer(self._header, np.uint8)
        good = (frames[:, : len(header)] == header).all(axis=1)
        # The check is the dear part: only as far as headers go.
        upto = count if good.all() else int(np.argmin(good))
        good = self._valid(frames[:upto])
        return upto if good.all() else int(np.argmin(good))

    def _may_be_followed(self, buffer: bytes, at: int) -> bool:
        """Return whether a frame may begin here that is not complete yet."""
        return len(buffer) - at < self._length and self._header.startswith(buffer[at : at + len(self._header)])

    def _followed(self, buffer: bytes, at: int) -> bool | None:
        """Return whether a header stands here or one frame further; None where that cannot be told yet."""
        for place in (at, at + self._length):
            rest = buffer[place : place + len(self._header)]
            if rest == self._header:
                return True
            if self._header.startswith(rest):
                return None
        return False


def crc_table(polynomial: int) -> NDArray[np.uint16]:
    """Return the table of a reflected 16-bit CRC."""
    out = np.zeros(256, dtype=np.uint16)
    for byte in range(256):
        value = byte
        for _ in range(8):
            value = (value >> 1) ^ (polynomial if value & 1 else 0)
        out[byte] = value
    return out


_MODBUS, _X25 = crc_table(0xA001), crc_table(0x8408)


def crc16_modbus(octets: Octets) -> NDArray[np.uint16]:
    """Return CRC-16/MODBUS of each row (n, length)."""
    return _crc(octets, _MODBUS)


def crc16_x25(octets: Octets) -> NDArray[np.uint16]:
    """Return CRC-16/X-25 of each row (n, length)."""
    return _crc(octets, _X25) ^ np.uint16(0xFFFF)


def _crc(octets: Octets, table: NDArray[np.uint16]) -> NDArray[np.uint16]:
    value = np.full(len(octets), 0xFFFF, dtype=np.uint16)
    for column in octets.T:
        value = (value >> np.uint16(8)) ^ table[(value ^ column) & np.uint16(0xFF)]
    return value
