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
from daq.vocabulary import did_you_mean

QUANTITIES = ("t", "Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
HEADERS = ("t_s", "Fx_N", "Fy_N", "Fz_N", "Tx_Nmm", "Ty_Nmm", "Tz_Nmm")
STATUS = "status"

# Of one block while reading, and of one row group while writing Parquet.
BLOCK_BYTES = 1 << 20
BLOCK_ROWS = 1 << 15
ROW_GROUP_ROWS = 1 << 18

# Exact by definition: standard gravity 9.80665 m/s², the pound 0.45359237 kg, the inch 25.4 mm.
_KGF = 9.80665
_LBF = 0.45359237 * _KGF
TIME_S: Mapping[str, float] = {
    "s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9,
    "min": 60.0, "h": 3600.0,
}  # fmt: skip
FORCE_N: Mapping[str, float] = {
    "N": 1.0, "newton": 1.0, "mN": 1e-3, "cN": 1e-2, "kN": 1e3, "lbf": _LBF, "lb": _LBF, "lbs": _LBF, "ozf": _LBF / 16,
    "kgf": _KGF, "kg": _KGF, "kp": _KGF, "gf": _KGF * 1e-3, "g": _KGF * 1e-3,
}  # fmt: skip
TORQUE_NMM: Mapping[str, float] = {
    "Nmm": 1.0, "Nm": 1e3, "Ncm": 10.0, "mNm": 1.0, "mNmm": 1e-3, "cNm": 10.0, "kNm": 1e6, "kNmm": 1e3,
    "lbfin": _LBF * 25.4, "lbin": _LBF * 25.4, "inlbf": _LBF * 25.4, "inlb": _LBF * 25.4, "lbfft": _LBF * 304.8,
    "lbft": _LBF * 304.8, "ftlbf": _LBF * 304.8, "ftlb": _LBF * 304.8, "ozfin": _LBF / 16 * 25.4,
    "kgfm": _KGF * 1e3, "kgfcm": _KGF * 10.0, "kgfmm": _KGF, "kgm": _KGF * 1e3, "kgcm": _KGF * 10.0, "kgmm": _KGF,
    "gfcm": _KGF * 1e-2, "gfmm": _KGF * 1e-3,
}  # fmt: skip

_PATTERN = re.compile(
    r"^\s*(?P<symbol>time|t|[ftm][xyz])\s*(?:[\[(]\s*(?P<inside>[^\])]*?)\s*[\])]|[_\s/]\s*(?P<after>\S.*?))?\s*$",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Column:
    """One column to read: quantity (of QUANTITIES, or status), header, place in the file, factor to s, N, N mm."""

    quantity: str
    header: str
    index: int
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
        raise ReadingsError(
            f"{file} lacks {_number_of(missing)} {', '.join(missing)} (it has {_listed(headers)})",
            f"columns {','.join(HEADERS)} in any order",
            "Name the columns in the first line, with their units",
        )
    used = tuple(found[q] for q in QUANTITIES)
    conversions = tuple(
        f"{c.header.strip()} × {c.factor:.10g} = {h}" for c, h in zip(used, HEADERS, strict=True) if c.factor != 1.0
    )
    return Columns(used, found.get(STATUS), conversions, tuple(notes))


def _column(header: str, index: int, file: str) -> Column | None:
    if header.strip().lower() == STATUS:
        return Column(STATUS, header, index, 1.0)
    match = _PATTERN.match(header)
    if match is None:
        return None
    symbol = match["symbol"].lower()
    unit = match["inside"] if match["inside"] is not None else match["after"]
    if symbol in ("t", "time"):
        quantity, units = "t", TIME_S
    elif symbol[0] == "f":
        quantity, units = "F" + symbol[1], FORCE_N
    else:
        quantity, units = "T" + symbol[1], TORQUE_NMM
    example = dict(zip(QUANTITIES, HEADERS, strict=True))[quantity]
    if not unit:
        raise ReadingsError(
            f"{file}: column {header.strip()!r} states no unit",
            f"a unit in its header, such as {example}",
            "A unit is never assumed: rename the column",
        )
    factor = units.get(re.sub(r"[\s_.*·⋅/×-]", "", unit))
    if factor is None:
        hint = did_you_mean(unit, units)
        raise ReadingsError(
            f"{file}: column {header.strip()!r} is in {unit!r}, which is not a unit of {_kind(quantity)}",
            f"one of {' '.join(list(units)[:8])} …, such as {example}",
            hint,
        )
    return Column(quantity, header, index, factor)


def _kind(quantity: str) -> str:
    return {"t": "time", "F": "force", "T": "torque"}[quantity[0]]


def _number_of(names: Sequence[str]) -> str:
    return "column" if len(names) == 1 else "columns"


def _listed(headers: Sequence[str]) -> str:
    names = [h.strip() for h in headers[:12]]
    return ", ".join(names) + (" …" if len(headers) > 12 else "")
