"""Mark of a journal's last commit, kept outside the journal and its write-ahead log.

Where the log is lost, cut or zeroed, SQLite shows an earlier state without a word. This small file tells that more had
been there. It is written after each commit, never before: a journal that is behind it has lost what was acknowledged.
"""

from __future__ import annotations

import os
import struct
import weakref
import zlib
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

# Two slots, written in turn, so that one is whole whenever a writer is killed.
# Each: mark, turn, rows, samples, epoch, checksum.
_SLOT = struct.Struct("<8sQQQ32sI")
_MAGIC = b"ftmark01"
# A block each, so that neither is torn with the other.
_APART = 4096


def mark_file(path: Path) -> Path:
    """Return the path of a journal's mark."""
    return path.with_name(path.name + "-mark")


@dataclass(frozen=True)
class Mark:
    """Position of a journal's last commit.

    Attributes:
        turn: how often this was written.
        rows: chunks and events that were ever written.
        samples: in all chunks.
        epoch: of the journal.
    """

    turn: int
    rows: int
    samples: int
    epoch: str

    def missing(self, epoch: str, rows: int, samples: int) -> str | None:
        """Describe committed rows that a journal lacks; None where it lacks nothing, or is another."""
        if self.epoch != epoch or self.rows <= rows:
            return None
        return f"{self.samples - samples} readings ({self.rows - rows} rows) were committed and are missing"


def read_mark(path: Path) -> Mark | None:
    """Read the mark of a journal; None where there is none that is whole."""
    try:
        data = mark_file(path).read_bytes()
    except OSError:
        return None
    found = [m for m in (_slot(data[k * _APART : k * _APART + _SLOT.size]) for k in (0, 1)) if m is not None]
    return max(found, key=lambda m: m.turn, default=None)


class MarkWriter:
    """Writes the mark of a journal; where it cannot, that is no reason to stop logging.

    Args:
        path: of the journal.
    """

    def __init__(self, path: Path) -> None:
        before = read_mark(path)
        self._turn = 0 if before is None else before.turn
        self._descriptor: int | None = None
        with suppress(OSError):
            file = mark_file(path)
            if not file.exists() or file.stat().st_size < 2 * _APART:
                file.write_bytes(bytes(2 * _APART))
            # Written in place: a disk that is full has room for it.
            self._descriptor = os.open(file, os.O_RDWR | getattr(os, "O_BINARY", 0))
            self._closed = weakref.finalize(self, os.close, self._descriptor)

    def note(self, epoch: str, rows: int, samples: int) -> None:
        """Remember how far the journal has come."""
        if self._descriptor is None:
            return
        self._turn += 1
        body = _SLOT.pack(_MAGIC, self._turn, rows, samples, epoch.encode()[:32], 0)[:-4]
        with suppress(OSError):
            os.lseek(self._descriptor, (self._turn % 2) * _APART, os.SEEK_SET)
            os.write(self._descriptor, body + struct.pack("<I", zlib.crc32(body)))

    def close(self) -> None:
        """Let go of the file."""
        if self._descriptor is not None:
            self._descriptor = None
            self._closed()


def _slot(data: bytes) -> Mark | None:
    if len(data) < _SLOT.size:
        return None
    magic, turn, rows, samples, epoch, checksum = _SLOT.unpack(data)
    if magic != _MAGIC or checksum != zlib.crc32(data[: _SLOT.size - 4]):
        return None
    return Mark(turn, rows, samples, epoch.rstrip(b"\0").decode("ascii", "replace"))
