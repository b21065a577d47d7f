"""Readings of a load cell as blocks, streamed from and to CSV, gzipped CSV and Parquet.

A block holds a second to some minutes of readings, so memory does not grow with the length of a recording.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from daq.errors import ReadingsError
from daq.files import replacing
from daq.recordings.columns import HEADERS, QUANTITIES, ROW_GROUP_ROWS, STATUS, ColumnFile, find_columns
from daq.vocabulary import LARGEST

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ReadingBlock:
    """Consecutive readings.

    Attributes:
        t_s: (n,) time [s].
        wrench: (n, 6) Fx Fy Fz [N], Tx Ty Tz [N mm], in the cell's axes.
        status: (n,) the cell's status flags, None where it gives none.
    """

    t_s: Floats
    wrench: Floats
    status: NDArray[np.int64] | None = None

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass(frozen=True)
class ReadingSource(ColumnFile):
    """A readings file whose header has been read; `blocks` reads the rest."""

    @property
    def conversions(self) -> tuple[str, ...]:
        """Conversions of units, such as `Fx_lbf × 4.448221615 = Fx_N`."""
        return self.columns.conversions

    @property
    def notes(self) -> tuple[str, ...]:
        """Further notes for the reader, such as columns that are not used."""
        return self.columns.notes

    @property
    def has_status(self) -> bool:
        """Whether the readings have a status."""
        return self.columns.status is not None

    def blocks(self) -> Iterator[ReadingBlock]:
        """Yield the readings in order.

        Raises:
            ReadingsError: a number that no cell can tell or that is none, a torn row or file, or no row at all.
        """
        from daq.recordings import files as reading_files

        rows = 0
        stream = reading_files.parquet_batches if self.kind == "parquet" else reading_files.csv_batches
        for arrays, status in stream(self):
            n = len(arrays[0])
            # Column by column in memory, as the file's columns arrive and as every later step reads them.
            wrench = np.empty((6, n))
            t_s = np.empty(n)
            for column, target, values in zip(self.columns.used, (t_s, *wrench), arrays, strict=True):
                np.multiply(values, column.factor, out=target)
            if not ((np.abs(wrench) <= LARGEST).all() and np.isfinite(t_s).all()):
                raise reading_files.fault(self, rows, np.stack([t_s, *wrench], axis=1))
            rows += n
            yield ReadingBlock(t_s, wrench.T, status)
        if rows == 0:
            raise ReadingsError(f"{self.path.name} has a header and no readings", "at least one row of readings")


def first_bytes(file: Path, count: int, expected: str) -> bytes:
    """Read how a file begins, which tells its kind.

    Args:
        file: to look at.
        count: of bytes, or fewer where the file is shorter.
        expected: what it should be, in words.

    Raises:
        ReadingsError: it cannot be read.
    """
    if file.is_dir():
        raise ReadingsError(f"{file} is a folder", expected, "Name a file in it")
    try:
        with file.open("rb") as stream:
            return stream.read(count)
    except OSError as error:
        raise ReadingsError(f"{file.name} cannot be read ({error.strerror})", expected, "Check the path") from error


def open_readings(path: str | Path) -> ReadingSource:
    """Read a readings file's header and match its columns.

    Args:
        path: a CSV, gzipped CSV or Parquet file; which of them is told by its first bytes.

    Raises:
        ReadingsError: it is absent, empty, torn, or its columns or units cannot be used.
    """
    from daq.recordings import files as reading_files

    file = Path(path)
    start = first_bytes(file, 4, "a readings file")
    if not start:
        raise ReadingsError(f"{file.name} is empty", f"a header {','.join(HEADERS)} and readings")
    if start == b"PAR1":
        return ReadingSource(file, "parquet", find_columns(reading_files.parquet_headers(file), file.name))
    kind: Literal["csv", "csv.gz"] = "csv.gz" if start[:2] == b"\x1f\x8b" else "csv"
    return ReadingSource(file, kind, find_columns(reading_files.csv_headers(file, kind), file.name))


def write_readings(path: str | Path, blocks: Iterable[ReadingBlock]) -> Path:
    """Write readings as CSV, gzipped CSV or Parquet, by the file's ending; the name appears when it is complete.

    Raises:
        ReadingsError: the ending is none of `.csv`, `.csv.gz`, `.parquet`, or only some blocks have a status.
    """
    from daq.recordings import files as reading_files

    file = Path(path)
    endings = [e for e in (".csv.gz", ".csv", ".parquet") if file.name.lower().endswith(e)]
    if not endings:
        raise ReadingsError(f"{file.name} ends in {file.suffix!r}", "a name ending in .csv, .csv.gz or .parquet")
    with replacing(file) as temporary:
        reading_files.write_batches(temporary, endings[0], _tables(blocks, file.name))
    return file


def _tables(blocks: Iterable[ReadingBlock], name: str) -> Iterator[dict[str, Any]]:
    """Gather blocks into columns of about ROW_GROUP_ROWS rows."""
    held: list[ReadingBlock] = []
    with_status: bool | None = None
    for block in blocks:
        if with_status is None:
            with_status = block.status is not None
        if with_status != (block.status is not None):
            raise ReadingsError(f"only some of the blocks for {name} have a status", "a status in all or in none")
        held.append(block)
        if sum(len(b) for b in held) >= ROW_GROUP_ROWS:
            yield _table(held)
            held = []
    if held or with_status is None:
        yield _table(held)


def _table(blocks: list[ReadingBlock]) -> dict[str, Any]:
    if not blocks:
        return {h: np.empty(0) for h in HEADERS}
    wrench = np.concatenate([b.wrench for b in blocks])
    out: dict[str, Any] = {HEADERS[0]: np.concatenate([b.t_s for b in blocks])}
    out |= {h: np.ascontiguousarray(wrench[:, i]) for i, h in enumerate(HEADERS[1:])}
    if blocks[0].status is not None:
        out[STATUS] = np.concatenate([b.status for b in blocks if b.status is not None])
    return out


__all__ = [
    "HEADERS",
    "QUANTITIES",
    "ReadingBlock",
    "ReadingSource",
    "open_readings",
    "write_readings",
]
