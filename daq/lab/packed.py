"""Unpacked size of an Excel or OpenDocument file, checked before a reader makes room for it.

Such a file is an archive whose list of contents may tell any size, and one stray cell far down makes a reader hold
every cell before it.
"""

from __future__ import annotations

import re
import struct
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import BinaryIO

from daq.errors import ReadingsError

# Of all parts together, and of the cells from the first to the last row and column of each sheet, all sheets together.
MOST_BYTES, MOST_CELLS = 1 << 30, 20_000_000
# More cells than these are no more than so many times those that are there: room is made for the gaps too.
_FEW_CELLS, _SPARSE = 2_000_000, 20
# Of numbers: more bytes than these are no more than so many times what the file has. Noise is not packed that tightly.
_MODEST, _PACKED = 1 << 30, 100
_BLOCK = 1 << 20
# Rows, cells and shared texts of a sheet, with their attributes; one that is not closed soon is none that is written.
_TAG = re.compile(rb"""<(?:[^\s<>/:]*:)?(row|c|si)(?=[\s/>])(?: r="([A-Z]{0,3})([0-9]{1,8})")?([^<>]{0,400})(>?)""")
_LONGEST_TAG, _LONGEST_ROW = 1000, 16 << 20
_PLACE = re.compile(rb"""(?<![\w:.-])r\s*=\s*["']([A-Za-z]{0,3})([0-9]{1,8})["']""")
_SHARED = re.compile(rb"""(?<![\w:.-])t\s*=\s*["']s["']""")
# Of OpenDocument: how often a row and a cell are repeated.
_REPEATED = re.compile(rb"""(rows|columns)-repeated\s*=\s*["']\s*([0-9]{1,18})""")
# Of a part's own head: its last two numbers are the lengths of its name and of what else stands before its bytes.
_HEAD = struct.Struct("<4s5H3L2H")


def require_held(path: Path, told: int) -> None:
    """Refuse a file that tells far more bytes of numbers than it can hold.

    Raises:
        ReadingsError: it does.
    """
    size = path.stat().st_size
    if told > max(_MODEST, _PACKED * size):
        raise ReadingsError(
            f"{path.name} tells {told} bytes of values and has {size}",
            f"at most {_PACKED} times as many as it has",
            "Export the recording again, without room for values that were never written",
        )


def require_modest(path: Path) -> None:
    """Refuse an archive that is unpacked to more than is read into memory.

    Raises:
        ReadingsError: it is; or it is no archive that can be read.
    """
    try:
        with zipfile.ZipFile(path) as archive, path.open("rb") as stream:
            if any(part.filename.lower().endswith("workbook.bin") for part in archive.infolist()):
                raise ReadingsError(
                    f"{path.name} is a binary workbook (.xlsb)", "an .xlsx or .xls file", "Save it as .xlsx or CSV"
                )
            size, sheets = 0, _Sheets()
            for part in archive.infolist():
                watched = _Repeats(sheets) if part.filename == "content.xml" else _Sheet(sheets)
                for piece in _unpacked(stream, part):
                    size += len(piece)
                    if size > MOST_BYTES:
                        raise _too_large(path, f"more than {MOST_BYTES} bytes unpacked", f"at most {MOST_BYTES}")
                    _require(path, watched.look(piece))
                _require(path, watched.end())
    except ReadingsError:
        raise
    except (zipfile.BadZipFile, zlib.error, OSError, ValueError, NotImplementedError) as error:
        said = " ".join(str(error).split())[:160]
        raise ReadingsError(f"{path.name} is no sound Excel file ({said})", "an .xlsx or .xls file") from error


def _require(path: Path, fault: str) -> None:
    if fault:
        raise _too_large(path, fault, f"at most {MOST_CELLS} cells, and {_SPARSE} for each that is there")


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


@dataclass
class _Sheets:
    """Total size of the sheets that were looked at.

    Attributes:
        cells: of the sheets that came before, gaps included.
        present: cells that are there.
        shared: cells that name a shared text; longest: bytes of the longest shared text.
    """

    cells: int = 0
    present: int = 0
    shared: int = 0
    longest: int = 0

    def too_many(self, cells: int) -> bool:
        """Whether a sheet of so many cells is too much, after those before."""
        whole = self.cells + cells
        return whole > min(MOST_CELLS, max(_FEW_CELLS, _SPARSE * self.present))


