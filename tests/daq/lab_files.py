"""Files as a lab's programs write them, and mappings that read them."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.lab.files import (
    AXES,
    GAUGES,
    Increment,
    LabFileMap,
    Taken,
)
from daq.recordings.readings import ReadingBlock

Floats = NDArray[np.float64]
WRENCH = np.array([[1.0, -2.0, 3.5, 10.0, -20.0, 30.0], [1.5, -2.5, 4.0, 11.0, -21.0, 31.0], [0.0] * 6])
VOLTS = np.array([[1.0, 0.0, 0.0, 0.0, 0.0, -2.0], [0.0, 9.9999, 0.0, 0.0, 0.0, 0.0]])
UNITS = ("N", "N", "N", "Nmm", "Nmm", "Nmm")
# Of gauge 1 at 1 V and gauge 6 at -2 V.
FROM_VOLTS = [-13.2648, 7.30188, 7.69369, 43.59016, 33.16228, -56.50161]


def tdms(path: Path, columns: dict[str, Any], units: dict[str, str] | None = None, **properties: Any) -> Path:
    """Write channels, named group/channel, with one set of waveform properties."""
    nptdms: Any = import_module("nptdms")
    objects = []
    for name, values in columns.items():
        group, channel = name.split("/")
        unit = {"unit_string": units[name]} if units and name in units else {}
        objects.append(nptdms.ChannelObject(group, channel, np.asarray(values), properties={**properties, **unit}))
    with nptdms.TdmsWriter(str(path)) as writer:
        writer.write_segment(objects)
    return path


def resolved(path: Path, wrench: Floats = WRENCH, units: tuple[str, ...] = UNITS, **properties: Any) -> Path:
    columns = {f"ATI/{a}": wrench[:, i] for i, a in enumerate(AXES)}
    return tdms(path, columns, {f"ATI/{a}": u for a, u in zip(AXES, units, strict=True)}, **properties)


def lvm(
    path: Path,
    rows: list[str],
    names: str = "Voltage_0 Voltage_1 Voltage_2 Voltage_3 Voltage_4 Voltage_5",
    *,
    x_columns: str = "One",
    decimal: str = ".",
    delta: str = "0.001000",
    unit: str = "Volts",
    encoding: str = "utf-8",
) -> Path:
    """Write text as LabVIEW does, its rows as given."""
    headings = names.split()
    n = len(headings)

    def line(tag: str, value: str) -> str:
        return "\t".join([tag, *[value] * n])

    text = [
        "LabVIEW Measurement\t",
        "Writer_Version\t2",
        "Reader_Version\t2",
        "Separator\tTab",
        f"Decimal_Separator\t{decimal}",
        "Multi_Headings\tNo",
        f"X_Columns\t{x_columns}",
        "Time_Pref\tRelative",
        "Operator\tMüller",
        "Date\t2019/07/22",
        f"Time\t17:18:18{decimal}938945",
        "***End_of_Header***\t",
        "\t",
        "***Start_Special***\t",
        "Packet_Notes\twhatever",
        "***End_Special***\t",
        f"Channels\t{n}",
        line("Samples", str(len(rows))),
        line("Date", "2019/07/22"),
        line("Y_Unit_Label", unit),
        line("X_Dimension", "Time"),
        line("X0", "0.0000000000000000E+0".replace(".", decimal)),
        line("Delta_X", delta),
        "***End_of_Header***\t",
        "\t".join(["X_Value", *headings, "Comment"]),
        *rows,
    ]
    path.write_bytes(("\r\n".join(text) + "\r\n").encode(encoding))
    return path


VOLT_ROWS = ["0.000000\t1.0\t0\t0\t0\t0\t-2.000000", "0.001000\t0.0\t9.9999\t0\t0\t0\t0\tdropped the weight"]


def mapped(time: Taken | Increment | None = None, **more: Any) -> LabFileMap:
    """The mapping of `resolved`."""
    given: dict[str, Any] = {
        "format": "lab-file-map/1",
        "confirmed": True,
        "time": time or Increment(increment_s="file"),
        "channels": {a: Taken(channel=f"ATI/{a}", unit=u) for a, u in zip(AXES, UNITS, strict=True)},
    }
    return LabFileMap(**(given | more))


def gauges(cal: Path, names: tuple[str, ...], **more: Any) -> LabFileMap:
    channels = {g: Taken(channel=n, unit="V") for g, n in zip(GAUGES, names, strict=True)}
    return mapped(more.pop("time", Taken(channel="X_Value", unit="s")), channels=channels, calibration=str(cal), **more)


VOLTAGES = tuple(f"Voltage_{k}" for k in range(6))


def together(blocks: list[ReadingBlock]) -> tuple[Floats, Floats]:
    return np.concatenate([b.t_s for b in blocks]), np.concatenate([b.wrench for b in blocks])
