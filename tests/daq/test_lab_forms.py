"""Recordings in the forms that labs have: each is read to its right numbers, or refused in one line with what to do."""

from __future__ import annotations

import gzip
from collections.abc import Callable, Iterator
from importlib import import_module
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from numpy.typing import NDArray

from daq.errors import InputError
from daq.lab.files import AXES, open_recording
from daq.lab.proposals import propose_mapping
from tests.daq.lab_files import lvm, resolved

Floats = NDArray[np.float64]

TIMES = np.arange(6) * 0.01
WRENCH = np.arange(36.0).reshape(6, 6) / 8.0 - 1.625
# Units as they stand in a file, and the numbers in them that are the same wrench.
UNITS: dict[str, tuple[str, str, float, float]] = {
    "N": ("N", "Nmm", 1.0, 1.0),
    "N-m": ("N", "N-m", 1.0, 1e3),
    "lbf": ("lbf", "lbf-in", 4.4482216152605, 112.98482902761667),
    "words": ("Newtons", "NewtonMeters", 1.0, 1e3),
}


def rows(units: str, times: str, decimal: str, start: int = 0) -> tuple[list[str], list[str], list[list[str]]]:
    """Names, units and cells."""
    force, torque, *factors = UNITS[units]
    values = WRENCH / np.repeat(factors, 3)
    clock = {
        "s": [f"{t:.2f}" for t in TIMES],
        "ms": [f"{1000 * t:.0f}" for t in TIMES],
        "iso": [f"2024-05-01T23:59:59.{round(t * 1e6) + 100000:06d}" for t in TIMES],
        "clock": [f"10:00:00.{round(t * 1e3):03d}" for t in TIMES],
        "epoch": [f"{1714564800000 + round(t * 1e3)}" for t in TIMES],
    }[times]
    stated = {"s": "s", "ms": "ms", "epoch": "ms"}.get(times, "")
    cells = [[c, *(repr(float(v)) for v in row)] for c, row in zip(clock, values, strict=True)]
    if decimal == ",":
        cells = [[c.replace(".", ",") for c in row] for row in cells]
    return ["time", *AXES], [stated, *[force] * 3, *[torque] * 3], cells[start:]


def written(header: str, separator: str, decimal: str, units: str, times: str) -> str:
    """A file's text."""
    names, stated, cells = rows(units, times, decimal)
    labels = [f"{n} ({u})" if u else n for n, u in zip(names, stated, strict=True)]
    lines = [separator.join(row) for row in cells]
    head = {
        "one line": [separator.join(labels)],
        "quoted": [separator.join(f'"{label}"' for label in labels)],
        "units below": [separator.join(names), separator.join(f"[{u}]" for u in stated)],
        "preamble": ["Rig 7, left hand", f"Date{separator}2024-05-01", "", separator.join(labels)],
        "remark": ["# " + separator.join(labels)],
    }[header]
    return "\n".join([*head, *lines]) + "\n"


def read(path: Path) -> tuple[Floats, Floats, tuple[str, ...], tuple[str, ...]]:
    """Times, wrench, doubts and notes by the proposal, as somebody who says yes to it has them."""
    proposal = propose_mapping(path)
    recording = open_recording(path, proposal.model_copy(update={"confirmed": True}))
    blocks = list(recording.blocks())
    t_s, wrench = (np.concatenate([getattr(b, key) for b in blocks]) for key in ("t_s", "wrench"))
    return t_s, wrench, proposal.doubts, recording.notes


TEXT_FORMS = [
    *product(("one line", "units below"), ("\t", ";", ",", "|"), (".", ","), ("N", "lbf"), ("s", "ms")),
    *product(("quoted", "preamble", "remark"), (";", "\t"), (".", ","), ("N-m",), ("s", "iso", "clock", "epoch")),
    *product(("one line",), (";", ","), (".",), ("words",), ("iso", "clock", "epoch")),
    *product(("one line",), (" ",), (".", ","), ("N",), ("s",)),
]


