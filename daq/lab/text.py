"""Text with columns, as any program writes it: its first lines tell separators, decimal commas, headers and times."""

from __future__ import annotations

import csv
import gzip
import io
import re
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import IO, Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray

from daq.errors import ReadingsError
from daq.lab.channels import BLOCK_ROWS, TIMESTAMP, Channel, LabChannels
from daq.lab.table import SAMPLE_ROWS, Clock, Table, find_table, is_told_again, moment_of, number_of
from daq.recordings.unpacking import unpacked

Floats = NDArray[np.float64]

_LONGEST_LINE, _BLOCK_CHARACTERS = 1 << 20, 1 << 22
# A cell whose quotation mark is closed on a later line; looked for so far down, and over at most so many lines.
_OPEN_QUOTE = re.compile(r'(?:^|[,;\t|])\s*"[^"]*$')
_HEAD_LINES, _HELD_LINES = 100, 20
_SPACES = " "
_REMOVE = "Remove that row, or everything from there on"
# Three digits behind a gap or an apostrophe.
_THOUSANDS = re.compile(r"\d[ '\u2019\u00a0\u202f]\d{3}(?!\d)")
# Separator and decimal mark; of two that tell as many numbers the first is taken.
_LAYOUTS = (
    ("\t", "."), ("\t", ","), (";", "."), (";", ","), ("|", "."), ("|", ","), (",", "."), (",", ","),
    (_SPACES, "."), (_SPACES, ","),
)  # fmt: skip
_SEPARATORS = {"\t": "tabs", ";": "semicolons", ",": "commas", "|": "bars", _SPACES: "spaces"}


class TableChannels(LabChannels):
    """Columns of a table that was found among rows of cells."""

    _table: Table

    def _name(self, table: Table, sample: Sequence[Sequence[Any]], decimal: str) -> None:
        """Take over what was found."""
        width = len(table.names)
        often = Counter(table.names)
        self._table, self._decimal = table, decimal
        self._names = [n if often[n] == 1 else f"{n} #{i + 1}" for i, n in enumerate(table.names)]
        columns: list[list[Any]] = [[row[i] for row in sample if len(row) > i] for i in range(width)]
        channels = []
        for i, (name, column) in enumerate(zip(self._names, columns, strict=True)):
            unit = table.units[i] if i < len(table.units) else ""
            numbers = [number_of(cell, decimal) is not None for cell in column]
            moments = 0 if any(numbers) else sum(moment_of(cell) is not None for cell in column)
            dated = 2 * moments > len(column)
            fault = "" if dated or all(numbers) or numbers.count(True) * 2 > len(numbers) else _text_of(column, numbers)
            channels.append(Channel(name, TIMESTAMP if dated else unit, fault=fault))
        self.channels = tuple(channels)
        if table.above:
            lines = "1 line above the names of the columns is" if table.above == 1 else f"{table.above} lines above are"
            self.notes += (f"{lines} not read",)

    def _rows_to_blocks(self, rows: Iterator[tuple[int, Sequence[Any]]], names: Sequence[str]) -> Iterator[Floats]:
        """Yield the numbers (n, k) of some columns; times as seconds since the first."""
        places = [self._names.index(self.readable(name).name) for name in names]
        clocks = {place: Clock(self.path.name) for place in places}
        while some := list(islice(rows, BLOCK_ROWS)):
            block = self._numbers(some, places, clocks)
            if len(block):
                yield block

    def _numbers(
        self, rows: Iterable[tuple[int, Sequence[Any]]], places: Sequence[int], clocks: Mapping[int, Clock]
    ) -> Floats:
        """Return the numbers (n, k) of some rows at some places; times as seconds since the first."""
        number = partial(number_of, decimal=self._decimal)
        block: list[list[float]] = []
        for line, cells in rows:
            if not any(str(c).strip() for c in cells if c is not None):
                continue
            try:
                block.append(self._row(line, cells, places, number, clocks))
            except ReadingsError:
                if not is_told_again(cells, self._table.names, self._table.units):
                    raise
        return np.array(block).reshape(-1, len(places))

    def _row(
        self,
        line: int,
        cells: Sequence[Any],
        places: Sequence[int],
        number: Callable[[Any], float | None],
        clocks: Mapping[int, Clock],
    ) -> list[float]:
        """The numbers of one row at some places; times as seconds since the first."""
        width = len(self._names)
        if len(cells) < width and max(places) >= len(cells):
            raise self._fault(line, f"it has {len(cells)} cells", f"{width}, as the first row has", _REMOVE)
        if any(str(c).strip() for c in cells[width:] if c is not None):
            remedy = "Export it without separators of thousands, or remove that row"
            raise self._fault(line, f"it has {len(cells)} cells", f"{width}, as the first row has", remedy)
        row = []
        for place in places:
            value = number(cells[place])
            if value is None and (moment := moment_of(cells[place])) is not None:
                value = clocks[place].elapsed(moment)
            if value is None or not np.isfinite(value):
                found = f"{self._names[place]} is {cells[place]!r}"
                raise self._fault(line, found, "a finite number", self._remedy(str(cells[place])))
            row.append(value)
        return row

    def _remedy(self, text: str) -> str:
        if _THOUSANDS.search(text):
            return "Export it without separators of thousands"
        other = {".": ",", ",": "."}[self._decimal]
        if other in text:
            mark = "point" if self._decimal == "." else "comma"
            return f"The first rows have a decimal {mark}: write all numbers alike, without separators of thousands"
        return _REMOVE

    def _fault(self, line: int, found: str, expected: str, remedy: str = "") -> ReadingsError:
        return ReadingsError(f"{self.path.name}, line {line}: {found}", expected, remedy)


