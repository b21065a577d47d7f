"""One published number beside ours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

VERDICTS = {True: "agrees", False: "DIFFERS"}


@dataclass(frozen=True)
class Row:
    """A published quantity, ours, and whether they agree.

    Attributes:
        quantity: what it is.
        published: as printed; None where a range alone is.
        ours: recomputed; None where it cannot be had.
        unit: of both.
        agrees: None where a comparison would mean nothing; `note` says why.
        note: why, or under which condition.
        printed: the published number, or range, with its printed digits.
    """

    quantity: str
    published: float | None
    ours: float | None
    unit: str
    agrees: bool | None
    note: str = ""
    printed: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)


def row(quantity: str, published: str, ours: float, unit: str, note: str = "") -> Row:
    """Compare ours with a number as printed; they agree when ours rounds to the printed digits.

    Half a unit of the last printed digit is the tolerance, and a hundredth of it is allowed for rounding in between.
    """
    digits = len(published.partition(".")[2])
    agrees = abs(ours - float(published)) <= 0.5 * 10.0**-digits * 1.01
    return Row(quantity, float(published), ours, unit, agrees, note, published)


def row_within(quantity: str, low: str, high: str, ours: float, unit: str, note: str = "") -> Row:
    """Compare ours with a published range, its ends as printed; they agree when ours lies in it."""
    return Row(quantity, None, ours, unit, float(low) <= ours <= float(high), note, f"{low} to {high}")


def row_about(quantity: str, published: str, spread: str, ours: float, unit: str, note: str = "") -> Row:
    """Compare ours with a published mean and its spread, both as printed; they agree when ours lies within it."""
    agrees = abs(ours - float(published)) <= float(spread)
    return Row(quantity, float(published), ours, unit, agrees, note, f"{published} ± {spread}")


def not_available(quantity: str, published: str, ours: float | None, unit: str, note: str) -> Row:
    """A number that cannot be recomputed from what was published."""
    return Row(quantity, float(published), ours, unit, None, note, published)


def published_table(rows: Sequence[Row]) -> tuple[list[str], list[list[str]], list[str]]:
    """Return rows as a table, published beside ours: its columns, its cells, and the notes, each once, as sentences."""
    cells = [[r.quantity, r.printed, ours(r), r.unit, verdict(r)] for r in rows]
    notes = dict.fromkeys(f"{r.note[:1].upper()}{r.note[1:]}." for r in rows if r.note)
    return ["quantity", "published", "ours", "unit", ""], cells, list(notes)


def verdict(row: Row) -> str:
    """A row's verdict in a word, or why there is none."""
    return row.note.partition(":")[0] if row.agrees is None else VERDICTS[row.agrees]


def ours(row: Row) -> str:
    """Our number of a row with sensible digits."""
    return "–" if row.ours is None else f"{row.ours:.4g}"
