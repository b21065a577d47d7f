"""Recordings that were cut off: their first readings, or one line."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.errors import InputError
from daq.lab.files import AXES
from daq.recordings.readings import ReadingBlock, open_readings
from tests.daq.lab.forms import (
    CONTAINERS,
    TIMES,
    WRENCH,
    Floats,
    as_bytes,
    c3d,
    excel,
    hdf5,
    parquet,
    read,
    zipped,
)


def several_segments(path: Path) -> Path:
    nptdms: Any = import_module("nptdms")
    with nptdms.TdmsWriter(str(path)) as writer:
        for part in (slice(0, 2), slice(2, 4), slice(4, 6)):
            writer.write_segment([
                nptdms.ChannelObject(
                    "cell", a, WRENCH[part, i],
                    properties={"wf_increment": 0.01, "unit_string": "N" if i < 3 else "Nmm"},
                )
                for i, a in enumerate(AXES)
            ])  # fmt: skip
    return path


CUT: dict[str, Callable[[Path], Path]] = {
    "tdms": several_segments,
    "lvm": CONTAINERS["lvm"],
    "csv": as_bytes("utf-8"),
    "gzip": zipped,
    "utf-16": as_bytes("utf-16"),
    "parquet": parquet,
    "hdf5": lambda path: hdf5(path, "datasets"),
    "c3d": c3d,
    "excel": lambda path: excel(path, "numbers"),
}


def read_or_refused(path: Path) -> tuple[Floats, Floats, tuple[str, ...], tuple[str, ...]] | str:
    try:
        return read(path)
    except InputError as error:
        return str(error)


def as_readings_file(path: Path) -> str | list[ReadingBlock]:
    try:
        return list(open_readings(path).blocks())
    except InputError as error:
        return str(error)


def prefixes(content: bytes) -> Iterator[int]:
    """Lengths all over a file, and all of the last bytes."""
    return iter(sorted({*range(0, len(content), max(1, len(content) // 150)), *range(len(content) - 40, len(content))}))


@pytest.mark.parametrize("name", CUT)
def test_a_file_cut_off_anywhere_gives_its_first_readings_or_one_line(name: str, tmp_path: Path) -> None:
    path = CUT[name](tmp_path / "r.dat")
    whole = path.read_bytes()
    saved = 0
    for length in prefixes(whole):
        path.write_bytes(whole[:length])
        found = read_or_refused(path)
        if isinstance(found, str):
            assert "\n" not in found
            continue
        t_s, wrench, _, notes = found
        saved += len(wrench)
        np.testing.assert_allclose(t_s, TIMES[: len(t_s)], rtol=0, atol=1e-9)
        np.testing.assert_allclose(wrench, WRENCH[: len(wrench)], rtol=1e-6 if name == "c3d" else 1e-12, atol=1e-12)
        assert len(wrench) == 6 or any("cut off" in note for note in notes) or _ends_a_row(whole[:length], name)
    assert saved > 0 or name in ("parquet", "hdf5", "c3d", "excel")


def _ends_a_row(content: bytes, name: str) -> bool:
    """A file that ends between two rows or segments is like one that is whole."""
    return name == "tdms" or content.endswith((b"\n", b"\n\x00"))


def test_a_gzip_file_with_a_byte_changed_gives_its_first_readings_or_one_line(tmp_path: Path) -> None:
    """Wherever the byte is: in the head, in what is packed, or in its checksum."""
    path = zipped(tmp_path / "r.csv")
    whole = path.read_bytes()
    for at, flip in itertools.product(range(len(whole)), (0x01, 0x10, 0xFF)):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ flip]) + whole[at + 1 :])
        for reading in (read_or_refused, as_readings_file):
            found = reading(path)
            assert not isinstance(found, str) or "\n" not in found


@pytest.mark.parametrize("flip", [0x01, 0x10, 0x60, 0xFF])
def test_a_tdms_file_with_a_damaged_lead_in_gives_its_first_readings_or_one_line(flip: int, tmp_path: Path) -> None:
    path = several_segments(tmp_path / "r.tdms")
    whole = path.read_bytes()
    segments = [at for at in range(len(whole)) if whole.startswith(b"TDSm", at)]
    assert len(segments) == 3
    kept = 0
    for at in (segment + place for segment in segments for place in (*range(5), *range(12, 28))):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ flip]) + whole[at + 1 :])
        found = read_or_refused(path)
        if isinstance(found, str):
            assert "\n" not in found
            continue
        t_s, wrench, _, notes = found
        kept += 1
        np.testing.assert_allclose(t_s, TIMES[: len(t_s)], rtol=0, atol=1e-9)
        np.testing.assert_array_equal(wrench, WRENCH[: len(wrench)])
        assert len(wrench) == 6 or any("cut off" in note for note in notes)
    assert kept >= 7  # that a segment's numbers begin behind the end of the file
