"""A chunk on its way to the service, in parts where it is too large for it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from daq.acquisition.blocks import Chunk
from daq.uplink.wire import Range


@dataclass(eq=False)
class Sending:
    """A chunk on its way.

    Attributes:
        stream: id of its stream.
        first_seq: number of its first sample.
        count: of its samples.
        payload: as it is kept.
        sha256: of the payload.
        parts: samples of it, from 0, that are still to be sent.
        resent: whether the service once had it.
        refusal: what the service said against it, until it is clear that the chunk is meant.
        refused: how often it was meant; a bit that was flipped on the way must not set it aside.
    """

    stream: str
    first_seq: int
    count: int
    payload: bytes
    sha256: str
    parts: list[Range]
    resent: bool
    refusal: str | None = None
    refused: int = 0

    def message(self, begin: int, end: int) -> tuple[bytes, str]:
        """Return a part as it is sent, and its SHA-256."""
        if (begin, end) == (0, self.count):
            return self.payload, self.sha256
        payload = part(Chunk.from_bytes(self.payload), begin, end).to_bytes()
        return payload, hashlib.sha256(payload).hexdigest()

    def halve(self) -> None:
        """Send the next part in two."""
        begin, end = self.parts[0]
        middle = (begin + end) // 2
        self.parts[:1] = [(begin, middle), (middle, end)]

    def held(self, stored: Any) -> list[Range]:
        """Return the parts of a chunk that the service already holds; none where it holds anything else in their place.

        Args:
            stored: chunks in its place, by the service's answer: `first_seq`, `count` and `sha256` of each.
        """
        found = [self._same(value) for value in stored] if isinstance(stored, list) else []
        return [] if None in found else [bounds for bounds in found if bounds is not None]

    def _same(self, value: Any) -> Range | None:
        if not isinstance(value, Mapping):
            return None
        first, count, digest = (value.get(key) for key in ("first_seq", "count", "sha256"))
        if not isinstance(first, int) or not isinstance(count, int):
            return None
        begin, end = first - self.first_seq, first - self.first_seq + count
        if not 0 <= begin <= end <= self.count or (begin == end and self.count):
            return None
        return (begin, end) if self.message(begin, end)[1] == digest else None


def part(chunk: Chunk, begin: int, end: int) -> Chunk:
    """Return samples `begin` to `end` of a chunk, with their share of its bytes.

    Parts that follow each other hold every sample, every byte and every read once and in order, so that they decode as
    the whole does: no read is torn, since one may be a datagram. Only the whole and the bounds count, so that the same
    part is the same again after a restart.
    """
    count = len(chunk)
    if (begin, end) == (0, count):
        return chunk
    ends = np.cumsum([size for size, _ in chunk.reads], dtype=np.int64)

    def reads_before(sample: int) -> int:
        return len(ends) if sample == count else int((ends * count <= len(chunk.raw) * sample).sum())

    first, last = (0 if begin == 0 else reads_before(begin)), reads_before(end)
    from_byte = int(ends[first - 1]) if first else 0
    to_byte = len(chunk.raw) if end == count else (int(ends[last - 1]) if last else 0)
    return Chunk(
        chunk.first_seq + begin,
        chunk.t_s[begin:end],
        chunk.wrench[begin:end],
        chunk.status[begin:end],
        chunk.overload[begin:end],
        chunk.raw[from_byte:to_byte],
        chunk.reads[first:last],
        chunk.utc_s,
        chunk.rejected if begin == 0 else 0,
        chunk.skipped if begin == 0 else 0,
    )
