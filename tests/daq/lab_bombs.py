"""Small files that claim to hold, or are unpacked to, far more than a reader has room for."""

from __future__ import annotations

import struct
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from daq.lab.files import AXES
from tests.daq.lab_files import resolved

MAIN = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
PACKAGE = "http://schemas.openxmlformats.org/package/2006"
OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
OPEN = "urn:oasis:names:tc:opendocument:xmlns"


def related(*parts: tuple[str, str]) -> str:
    """Relationships r1, r2 … of a kind to a target."""
    listed = "".join(
        f'<Relationship Id="r{k}" Type="{OFFICE}/{kind}" Target="{target}"/>'
        for k, (kind, target) in enumerate(parts, 1)
    )
    return f'<Relationships xmlns="{PACKAGE}/relationships">{listed}</Relationships>'


def workbook(path: Path, *sheets: str, folder: str = "worksheets", shared: str = "") -> Path:
    """A workbook of sheets, each given by its rows, and of one shared text."""
    types = f'<Types xmlns="{PACKAGE}/content-types"><Default Extension="xml" ContentType="application/xml"/></Types>'
    places = [f"{folder}/sheet{k}.xml" for k in range(1, len(sheets) + 1)]
    named = "".join(f'<sheet name="S{k}" sheetId="{k}" r:id="r{k}"/>' for k in range(1, len(sheets) + 1))
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
        out.writestr("[Content_Types].xml", types)
        out.writestr("_rels/.rels", related(("officeDocument", "xl/workbook.xml")))
        targets = [("worksheet", place) for place in places] + [("sharedStrings", "sharedStrings.xml")] * bool(shared)
        out.writestr("xl/_rels/workbook.xml.rels", related(*targets))
        out.writestr(
            "xl/workbook.xml", f'<workbook xmlns="{MAIN}" xmlns:r="{OFFICE}"><sheets>{named}</sheets></workbook>'
        )
        for place, rows in zip(places, sheets, strict=True):
            out.writestr(f"xl/{place}", f'<worksheet xmlns="{MAIN}"><sheetData>{rows}</sheetData></worksheet>')
        if shared:
            out.writestr("xl/sharedStrings.xml", f'<sst xmlns="{MAIN}"><si><t>{shared}</t></si></sst>')
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


def _room(path: Path) -> Path:
    """Seven channels of 10¹² values, none of them written."""
    import h5py

    with h5py.File(path, "w") as file:
        for axis in ("t", *AXES):
            file.create_dataset(axis, shape=(10**12,), dtype="f8", chunks=(1 << 14,), compression="gzip")
    return path


def _piece(path: Path) -> Path:
    """A channel in one piece, which is unpacked whole for any of its values."""
    import h5py

    with h5py.File(path, "w") as file:
        chunk = 1 << 23
        file.create_dataset("t", shape=(chunk,), dtype="f8", chunks=(chunk,), compression="gzip")[:2] = 1.0
    return path


def _labels(path: Path) -> Path:
    """A table as pandas writes it, with 10¹⁰ names for its columns."""
    import h5py

    with h5py.File(path, "w") as file:
        file["t/block0_values"] = np.zeros((40, 7))
        file.create_dataset("t/block0_items", shape=(10**10,), dtype="S8", chunks=(1 << 14,), compression="gzip")
    return path


def _alike(path: Path) -> Path:
    """A Parquet file of a value that is repeated, as an increment of time would have it."""
    table = pa.table({axis: np.zeros(1 << 20, np.int8) for axis in AXES})
    with pa.parquet.ParquetWriter(path, table.schema, compression="zstd") as out:
        for _ in range(24):
            out.write_table(table)
    return path


def _index(path: Path) -> Path:
    """A TDMS file whose raw index tells 10¹² values of each channel."""
    content = resolved(path).read_bytes()
    told, claimed = struct.pack("<IQ", 1, 3), struct.pack("<IQ", 1, 10**12)
    assert content.count(told) == len(AXES)
    path.write_bytes(content.replace(told, claimed))
    return path


def _lead_in(path: Path) -> Path:
    """The same, of a segment that goes on to a place far behind the end."""
    content = bytearray(_index(path).read_bytes())
    content[12:20] = struct.pack("<Q", 1 << 62)
    path.write_bytes(content)
    return path


def _binary(path: Path) -> Path:
    """A binary workbook."""
    with zipfile.ZipFile(path, "w") as out:
        out.writestr("xl/workbook.bin", b"\x83\x01\x00")
        out.writestr("xl/worksheets/sheet1.bin", b"\x81\x01\x00")
    return path


def _unplaced(path: Path) -> Path:
    """Cells that do not say their place in one row, and a row far below."""
    cells = "<c><v>1</v></c>" * 16000
    return workbook(path, f"{table(40)}<row>{cells}</row>{row(1_000_000, ('A', '1'))}")


def _shared(path: Path) -> Path:
    """Cells that share one long text, which becomes a text of each."""
    cells = "".join(f'<row r="{n}"><c r="A{n}" t="s"><v>0</v></c></row>' for n in range(40, 4000))
    return workbook(path, table(40) + cells, shared="x" * 1_000_000)


def _repeated(path: Path) -> Path:
    """An OpenDocument table of one row that is repeated."""
    cell = '<table:table-cell table:number-columns-repeated="90" office:value-type="float" office:value="1"/>'
    rows = f'<table:table-row table:number-rows-repeated="1000000">{cell}</table:table-row>'
    spaces = f'xmlns:office="{OPEN}:office:1.0" xmlns:table="{OPEN}:table:1.0"'
    body = f'<office:body><office:spreadsheet><table:table table:name="S">{rows}</table:table></office:spreadsheet>'
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
        out.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        out.writestr("content.xml", f"<office:document-content {spaces}>{body}</office:body></office:document-content>")
    return path


FAR = row(1_000_000, ("R", "1"))
BOMBS: Mapping[str, Callable[[Path], Path]] = {
    "room.h5": _room,
    "piece.h5": _piece,
    "labels.h5": _labels,
    "alike.parquet": _alike,
    "index.tdms": _index,
    "lead_in.tdms": _lead_in,
    "binary.xlsb": _binary,
    "far.xlsx": lambda path: workbook(path, table(40) + row(1_048_576, ("XFD", "1"))),
    "sparse.xlsx": lambda path: workbook(path, table(40) + FAR),
    "elsewhere.xlsx": lambda path: workbook(path, table(40) + row(1_048_576, ("XFD", "1")), folder="leaves"),
    "sheets.xlsx": lambda path: workbook(path, *[table(40) + FAR] * 4),
    "odd_tag.xlsx": lambda path: workbook(path, table(40) + FAR.replace("<c r", '<c s=">" r')),
    "unplaced.xlsx": _unplaced,
    "shared.xlsx": _shared,
    "repeated.ods": _repeated,
}
