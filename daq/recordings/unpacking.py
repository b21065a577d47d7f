"""The text of a gzip file, refused as soon as it is far more than the file can hold."""

from __future__ import annotations

import gzip
import io
from pathlib import Path
from typing import Any, BinaryIO

from daq.errors import ReadingsError

# More bytes than these are no more than so many times the file's: text of readings is packed to a tenth or so.
MODEST, PACKED = 1 << 26, 100
_BUFFER = 1 << 20


def unpacked(path: Path) -> BinaryIO:
    """Open the text of a gzip file.

    Raises:
        ReadingsError: while it is read, as soon as it is far more than the file can hold.
    """
    return io.BufferedReader(Limited(gzip.open(path, "rb"), path), _BUFFER)


class Limited(io.RawIOBase):
    """An unpacked stream, counted."""

    def __init__(self, stream: Any, path: Path) -> None:
        """Take a stream that has `read1` and closes with this one, and the packed file."""
        self._stream, self._path, self._count = stream, path, 0
        self._size = path.stat().st_size

    def readable(self) -> bool:
        """Return that it can be read."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Read some bytes.

        Raises:
            ReadingsError: they are far more than the file can hold.
        """
        room = memoryview(buffer).cast("B")
        data = self._stream.read1(len(room))
        room[: len(data)] = data
        self._count += len(data)
        if self._count > max(MODEST, PACKED * self._size):
            raise ReadingsError(
                f"{self._path.name} has {self._size} bytes and is unpacked to more than {self._count - len(data)}",
                f"at most {PACKED} times as many as it has",
                "Is it a recording? Unpack it yourself, and give the unpacked file",
            )
        return len(data)

    def close(self) -> None:
        """Close it, and the stream below."""
        self._stream.close()
        super().close()