@pytest.mark.parametrize(("header", "separator", "decimal", "units", "times"), TEXT_FORMS)
def test_text_in_every_form(header: str, separator: str, decimal: str, units: str, times: str, tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    text = written(header, separator, decimal, units, times)
    if separator == " ":
        text = text.replace(" (", "_").replace(")", "")
    path.write_text(text, encoding="utf-8")
    if separator == decimal:
        with pytest.raises(InputError, match="semicolons or decimal points"):
            read(path)
        return
    t_s, wrench, *_ = read(path)
    np.testing.assert_allclose(t_s - t_s[0], TIMES, rtol=0, atol=1e-6)
    np.testing.assert_allclose(wrench, WRENCH, rtol=1e-12, atol=1e-12)


def plain(header: str = "one line", separator: str = ",", decimal: str = ".") -> str:
    return written(header, separator, decimal, "N", "s")


def as_bytes(encoding: str, end: str = "\n") -> Callable[[Path], Path]:
    def write(path: Path) -> Path:
        path.write_bytes(plain().replace("\n", end).encode(encoding))
        return path

    return write


def zipped(path: Path) -> Path:
    path.write_bytes(gzip.compress(plain(separator=";").encode()))
    return path


def parquet(path: Path, when: bool = False) -> Path:
    moments = np.datetime64("2024-05-01T12:00:00", "us") + (TIMES * 1e6).astype("timedelta64[us]")
    units = ["N"] * 3 + ["Nmm"] * 3
    columns: dict[str, Any] = {"time": moments} if when else {"time_s": TIMES}
    columns |= {f"{a}_{u}": WRENCH[:, i] for i, (a, u) in enumerate(zip(AXES, units, strict=True))}
    pa.parquet.write_table(pa.table(columns), path)
    return path


def with_text_column(path: Path) -> Path:
    lines = plain().splitlines()
    path.write_text("\n".join([f"{lines[0]},remark", *(f"{line},ok" for line in lines[1:])]) + "\n", "utf-8")
    return path


def german(path: Path) -> Path:
    names = ["Zeit (s)", *(f"{w} {x} ({u})" for w, u in (("Kraft", "N"), ("Moment", "Nmm")) for x in "xyz")]
    lines = plain(separator=";", decimal=",").splitlines()
    path.write_bytes("\r\n".join(["Größe;Prüfstand", ";".join(names), *lines[1:], ""]).encode("cp1252"))
    return path


CONTAINERS: dict[str, Callable[[Path], Path]] = {
    "byte order mark": as_bytes("utf-8-sig"),
    "utf-16": as_bytes("utf-16"),
    "windows lines": as_bytes("utf-8", "\r\n"),
    "old mac lines": as_bytes("utf-8", "\r"),
    "gzip": zipped,
    "parquet": parquet,
    "parquet with times": lambda path: parquet(path, when=True),
    "text column": with_text_column,
    "german": german,
    "tdms": lambda path: resolved(path, WRENCH, wf_increment=0.01),
    "lvm": lambda path: lvm(
        path,
        ["\t".join([f"{t:.6f}", *(repr(float(v)) for v in row)]) for t, row in zip(TIMES, WRENCH, strict=True)],
        "Fx_N Fy_N Fz_N Tx_Nmm Ty_Nmm Tz_Nmm",
        unit="",
    ),
}


@pytest.mark.parametrize("name", CONTAINERS)
def test_every_container(name: str, tmp_path: Path) -> None:
    t_s, wrench, *_ = read(CONTAINERS[name](tmp_path / "r.dat"))
    np.testing.assert_allclose(t_s, TIMES, rtol=0, atol=1e-9)
    np.testing.assert_allclose(wrench, WRENCH, rtol=1e-12, atol=1e-12)


REFUSED: dict[str, tuple[str, str]] = {
    "nothing": ("", "has no whole line"),
    "words": ("this is\na letter\n", "columns of numbers"),
    "no unit": (plain().replace(" (N)", ""), "gives Fx no unit; expected one of N mN"),
    "a ratio": (plain().replace("(N)", "(mV/V)"), "'mV/V', which is no unit of force"),
    "not a unit": (plain().replace("(N)", "(Newtonz)"), "'Newtonz', which is no unit of force"),
    "thousands": (plain(separator=";").replace("\n0.01;-0.875", "\n0.01;-1,000.875"), "separators of thousands"),
    "no time": ("\n".join(line.split(",", 1)[1] for line in plain().splitlines()) + "\n", "no channel of time"),
    "a gap": (plain().replace("0.03,", "0.03,,", 1), "it has 8 cells; expected 7"),
    "a short row": (plain().replace("0.03,", "", 1), "it has 6 cells; expected 7"),
    "a hole": (plain().replace("\n0.02,-0.125,", "\n0.02,,"), "Fx (N) is ''; expected a finite number"),
    "time goes back": (plain().replace("\n0.03,", "\n0.01,"), "time goes back"),
    "dates turned": (
        plain().replace("\n0.00,", "\n31/05/24 23:59:59.9,").replace("\n0.01,", "\n01/06/24 00:00:00.1,")
        .replace("\n0.02,", "\n01/06/24 00:00:00.2,").replace("\n0.03,", "\n01/06/24 00:00:00.3,")
        .replace("\n0.04,", "\n01/06/24 00:00:00.4,").replace("\n0.05,", "\n01/06/24 00:00:00.5,"),
        "dates such as 2024-05-31",
    ),
    "two cells": (plain().replace("Fy (N)", "Fx (N)"), "do not tell which is which"),
    "not a number": (plain().replace("\n0.03,0.625,", "\n0.03,broken,"), "line 5: Fx (N) is 'broken'"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_read_is_one_line_that_says_what_to_do(name: str, tmp_path: Path) -> None:
    text, said = REFUSED[name]
    path = tmp_path / "r.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read(path)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_journal_is_known_for_one(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite3"
    path.write_bytes(b"SQLite format 3\x00" + bytes(90))
    with pytest.raises(InputError, match="fingertwin journal export"):
        read(path)


def test_an_excel_sheet(tmp_path: Path) -> None:
    path = tmp_path / "r.xlsx"
    path.write_bytes(_workbook(plain("preamble")))
    t_s, wrench, *_ = read(path)
    np.testing.assert_allclose(t_s, TIMES, rtol=0, atol=1e-9)
    np.testing.assert_allclose(wrench, WRENCH, rtol=1e-12, atol=1e-12)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(InputError, match="no sound Excel file"):
        read(path)


def _workbook(text: str) -> bytes:
    """The least workbook: one sheet with the cells of comma-separated text."""
    import io
    import zipfile
    from xml.sax.saxutils import escape

    body = ""
    for i, line in enumerate(text.splitlines(), 1):
        cells = ""
        for j, cell in enumerate(line.split(",") if line else []):
            at = f"{'ABCDEFGH'[j]}{i}"
            number = cell.replace(".", "").replace("-", "").isdigit()
            cells += (
                f'<c r="{at}"><v>{cell}</v></c>'
                if number
                else (f'<c r="{at}" t="inlineStr"><is><t>{escape(cell)}</t></is></c>')
            )
        body += f'<row r="{i}">{cells}</row>'
    main = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
    office = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    package = "http://schemas.openxmlformats.org/package/2006"
    kind = "application/vnd.openxmlformats-officedocument.spreadsheetml"
    files = {
        "[Content_Types].xml": f'<Types xmlns="{package}/content-types"><Default Extension="rels" ContentType="'
        f'application/vnd.openxmlformats-package.relationships+xml"/><Override PartName="/xl/workbook.xml" '
        f'ContentType="{kind}.sheet.main+xml"/><Override PartName="/xl/s.xml" '
        f'ContentType="{kind}.worksheet+xml"/></Types>',
        "_rels/.rels": f'<Relationships xmlns="{package}/relationships"><Relationship Id="a" '
        f'Type="{office}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        "xl/workbook.xml": f'<workbook xmlns="{main}" xmlns:r="{office}"><sheets><sheet name="data" sheetId="1" '
        'r:id="a"/></sheets></workbook>',
        "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{package}/relationships"><Relationship Id="a" '
        f'Type="{office}/worksheet" Target="s.xml"/></Relationships>',
        "xl/s.xml": f'<worksheet xmlns="{main}"><sheetData>{body}</sheetData></worksheet>',
    }
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return out.getvalue()


# Files that were cut off


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
}


def read_or_refused(path: Path) -> tuple[Floats, Floats, tuple[str, ...], tuple[str, ...]] | str:
    try:
        return read(path)
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
        np.testing.assert_allclose(wrench, WRENCH[: len(wrench)], rtol=1e-12, atol=1e-12)
        assert len(wrench) == 6 or any("cut off" in note for note in notes) or _ends_a_row(whole[:length], name)
    assert saved > 0 or name in ("parquet",)


def _ends_a_row(content: bytes, name: str) -> bool:
    """A file that ends between two rows or segments is like one that is whole."""
    return name == "tdms" or content.endswith((b"\n", b"\n\x00"))
