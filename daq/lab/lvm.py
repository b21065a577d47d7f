"""LVM files, the text that LabVIEW writes measurements as: a header with tags, then segments of rows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.errors import ReadingsError
from daq.lab.channels import BLOCK_ROWS, Channel, LabChannels

Floats = NDArray[np.float64]

_END_OF_HEADER = "***End_of_Header***"
_LONGEST_LINE = 1 << 20
_SEGMENT_TAGS = ("Channels", "Samples", "Date", "Time", "Y_Unit_Label", "Y_Dimension", "X_Dimension", "X0", "Delta_X")


# To so many seconds are increments written.
_STEP_S = 1e-6


class LvmChannels(LabChannels):
    """An LVM file: a header with tags, then segments, each with a header, headings and rows."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rounded_to_s = _STEP_S
        with path.open("rb") as stream:
            stream.seek(-1, 2)
            self.cut_off = stream.read(1) != b"\n"
            stream.seek(0)
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
                raise self._fault(lines.number, "commas separate numbers and decimals", "a file with Separator Tab")
            tags, self._headings = self._segment(lines, None)
            self.pauses_possible = any(t.split(self._separator)[0].strip() in _SEGMENT_TAGS for t in lines)
        names = [h or f"column {i + 1}" for i, h in enumerate(self._headings)]
        often = Counter(names)
        self._names = [n if often[n] == 1 else f"{n} #{i + 1}" for i, n in enumerate(names)]
        # Tags count channels; columns count the time as well, whether its cells are filled or not.
        places = [i for i, h in enumerate(self._headings) if h not in ("X_Value", "Comment")]
        units, steps, starts = (self._cells(tags, t, places) for t in ("Y_Unit_Label", "Delta_X", "X0"))
        x_columns = head.get("X_Columns", "One").lower()
        x_filled = x_columns != "no"
        self._clocks = [i for i, h in enumerate(self._headings) if h == "X_Value"] if x_columns == "multi" else []
        self.channels = tuple(
            Channel(
                name,
                units.get(i, ""),
                "",
                None if steps.get(i) is None else self._number(steps[i]),
                (self._number(starts[i]) if starts.get(i) else 0.0) or 0.0,
            )
            for i, (name, h) in enumerate(zip(self._names, self._headings, strict=True))
            if h != "Comment" and (h != "X_Value" or x_filled)
        )

    def blocks(self, names: Sequence[str]) -> Iterator[Floats]:
        """Yield the numbers (n, k) of some channels."""
        places = [self._names.index(self.channel(n).name) for n in names]
        rows: list[list[float]] = []
        with self.path.open("rb") as stream:
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
        row = []
        for place in places:
            value = self._number(cells[place]) if place < len(cells) else None
            if value is None:
                found = repr(cells[place]) if place < len(cells) else "missing"
                raise self._fault(lines.number, f"{self._names[place]} is {found}", "a finite number")
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
        return tags, headings

    @staticmethod
    def _cells(tags: dict[str, list[str]], tag: str, places: list[int]) -> dict[int, str]:
        # The tag stands over the first column, and each value over its own; an empty one states nothing.
        cells = ["", *tags.get(tag, [])]
        return {p: cells[p] for p in places if p < len(cells) and cells[p]}

    def _number(self, text: str) -> float | None:
        if self._comma:
            if "." in text:
                return None
            text = text.replace(",", ".")
        try:
            value = float(text)
        except ValueError:
            return None
        return value if np.isfinite(value) else None

    def _fault(self, line: int, found: str, expected: str, remedy: str = "Copy it again") -> ReadingsError:
        return ReadingsError(f"{self.path.name}, line {line}: {found}", expected, remedy)


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
        line: bytes = self._stream.readline(_LONGEST_LINE)
        if not line:
            raise StopIteration
        self.number += 1
        if len(line) == _LONGEST_LINE:
            raise ReadingsError(f"{self._path.name}, line {self.number}: more than a megabyte", "lines of an LVM file")
        if not line.endswith(b"\n"):
            raise StopIteration
        try:
            return line.decode("utf-8-sig").rstrip("\r\n")
        except UnicodeDecodeError:
            return line.decode("cp1252", "replace").rstrip("\r\n")  # LabVIEW's own, on Western Windows
