"""What an Excel or OpenDocument file is unpacked, told before a reader makes room for it.

Such a file is an archive whose list of contents may tell any size, and one stray cell far down makes a reader hold
every cell before it.
"""

from __future__ import annotations

import re
import struct
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from daq.errors import ReadingsError

# Of all parts together, and of the cells from the first to the last row and column of a sheet.
MOST_BYTES, MOST_CELLS = 1 << 30, 20_000_000
_BLOCK = 1 << 20
# Names of rows and cells in a sheet, such as r="17" and r="AB17"; a name is short, so that none is cut in two.
_PLACE = re.compile(rb"""<(?:\w+:)?(?:c|row)\s(?:[^<>]{0,200}?\s)?r\s*=\s*["']([A-Za-z]{0,3})([0-9]{1,8})["']""")
_OVERLAP = 300
# Of a part's own head: its last two numbers are the lengths of its name and of what else stands before its bytes.
_HEAD = struct.Struct("<4s5H3L2H")


def require_modest(path: Path) -> None:
    """Refuse an archive that is unpacked to more than is read into memory.

    Raises:
        ReadingsError: it is; or it is no archive that can be read.
    """
    try:
        with zipfile.ZipFile(path) as archive, path.open("rb") as stream:
            size = 0
            for part in archive.infolist():
                sheet = _Sheet() if "worksheets/" in part.filename else None
                for piece in _unpacked(stream, part):
                    size += len(piece)
                    if size > MOST_BYTES:
                        raise _too_large(path, f"more than {MOST_BYTES} bytes unpacked", f"at most {MOST_BYTES}")
                    if sheet is not None and sheet.cells(piece) > MOST_CELLS:
                        found = f"a cell in row {sheet.row}, column {sheet.column}"
                        raise _too_large(path, found, f"at most {MOST_CELLS} cells in all")
    except ReadingsError:
        raise
    except (zipfile.BadZipFile, zlib.error, OSError, ValueError, NotImplementedError) as error:
        said = " ".join(str(error).split())[:160]
        raise ReadingsError(f"{path.name} is no sound Excel file ({said})", "an .xlsx or .xls file") from error


def _too_large(path: Path, found: str, expected: str) -> ReadingsError:
    return ReadingsError(
        f"{path.name} has {found}", expected, "Delete what is not of the recording, or save the sheet as CSV"
    )


def _unpacked(stream: BinaryIO, part: zipfile.ZipInfo) -> Iterator[bytes]:
    """Unpack a part of an archive to its end, whatever size the list of contents tells."""
    stream.seek(part.header_offset)
    head = stream.read(_HEAD.size)
    if len(head) < _HEAD.size:
        raise zipfile.BadZipFile("a part begins behind the end")
    stream.seek(sum(_HEAD.unpack(head)[-2:]), 1)
    left = part.compress_size
    unpack = zlib.decompressobj(-zlib.MAX_WBITS) if part.compress_type == zipfile.ZIP_DEFLATED else None
    if unpack is None and part.compress_type != zipfile.ZIP_STORED:
        raise zipfile.BadZipFile(f"method {part.compress_type} of packing")
    while left > 0 and (packed := stream.read(min(_BLOCK, left))):
        left -= len(packed)
        if unpack is None:
            yield packed
            continue
        while packed:
            yield unpack.decompress(packed, _BLOCK)
            packed = unpack.unconsumed_tail


class _Sheet:
    """The last row and column of a sheet."""

    def __init__(self) -> None:
        self.row = self.column = 1
        self._rest = b""

    def cells(self, piece: bytes) -> int:
        """Return how many cells lie up to the last one so far, with one more piece of the sheet's text."""
        text = self._rest + piece
        for letters, digits in set(_PLACE.findall(text)):
            self.row = max(self.row, int(digits))
            column = 0
            for letter in letters.upper():
                column = 26 * column + letter - 64
            self.column = max(self.column, column)
        self._rest = text[-_OVERLAP:]
        return self.row * self.column
