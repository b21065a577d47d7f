"""Recordings in the forms that labs have, all of one wrench, and how they are read."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from numpy.typing import NDArray

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
