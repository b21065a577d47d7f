"""Recordings in the forms that labs have: each is read to its right numbers, or refused in one line with what to do."""

from __future__ import annotations

import gzip
import tracemalloc
from collections.abc import Callable, Iterator
from functools import partial
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


# What strangers' files have besides


def columned(separator: str = ";", **changes: Callable[[list[list[str]]], list[list[str]]]) -> str:
    """The plain file's lines by cells, changed."""
    cells = [line.split(",") for line in plain().splitlines()]
    for change in changes.values():
        cells = change(cells)
    return "\n".join(separator.join(row) for row in cells) + "\n"


def clocked(clock: Callable[[int], str]) -> str:
    """The plain file with times as a clock writes them, from milliseconds since the beginning."""

    def timed(cells: list[list[str]]) -> list[list[str]]:
        rest = zip(TIMES, cells[1:], strict=True)
        return [["time", *cells[0][1:]], *([clock(round(1000 * t)), *row[1:]] for t, row in rest)]

    return columned(a=timed)


def at(ms: int, start_s: float = 0.0) -> tuple[int, int, int, int]:
    """Hours, minutes, seconds and milliseconds, so long after a time of day."""
    whole = round(1000 * start_s) + ms
    return whole // 3_600_000 % 24, whole // 60_000 % 60, whole // 1000 % 60, whole % 1000


def twelve(ms: int) -> str:
    hour, minute, second, rest = at(ms, 12 * 3600 + 3600 - 0.02)
    return f"5/31/2024 {(hour - 1) % 12 + 1}:{minute:02d}:{second:02d}.{rest:03d} PM"


def new_day(ms: int) -> str:
    hour, minute, second, rest = at(ms, 86_400 - 0.02)
    return f"2024/{'05/31' if hour else '06/01'} {hour:02d}:{minute:02d}:{second:02d}.{rest:03d}"


def o_clock(ms: int, start_s: float = 36_000.0, mark: str = ".") -> str:
    hour, minute, second, rest = at(ms, start_s)
    return f"{hour:02d}:{minute:02d}:{second:02d}{mark}{rest:03d}"


def minutes(ms: int) -> str:
    _, minute, second, rest = at(ms, 302.0)
    return f"{minute:02d}:{second:02d}.{rest:03d}"


def row_by_row(cells: list[list[str]]) -> list[list[str]]:
    """Headings in two lines and units in a third, as some programs group their channels."""
    groups = ["Zeit", "Kraft", "", "", "Moment", "", ""]
    return [groups, ["", *"XYZXYZ"], ["s", *["N"] * 3, *["Nmm"] * 3], *cells[1:]]


def paged(cells: list[list[str]]) -> list[list[str]]:
    """Names and units once more before the third reading."""
    head = row_by_row(cells)[1:3]
    return [*head, *cells[1:3], *head, *cells[3:]]


def with_temperature(cells: list[list[str]]) -> list[list[str]]:
    units = ["s", *["N"] * 3, *["Nmm"] * 3, "°C"]
    return [["time", *AXES, "Temp"], units, *([*row, "21.5"] for row in cells[1:])]


def turned(cells: list[list[str]]) -> list[list[str]]:
    """Fz first, and time last."""
    return [row[:0:-1] + row[:1] for row in cells]


def headed(time: str, force: str, torque: str) -> str:
    """The plain file with other names, in which {} stands for the axis."""
    names = [time, *(word.format(x) for word in (force, torque) for x in "xyz")]
    return columned(a=lambda cells: [names, *cells[1:]])


def scaled_to(force: str, torque: str, newtons: float, newton_mm: float) -> str:
    cells = [["time (s)", *(f"{a} ({force if a[0] == 'F' else torque})" for a in AXES)]]
    for t, row in zip(TIMES, WRENCH / np.repeat([newtons, newton_mm], 3), strict=True):
        cells.append([f"{t:.2f}", *(repr(float(v)) for v in row)])
    return "\n".join(";".join(row) for row in cells) + "\n"


