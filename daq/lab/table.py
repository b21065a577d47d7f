"""A table among rows of cells: where its numbers begin, what its columns are called, and in which units."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from daq.errors import ReadingsError
from daq.units import is_unit

# Of a file, to tell how it is laid out.
SAMPLE_ROWS = 300
_CLOCK = r"(\d{1,2}):(\d{2})(?::(\d{2})(?:[.,](\d{1,9}))?)?"
_WHEN = re.compile(
    rf"^(?:(\d{{4}}-\d{{2}}-\d{{2}}|\d{{1,2}}[./]\d{{1,2}}[./]\d{{2,4}})[T ]+)?{_CLOCK}\s*(?:Z|[+-]\d\d:?\d\d)?$"
)
_NUMBER = re.compile(r"^[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?$|^[+-]?(nan|inf|infinity)$", re.IGNORECASE)


@dataclass(frozen=True)
class Moment:
    """A time as it stands in a cell: seconds of the day, and the day where it is told."""

    second: float
    day: str = ""


Value = float | Moment


@dataclass(frozen=True)
class Table:
    """Where a table is.

    Attributes:
        names: of its columns; `column 1` and so on where it has no header.
        units: as a row of its own states them; nothing where there is none.
        first: index of the first row of numbers.
        above: rows above the names that are not read.
        values: cells in the sample that are numbers or times.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    first: int
    above: int
    values: int


def number_of(cell: Any, decimal: str = ".") -> float | None:
    """A cell's number; None where it is none.

    Args:
        cell: text, or a number of a spreadsheet.
        decimal: point or comma.
    """
    if isinstance(cell, bool):
        return None
    if isinstance(cell, int | float):
        return float(cell)
    if not isinstance(cell, str):
        return None
    text = cell.strip()
    if decimal == ",":
        if "." in text:
            return None
        text = text.replace(",", ".")
    return float(text) if _NUMBER.match(text) else None


def moment_of(cell: Any) -> Moment | None:
    """A cell's time; None where it is none."""
    if isinstance(cell, dt.datetime):
        whole = cell.replace(hour=0, minute=0, second=0, microsecond=0)
        return Moment((cell - whole).total_seconds(), cell.date().isoformat())
    if isinstance(cell, dt.time):
        return Moment(cell.hour * 3600.0 + cell.minute * 60.0 + cell.second + cell.microsecond * 1e-6)
    match = _WHEN.match(cell.strip()) if isinstance(cell, str) else None
    if match is None:
        return None
    day, hours, minutes, seconds, parts = match.groups()
    return Moment(int(hours) * 3600.0 + int(minutes) * 60.0 + float(f"{seconds or 0}.{parts or 0}"), day or "")


def elapsed(now: Moment, start: Moment, file: str) -> float:
    """Seconds from one time to another.

    Raises:
        ReadingsError: the day changes, and is not written in the order of ISO 8601.
    """
    if now.day == start.day:
        return now.second - start.second
    try:
        days = dt.date.fromisoformat(now.day) - dt.date.fromisoformat(start.day)
    except ValueError:
        raise ReadingsError(
            f"{file}: the day changes from {start.day!r} to {now.day!r}, whose day and month may be exchanged",
            "dates such as 2024-05-31",
        ) from None
    return days.total_seconds() + now.second - start.second


def find_table(rows: Sequence[Sequence[Any]], number: Callable[[Any], float | None]) -> Table | None:
    """Find the table whose rows hold numbers or times; None where there is none.

    Args:
        rows: the file's first ones.
        number: a cell's number.
    """

    def values(row: Sequence[Any]) -> int:
        return sum(number(c) is not None or moment_of(c) is not None for c in row)

    def trimmed(row: Sequence[Any]) -> list[Any]:
        cells = list(row)
        while cells and (cells[-1] is None or not str(cells[-1]).strip()):
            cells.pop()
        return cells

    cells = [trimmed(row) for row in rows]
    counts = [values(row) for row in cells]
    numeric = [count >= 2 and 2 * count >= len(row) for count, row in zip(counts, cells, strict=True)]
    begins = [i for i, yes in enumerate(numeric) if yes]
    if not begins:
        return None

    def alike(first: int) -> bool:
        """Whether the next rows are as wide and hold numbers too."""
        near = [i for i in range(first, min(first + 4, len(cells))) if cells[i]]
        return all(numeric[i] and len(cells[i]) == len(cells[first]) for i in near)

    found = [(first, _header(cells, counts, first)) for first in begins]
    named = [pair for pair in found if pair[1][0]]
    # Numbers above a header belong to what stands above the table; without one they are the table's first.
    first, (names, units, above) = next((p for p in named if alike(p[0])), (named or found)[0])
    if not names:
        names = tuple(f"column {i + 1}" for i in range(len(cells[first])))
    return Table(names, units, first, above, sum(counts[first:]))


def _header(
    cells: Sequence[Sequence[Any]], counts: Sequence[int], first: int
) -> tuple[tuple[str, ...], tuple[str, ...], int]:
    """Names and units above a row of numbers, nothing where there are none, and how many rows stand above them."""
    above = [i for i in range(first) if cells[i]]

    def words(i: int) -> bool:
        return len(cells[i]) > 1 and 2 * counts[i] < len(cells[i])

    units: tuple[str, ...] = ()
    if len(above) >= 2 and words(above[-2]) and _are_units(cells[above[-1]]) and not counts[above[-2]]:
        units = tuple(str(c).strip().strip("[]()") for c in cells[above.pop()])
    if not above or not words(above[-1]):
        return (), (), len(above)
    names = [str(c).strip() for c in cells[above.pop()]]
    names[0] = names[0].lstrip("#%/ ").strip()
    return tuple(name or f"column {i + 1}" for i, name in enumerate(names)), units, len(above)


def _are_units(row: Sequence[Any]) -> bool:
    words = [str(c).strip() for c in row if str(c).strip()]
    bracketed = [w[0] in "[(" and w[-1] in "])" for w in words if w]
    return bool(words) and (all(bracketed) or all(is_unit(w) or w in ("-", "1") for w in words))
