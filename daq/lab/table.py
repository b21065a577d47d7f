"""A table among rows of cells: where its numbers begin, what its columns are called, and in which units."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

from daq.errors import ReadingsError
from daq.units import is_unit

# Of a file, to tell how it is laid out.
SAMPLE_ROWS = 300
_DAY = r"\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-./]\d{1,2}[-./]\d{2,4}|\d{1,2}[- ][A-Za-z]{3}[- ]\d{4}"
_CLOCK = r"(\d{1,2}):(\d{2})(?::(\d{2})(?:[.,](\d{1,9})|:(\d{3,9}))?)?"
_WHEN = re.compile(rf"^(?:({_DAY}),?[T ]+)?{_CLOCK}\s*(?:([AaPp])\.?[Mm]\.?)?\s*(?:Z|[+-]\d\d:?\d\d)?$")
# What begins a line that is no reading.
_REMARKS = ("#", "%", "//")
# Minutes and seconds, as spreadsheets write times of less than an hour.
_MINUTES = re.compile(r"^(\d{1,3}):(\d{2})[.,](\d{1,9})$")
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_LONGEST_UNIT = 14
_HALF_DAY_S, _DAY_S = 43_200.0, 86_400.0
# As cells write their status flags.
_HEXADECIMAL = re.compile(r"^0[xX][0-9a-fA-F]{1,16}$")
_NUMBER = re.compile(r"^[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?$|^[+-]?(nan|inf|infinity)$", re.IGNORECASE)


@dataclass(frozen=True)
class Moment:
    """Time of a cell: seconds of the day, and the day where it is stated."""

    second: float
    day: str = ""


Value = float | Moment


@dataclass(frozen=True)
class Table:
    """Position of a table in its file.

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
    """Return a cell's number; None where it is none.

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
    text = cell.strip().replace("\u2212", "-")
    if decimal == ",":
        if "." in text:
            return None
        text = text.replace(",", ".")
    if _NUMBER.match(text):
        return float(text)
    return float(int(text, 16)) if _HEXADECIMAL.match(text) else None


def moment_of(cell: Any) -> Moment | None:
    """Return a cell's time; None where it is none."""
    if isinstance(cell, dt.datetime):
        whole = cell.replace(hour=0, minute=0, second=0, microsecond=0)
        return Moment((cell - whole).total_seconds(), cell.date().isoformat())
    if isinstance(cell, dt.time):
        return Moment(cell.hour * 3600.0 + cell.minute * 60.0 + cell.second + cell.microsecond * 1e-6)
    if isinstance(cell, dt.timedelta):
        return Moment(cell.total_seconds())
    if not isinstance(cell, str):
        return None
    if minutes := _MINUTES.match(cell.strip()):
        return Moment(int(minutes[1]) * 60.0 + float(f"{minutes[2]}.{minutes[3]}"))
    match = _WHEN.match(cell.strip())
    if match is None:
        return None
    day, hours, minutes_, seconds, parts, milli, half = match.groups()
    hour = int(hours)
    if half:
        hour = hour % 12 + (12 if half in "Pp" else 0)
    return Moment(
        hour * 3600.0 + int(minutes_) * 60.0 + float(f"{seconds or 0}.{parts or milli or 0}"), _iso(day or "")
    )


def _iso(day: str) -> str:
    """Return a day as ISO 8601 has it, where its order is plain; else as it stands."""
    parts = re.split(r"[-/. ]", day)
    if len(parts) == 3 and parts[1].isalpha():
        month = parts[1].lower()
        return f"{parts[2]}-{_MONTHS.index(month) + 1:02d}-{int(parts[0]):02d}" if month in _MONTHS else day
    if len(parts) == 3 and len(parts[0]) == 4:
        return f"{parts[0]}-{int(parts[1]):02d}-{int(parts[2]):02d}"
    if day.count(".") == 2:  # with points the day comes first everywhere
        year = int(parts[2]) + (2000 if len(parts[2]) == 2 else 0)
        return f"{year}-{int(parts[1]):02d}-{int(parts[0]):02d}"
    return day


# Places of year, month and day in a date that does not tell their order: day first, month first, year first.
_ORDERS = ((2, 1, 0), (2, 0, 1), (0, 1, 2))


def _date(day: str, order: tuple[int, int, int]) -> dt.date | None:
    """Return the date that a day stands for in an order; None where it is none."""
    try:
        if re.match(r"\d{4}-", day):
            return dt.date.fromisoformat(day)
        parts = re.split(r"[-/]", day)
        year, month, date = (parts[k] for k in order)
        return dt.date(int(year) + (2000 if len(year) == 2 else 0), int(month), int(date)) if len(year) > 1 else None
    except (ValueError, IndexError):
        return None


