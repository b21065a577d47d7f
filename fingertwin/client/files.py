"""What the service writes as files, what it finds in a session, and its stored readings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from daq.errors import InputError
from daq.files import replacing
from fingertwin.client.exchange import Body, Exchange, reading
from fingertwin.client.summaries import Floats

# Formats by the ends of names; others have to be named.
ENDS = {
    ".csv": "csv",
    ".parquet": "parquet",
    ".xlsx": "xlsx",
    ".h5": "hdf5",
    ".c3d": "c3d",
    ".mat": "mat",
    ".json": "json",
}
CHANNELS = ("Fx_N", "Fy_N", "Fz_N", "Tx_Nmm", "Ty_Nmm", "Tz_Nmm")


@dataclass(frozen=True)
class Check:
    """What was found in a session before it is believed.

    Attributes:
        ok: whether it can be used.
        findings: level (error, warning, note), code, where and text of each.
        body: the whole answer.
    """

    ok: bool
    findings: list[Mapping[str, str]]
    body: Body = field(repr=False)

    @classmethod
    def of(cls, body: Body) -> Check:
        """Of the service's answer."""
        with reading("what was found"):
            return cls(bool(body["ok"]), list(body["findings"]), body)


@dataclass(frozen=True, eq=False)
class Readings:
    """Stored readings of a window of time, tare not taken off, in the cell's axes.

    Where there are more than were asked for, each row is a stretch of them, with its least and its greatest.

    Attributes:
        from_s, to_s: (n,) first and last time of each row [s].
        least, most: (n, 6) Fx Fy Fz [N], Tx Ty Tz [N mm]; the same where a row is one reading.
        body: the whole answer.
    """

    from_s: Floats
    to_s: Floats
    least: Floats
    most: Floats
    body: Body = field(repr=False)

    @classmethod
    def of(cls, body: Body) -> Readings:
        """Of the service's answer."""
        with reading("readings"):
            if body["kind"] == "raw":
                t_s, values = _numbers(body["t_s"]), _columns(body["values"])
                return cls(t_s, t_s, values, values, body)
            least, most = _columns(body["least"]), _columns(body["most"])
            return cls(_numbers(body["from_s"]), _numbers(body["to_s"]), least, most, body)


def format_of(path: Path, file_format: str | None) -> str:
    """Return the format of a file, by its name where none is given.

    Raises:
        InputError: the name does not tell.
    """
    found = file_format or ENDS.get(path.suffix.lower())
    if found is None:
        raise InputError(f"the file {path.name!r}", f"a name that ends in {' '.join(ENDS)}", "Or name the format")
    return found


def fetched(exchange: Exchange, address: str, path: Path, params: Mapping[str, Any]) -> Path:
    """Write an answer to a file, whole or not at all, and return the file."""
    query = {k: v for k, v in params.items() if v is not None}
    answer = exchange.ask("GET", address, params=query, again=True)
    with replacing(path) as temporary:
        temporary.write_bytes(answer.content)
    return path


def _numbers(values: list[float | None]) -> Floats:
    return np.array([np.nan if v is None else v for v in values])


def _columns(values: Mapping[str, list[float | None]]) -> Floats:
    return np.stack([_numbers(values[name]) for name in CHANNELS], axis=1)