class _Sheet:
    """The last row and column of a part that is a sheet, and the longest text of one that holds shared texts.

    A row or cell that does not say its place is the next one.
    """

    def __init__(self, sheets: _Sheets) -> None:
        self._all = sheets
        self._row = self._column = 0
        self._last = (0, 0)
        self._begun = False
        self._rest = b""
        self._passed, self._text_at = 0, -1

    def look(self, piece: bytes) -> str:
        """Take one more piece of its text; return what is too much, nothing where nothing is."""
        text = self._rest + piece
        end = text.rfind(b"<")
        whole, self._rest = (text[:end], text[end:]) if end >= 0 and len(text) - end < _LONGEST_TAG else (text, b"")
        self._begun = self._begun or b"sheetData" in text
        for tag in _TAG.finditer(whole):
            name, letters, digits, attributes, closed = tag.groups()
            if name == b"si":
                self._text(self._passed + tag.start())
            elif self._begun and digits and name == b"c" and attributes == b"" and closed:  # as most are
                self._all.present += 1
                self._see(int(digits), _column(letters))
            elif self._begun:
                if not closed or attributes.count(b'"') % 2 or attributes.count(b"'") % 2:
                    return f"the tag {whole[tag.start() : tag.start() + 40]!r}, which cannot be read"
                self._place(name, [(letters, digits)] if digits else [], attributes)
        self._passed += len(whole)
        return self._too_much()

    def _too_much(self) -> str:
        if self._all.too_many(self._last[0] * self._last[1]):
            return f"a cell in row {self._last[0]}, column {self._last[1]}"
        if self._all.shared * self._all.longest > MOST_BYTES:
            return f"{self._all.shared} cells that share texts of up to {self._all.longest} bytes"
        return ""

    def end(self) -> str:
        """Take note that the part is over; return what is too much."""
        self._text(self._passed + len(self._rest))
        fault = self._too_much()
        self._all.cells += self._last[0] * self._last[1]
        return fault

    def _place(self, name: bytes, told: list[tuple[bytes, bytes]], attributes: bytes) -> None:
        told = told + _PLACE.findall(attributes)
        row = max((int(digits) for _, digits in told), default=0)
        if name == b"row":
            self._see(row or self._row + 1, 0)
        else:
            column = max((_column(letters) for letters, _ in told), default=0)
            self._see(max(row, self._row), column or self._column + 1)
            self._all.present += 1
            self._all.shared += _SHARED.search(attributes) is not None

    def _see(self, row: int, column: int) -> None:
        self._row, self._column = row, column
        self._last = (max(self._last[0], row), max(self._last[1], column))

    def _text(self, at: int) -> None:
        """End a shared text, and begin another."""
        if self._text_at >= 0:
            self._all.longest = max(self._all.longest, at - self._text_at)
        self._text_at = at


@cache
def _column(letters: bytes) -> int:
    out = 0
    for letter in letters.upper():
        out = 26 * out + letter - 64
    return out


class _Repeats:
    """Number of cells of an OpenDocument table, whose rows and cells may be stored once and repeated."""

    def __init__(self, sheets: _Sheets) -> None:
        self._all = sheets
        self._rows = self._empty = self._width = 0
        self._rest = b""

    def look(self, piece: bytes) -> str:
        """Take one more piece of its text; return what is too much, nothing where nothing is."""
        *rows, self._rest = (self._rest + piece).split(b"<table:table-row")
        for row in rows:
            self._add(row)
        return f"more than {_LONGEST_ROW} bytes in a row" if len(self._rest) > _LONGEST_ROW else self._too_much()

    def _too_much(self) -> str:
        if self._all.too_many(self._rows * self._width):
            return f"cells that are repeated to {self._rows} rows of {self._width}"
        return ""

    def end(self) -> str:
        """Take note that the part is over; return what is too much."""
        self._add(self._rest)
        fault = self._too_much()
        self._all.cells += self._rows * self._width
        return fault

    def _add(self, row: bytes) -> None:
        """Count a row from its text; empty rows and cells count where a filled one follows."""
        head, _, told = row.partition(b">")
        often = max((int(n) for kind, n in _REPEATED.findall(head) if kind == b"rows"), default=1)
        width = last = 0
        for cell in told.split(b"<table:")[1:]:
            width += max((int(n) for kind, n in _REPEATED.findall(cell) if kind == b"columns"), default=1)
            if any(word in cell for word in (b"value", b"<text:", b"formula")):
                last = width
                self._all.present += 1
        if last:
            self._rows, self._empty, self._width = self._rows + self._empty + often, 0, max(self._width, last)
        else:
            self._empty += often
