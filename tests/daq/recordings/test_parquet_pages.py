"""What a Parquet file's pages are unpacked is known before they are, whatever its footer tells."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from daq.errors import ReadingsError
from daq.lab.tables import ParquetChannels
from daq.recordings.parquet_pages import unpacked_bytes
from daq.recordings.readings import HEADERS, open_readings

ROWS = 1_000_000


def coded(value: int, length: int = 0) -> bytes:
    """A number as Thrift's compact protocol has it, with as many bytes as are wanted."""
    left, out = 2 * value, list[int]()
    while left or not out or len(out) < length:
        out.append(left & 0x7F)
        left >>= 7
    return bytes(b | 0x80 for b in out[:-1]) + bytes(out[-1:])


def footer_tells(path: Path) -> int:
    with pa.parquet.ParquetFile(path) as file:
        groups = [file.metadata.row_group(k) for k in range(file.metadata.num_row_groups)]
        return sum(g.column(c).total_uncompressed_size for g in groups for c in range(g.num_columns))


def bomb(path: Path) -> Path:
    """Seven columns of zeros, of which the footer tells that they are a few bytes."""
    zeros = pa.table(dict.fromkeys(HEADERS, np.zeros(ROWS)))
    pa.parquet.write_table(zeros, path, compression="zstd", use_dictionary=False)
    with pa.parquet.ParquetFile(path) as file:
        groups = [file.metadata.row_group(k) for k in range(file.metadata.num_row_groups)]
        sizes = {g.column(c).total_uncompressed_size for g in groups for c in range(g.num_columns)}
    data = path.read_bytes()
    for size in sizes:
        told = coded(size)
        data = data.replace(told, coded(7, len(told)))
    path.write_bytes(data)
    assert footer_tells(path) < 1000
    assert len(data) < ROWS // 10
    return path


@pytest.mark.parametrize("compression", ["none", "snappy", "zstd", "gzip", "lz4", "brotli"])
@pytest.mark.parametrize("version", ["1.0", "2.0"])
def test_pages_and_footer_of_sound_files_agree(compression: str, version: str, tmp_path: Path) -> None:
    rng, rows = np.random.default_rng(0), 5000
    columns = {
        "drawn": rng.normal(size=rows),
        "few": rng.integers(0, 5, rows),
        "words": ["x" * (i % 7) for i in range(rows)],
        "holes": pa.array([None if i % 3 else 1.0 for i in range(rows)]),
        "truths": [i % 2 == 0 for i in range(rows)],
    }
    for dictionary in (True, False):
        file = tmp_path / f"{dictionary}.parquet"
        pa.parquet.write_table(
            pa.table(columns), file, compression=compression, data_page_version=version, use_dictionary=dictionary,
            row_group_size=2000, write_page_index=dictionary, write_page_checksum=dictionary,
        )  # fmt: skip
        # The footer counts the heads as well.
        assert 0.98 * footer_tells(file) < unpacked_bytes(file) < footer_tells(file)


@pytest.mark.parametrize("reads", [open_readings, ParquetChannels])
def test_a_file_that_tells_too_little_is_refused_unread(reads: Callable[[Path], object], tmp_path: Path) -> None:
    file = bomb(tmp_path / "readings.parquet")
    before = pa.total_allocated_bytes()
    tracemalloc.start()
    with pytest.raises(ReadingsError, match=r"its pages are 56\d{6} bytes unpacked") as caught:
        reads(file)
    assert tracemalloc.get_traced_memory()[1] < 4 << 20
    tracemalloc.stop()
    assert pa.total_allocated_bytes() - before < 1 << 20
    assert "\n" not in str(caught.value)


def test_whatever_stands_where_a_page_should_begin_is_damage(tmp_path: Path) -> None:
    file = tmp_path / "readings.parquet"
    pa.parquet.write_table(pa.table(dict.fromkeys(HEADERS, np.arange(100.0))), file)
    data = bytearray(file.read_bytes())
    rng = np.random.default_rng(1)
    for _ in range(200):
        broken = bytearray(data)
        broken[4:40] = rng.bytes(36)
        file.write_bytes(bytes(broken))
        with suppress(ReadingsError):
            unpacked_bytes(file)
