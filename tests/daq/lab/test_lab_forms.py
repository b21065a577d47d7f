"""Recordings in the forms that labs have: each is read to its right numbers, or refused in one line with what to do."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from daq.errors import InputError
from daq.lab.files import AXES, open_recording
from daq.lab.proposals import propose_mapping
from tests.daq.lab.forms import CONTAINERS, TIMES, WRENCH, c3d, excel, hdf5, plain, read, written

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


@pytest.mark.parametrize("name", CONTAINERS)
def test_every_container(name: str, tmp_path: Path) -> None:
    t_s, wrench, *_ = read(CONTAINERS[name](tmp_path / "r.dat"))
    np.testing.assert_allclose(t_s, TIMES, rtol=0, atol=1e-9)
    np.testing.assert_allclose(wrench, WRENCH, rtol=1e-12, atol=1e-12)


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


def over_midnight(before: str, after: str) -> str:
    """Times that go over midnight with the readings, with the day before and after it."""
    return clocked(lambda ms: f"{before if ms < 20 else after} {o_clock(ms, 86_400 - 0.02)}")


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
    "the day first, told by itself": over_midnight("25/11/2026", "26/11/2026"),
    "the month first, told by itself": over_midnight("11/25/2026", "11/26/2026"),
    "the day first, told by midnight": over_midnight("11/12/2026", "12/12/2026"),
    "the month first, told by midnight": over_midnight("11/12/2026", "11/13/2026"),
    "the month first, told by a new day alone": over_midnight("02-03-2026", "02-04-2026"),
    "the day first, at the end of a month": over_midnight("31/05/24", "01/06/24"),
    "the day first, at the end of a short month": over_midnight("30/06/2026", "01/07/2026"),
    "the year first, in two digits": over_midnight("26/11/25", "26/11/26"),
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
    "more than a cell tells": (
        plain().replace("\n0.02,-0.125,", "\n0.02,1e200,"),
        "Fx (N) is 1e+200; expected a number that a load cell can tell",
    ),
    "time goes back": (plain().replace("\n0.03,", "\n0.01,"), "time goes back"),
    "days apart, or months": (over_midnight("05/06/2026", "07/06/2026"), "dates such as 2024-05-31"),
    "years apart, or days": (over_midnight("05/06/07", "05/07/08"), "whose day and month may be exchanged"),
    "no date": (over_midnight("31/31/2026", "32/31/2026"), "dates such as 2024-05-31"),
    "two cells": (plain().replace("Fy (N)", "Fx (N)"), "do not tell which is which: none that can be read is Fy"),
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
