"""The segments of a TDMS file: up to where they are whole, and whether they are as long as they say.

A segment is a lead-in, a description and numbers. It has no checksum: a damaged lead-in makes a reader take one for
the other, or numbers of one channel for another's.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence
from typing import Any, BinaryIO

TDMS = (b"TDSm", b"TDSh")
# Of a segment: its lead-in, and the bit of it that turns the order of bytes round.
_LEAD_IN, _BIG_ENDIAN = 28, 1 << 6
_VERSIONS = (4712, 4713)
_BLOCK = 1 << 22


def last_segment(stream: BinaryIO) -> int:
    """Return the bytes up to the last segment with a whole description; later ones were cut off in writing."""
    size = stream.seek(0, 2)
    at = 0
    while size - at >= _LEAD_IN:
        stream.seek(at)
        lead = stream.read(_LEAD_IN)
        if lead[:4] not in TDMS:
            return size
        order = ">" if int.from_bytes(lead[4:8], "little") & _BIG_ENDIAN else "<"
        following, raw = struct.unpack(f"{order}QQ", lead[12:])
        if at + _LEAD_IN + raw > size:
            return at
        if at + _LEAD_IN + following >= size:
            return size
        at += _LEAD_IN + following
    return at


def fault_of(segments: Sequence[Any], stream: Bounded) -> str:
    """Return why a file's segments cannot be as they say; nothing where they can.

    Args:
        segments: as npTDMS has read their descriptions.
        stream: of which they were read.
    """
    for number, segment in enumerate(segments, 1):
        begun = segment.position + _LEAD_IN
        described = stream.read_up_to(segment.position, segment.next_segment_pos)
        if described > segment.data_position:
            return f"segment {number} has its numbers before its description ends"
        if not stream.is_empty(max(described, begun), segment.data_position):
            return f"segment {number} has something between its description and its numbers"
        if segment.segment_incomplete:  # as a recording that crashed leaves it
            if stream.has_segment(segment.data_position):
                return f"segment {number} goes beyond the next one"
        elif segment.final_chunk_lengths_override is not None:
            return f"segment {number} has numbers that do not fill its channels"
    return ""


class Bounded(io.RawIOBase):
    """A stream that ends earlier than its file, and knows what was read of it."""

    def __init__(self, stream: BinaryIO, end: int) -> None:
        """Take an open file, and the bytes after which it ends."""
        self._stream, self._end = stream, end
        self._reads: list[tuple[int, int]] | None = []
        stream.seek(0)

    def forget(self) -> None:
        """Note no longer what is read."""
        self._reads = None

    def read_up_to(self, begin: int, end: int) -> int:
        """Return where the last of the reads ended that began in a range of bytes."""
        return max((b for a, b in self._reads or () if begin <= a < end), default=begin)

    def is_empty(self, begin: int, end: int) -> bool:
        """Return whether a range of bytes is filled with zeros, as programs do to align what follows."""
        self._stream.seek(begin)
        while begin < end:
            piece = self._stream.read(min(_BLOCK, end - begin))
            if not piece or piece.count(0) < len(piece):
                return not piece
            begin += len(piece)
        return True

    def has_segment(self, begin: int) -> bool:
        """Return whether a segment begins somewhere behind a place."""
        self._stream.seek(begin)
        rest = b""
        while piece := self._stream.read(_BLOCK):
            text = rest + piece
            at = text.find(TDMS[0])
            while at >= 0:
                version = text[at + 8 : at + 12]
                if any(version in (v.to_bytes(4, "little"), v.to_bytes(4, "big")) for v in _VERSIONS):
                    return True
                at = text.find(TDMS[0], at + 1)
            rest = text[-_LEAD_IN:]
        return False

    def readable(self) -> bool:
        """Return that it can be read."""
        return True

    def seekable(self) -> bool:
        """Return that any place of it can be read."""
        return True

    def seek(self, offset: int, whence: int = 0) -> int:
        """Go to a place."""
        return self._stream.seek(self._end + offset) if whence == 2 else self._stream.seek(offset, whence)

    def tell(self) -> int:
        """Return the place."""
        return self._stream.tell()

    def read(self, size: int = -1) -> bytes:
        """Read some bytes, or all that are left."""
        at = self._stream.tell()
        left = max(self._end - at, 0)
        out = self._stream.read(left if size < 0 else min(size, left))
        if self._reads is not None:
            self._reads.append((at, at + len(out)))
        return out

    def readinto(self, buffer: Any) -> int:
        """Read bytes into a buffer; return how many."""
        room = memoryview(buffer).cast("B")
        data = self.read(len(room))
        room[: len(data)] = data
        return len(data)
