"""Find the six axes, the time and the status among a file's columns, and the factor that brings each to s, N and N mm.

A unit is read from the header and never assumed; every conversion is reported.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from daq.errors import ReadingsError
from daq.units import COMMON, Kind, factor_of
from daq.vocabulary import did_you_mean

QUANTITIES = ("t", "Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
HEADERS = ("t_s", "Fx_N", "Fy_N", "Fz_N", "Tx_Nmm", "Ty_Nmm", "Tz_Nmm")
STATUS = "status"
_MOMENTS = ("Tx", "Ty", "Tz")
# By a quantity's first letter.
KINDS: Mapping[str, Kind] = {"t": "time", "F": "force", "T": "torque"}

# Of one block while reading, and of one row group while writing Parquet.
BLOCK_BYTES = 1 << 20
BLOCK_ROWS = 1 << 15
ROW_GROUP_ROWS = 1 << 18

_PATTERN = re.compile(
    r"^\s*(?P<symbol>time|t|[ftm][xyz])\s*(?:[\[(]\s*(?P<inside>[^\])]*?)\s*[\])]|[_\s/]\s*(?P<after>\S.*?))?\s*$",
    re.IGNORECASE,
)


def number_of(text: str) -> float | None:
    """Return a cell's number, also nan and inf; None of what only Python reads as one, such as `2_1`."""
    try:
        return float(text) if text.isascii() and "_" not in text else None
    except ValueError:
        return None


@dataclass(frozen=True)
class Column:
    """One column to read.

    Attributes:
        quantity: of QUANTITIES, or status.
        header: with its unit; index: its place in the file.
        unit: as the header states it; nothing of a status.
        factor: that brings it to s, N or N mm.
    """

    quantity: str
    header: str
    index: int
    unit: str
    factor: float


@dataclass(frozen=True)
class Columns:
    """The columns of a readings file, in the order of QUANTITIES, then the status where there is one."""

    used: tuple[Column, ...]
    status: Column | None
    conversions: tuple[str, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class ColumnFile:
    """A readings file and where its columns are.

    Attributes:
        path: of the file.
        kind: of the file, told by its content.
        columns: which column holds what, and its factor.
    """

    path: Path
    kind: Literal["csv", "csv.gz", "parquet"]
    columns: Columns


def find_columns(headers: Sequence[str], file: str) -> Columns:
    """Match a file's headers with what is needed, in any order.

    Raises:
        ReadingsError: a column is missing, there twice, without a unit or with one that is not known.
    """
    found: dict[str, Column] = {}
    notes = []
    for index, header in enumerate(headers):
        column = _column(header, index, file)
        if column is None:
            notes.append(f"column {header.strip()!r} is not used")
            continue
        other = found.get(column.quantity)
        if other is not None:
            raise ReadingsError(
                f"{file} has {column.quantity} twice, as {other.header!r} and {header!r}",
                "each quantity once",
                "Remove one of the two columns",
            )
        found[column.quantity] = column
    missing = [h for q, h in zip(QUANTITIES, HEADERS, strict=True) if q not in found]
    if missing:
        three_axes = not any(q in found for q in _MOMENTS) and len(missing) == len(_MOMENTS)
        raise ReadingsError(
            f"{file} lacks {_number_of(missing)} {', '.join(missing)} (it has {_listed(headers)})",
            f"columns {','.join(HEADERS)} in any order",
            "Of a cell with three axes fill the moments with 0 (they count as not read), or give averages, force_N"
            if three_axes
            else "Name the columns in the first line, with their units",
        )
    used = tuple(found[q] for q in QUANTITIES)
    conversions = tuple(
        f"{c.header.strip()} × {c.factor:.10g} = {h}" for c, h in zip(used, HEADERS, strict=True) if c.factor != 1.0
    )
    return Columns(used, found.get(STATUS), conversions, tuple(notes))


def quantity_of(header: str) -> str | None:
    """Return which of QUANTITIES, or the status, a header names, with or without a unit; None for another column."""
    if header.strip().lower() == STATUS:
        return STATUS
    match = _PATTERN.match(header)
    if match is None:
        return None
    symbol = match["symbol"].lower()
    if symbol in ("t", "time"):
        return "t"
    return ("F" if symbol[0] == "f" else "T") + symbol[1]


def _column(header: str, index: int, file: str) -> Column | None:
    quantity, match = quantity_of(header), _PATTERN.match(header)
    if quantity == STATUS:
        return Column(STATUS, header, index, "", 1.0)
    if quantity is None or match is None:
        return None
    unit = match["inside"] if match["inside"] is not None else match["after"]
    example = dict(zip(QUANTITIES, HEADERS, strict=True))[quantity]
    if not unit:
        raise ReadingsError(
            f"{file}: column {header.strip()!r} states no unit",
            f"a unit in its header, such as {example}",
            "A unit is never assumed: rename the column",
        )
    kind = KINDS[quantity[0]]
    factor = factor_of(unit, kind)
    if factor is None:
        raise ReadingsError(
            f"{file}: column {header.strip()!r} is in {unit!r}, which is not a unit of {kind}",
            f"one of {' '.join(COMMON[kind])} …, such as {example}",
            did_you_mean(unit, COMMON[kind]),
        )
    return Column(quantity, header, index, unit, factor)


def _number_of(names: Sequence[str]) -> str:
    return "column" if len(names) == 1 else "columns"


def _listed(headers: Sequence[str]) -> str:
    names = [h.strip() for h in headers[:12]]
    return ", ".join(names) + (" …" if len(headers) > 12 else "")
