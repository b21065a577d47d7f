"""LVM files, the text that LabVIEW writes measurements as: a header with tags, then segments of rows."""

from __future__ import annotations

import codecs
import io
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from daq.errors import ReadingsError
from daq.lab.channels import BLOCK_ROWS, Channel, LabChannels
from daq.recordings.columns import number_of
from daq.units import factor_of

Floats = NDArray[np.float64]

_BEGINS = "LabVIEW Measurement"
# Bytes in which a file tells that it is one, also as UTF-16.
LVM_BYTES = 2 * len(_BEGINS) + 2
# How a file begins that an editor saved as UTF-16, with its mark or without.
_WIDE = {codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
_WIDE |= {_BEGINS.encode(encoding): encoding for encoding in ("utf-16-le", "utf-16-be")}
_END_OF_HEADER = "***End_of_Header***"
_LONGEST_LINE = 1 << 20
_SEGMENT_TAGS = ("Channels", "Samples", "Date", "Time", "Y_Unit_Label", "Y_Dimension", "X_Dimension", "X0", "Delta_X")
# What must be the same in all segments.
_UNITS = ("Y_Unit_Label", "X_Unit_Label")
_REMOVE = "Remove that row, or copy the file again"


# To so many seconds are increments written.
_STEP_S = 1e-6


class LvmChannels(LabChannels):
    """An LVM file: a header with tags, then segments, each with a header, headings and rows."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rounded_to_s = _STEP_S
        with path.open("rb") as raw:
            raw.seek(-2, 2)
            self.cut_off = not raw.read().strip(b"\x00").endswith(b"\n")
        with _opened(path) as stream:
            lines = _Lines(stream, path)
            head: dict[str, str] = {}
            self._separator = "\t"
            for text in lines:
                if text.startswith(_END_OF_HEADER):
                    break
                tag, _, value = text.partition("," if text.startswith("Separator,") else self._separator)
                if tag == "Separator":
                    self._separator = "," if value.startswith("Comma") else "\t"
                head[tag.strip()] = value.strip()
            else:
                raise self._fault(lines.number, "the header does not end", _END_OF_HEADER)
            self._comma = head.get("Decimal_Separator") == ","
            if self._comma and self._separator == ",":
                remedy = "Write it again with tabs"
                raise self._fault(
                    lines.number, "commas separate numbers and decimals", "a file with Separator Tab", remedy
                )
            self._units: dict[str, str] = {}
            tags, self._headings = self._segment(lines, None)
            self._units = {tag: " ".join(tags[tag]).strip() for tag in _UNITS if tag in tags}
            self.pauses_possible = any(t.split(self._separator)[0].strip() in _SEGMENT_TAGS for t in lines)
        names = [h or f"column {i + 1}" for i, h in enumerate(self._headings)]
        often = Counter(names)
        self._names = [n if often[n] == 1 else f"{n} #{i + 1}" for i, n in enumerate(names)]
        # Tags count channels; columns count the time as well, whether its cells are filled or not.
        places = [i for i, h in enumerate(self._headings) if h not in ("X_Value", "Comment")]
        units, steps, starts = (self._cells(tags, t, places) for t in ("Y_Unit_Label", "Delta_X", "X0"))
        x_unit = next(filter(None, tags.get("X_Unit_Label", [])), "")
        x_s = factor_of(x_unit or "s", "time")
        x_columns = head.get("X_Columns", "One").lower()
        x_filled = x_columns != "no"
        self._clocks = [i for i, h in enumerate(self._headings) if h == "X_Value"] if x_columns == "multi" else []
        self.channels = tuple(
            Channel(
                name,
                x_unit if h == "X_Value" else units.get(i, ""),
                "",
                # An increment of 0 says that there is none.
                step if (step := self._seconds(steps.get(i), x_s)) > 0.0 else None,
                self._seconds(starts.get(i), x_s),
            )
            for i, (name, h) in enumerate(zip(self._names, self._headings, strict=True))
            if h != "Comment" and (h != "X_Value" or x_filled)
        )

    def blocks(self, names: Sequence[str]) -> Iterator[Floats]:
        """Yield the numbers (n, k) of some channels."""
        places = [self._names.index(self.channel(n).name) for n in names]
        rows: list[list[float]] = []
        with _opened(self.path) as stream:
            lines = _Lines(stream, self.path)
            for text in lines:
                if text.startswith(_END_OF_HEADER):
                    break
            self._segment(lines, None)
            for text in lines:
                cells = text.split(self._separator)
                tag = cells[0].strip()
                if not text.strip():
                    continue
                if tag in _SEGMENT_TAGS or text.startswith("***"):
                    try:
                        self._segment(lines, text)
                    except _EndedError:
                        break
                    continue
                rows.append(self._row(cells, places, lines))
                self._check_clocks(cells, places, lines)
                if len(rows) == BLOCK_ROWS:
                    yield np.array(rows)
                    rows = []
        if rows:
            yield np.array(rows)

    def _row(self, cells: list[str], places: list[int], lines: _Lines) -> list[float]:
        # Between commas, a separator of thousands moves all numbers behind it: the last stands where a comment does.
        own = len(self._headings) - (self._separator == "," and self._headings[-1] == "Comment")
        if len(cells) > own and any(self._number(cell) is not None for cell in cells[own:]):
            remedy = "Export it without separators of thousands, or remove that row"
            raise self._fault(lines.number, f"a number stands in cell {len(cells)}", f"{own} numbers", remedy)
        row = []
        for place in places:
            value = self._number(cells[place]) if place < len(cells) else None
            if value is None:
                found = repr(cells[place]) if place < len(cells) else "missing"
                remedy = self._remedy(cells[place]) if place < len(cells) else _REMOVE
                raise self._fault(lines.number, f"{self._names[place]} is {found}", "a finite number", remedy)
            row.append(value)
        return row

    def _check_clocks(self, cells: list[str], places: list[int], lines: _Lines) -> None:
        """Refuse rows whose channels differ in time, in a file with a time column for each channel."""
        own = {max((c for c in self._clocks if c <= place), default=-1): place for place in places}
        times = {self._number(cells[c]) if c < len(cells) else None for c in own if c >= 0}
        if len(times) > 1:
            raise self._fault(
                lines.number,
                f"the channels differ in time ({', '.join(str(x) for x in times)} s)",
                "the same in all",
                "Write the file with one time column, or resample the channels to one clock",
            )

    def _segment(self, lines: _Lines, first: str | None) -> tuple[dict[str, list[str]], list[str]]:
        """Read a segment's header and headings; of a later segment the headings must be the same."""
        tags: dict[str, list[str]] = {}
        text = first if first is not None else next(lines, None)
        while text is not None and not text.startswith(_END_OF_HEADER):
            if text.startswith("***Start_Special***"):
                while text is not None and not text.startswith("***End_Special***"):
                    text = next(lines, None)
            elif text.strip():
                cells = text.split(self._separator)
                tags[cells[0].strip()] = [c.strip() for c in cells[1:]]
            text = next(lines, None)
        if text is None and first is not None and self.cut_off:
            raise _EndedError
        headings = [h.strip() for h in (next(lines, "") or "").split(self._separator)]
        while headings and not headings[-1]:
            headings.pop()
        if not headings and first is not None and self.cut_off:
            raise _EndedError
        if not headings:
            raise self._fault(lines.number, "a segment has no headings", "its channels' names after its header")
        if first is not None and headings != self._headings:
            raise self._fault(lines.number, "a segment has other channels", ", ".join(self._headings))
        for tag, stated in self._units.items():
            if tag in tags and (told := " ".join(tags[tag]).strip()) != stated:
                raise self._fault(lines.number, f"a segment has {tag} {told}", stated, "Split the file there")
        return tags, headings

    @staticmethod
    def _cells(tags: dict[str, list[str]], tag: str, places: list[int]) -> dict[int, str]:
        # The tag stands over the first column, and each value over its own; an empty one states nothing.
        cells = ["", *tags.get(tag, [])]
        return {p: cells[p] for p in places if p < len(cells) and cells[p]}

    def _seconds(self, text: str | None, factor: float | None) -> float:
        """Return a tag's number in seconds; 0 where it states none, or its unit is not one of time."""
        number = None if text is None else self._number(text)
        return 0.0 if number is None or factor is None else number * factor

    def _remedy(self, text: str) -> str:
        if any(mark in text for mark in ".,") and _number(text.replace(",", ".")) is not None:
            mark = "," if self._comma else "."
            return f"Its header states Decimal_Separator {mark}: correct it there, or write all numbers so"
        return _REMOVE

    def _number(self, text: str) -> float | None:
        if self._comma:
            if "." in text:
                return None
            text = text.replace(",", ".")
        return _number(text)

    def _fault(self, line: int, found: str, expected: str, remedy: str = "Copy it again") -> ReadingsError:
        return ReadingsError(f"{self.path.name}, line {line}: {found}", expected, remedy)


def is_lvm(start: bytes) -> bool:
    """Return whether a file begins as LabVIEW's text does."""
    return start.decode(_wide(start) or "utf-8-sig", "replace").startswith(_BEGINS)


def _wide(start: bytes) -> str | None:
    return next((encoding for mark, encoding in _WIDE.items() if start.startswith(mark)), None)


def _opened(path: Path) -> IO[Any]:
    """Open a file for its lines: as bytes, since each may be in another code page, or as text where it is UTF-16."""
    stream = path.open("rb")
    wide = _wide(stream.read(LVM_BYTES))
    stream.seek(0)
    return io.TextIOWrapper(stream, wide, "replace", newline="\n") if wide else stream


def _number(text: str) -> float | None:
    value = number_of(text)
    return value if value is not None and math.isfinite(value) else None


class _EndedError(Exception):
    """The file was cut off within the header of a later segment."""


class _Lines:
    """Whole lines of a file as text, counted, of bounded length: half a number looks like a whole one."""

    def __init__(self, stream: Any, path: Path) -> None:
        self._stream, self._path = stream, path
        self.number = 0

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        line: str | bytes = self._stream.readline(_LONGEST_LINE)
        if not line:
            raise StopIteration
        self.number += 1
        if len(line) == _LONGEST_LINE:
            raise ReadingsError(f"{self._path.name}, line {self.number}: more than a megabyte", "lines of an LVM file")
        text = line if isinstance(line, str) else _decoded(line)
        if not text.endswith("\n"):
            raise StopIteration
        return text.rstrip("\r\n")


def _decoded(line: bytes) -> str:
    try:
        return line.decode("utf-8-sig")
    except UnicodeDecodeError:
        return line.decode("cp1252", "replace")  # LabVIEW's own, on Western Windows