class TextChannels(TableChannels):
    """Text with columns; gzipped or not."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with path.open("rb") as stream:
            self._zipped = stream.read(2) == b"\x1f\x8b"
        start = self._start()
        self._encoding = _encoding_of(start, path.name)
        lines = [line for _, line in islice(self._lines(), SAMPLE_ROWS)]
        found = [
            (table, layout)
            for layout in _LAYOUTS
            if (table := find_table(_split(lines, layout[0]), partial(number_of, decimal=layout[1]))) is not None
        ]
        if not found:
            begins = f"begins with {lines[0][:40]!r} and has no rows of numbers" if lines else "has no whole line"
            raise ReadingsError(
                f"{path.name} {begins}",
                "columns of numbers between commas, semicolons, tabs or spaces, below their names",
                "Export it as CSV, without separators of thousands",
            )
        # The layout that makes most of the sample numbers; where two do, the one named first.
        table, (self._separator, decimal) = max(found, key=lambda f: f[0].values)
        sample = _split(lines, self._separator)[table.first :]
        width = len(_trimmed(sample[0]))
        # The last cells may be empty, such as those of a column for remarks.
        if not width <= len(table.names) <= len(sample[0]):
            remedy = "Name every column"
            if self._separator == "," and width > len(table.names):
                remedy = "Commas between columns and in numbers look alike: export it with semicolons or decimal points"
            raise ReadingsError(
                f"{path.name} has {len(table.names)} names above {width} numbers in a row", "as many", remedy
            )
        if self._separator == _SPACES and len(table.units) not in (0, len(table.names)):
            self.notes += (f"its row of units has {len(table.units)} words for {width} columns and is not heeded",)
            table = replace(table, units=())
        self._name(table, sample, decimal)
        if decimal == ",":
            self.notes += ("its numbers have decimal commas",)
        if self._separator != ",":
            self.notes += (f"its columns stand between {_SEPARATORS[self._separator]}",)

    def blocks(self, names: Sequence[str]) -> Iterator[Floats]:
        """Yield the numbers (n, k) of some columns."""
        places = [self._names.index(self.readable(name).name) for name in names]
        clocks = {place: Clock(self.path.name) for place in places}
        for lines in _parts(islice(self._lines(), self._table.first, None)):
            block = self._plain_numbers([line for _, line in lines], places)
            if block is None:
                cells = _split([line for _, line in lines], self._separator)
                block = self._numbers(zip((n for n, _ in lines), cells, strict=True), places, clocks)
            if len(block):
                yield block

    def _plain_numbers(self, lines: Sequence[str], places: Sequence[int]) -> Floats | None:
        """Return the numbers (n, k) of lines that hold nothing but numbers, ten times faster; None of others."""
        separator = self._separator
        if separator == _SPACES:
            separator, lines = "\t", ["\t".join(line.split()) for line in lines]
        text = "\n".join(lines)
        if '"' in text:
            return None
        width = lines[0].count(separator) + 1
        if width < len(self._names):
            return None
        empty = {str(i): pa.null() for i in range(len(self._names), width)}
        columns = [str(place) for place in places]
        try:
            table = pa.csv.read_csv(
                pa.BufferReader(text.encode()),
                pa.csv.ReadOptions(use_threads=False, column_names=[str(i) for i in range(width)]),
                pa.csv.ParseOptions(delimiter=separator, quote_char=False),
                pa.csv.ConvertOptions(
                    column_types=dict.fromkeys(columns, pa.float64()) | empty,
                    include_columns=[*columns, *empty],
                    null_values=[""],
                    decimal_point=self._decimal,
                ),
            )
        except (pa.ArrowException, UnicodeEncodeError):
            return None
        block = np.stack([table.column(name).to_numpy() for name in columns], axis=1)
        # A cell without a number is not a number here; what it is, is said by those who read it cell by cell.
        return block if np.isfinite(block).all() else None

    def _opened(self) -> IO[bytes]:
        return unpacked(self.path) if self._zipped else self.path.open("rb")

    def _start(self) -> bytes:
        try:
            with gzip.open(self.path) if self._zipped else self.path.open("rb") as stream:
                return stream.read(1 << 16)
        except EOFError:
            return b""
        except (OSError, ValueError, zlib.error) as error:
            raise ReadingsError(
                f"{self.path.name} cannot be unpacked ({error})", "a gzip file", "Copy it again"
            ) from error

    def _lines(self) -> Iterator[tuple[int, str]]:
        """Yield whole lines with their number; a heading in quotation marks may go over several."""
        held: list[tuple[int, str]] = []
        for number, line in self._single_lines():
            if not held and (number > _HEAD_LINES or not _OPEN_QUOTE.search(line)):
                yield number, line
                continue
            held.append((number, line))
            whole = " ".join(text for _, text in held)
            if whole.count('"') % 2 == 0:
                yield number, whole
                held = []
            elif len(held) > _HELD_LINES:
                yield from held
                held = []
        yield from held

    def _single_lines(self) -> Iterator[tuple[int, str]]:
        """Yield whole lines with their number: half a number looks like a whole one."""
        number = 0
        with self._opened() as raw, io.TextIOWrapper(raw, encoding=self._encoding, newline=None) as stream:
            while True:
                try:
                    line = stream.readline(_LONGEST_LINE)
                except EOFError:
                    self.cut_off = True
                    return
                except ReadingsError:
                    raise
                except (UnicodeDecodeError, OSError, ValueError, zlib.error) as error:
                    raise self._fault(number + 1, f"it cannot be read ({error})", "text", "Copy it again") from error
                if len(line) == _LONGEST_LINE:
                    raise self._fault(number + 1, "more than a million characters", "lines of a table")
                if not line or not line.endswith("\n"):
                    self.cut_off = self.cut_off or bool(line)
                    return
                number += 1
                yield number, line.rstrip("\n")


def _parts(lines: Iterator[tuple[int, str]]) -> Iterator[list[tuple[int, str]]]:
    """Yield lines by the block, fewer where they are long."""
    held: list[tuple[int, str]] = []
    size = 0
    for number, line in lines:
        held.append((number, line))
        size += len(line)
        if len(held) == BLOCK_ROWS or size > _BLOCK_CHARACTERS:
            yield held
            held, size = [], 0
    if held:
        yield held


def _trimmed(cells: Sequence[str]) -> list[str]:
    out = list(cells)
    while out and not out[-1].strip():
        out.pop()
    return out


def _text_of(column: Sequence[Any], numbers: Sequence[bool]) -> str:
    """Describe a column with few numbers or none, by the first of its cells that is something else."""
    others = (str(c).strip() for c, known in zip(column, numbers, strict=True) if c is not None and not known)
    if first := next((text for text in others if text), ""):
        return f"holds text ({first[:24]!r})"
    return "is empty in half of its rows or more" if any(numbers) else "holds nothing"


def _split(lines: Sequence[str], separator: str) -> list[list[str]]:
    if separator == _SPACES:
        return [line.split() if '"' not in line else _between_spaces(line) for line in lines]
    # One line at a time: a quotation mark that is never closed swallows no more than its own.
    return [next(csv.reader([line], delimiter=separator, skipinitialspace=True), []) for line in lines]


def _between_spaces(line: str) -> list[str]:
    """Return cells in quotation marks between any number of spaces, as R writes them."""
    return _trimmed(next(csv.reader([line.replace("\t", " ").strip()], delimiter=_SPACES, skipinitialspace=True), []))


def _encoding_of(start: bytes, name: str) -> str:
    for mark, encoding in ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if start.startswith(mark):
            return encoding
    even, odd = start[:200:2], start[1:200:2]
    if len(start) > 20 and b"\x00" in start and b"\x00" not in (even if b"\x00" in odd else odd):
        return "utf-16-le" if b"\x00" in odd else "utf-16-be"  # without its mark
    if re.search(rb"[\x00-\x08\x0e-\x1f]", start):
        raise ReadingsError(
            f"{name} is neither text nor a recording that is known",
            "a TDMS, LVM, Parquet or Excel file, or text with columns",
            "Export it as CSV from the program that wrote it",
        )
    try:
        # The last character may be cut.
        start[: start.rfind(b"\n") + 1].decode("utf-8")
    except UnicodeDecodeError:
        return "cp1252"  # Windows' own, in western countries
    return "utf-8"
