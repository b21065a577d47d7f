"""Write a session for other software: HDF5, MATLAB and C3D.

HDF5 and MATLAB files hold the readings, where the session has them, and the table of cases. A C3D file holds the six
channels alone, evenly sampled as that format has it, and the windows as events.
"""

from __future__ import annotations

import errno
import json
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.errors import InputError, ReadingsError
from daq.export.tables import CELL_FRAME, describe_columns, sha256_of, software
from daq.files import replacing
from daq.recordings.gaps import EVEN
from daq.recordings.readings import HEADERS, ReadingBlock, open_readings
from daq.sessions.models import Session
from daq.signals.corrections import windows_of

Columns = Mapping[str, list[Any]]
FORMAT = "fingertwin-export/1"
# Limits of C3D: frames are counted in 16 bits, a parameter's entries in 8, and all parameters take 255 blocks of 512.
C3D_FRAMES = 65535
C3D_ENTRIES = 255
C3D_EVENT_BYTES = 100_000
ANOTHER = "Use --format hdf5"


def write_hdf5(session: Session, columns: Columns, file: Path, about: Mapping[str, Any]) -> None:
    """Write `/readings`, `/cases` and `/events`, every dataset with its unit, frame and meaning as attributes.

    An unknown number is NaN, an unknown text empty, and of yes and no 1, 0 and -1 for unknown.
    """
    import h5py

    with replacing(file) as temporary:
        temporary.touch()  # so that a folder that cannot be written to is said in the system's words
        try:
            with h5py.File(temporary, "w") as out:
                out.attrs["format"] = FORMAT
                for name, value in _facts(session, about).items():
                    out.attrs[name] = value
                _describe(_hdf5_columns(out.create_group("cases"), columns))
                if session.events:
                    _hdf5_columns(out.create_group("events"), _event_columns(session))["t_s"].attrs["unit"] = "s"
                if session.readings_path is not None:
                    _hdf5_readings(out.create_group("readings"), open_readings(session.readings_path).blocks())
        except (RuntimeError, OSError) as error:  # the library has its own words, of several lines
            number = re.search(r"errno = (\d+)", str(error))
            code = int(number[1]) if number else errno.EIO
            raise OSError(code, os.strerror(code), str(file)) from error


def write_mat(session: Session, columns: Columns, file: Path, about: Mapping[str, Any]) -> None:
    """Write a MATLAB 5 file: `cases`, `events`, `readings` and `columns`, each a struct of columns.

    The field names end in their units, as the columns' names do; an unknown number is NaN, an unknown text blank.
    Texts are the rows of a matrix of characters, which `cellstr` and `struct2table` take apart: a struct array, or a
    cell for each text, takes seconds for thousands of cases, here and in MATLAB.

    Raises:
        InputError: the readings are too many for the format.
    """
    from scipy.io import savemat

    fields = _field_names(list(columns))
    contents: dict[str, Any] = {
        "session": {"format": FORMAT, **_facts(session, about)},
        "cases": _mat_columns(fields, columns),
        "columns": _mat_columns(
            {k: k for k in ("field", "name", "unit", "frame", "meaning")},
            _transposed([{"field": fields[str(c["name"])], **c} for c in describe_columns(list(columns))]),
        ),
    }
    if session.events:
        events = _event_columns(session)
        contents["events"] = _mat_columns(_field_names(list(events)), events)
    if session.readings_path is not None:
        block = _all_readings(session.readings_path)
        readings: dict[str, NDArray[Any]] = {"t_s": block.t_s} | {
            h: block.wrench[:, i] for i, h in enumerate(HEADERS[1:])
        }
        if block.status is not None:
            readings["status"] = block.status
        contents["readings"] = {"frame": CELL_FRAME} | {k: v[:, None] for k, v in readings.items()}
    with replacing(file) as temporary:
        try:
            savemat(temporary, contents, long_field_names=True, do_compression=True, appendmat=False)
        except ValueError as error:  # scipy's MatWriteError is one
            raise InputError(f"{file.name}: {error}", "less than 4 GB of readings", ANOTHER) from error
        # The 116 bytes of the header are free text, which otherwise tells the time and the operating system.
        with temporary.open("rb+") as stream:
            stream.write(f"MATLAB 5.0 MAT-file, written by {software()}".encode("ascii", "replace").ljust(116)[:116])