STRANGE: dict[str, str | bytes] = {
    "quantity over unit": headed("t/s", "F_{}/N", "M_{} / (N mm)").replace(".", ","),
    "the axis first": headed("t [s]", "{} Force (N)", "{} Torque (Nmm)"),
    "whole sentences": headed("Zeit in s", "Kraft in {}-Richtung in N", "Moment um {} in Nmm"),
    "Russian": headed("Время (с)", "Сила {} (Н)", "Момент {} (Н·мм)"),
    "the day first, with points, over midnight": clocked(
        lambda ms: ("31.05.24 " if ms < 20 else "01.06.24 ") + o_clock(ms, 86_400 - 0.02)
    ),
    "an index before all": columned(a=lambda cells: [[str(i - 1) if i else "", *row] for i, row in enumerate(cells)]),
    "two plates": columned(
        a=lambda cells: [[*row, *(f"{c}2" if not i else "7" for c in cells[0][1:])] for i, row in enumerate(cells)]
    ).replace(" (N)2", "2 (N)").replace(" (Nmm)2", "2 (Nmm)"),
    "utf-16 without its mark": plain().encode("utf-16-le"),
    "decimal commas, tabs, two lines of headings": columned("\t", a=row_by_row).replace(".", ","),
    "a unit that is not known beside others": columned(a=with_temperature),
    "am and pm": clocked(twelve),
    "the year first, over midnight": clocked(new_day),
    "times of day over midnight": clocked(lambda ms: o_clock(ms, 86_400 - 0.02)),
    "a colon before milliseconds": clocked(lambda ms: o_clock(ms, mark=":")),
    "minutes and seconds": clocked(minutes),
    "a month by its name": clocked(lambda ms: f"31-May-2024 {o_clock(ms)}"),
    "separators behind each row": columned(a=lambda cells: [[*row, "", ""] for row in cells]),
    "the heading once more": columned(a=lambda cells: [*cells[:4], cells[0], *cells[4:]]),
    "headings and units once more": columned(a=paged),
    "a remark at the end": plain() + "# written by hand\n",
    "turned round": columned(a=turned),
    "kgf": scaled_to("kgf", "kgf-cm", 9.80665, 98.0665),
    "ounces": scaled_to("ozf", "in-oz", 0.27801385095378125, 7.061551814226044),
    "an empty column": columned(a=lambda cells: [[*row[:3], "", *row[3:]] for row in cells]),
    "a true minus": plain().replace("-", "\u2212"),
    "quoted decimal commas between commas": "\n".join(
        ",".join(f'"{c}"' for c in line.split(";")) for line in plain(separator=";", decimal=",").splitlines()
    ) + "\n",
    "headings over two lines": (
        ",".join(f'"{c}"' for c in plain().splitlines()[0].split(",")).replace(" (", "\n(") + "\n"
        + "\n".join(plain().splitlines()[1:]) + "\n"
    ),
    "a mark that is never closed": '"Rig 7, left\n' + plain(),
    "inches": 'Rod 5" long; cable 3"\nand 2" more\n' + plain(separator=";"),
    "a line for Excel": "sep=;\n" + plain(separator=";"),
    "Finnish": headed("t [s]", "Voima {} [N]", "Vääntö {} [Nmm]"),
    "Japanese": headed("t [s]", "力 {} [N]", "トルク {} [Nmm]"),
    "torques first, in Hungarian": "\n".join(
        ";".join([row[0], *row[4:], *row[1:4]])
        for row in (line.split(";") for line in headed("t [s]", "Erő {} [N]", "Nyomaték {} [Nmm]").splitlines())
    ) + "\n",
}  # fmt: skip


@pytest.mark.parametrize("name", STRANGE)
def test_what_strangers_write(name: str, tmp_path: Path) -> None:
    path = tmp_path / "r.txt"
    content = STRANGE[name]
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    t_s, wrench, *_ = read(path)
    np.testing.assert_allclose(t_s - t_s[0], TIMES, rtol=0, atol=1e-6)
    np.testing.assert_allclose(wrench, WRENCH, rtol=1e-12, atol=1e-12)


def hdf5(path: Path, form: str) -> Path:
    import h5py

    names = ["t_s", *(f"{a}_{'N' if a[0] == 'F' else 'Nmm'}" for a in AXES)]
    whole = np.column_stack([TIMES, WRENCH])
    with h5py.File(path, "w", userblock_size=512 if form == "matlab" else 0) as file:
        if form == "table":
            table = file.create_dataset("rig/run 1", data=whole)
            table.attrs["columns"] = ["time", *AXES]
            table.attrs["units"] = ["s", *["N"] * 3, *["Nmm"] * 3]
        elif form == "records":
            file["run"] = np.array([tuple(row) for row in whole], dtype=[(n, "f8") for n in names])
        elif form == "pandas":
            file["df/block0_items"] = np.array(names, dtype="S8")
            file["df/block0_values"] = whole
        else:
            for name, column in zip(names, whole.T, strict=True):
                file[f"data/{name}"] = column[None] if form == "matlab" else column
            file["data/gain"] = [1.0, 2.0]
    if form == "matlab":
        with path.open("rb+") as stream:
            stream.write(b"MATLAB 7.3 MAT-file, Platform: PCWIN64".ljust(124))
    return path


