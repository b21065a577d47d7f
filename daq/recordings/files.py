"""Arrow's view of a readings file: its header, its batches, and the place of what is wrong in it.

Arrow parses on this thread in blocks of about a megabyte. Only when it fails is a CSV file read again, row by row from
where all was well, to name the place.
"""

from __future__ import annotations

import csv
import gzip
import math
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from daq.errors import ReadingsError
from daq.recordings.columns import BLOCK_BYTES, BLOCK_ROWS, HEADERS, ROW_GROUP_ROWS, Column, ColumnFile, number_of
from daq.recordings.parquet_pages import unpacked_bytes
from daq.recordings.unpacking import Limited
from daq.vocabulary import LARGEST, TELLABLE

Batch = tuple[list[NDArray[np.float64]], NDArray[np.int64] | None]

_LONGEST_HEADER = 1 << 16


def csv_headers(path: Path, kind: str) -> list[str]:
    """Return the fields of a CSV file's first line.

    Raises:
        ReadingsError: the line is not a header with commas between its names.
    """
    try:
        with gzip.open(path, "rb") if kind == "csv.gz" else path.open("rb") as stream:
            line = stream.readline(_LONGEST_HEADER)
        # Some programs end a line with a lone carriage return.
        text = line.decode("utf-8-sig").split("\r")[0].strip("\n")
    except (EOFError, OSError, zlib.error) as error:
        raise _torn(path, error) from error
    except UnicodeDecodeError as error:
        raise ReadingsError(
            f"{path.name} is not UTF-8 text", "CSV, gzipped CSV or Parquet", "Save it as UTF-8"
        ) from error
    wanted = f"the header {','.join(HEADERS)}"
    if not text.strip():
        raise ReadingsError(f"line 1 of {path.name} is empty", wanted)
    for mark, name in ((";", "semicolons"), ("\t", "tabs")):
        if mark in text and "," not in text:
            raise ReadingsError(
                f"{path.name} has {name} between its columns",
                "commas",
                "Make it a readings file with `fingertwin import`",
            )
    try:
        fields = next(csv.reader([text]))
    except csv.Error as error:
        raise ReadingsError(f"line 1 of {path.name} is {text[:40]!r} ({error})", wanted) from error
    if all(number_of(f) is not None for f in fields):
        raise ReadingsError(f"line 1 of {path.name} is {text[:40]!r}", wanted, "Add the header line")
    return fields


def parquet_headers(path: Path) -> list[str]:
    """Return the column names of a Parquet file.

    Raises:
        ReadingsError: it is torn, or unpacks to far more than it tells.
    """
    try:
        unpacked_bytes(path)
        with pa.parquet.ParquetFile(path) as file:
            return list(file.schema_arrow.names)
    except (pa.ArrowException, OSError) as error:
        raise _torn(path, error) from error


def csv_batches(source: ColumnFile) -> Iterator[Batch]:
    """Yield the used columns of a CSV file as float arrays, in its own units."""
    columns = source.columns
    wanted = [*columns.used, *([columns.status] if columns.status else [])]
    names = [f"c{c.index}" for c in wanted]
    width = _width(source)
    options: Mapping[str, Any] = {
        "read_options": pa.csv.ReadOptions(
            use_threads=False, block_size=BLOCK_BYTES, skip_rows=1, column_names=[f"c{i}" for i in range(width)]
        ),
        "convert_options": pa.csv.ConvertOptions(
            include_columns=names,
            column_types={f"c{c.index}": pa.float64() for c in columns.used}
            | ({f"c{columns.status.index}": pa.string()} if columns.status else {}),
            null_values=[],
        ),
    }
    rows = 0
    try:
        with _text(source) as stream:
            for batch in pa.csv.open_csv(stream, **options):
                arrays = [_floats(batch.column(i)) for i in range(len(columns.used))]
                status = _status(batch.column(len(arrays)), source) if columns.status else None
                yield arrays, status
                rows += batch.num_rows
    except pa.ArrowInvalid as error:
        if "Empty CSV" in str(error) or "Could not skip" in str(error):
            return  # a header and nothing after it
        raise _first_fault(source, rows) or ReadingsError(f"{source.path.name}: {error}", "CSV") from error
    except OSError as error:
        raise _torn(source.path, error) from error


def _text(source: ColumnFile) -> Any:
    """Open the text of a CSV file."""
    if source.kind == "csv":
        return pa.input_stream(str(source.path), compression=None)
    return pa.PythonFile(Limited(pa.input_stream(str(source.path), compression="gzip"), source.path), "r")


def parquet_batches(source: ColumnFile) -> Iterator[Batch]:
    """Yield the used columns of a Parquet file as float arrays, in its own units."""
    columns = source.columns
    wanted = [*columns.used, *([columns.status] if columns.status else [])]
    try:
        with pa.parquet.ParquetFile(source.path, pre_buffer=False, buffer_size=1 << 16) as file:
            for column in columns.used:
                kind = file.schema_arrow.field(column.index).type
                if not (pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind)):
                    raise ReadingsError(f"{source.path.name}: column {column.header!r} holds {kind}", "numbers")
            names = [c.header for c in wanted]
            for batch in file.iter_batches(batch_size=BLOCK_ROWS, columns=names, use_threads=False):
                arrays = [_floats(batch.column(c.header)) for c in columns.used]
                status = _status(batch.column(columns.status.header), source) if columns.status else None
                yield arrays, status
    except (pa.ArrowException, OSError) as error:
        raise _torn(source.path, error) from error


