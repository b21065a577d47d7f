"""Excel files that are unpacked to far more than they tell are refused before a reader makes room for them."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from daq.errors import ReadingsError
from daq.lab import packed
from daq.lab.opened import open_channels
from daq.lab.packed import require_modest
from tests.daq.lab_bombs import row, table, workbook


def test_a_table_is_read_and_a_stray_cell_a_little_away_does_not_matter(tmp_path: Path) -> None:
    file = workbook(tmp_path / "a.xlsx", table(40) + row(5000, ("AB", "7")))
    assert [c.name for c in open_channels(file).channels][:2] == ["time [s]", "Fx [N]"]


@pytest.mark.parametrize("cell", [row(1048576, ("XFD", "1")), row(1048576, ("xfd", "1")).replace('"', "'")])
def test_one_cell_far_away_is_refused_and_named(cell: str, tmp_path: Path) -> None:
    file = workbook(tmp_path / "a.xlsx", table(40) + cell)
    with pytest.raises(
        ReadingsError, match=r"a\.xlsx has a cell in row 1048576, column 16384; expected at most"
    ) as caught:
        open_channels(file)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("told", [None, 100])
def test_parts_are_measured_by_what_they_are_and_not_by_what_is_told(
    told: int | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(packed, "MOST_BYTES", 4 << 20)
    file = workbook(tmp_path / "a.xlsx", table(40) + f"<!--{' ' * (8 << 20)}-->")
    assert file.stat().st_size < 100_000
    if told is not None:
        with zipfile.ZipFile(file) as archive:
            size = archive.getinfo("xl/worksheets/sheet1.xml").file_size
        lying = file.read_bytes().replace(size.to_bytes(4, "little"), told.to_bytes(4, "little"))
        file.write_bytes(lying)
        with zipfile.ZipFile(file) as archive:
            assert archive.getinfo("xl/worksheets/sheet1.xml").file_size == told
    with pytest.raises(ReadingsError, match="more than 4194304 bytes unpacked"):
        open_channels(file)


def test_an_archive_that_is_cut_off_is_one_clear_line(tmp_path: Path) -> None:
    data = workbook(tmp_path / "a.xlsx", table(40)).read_bytes()
    for share in (0.2, 0.5, 0.9, 0.99):
        file = tmp_path / "b.xlsx"
        file.write_bytes(data[: int(share * len(data))])
        with pytest.raises(ReadingsError, match="no sound Excel file"):
            require_modest(file)