def c3d(path: Path) -> Path:
    import ezc3d

    out = ezc3d.c3d()
    out["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    analog = out["parameters"]["ANALOG"]
    analog["RATE"]["value"] = [100.0]
    analog["LABELS"]["value"] = [*AXES, "EMG"]
    analog["UNITS"]["value"] = [*["N"] * 3, *["Nmm"] * 3, "V"]
    out["data"]["points"] = np.zeros((4, 0, len(TIMES)))
    out["data"]["analogs"] = np.vstack([WRENCH.T, TIMES])[None]
    named = path.with_name("r.c3d")
    out.write(str(named))
    return named.replace(path)


def excel(path: Path, kind: str) -> Path:
    """A workbook with a table of settings first, and the readings on its second sheet."""
    import datetime as dt

    import xlsxwriter

    with xlsxwriter.Workbook(path, {"default_date_format": "hh:mm:ss.000"}) as book:
        settings = book.add_worksheet("settings")
        for i in range(4):
            settings.write_row(i, 0, [1.0 + i, 2.0, 3.0, 4.0])
        sheet = book.add_worksheet("run 1")
        names = [f"{a} ({'N' if a[0] == 'F' else 'Nmm'})" for a in AXES]
        sheet.write_row(2, 1, ["time" if kind == "times" else "time (s)", *names])
        for i, (t, row) in enumerate(zip(TIMES, WRENCH, strict=True)):
            if kind == "times":
                sheet.write_datetime(3 + i, 1, dt.datetime(2024, 5, 31, 10) + dt.timedelta(seconds=float(t)))  # noqa: DTZ001
            else:
                sheet.write_number(3 + i, 1, t)
            sheet.write_row(3 + i, 2, row)
    return path


HDF5_FORMS = ("datasets", "table", "records", "pandas", "matlab")
MORE_CONTAINERS: dict[str, Callable[[Path], Path]] = {
    **{f"hdf5 {form}": partial(hdf5, form=form) for form in HDF5_FORMS},
    "c3d": c3d,
    "excel, second sheet": lambda path: excel(path, "numbers"),
    "excel, times of day": lambda path: excel(path, "times"),
}


@pytest.mark.parametrize("name", MORE_CONTAINERS)
def test_every_other_container(name: str, tmp_path: Path) -> None:
    t_s, wrench, *_ = read(MORE_CONTAINERS[name](tmp_path / "r.dat"))
    np.testing.assert_allclose(t_s, TIMES, rtol=0, atol=1e-4 if name.startswith("excel") else 1e-9)
    np.testing.assert_allclose(wrench, WRENCH, rtol=1e-6 if name == "c3d" else 1e-12, atol=1e-12)


def test_a_file_that_points_out_of_itself_is_not_followed(tmp_path: Path) -> None:
    import h5py

    secret = tmp_path / "secret"
    secret.write_bytes(bytes(8 * 6))
    path = tmp_path / "r.h5"
    with h5py.File(path, "w") as file:
        file["t_s"] = TIMES
        for i, a in enumerate(AXES):
            file[f"{a}_N" if i < 3 else f"{a}_Nmm"] = WRENCH[:, i]
        del file["Fx_N"]
        file.create_dataset("Fx_N", shape=(6,), dtype="f8", external=[(str(secret), 0, 48)])
        file["elsewhere"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/x")
    with pytest.raises(InputError, match="holds numbers of other files"):
        read(path)


REFUSED: dict[str, tuple[str, str]] = {
    "nothing": ("", "has no whole line"),
    "words": ("this is\na letter\n", "columns of numbers"),
    "no unit": (plain().replace(" (N)", ""), "gives Fx no unit; expected one of N mN"),
    "a ratio": (plain().replace("(N)", "(mV/V)"), "A ratio becomes a force by the cell's calibration"),
    "frames and no time": (
        "Devices\n100\n,,Force - Force,,,Moment - Moment,,\nFrame,Sub Frame,Fx,Fy,Fz,Mx,My,Mz\n"
        ",,N,N,N,N.mm,N.mm,N.mm\n" + "".join(f"{i},0,1,2,3,4,5,6\n" for i in range(9)),
        "or state load_cell: rate_hz in the rig's setup",
    ),
    "names of a robot's bus": (
        "%time," + ",".join(f"field.wrench.{w}.{x}" for w in ("force", "torque") for x in "xyz") + "\n"
        + "".join(f"{1714564800000000000 + 10**7 * i},1,2,3,4,5,6\n" for i in range(9)),
        "gives field.wrench.force.x no unit",
    ),
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
    "whole seconds": (
        "time,Fx (N),Fy (N),Fz (N),Tx (Nmm),Ty (Nmm),Tz (Nmm)\n"
        + "".join(f"5/31/2024 1:05:{i // 10:02d} PM,{i},0,0,0,0,0\n" for i in range(40)),
        "time stands still from most readings to the next",
    ),
    "thousands by a gap": (
        plain(separator=";").replace("\n0.01;-0.875", "\n0.01;-1\u00a0000.875"), "without separators of thousands"
    ),
    "thousands between commas": (plain().replace("\n0.01,-0.875", "\n0.01,-1,000.875"), "separators of thousands"),
    "statistics below": (plain() + "Mean,1,2,3,4,5,6\n", "line 8: time (s) is 'Mean'"),
    "statistics behind an empty line": (plain() + "\nMean,1\n", "Remove that row, or everything from there on"),
    "units in every cell": (
        "\n".join(",".join(c if i == 0 else f"{c} N" for c in line.split(",")) if i else line
                  for i, line in enumerate(plain().splitlines())) + "\n",
        "no rows of numbers",
    ),
    "a second recording behind the first": (plain() + plain(), "Was a second recording appended?"),
    "six without names or units": (
        columned(a=lambda cells: [["time (s)", *(f"Kanal {x}" for x in "abcdef")], *cells[1:]]), "gives Kanal a no unit"
    ),
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
    _workbook(path, plain("preamble"))
    t_s, wrench, *_ = read(path)
    np.testing.assert_allclose(t_s, TIMES, rtol=0, atol=1e-9)
    np.testing.assert_allclose(wrench, WRENCH, rtol=1e-12, atol=1e-12)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(InputError, match="no sound Excel file"):
        read(path)


def _workbook(path: Path, text: str) -> Path:
    """A sheet with the cells of comma-separated text."""
    import xlsxwriter

    with xlsxwriter.Workbook(path, {"strings_to_numbers": True}) as book:
        sheet = book.add_worksheet("data")
        for i, line in enumerate(text.splitlines()):
            sheet.write_row(i, 0, line.split(","))
    return path


@pytest.mark.parametrize("separator", [",", ";"])
def test_a_long_recording_is_read_in_memory_that_does_not_grow(
    separator: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daq.lab.text.BLOCK_ROWS", 500)
    peaks = []
    for count in (4_000, 32_000):
        path = tmp_path / f"{count}.csv"
        head, first = plain(separator=separator).splitlines()[:2]
        rest = first.split(separator, 1)[1]
        path.write_text(head + "\n" + "".join(f"{i / 100}{separator}{rest}\n" for i in range(count)), "utf-8")
        recording = open_recording(path, propose_mapping(path).model_copy(update={"confirmed": True}))
        tracemalloc.start()
        assert sum(len(block) for block in recording.blocks()) == count
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]


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
    "hdf5": lambda path: hdf5(path, "datasets"),
    "c3d": c3d,
    "excel": lambda path: excel(path, "numbers"),
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
        np.testing.assert_allclose(wrench, WRENCH[: len(wrench)], rtol=1e-6 if name == "c3d" else 1e-12, atol=1e-12)
        assert len(wrench) == 6 or any("cut off" in note for note in notes) or _ends_a_row(whole[:length], name)
    assert saved > 0 or name in ("parquet", "hdf5", "c3d", "excel")


def _ends_a_row(content: bytes, name: str) -> bool:
    """A file that ends between two rows or segments is like one that is whole."""
    return name == "tdms" or content.endswith((b"\n", b"\n\x00"))