def write_batches(path: Path, ending: str, tables: Iterator[dict[str, Any]]) -> None:
    """Write tables of columns one after another into one file."""
    first = pa.table(next(tables))
    if ending == ".parquet":
        with pa.parquet.ParquetWriter(path, first.schema, compression="zstd") as writer:
            for table in _with(first, tables):
                writer.write_table(table, row_group_size=ROW_GROUP_ROWS)
        return
    options = pa.csv.WriteOptions(quoting_header="none", quoting_style="none")
    compression = "gzip" if ending == ".csv.gz" else None
    with (
        pa.output_stream(str(path), compression=compression) as stream,
        pa.csv.CSVWriter(stream, first.schema, write_options=options) as writer,
    ):
        for table in _with(first, tables):
            writer.write_table(table)


def fault(source: ColumnFile, rows_before: int, block: NDArray[np.float64]) -> ReadingsError:
    """Name the first number of a block (n, 7) that is not finite, or no number that a load cell can tell."""
    if source.kind != "parquet":
        found = _first_fault(source, rows_before)
        if found is not None:
            return found
    unsound = ~np.isfinite(block)
    unsound[:, 1:] |= np.abs(block[:, 1:]) > LARGEST
    row, column = np.argwhere(unsound)[0]
    used = source.columns.used[column]
    number = float(block[row, column] / used.factor)
    return _bad_number(source, f"row {rows_before + int(row) + 1}", used, repr(number), number)


def _with(first: pa.Table, rest: Iterator[dict[str, Any]]) -> Iterator[pa.Table]:
    yield first
    for columns in rest:
        yield pa.table(columns, schema=first.schema)


def _floats(array: pa.Array) -> NDArray[np.float64]:
    """Return numbers, NaN where there is none; Arrow's own `to_numpy` would load pandas where it is installed."""
    numbers = array.cast(pa.float64(), safe=False)
    if numbers.null_count:
        numbers = numbers.fill_null(np.nan)
    out: NDArray[np.float64] = np.from_dlpack(numbers)  # type: ignore[assignment]
    return out


def _status(array: pa.Array, source: ColumnFile) -> NDArray[np.int64]:
    """Return status flags, given as whole numbers or as hexadecimal text."""
    codes = array.dictionary_encode()
    values = []
    for value in codes.dictionary.to_pylist():
        try:
            text = str(value).strip()
            values.append(int(text, 16) if text.lower().startswith("0x") else int(float(text)))
        except (ValueError, OverflowError):
            raise ReadingsError(
                f"{source.path.name}: status {value!r}", "a whole number, or hexadecimal such as 0x80000005"
            ) from None
    if codes.indices.null_count:
        raise ReadingsError(f"{source.path.name}: a reading lacks its status", "a whole number in every row")
    return np.array(values, dtype=np.int64)[np.from_dlpack(codes.indices)]


def _width(source: ColumnFile) -> int:
    return len(csv_headers(source.path, source.kind))


def _torn(path: Path, error: Exception) -> ReadingsError:
    return ReadingsError(
        f"{path.name} is torn or damaged ({str(error).splitlines()[0].rstrip('.') if str(error) else 'unreadable'})",
        "a complete file",
        "Copy it again from the bench, or recover it from the journal",
    )


def _first_fault(source: ColumnFile, sound: int) -> ReadingsError | None:
    """Read a CSV file row by row and name the first row that cannot be used.

    Args:
        source: the file.
        sound: how many rows at its beginning need not be looked at, unless a quoted field in them may hold a line end.
    """
    width, name = _width(source), source.path.name
    with (
        gzip.open(source.path, "rt", encoding="utf-8-sig", errors="replace", newline="")
        if (source.kind == "csv.gz")
        else source.path.open(encoding="utf-8-sig", errors="replace", newline="") as stream
    ):
        try:
            stream.readline()
            before, row = 1, 0
            while row < sound:
                line = stream.readline()
                if not line or '"' in line:
                    return _first_fault(source, 0)
                before += 1
                row += line not in ("\n", "\r\n", "\r")
            reader = csv.reader(stream)
            for fields in reader:
                if not fields:
                    continue
                row += 1
                if len(fields) != width:
                    remedy = ""
                    if len(fields) >= 2 * width - 1:
                        remedy = "Decimal commas? Export with decimal points"
                    return ReadingsError(
                        f"{name}: row {row} (line {before + reader.line_num}) has {len(fields)} fields",
                        f"{width}, as the header has",
                        remedy or "Was the recording cut off there? Remove the row",
                    )
                for column in source.columns.used:
                    text = fields[column.index].strip()
                    number = number_of(text)
                    if number is None or not _is_sound(number, column):
                        where = f"row {row} (line {before + reader.line_num})"
                        return _bad_number(source, where, column, repr(text), number)
        except (EOFError, OSError, zlib.error, csv.Error) as error:
            return _torn(source.path, error)
    return None


def _is_sound(number: float, column: Column) -> bool:
    return math.isfinite(number) and (column.quantity == "t" or abs(number * column.factor) <= LARGEST)


def _bad_number(source: ColumnFile, where: str, column: Column, found: str, number: float | None) -> ReadingsError:
    remedy = "Write a decimal point, not a comma" if "," in found else "Remove the row, or write what was read"
    expected = "a finite number" if number is None or not math.isfinite(number) else TELLABLE
    return ReadingsError(f"{source.path.name}: {where}, column {column.header.strip()} is {found}", expected, remedy)
