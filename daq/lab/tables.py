"""The columns of Parquet and Excel files."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from numpy.typing import NDArray

from daq.errors import ReadingsError
from daq.lab.channels import BLOCK_ROWS, TIMESTAMP, Channel, LabChannels
from daq.lab.packed import require_held, require_modest
from daq.lab.table import SAMPLE_ROWS, find_table, number_of
from daq.lab.text import TableChannels
from daq.recordings.parquet_pages import unpacked_bytes

Floats = NDArray[np.float64]


class ParquetChannels(LabChannels):
    """A Parquet file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            unpacked_bytes(path)
            with pa.parquet.ParquetFile(path) as file:
                fields = list(file.schema_arrow)
                rows = file.metadata.num_rows
        except (pa.ArrowException, OSError) as error:
            raise self._torn(error) from error
        require_held(path, 8 * rows * len(fields))
        self.channels = tuple(self._describe(field) for field in fields)

    @staticmethod
    def _describe(field: Any) -> Channel:
        if pa.types.is_timestamp(field.type):
            return Channel(field.name, TIMESTAMP)
        known = (pa.types.is_floating, pa.types.is_integer, pa.types.is_decimal)
        fault = "" if any(is_kind(field.type) for is_kind in known) else f"holds {field.type}"
        return Channel(field.name, "", fault=fault)

    def blocks(self, names: Sequence[str]) -> Iterator[Floats]:
        """Yield the numbers (n, k) of some columns."""
        wanted = [self.readable(name) for name in names]
        origins: dict[str, int] = {}
        try:
            with pa.parquet.ParquetFile(self.path) as file:
                for batch in file.iter_batches(batch_size=BLOCK_ROWS, columns=list(names), use_threads=False):
                    yield np.stack([self._numbers(batch.column(c.name), c, origins) for c in wanted], axis=1)
        except (pa.ArrowException, OSError) as error:
            raise self._torn(error) from error

    def _numbers(self, values: Any, channel: Channel, origins: dict[str, int]) -> Floats:
        if values.null_count:
            raise ReadingsError(f"{self.path.name}: {channel.name} lacks a value", "a number in every row")
        if channel.unit == TIMESTAMP:
            nanoseconds = values.cast(pa.timestamp("ns", tz=values.type.tz)).cast(pa.int64()).to_numpy()
            origin = origins.setdefault(channel.name, int(nanoseconds[0]))
            return np.asarray((nanoseconds - origin) * 1e-9, dtype=np.float64)
        out: Floats = values.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
        return out

    def _torn(self, error: Exception) -> ReadingsError:
        said = " ".join(str(error).split())[:160]
        return ReadingsError(
            f"{self.path.name} is torn or damaged ({said})", "a complete Parquet file", "Copy it again"
        )


class ExcelChannels(TableChannels):
    """The sheet with the largest table of an Excel or OpenDocument file."""

    def __init__(self, path: Path) -> None:
        from python_calamine import CalamineError, load_workbook

        self.path = path
        if zipfile.is_zipfile(path):
            require_modest(path)
        try:
            book = load_workbook(str(path))
            names = book.sheet_names
            sheets = [book.get_sheet_by_name(name).to_python(skip_empty_area=False) for name in names]
        except (CalamineError, OSError, ValueError) as error:
            said = " ".join(str(error).split())[:160]
            raise ReadingsError(f"{path.name} is no sound Excel file ({said})", "an .xlsx or .xls file") from error
        found = [(rows, find_table(rows[:SAMPLE_ROWS], partial(number_of, decimal="."))) for rows in sheets]
        held = [(name, rows, table) for name, (rows, table) in zip(names, found, strict=True) if table is not None]
        if not held:
            commas = any(find_table(rows[:SAMPLE_ROWS], partial(number_of, decimal=",")) for rows in sheets)
            raise ReadingsError(
                f"no sheet of {path.name} has rows of numbers",
                "columns of numbers below their names",
                "Its numbers are text with decimal commas: change them to numbers" if commas else "",
            )
        # A table of settings beside the readings is not what is meant.
        name, self._cells, table = max(held, key=lambda h: (len(h[1]) - h[2].first) * len(h[2].names))
        width = len([c for c in self._cells[table.first] if c is not None and str(c).strip()])
        if len(table.names) < width:
            raise ReadingsError(f"{path.name} has {len(table.names)} names above {width} numbers", "as many")
        self._name(table, self._cells[table.first : table.first + SAMPLE_ROWS], ".")
        if len(held) > 1:
            self.notes += (f"of its sheets {name!r} is read",)

    def blocks(self, names: Sequence[str]) -> Iterator[Floats]:
        """Yield the numbers (n, k) of some columns."""
        rows = enumerate(self._cells[self._table.first :], self._table.first + 1)
        return self._rows_to_blocks(iter(rows), names)