class Clock:
    """Seconds since the first of the times that a column holds.

    Where a date does not tell whether its day or its month comes first, a later one does: in the wrong order one would
    be no date, time would go back, or the day would not go on by one.
    """

    def __init__(self, file: str) -> None:
        self._file = file
        self._start: Moment | None = None
        self._day, self._days = "", 0
        self._orders: tuple[tuple[int, int, int], ...] = _ORDERS

    def elapsed(self, now: Moment) -> float:
        """Return the seconds [s] from the first time to this one.

        Raises:
            ReadingsError: the day changes, and nothing tells the order of its day and month.
        """
        if self._start is None:
            self._start, self._day = now, now.day
        if now.day != self._day:
            self._days += self._passed(self._day, now.day)
            self._day = now.day
        since = self._days * _DAY_S + now.second - self._start.second
        # A time of day without its date begins anew at midnight.
        return since + _DAY_S if not now.day and since < -_HALF_DAY_S else since

    def _passed(self, before: str, after: str) -> int:
        """Days from one day to the next that is told."""
        dates = {order: (_date(before, order), _date(after, order)) for order in self._orders}
        days = {order: (b - a).days for order, (a, b) in dates.items() if a is not None and b is not None}
        if len(set(days.values())) > 1:
            days = {order: passed for order, passed in days.items() if passed >= 0}
        if len(set(days.values())) > 1:
            days = {order: passed for order, passed in days.items() if passed == 1}
        if len(set(days.values())) != 1:
            raise ReadingsError(
                f"{self._file}: the day changes from {before!r} to {after!r}, whose day and month may be exchanged",
                "dates such as 2024-05-31",
            )
        self._orders = tuple(days)
        return next(iter(days.values()))


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

    def alike(first: int, names: Sequence[str], units: Sequence[str]) -> bool:
        """Return whether the next rows are as wide and hold numbers too."""
        rest = (i for i in range(first, len(cells)) if cells[i] and not is_told_again(cells[i], names, units))
        return all(numeric[i] and len(cells[i]) == len(cells[first]) for i in islice(rest, 4))

    found = [(first, _header(cells, counts, first)) for first in begins]
    named = [pair for pair in found if pair[1][0]]
    # Numbers above a header belong to what stands above the table; without one they are the table's first.
    first, (names, units, above) = next((p for p in named if alike(p[0], *p[1][:2])), (named or found)[0])
    if not names:
        names = tuple(f"column {i + 1}" for i in range(len(cells[first])))
    return Table(names, units, first, above, sum(counts[first:]))


def is_told_again(row: Sequence[Any], names: Sequence[str], units: Sequence[str]) -> bool:
    """Return whether a row is a remark, or the heading once more, as programs write it on each page."""
    texts = [str(c).strip() for c in row if c is not None]
    while texts and not texts[-1]:
        texts.pop()
    if not texts or texts[0].startswith(_REMARKS):
        return True
    named = [text or f"column {i + 1}" for i, text in enumerate(texts)]
    return named == list(names) or (bool(units) and [text.strip("[]()") for text in texts] == list(units))


def _header(
    cells: Sequence[Sequence[Any]], counts: Sequence[int], first: int
) -> tuple[tuple[str, ...], tuple[str, ...], int]:
    """Return names and units above a row of numbers, empty where there are none, and the count of rows above them."""
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
    if above and len(set(names)) < len(names) and words(above[-1]) and not counts[above[-1]]:
        names = _below(cells[above.pop()], names)
    return tuple(name or f"column {i + 1}" for i, name in enumerate(names)), units, len(above)


def _below(groups: Sequence[Any], names: Sequence[str]) -> list[str]:
    """Return names of a second line of headings, each behind the heading of the first line that stands over it."""
    out, over = [], ""
    for i, name in enumerate(names):
        over = (str(groups[i]).strip() if i < len(groups) else "") or over
        out.append(f"{over} {name}".strip() if name else over)
    return out


def _are_units(row: Sequence[Any]) -> bool:
    words = [str(c).strip() for c in row if str(c).strip()]
    bracketed = [w[0] in "[(" and w[-1] in "])" for w in words if w]
    known = [is_unit(w) or w in ("-", "1") for w in words]
    # One that is not known, such as of a temperature, makes the others no names.
    return bool(words) and (all(bracketed) or (2 * sum(known) > len(words) and max(map(len, words)) <= _LONGEST_UNIT))
