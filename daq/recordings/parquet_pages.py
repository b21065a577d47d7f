"""Unpacked size of the pages of a Parquet file, checked before any of them is unpacked.

The footer is one account of that, the head of every page another, and Arrow makes room by the latter. Heads are structs
of Thrift's compact protocol: fields of a type and a number, integers in sevens of bits.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import pyarrow.parquet

from daq.errors import ReadingsError

# A writer may count otherwise by a little; what is more than this is no slip.
_SLACK = 1 << 20
# More than any head with its statistics.
_LONGEST_HEAD = 1 << 20
_DEEPEST = 16
_STOP, _BYTE, _DOUBLE, _BINARY, _LIST, _SET, _MAP, _STRUCT = 0, 3, 7, 8, 9, 10, 11, 12
_INTEGERS = (4, 5, 6)
_UNPACKED, _PACKED = 2, 3


def unpacked_bytes(path: Path) -> int:
    """Return how many bytes a Parquet file's pages are unpacked, by their own heads.

    Raises:
        ReadingsError: a head cannot be read, or they are far more than the footer tells.
        pyarrow.ArrowException, OSError: the footer cannot be read.
    """
    with pyarrow.parquet.ParquetFile(path) as file:
        metadata = file.metadata
        groups = [metadata.row_group(k) for k in range(metadata.num_row_groups)]
        chunks = [group.column(c) for group in groups for c in range(group.num_columns)]
        spans = [(_begin(chunk), chunk.total_compressed_size) for chunk in chunks]
        told = sum(max(chunk.total_uncompressed_size, 0) for chunk in chunks)
    size = path.stat().st_size
    with path.open("rb") as stream:
        found = sum(_pages(stream, begin, min(begin + max(length, 0), size), path.name) for begin, length in spans)
    if found > 2 * told + _SLACK:
        raise ReadingsError(
            f"{path.name} is damaged: its pages are {found} bytes unpacked, its footer tells {told}",
            "a Parquet file that tells its size",
            "Write it again",
        )
    return found


def _begin(chunk: pyarrow.parquet.ColumnChunkMetaData) -> int:
    # As Arrow has it: a dictionary's page lies before the others.
    first = int(chunk.data_page_offset)
    dictionary = chunk.dictionary_page_offset if chunk.has_dictionary_page else None
    return first if not dictionary or dictionary <= 0 else min(first, int(dictionary))


def _pages(stream: BinaryIO, at: int, end: int, name: str) -> int:
    """Return the sum of the pages from one place of a file to another."""
    out = 0
    while at < end:
        stream.seek(at)
        head = _Head(stream.read(min(_LONGEST_HEAD, end - at)))
        try:
            unpacked, packed = head.sizes()
        except (IndexError, KeyError, ValueError) as error:
            raise ReadingsError(
                f"{name} is torn or damaged (no page begins at byte {at})", "a complete file", "Copy it again"
            ) from error
        out += unpacked
        at += head.at + packed
    return out


class _Head:
    """Reads a page's head from its bytes."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def sizes(self) -> tuple[int, int]:
        """Return how many bytes the page has unpacked and packed; `at` is behind the head then.

        Raises:
            IndexError, KeyError, ValueError: this is no head.
        """
        found: dict[int, int] = {}
        for field, kind in self._fields():
            if field in (_UNPACKED, _PACKED) and kind in _INTEGERS:
                found[field] = self._signed()
            else:
                self._skip(kind, 0)
        unpacked, packed = found[_UNPACKED], found[_PACKED]
        if unpacked < 0 or packed < 0:
            raise ValueError("a negative size")
        return unpacked, packed

    def _fields(self) -> Iterator[tuple[int, int]]:
        field = 0
        while (byte := self._byte()) & 0x0F != _STOP:
            field = field + (byte >> 4) if byte >> 4 else self._signed()
            yield field, byte & 0x0F

    def _skip(self, kind: int, depth: int) -> None:
        if depth > _DEEPEST:
            raise ValueError("too deep")
        if kind == _BYTE:
            self._byte()
        elif kind in _INTEGERS:
            self._whole()
        elif kind == _DOUBLE:
            self._leap(8)
        elif kind == _BINARY:
            self._leap(self._whole())
        elif kind in (_LIST, _SET):
            byte = self._byte()
            for _ in range(byte >> 4 if byte >> 4 < 15 else self._whole()):
                self._item(byte & 0x0F, depth + 1)
        elif kind == _MAP:
            count = self._whole()
            kinds = self._byte() if count else 0
            for _ in range(count):
                self._item(kinds >> 4, depth + 1)
                self._item(kinds & 0x0F, depth + 1)
        elif kind == _STRUCT:
            for _, inner in self._fields():
                self._skip(inner, depth + 1)
        elif kind not in (1, 2):  # true and false have no bytes of their own
            raise ValueError("no type of the protocol")

    def _item(self, kind: int, depth: int) -> None:
        """Skip an item of a list; a truth value has a byte there, which a field's has not."""
        self._skip(_BYTE if kind in (1, 2) else kind, depth)

    def _byte(self) -> int:
        value = self.data[self.at]
        self.at += 1
        return value

    def _leap(self, count: int) -> None:
        self.at += count
        if self.at > len(self.data):
            raise IndexError("behind the end")

    def _whole(self) -> int:
        value = shift = 0
        while True:
            byte = self._byte()
            value |= (byte & 0x7F) << shift
            if not byte & 0x80:
                return value
            shift += 7
            if shift > 63:
                raise ValueError("too long")

    def _signed(self) -> int:
        value = self._whole()
        return (value >> 1) ^ -(value & 1)
