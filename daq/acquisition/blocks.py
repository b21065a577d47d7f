"""A chunk: some hundred milliseconds of a stream, as read and as decoded, in the form in which it is kept and sent."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.errors import JournalError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_HEAD = struct.Struct("<4sHxxqqqqqd")
_MAGIC, _VERSION = b"FTCK", 1
# Each sample: time, six components, status, overload.
_SAMPLE = np.dtype([("t_s", "<f8"), ("wrench", "<f8", (6,)), ("status", "<i8"), ("overload", "?")])
_READ = np.dtype([("bytes", "<i8"), ("arrival_s", "<f8")])


@dataclass(frozen=True, eq=False)
class Chunk:
    """Consecutive samples of a stream, with the bytes that they came from.

    Attributes:
        first_seq: number of the first sample in its stream, from 0 and without gaps: what the device lost is an event.
        t_s: (n,) time of each sample since the stream began [s].
        wrench: (n, 6) Fx Fy Fz [N], Tx Ty Tz [N mm], in the cell's axes.
        status: (n,) of the device, 0 where all is well.
        overload: (n,) whether the device says that it is beyond its range.
        raw: all bytes that were read, whether they became samples or not.
        reads: (number of bytes, arrival [s since the stream began]) of each read that `raw` is made of.
        utc_s: wall clock when the chunk was closed [s since 1970]; for people, never for timing.
        rejected: records that the decoder refused.
        skipped: bytes that belonged to no record.
    """

    first_seq: int
    t_s: Floats
    wrench: Floats
    status: Integers
    overload: NDArray[np.bool_]
    raw: bytes
    reads: Sequence[tuple[int, float]]
    utc_s: float
    rejected: int = 0
    skipped: int = 0

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def next_seq(self) -> int:
        """Number of the sample after the last."""
        return self.first_seq + len(self)

    @property
    def packed_bytes(self) -> int:
        """Length of the packed chunk."""
        return _HEAD.size + len(self) * _SAMPLE.itemsize + len(self.reads) * _READ.itemsize + len(self.raw) + 4

    def to_bytes(self) -> bytes:
        """Pack; the last four bytes are the CRC-32 of all before."""
        table = np.empty(len(self), dtype=_SAMPLE)
        table["t_s"], table["wrench"] = self.t_s, self.wrench
        table["status"], table["overload"] = self.status, self.overload
        reads = np.array([tuple(r) for r in self.reads], dtype=_READ)
        head = _HEAD.pack(
            _MAGIC, _VERSION, self.first_seq, len(self), len(reads), self.rejected, self.skipped, self.utc_s
        )
        # Joined once: a replay's chunks are tens of megabytes.
        parts = (head, table.view(np.uint8).data, reads.tobytes(), self.raw)
        crc = 0
        for part in parts:
            crc = zlib.crc32(part, crc)
        return b"".join((*parts, struct.pack("<I", crc)))

    @classmethod
    def from_bytes(cls, data: bytes) -> Chunk:
        """Unpack.

        Raises:
            JournalError: it is damaged or of another version.
        """
        if len(data) < _HEAD.size + 4 or zlib.crc32(data[:-4]) != struct.unpack("<I", data[-4:])[0]:
            raise JournalError(
                "a chunk is damaged (its checksum does not hold)", "what was written", "Recover the rest"
            )
        magic, version, first, count, reads, rejected, skipped, utc_s = _HEAD.unpack_from(data)
        if magic != _MAGIC or version != _VERSION:
            raise JournalError(f"a chunk of version {version}", f"version {_VERSION}", "Use the newer fingertwin")
        end = _HEAD.size + count * _SAMPLE.itemsize
        if count < 0 or reads < 0 or end + reads * _READ.itemsize + 4 > len(data):
            raise JournalError(
                f"a chunk that says it has {count} samples and {reads} reads, in {len(data)} bytes",
                "as many as it has",
                "Send what was read",
            )
        table = np.frombuffer(data, _SAMPLE, count, _HEAD.size)
        portions = np.frombuffer(data, _READ, reads, end)
        return cls(
            first,
            table["t_s"].copy(),
            table["wrench"].copy(),
            table["status"].astype(np.int64),
            table["overload"].copy(),
            data[end + reads * _READ.itemsize : -4],
            [(int(n), float(at)) for n, at in portions],
            utc_s,
            rejected,
            skipped,
        )
