"""Excel files that are unpacked to far more than they tell are refused before a reader makes room for them."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from daq.errors import ReadingsError
from daq.lab import packed
from daq.lab.opened import open_channels
from daq.lab.packed import require_modest

MAIN = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
PACKAGE = "http://schemas.openxmlformats.org/package/2006"
OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"


def related(kind: str, target: str) -> str:
    one = f'<Relationship Id="r1" Type="{OFFICE}/{kind}" Target="{target}"/>'
    return f'<Relationships xmlns="{PACKAGE}/relationships">{one}</Relationships>'


def workbook(path: Path, rows: str) -> Path:
    """A workbook of one sheet."""
    sheet = f'<worksheet xmlns="{MAIN}"><sheetData>{rows}</sheetData></worksheet>'
    types = f'<Types xmlns="{PACKAGE}/content-types"><Default Extension="xml" ContentType="application/xml"/></Types>'
    named = '<sheets><sheet name="S" sheetId="1" r:id="r1"/></sheets>'
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
        out.writestr("[Content_Types].xml", types)
        out.writestr("_rels/.rels", related("officeDocument", "xl/workbook.xml"))
        out.writestr("xl/_rels/workbook.xml.rels", related("worksheet", "worksheets/sheet1.xml"))
        out.writestr("xl/workbook.xml", f'<workbook xmlns="{MAIN}" xmlns:r="{OFFICE}">{named}</workbook>')
        out.writestr("xl/worksheets/sheet1.xml", sheet)
    return path


def row(number: int, *cells: tuple[str, str]) -> str:
    held = "".join(
        f'<c r="{at}{number}"><v>{value}</v></c>'
        if value[0].isdigit()
        else f'<c r="{at}{number}" t="inlineStr"><is><t>{value}</t></is></c>'
        for at, value in cells
    )
    return f'<row r="{number}">{held}</row>'


def table(count: int) -> str:
    head = row(1, ("A", "time [s]"), ("B", "Fx [N]"))
    return head + "".join(row(n, ("A", f"{n}.5"), ("B", "2.5")) for n in range(2, count))


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