def write_c3d(session: Session, file: Path) -> None:
    """Write the readings as six analog channels [N, N mm] in the cell's axes, and windows and events as C3D events.

    C3D counts its time in readings from the first one on, so windows and events stand at the readings that they stood
    at, also where a clock wandered. It keeps single precision; the group FINGERTWIN tells the time of the
    first reading and the number of readings. Status flags have no place in it. Beyond 65,535 readings several share a
    frame, and the last frame is filled up with NaN.

    Raises:
        InputError: the session has no readings, they are not evenly sampled, or there are too many events.
    """
    import ezc3d

    path = session.readings_path
    if path is None:
        raise InputError(
            f"session {session.id} has averaged forces and no readings",
            "a session with readings, whose channels C3D can hold",
            ANOTHER,
        )
    block = _all_readings(path)
    start_s, count = float(block.t_s[0]), len(block)
    rate_hz = _even_rate_hz(block.t_s, session, path.name)
    shared = -(-count // C3D_FRAMES)
    frames = -(-count // shared)
    channels = np.full((1, 6, frames * shared), np.nan)
    channels[0, :, :count] = block.wrench.T

    out = ezc3d.c3d()
    out["parameters"]["POINT"]["RATE"]["value"] = [_frame_rate_hz(rate_hz, shared)]
    analog = out["parameters"]["ANALOG"]
    analog["RATE"]["value"] = [rate_hz]
    analog["LABELS"]["value"] = [h.split("_")[0] for h in HEADERS[1:]]
    analog["UNITS"]["value"] = ["N", "N", "N", "Nmm", "Nmm", "Nmm"]
    analog["DESCRIPTIONS"]["value"] = [f"{c['meaning']}, {CELL_FRAME}" for c in describe_columns(HEADERS[1:])]
    out["data"]["points"] = np.zeros((4, 0, frames))
    out["data"]["analogs"] = channels
    facts = {"SESSION": session.id[:100], "SOFTWARE": software(), "READINGS_SHA256": sha256_of(path)}
    for name, value in facts.items():
        out.add_parameter("FINGERTWIN", name, [value])
    out.add_parameter("FINGERTWIN", "START_S", [start_s])
    out.add_parameter("FINGERTWIN", "READINGS", [count])
    for i, group in enumerate(_event_groups(session, block.t_s, rate_hz)):
        suffix = "" if i == 0 else str(i + 1)
        times = np.array([t for t, _ in group])
        out.add_parameter("EVENT", f"USED{suffix}", [len(group)])
        out.add_parameter("EVENT", f"CONTEXTS{suffix}", ["General"] * len(group))
        out.add_parameter("EVENT", f"LABELS{suffix}", [label for _, label in group])
        out.add_parameter("EVENT", f"TIMES{suffix}", np.stack([times // 60.0, times % 60.0]))
    with replacing(file) as temporary:
        named = temporary.with_name(f"{temporary.name}.c3d")  # the library adds the ending where it lacks
        try:
            named.touch()
            out.write(str(named))
            if named.stat().st_size < channels.size * 4:  # it says nothing where it cannot write
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(file))
            named.replace(temporary)
        finally:
            named.unlink(missing_ok=True)


def _facts(session: Session, about: Mapping[str, Any]) -> dict[str, Any]:
    """Return the head of a file, as texts and numbers."""
    given = {k: v if isinstance(v, str | int | float) else json.dumps(v) for k, v in about.items()}
    return {
        "session": session.id,
        "specimen": session.specimen.id,
        "side": session.specimen.side,
        "gravity_m_s2": session.gravity_m_s2,
        **given,
    }


def _event_columns(session: Session) -> Columns:
    return {
        "t_s": [e.t_s for e in session.events],
        "kind": [e.kind for e in session.events],
        "value": [None if e.value is None else str(e.value) for e in session.events],
        "text": [e.text for e in session.events],
    }


def _hdf5_columns(group: Any, columns: Columns) -> Any:
    for name, values in columns.items():
        known = [v for v in values if v is not None]
        if known and all(isinstance(v, str) for v in known):
            group.create_dataset(name, data=["" if v is None else v for v in values])
        elif known and all(isinstance(v, bool) for v in known):
            group.create_dataset(name, data=np.array([-1 if v is None else int(v) for v in values], dtype=np.int8))
        elif known == values and all(isinstance(v, int) for v in known):
            group.create_dataset(name, data=np.array(values, dtype=np.int64))
        else:
            group.create_dataset(name, data=np.array([np.nan if v is None else float(v) for v in values]))
    return group


def _hdf5_readings(group: Any, blocks: Iterator[ReadingBlock]) -> None:
    """Append block by block, so that memory does not grow with the recording."""
    for block in blocks:
        columns: dict[str, NDArray[Any]] = {"t_s": block.t_s} | {
            h: block.wrench[:, i] for i, h in enumerate(HEADERS[1:])
        }
        if block.status is not None:
            columns["status"] = block.status
        for name, values in columns.items():
            if name not in group:
                group.create_dataset(
                    name, data=values, maxshape=(None,), chunks=(1 << 14,), compression="gzip", compression_opts=4
                )
            else:
                group[name].resize(len(group[name]) + len(values), axis=0)
                group[name][-len(values) :] = values
    _describe(group, CELL_FRAME)


def _describe(group: Any, frame: str | None = None) -> None:
    names = list(group)
    for column in describe_columns(names) if frame is None else describe_columns(names, frame):
        for key in ("unit", "frame", "meaning"):
            if column[key] is not None:
                group[column["name"]].attrs[key] = column[key]


def _field_names(names: list[str]) -> dict[str, str]:
    """Return a MATLAB field name for each column: letters, digits and underscores, at most 63, all different."""
    out: dict[str, str] = {}
    for name in names:
        field = re.sub(r"\W", "_", name, flags=re.ASCII)[:59]
        field = field if field[:1].isalpha() else f"x{field}"
        taken, number = field, 2
        while field in out.values():
            field, number = f"{taken}_{number}", number + 1
        out[name] = field
    return out


def _mat_columns(fields: Mapping[str, str], columns: Columns) -> dict[str, NDArray[Any]]:
    """Return columns as MATLAB has them: numbers (n, 1), texts (n, width) padded with blanks."""
    out: dict[str, NDArray[Any]] = {}
    for name, field in fields.items():
        values = columns[name]
        if any(isinstance(v, str) for v in values) or name in ("text", "unit", "frame"):
            texts = ["" if v is None else str(v) for v in values]
            width = max(1, *map(len, texts))
            out[field] = np.array([t.ljust(width) for t in texts])
        else:
            out[field] = np.array([[np.nan if v is None else float(v)] for v in values])
    return out


def _transposed(rows: list[dict[str, Any]]) -> Columns:
    return {key: [row[key] for row in rows] for key in rows[0]}


def _all_readings(path: Path) -> ReadingBlock:
    blocks = list(open_readings(path).blocks())
    status = [b.status for b in blocks if b.status is not None]
    return ReadingBlock(
        np.concatenate([b.t_s for b in blocks]),
        np.concatenate([b.wrench for b in blocks]),
        np.concatenate(status) if len(status) == len(blocks) else None,
    )


def _even_rate_hz(t_s: NDArray[np.float64], session: Session, file: str) -> float:
    """Return the rate [Hz] at which every reading lies within half a step of its place in an even row.

    A clock that wanders slowly takes a long recording out of any such row; its readings are even all the same.

    Raises:
        ReadingsError: there is none, and the channels would tell times that are not those of the readings.
    """
    if len(t_s) < 2 or not t_s[-1] > t_s[0]:
        raise ReadingsError(f"{file} has {len(t_s)} readings over no time", "two or more, at a rate", ANOTHER)
    stated = session.load_cell.rate_hz if session.load_cell else None
    mean = (len(t_s) - 1) / float(t_s[-1] - t_s[0])
    for rate_hz in (stated, mean):
        if rate_hz is not None and np.abs((t_s - t_s[0]) * rate_hz - np.arange(len(t_s))).max() < 0.5:
            return float(rate_hz)
    steps = np.diff(t_s)
    if np.abs(steps * mean - 1.0).max() <= EVEN:
        return mean
    worst = int(np.argmax(np.abs(steps - np.median(steps))))
    raise ReadingsError(
        f"{file} is not evenly sampled: {steps[worst]:.4g} s pass after t = {t_s[worst]:.4f} s, "
        f"elsewhere {np.median(steps):.4g} s",
        "readings without gaps, as C3D channels are",
        ANOTHER,
    )


def _frame_rate_hz(rate_hz: float, shared: int) -> float:
    """Return the rate of frames that share readings, in single precision: readers cut the quotient of the two rates."""
    frames_hz = np.float32(rate_hz / shared)
    while np.float32(rate_hz) / frames_hz < shared or float(np.float32(rate_hz)) / float(frames_hz) < shared:
        frames_hz = np.nextafter(frames_hz, np.float32(0.0))
    return float(frames_hz)


def _event_groups(session: Session, t_s: NDArray[np.float64], rate_hz: float) -> list[list[tuple[float, str]]]:
    """Return times [s] after the first reading with labels, in order, in groups of as many as C3D holds together."""
    after_s = t_s - t_s[0]
    moved_s = np.arange(len(t_s)) / rate_hz - after_s
    events = [(e.t_s, e.kind) for e in session.events]
    for span, name in windows_of(session).items():
        label = name.removeprefix("case ").replace(":", "").removesuffix("_s")
        events += [(span[0], f"{label} start"), (span[1], f"{label} end")]
    # A time before the first reading has no place in the format.
    kept = [(t - t_s[0], label) for t, label in events if t >= t_s[0]]
    found = sorted((float(t + np.interp(t, after_s, moved_s)), label) for t, label in kept)
    widest = max((len(label.encode()) for _, label in found), default=0)
    if widest > C3D_ENTRIES or len(found) * (widest + len("General") + 8) > C3D_EVENT_BYTES:
        raise InputError(
            f"session {session.id} has {len(found)} events with labels of up to {widest} bytes",
            f"{C3D_EVENT_BYTES} bytes of events and labels of {C3D_ENTRIES}, which is what C3D can hold",
            ANOTHER,
        )
    return [found[i : i + C3D_ENTRIES] for i in range(0, len(found), C3D_ENTRIES)]
