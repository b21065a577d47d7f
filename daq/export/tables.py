"""Write a session's measured cases as a table, one row a load case, with units in the column names.

A CSV file cannot say more than its header: `write_table` puts a JSON file beside it that tells each column's unit,
frame and meaning, and what the numbers came from.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from daq.errors import InputError
from daq.files import replacing
from daq.measured import MeasuredSession
from daq.recordings.readings import HEADERS
from daq.sessions.models import Session
from daq.vocabulary import JOINT_ANGLES, TENDONS

AXES = HEADERS[1:]
TABLE_FORMAT = "fingertwin-table/1"
MOUNT_FRAME = "mount axes at the case's location, right-hand-equivalent: x proximal, y dorsal, z radial"
CELL_FRAME = "the cell's own axes"

# Unit and meaning of the columns whose names do not follow a rule.
_MEANINGS: Mapping[str, tuple[str | None, str]] = {
    "session": (None, "id of the session"),
    "id": (None, "id of the load case"),
    "role": (None, "identification: may be fitted; validation: never fitted"),
    "posture": (None, "name of the posture"),
    "location": (None, "where the cell sits: tip (distal phalanx) or bone (metacarpal)"),
    "setting": ("1", "number of times that the posture was set anew"),
    "mounting": ("1", "number of times that the cell or the clamp was moved"),
    "direction": (None, "whether the weights were put on (loading) or taken off (unloading)"),
    "tension_factor": ("1", "friction correction: tension = factor x mass x gravity"),
    "steady": (None, "whether the loaded reading was steady; empty where that is open"),
    "z": ("1", "norm of the force residual in standard uncertainties"),
    "model": (None, "model that the predictions come from"),
    "name": (None, "name of the parameter"),
    "unit": (None, "unit of the numbers in this row"),
    "kind": (None, "anatomy, budget (an error of the rig) or effect"),
    "initial": ("as in unit", "value before the fit"),
    "value": ("as in unit", "fitted value"),
    "prior_sd": ("as in unit", "standard deviation of the prior; empty where it is flat"),
    "sd": ("as in unit", "standard uncertainty of the value"),
    "at_bound": (None, "whether the value stands at the end of its range"),
    "identified": (None, "whether the readings, not the prior alone, determine it"),
    "t_s": ("s", "time in the recording"),
    "status": ("1", "the cell's status flags, 0 where all is well"),
    "loaded_mid_s": ("s", "middle of the loaded window"),
    "unloaded_mid_s": ("s", "middle of the unloaded window before it"),
}


def write_columns(columns: Mapping[str, list[Any]], file: Path, file_format: str) -> None:
    """Write columns of one length as `csv` or `parquet`; the name appears when the file is complete.

    Raises:
        InputError: there is no row.
    """
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.parquet

    if not columns or not next(iter(columns.values())):
        raise InputError("nothing to export", "at least one row")
    if file_format == "csv":
        columns = {name: [defused(v) for v in values] for name, values in columns.items()}
    # A column without a single number is still one of numbers.
    table = pa.table(
        {
            name: pa.array(values, pa.float64()) if all(v is None for v in values) else pa.array(values)
            for name, values in columns.items()
        }
    )
    with replacing(file) as temporary:
        if file_format == "csv":
            pa.csv.write_csv(table, temporary, pa.csv.WriteOptions(quoting_header="none"))
        else:
            pa.parquet.write_table(table, temporary)


# What a spreadsheet takes for the beginning of a formula.
_FORMULA = ("=", "+", "-", "@", "\t", "\r")
DEFUSED = "a text that begins with = + - @ has an apostrophe before it, so that no spreadsheet takes it for a formula"


def defused(value: Any) -> Any:
    """Return a value as it may stand in a CSV: a text that would be a formula gets an apostrophe before it."""
    return f"'{value}" if isinstance(value, str) and value.startswith(_FORMULA) else value


def case_columns(measured: MeasuredSession) -> Mapping[str, list[Any]]:
    """Return the measured cases as columns, one row each; None is what was not read or states no uncertainty.

    Forces and torques are in mount axes, right-hand-equivalent; the standard uncertainties include the tares'.
    """
    session = measured.session
    angles: dict[str, dict[str, float]] = {}
    for name, posture in session.postures_deg.items():
        known = posture.model_dump()
        ordered = {j: known[j] for j in JOINT_ANGLES} | known
        angles[name] = {f"{joint}_deg": float(angle) for joint, angle in ordered.items()}
    rows = []
    for m, sd in zip(measured.cases, measured.standard_uncertainties(), strict=True):
        case = m.case
        row: dict[str, Any] = {
            "session": session.id,
            "id": case.id,
            "role": case.role,
            "posture": case.posture,
            "location": case.location,
            "setting": case.setting,
            "mounting": case.mounting,
            "direction": case.direction,
        }
        row |= angles[case.posture]
        row |= {f"{tendon}_g": float(case.masses_g.get(tendon, 0.0)) for tendon in TENDONS}
        row["tension_factor"] = measured.tension_factor
        for k, name in enumerate(AXES):
            quantity, unit = name.split("_")
            read = bool(np.isfinite(m.wrench[k]))
            row[name] = float(m.wrench[k]) if read else None
            row[f"{quantity}_sd_{unit}"] = float(sd[k]) if read and m.noise_stated and sd[k] > 0.0 else None
        row["loaded_mid_s"] = m.loaded_mid_s
        row["unloaded_mid_s"] = m.unloaded_mid_s
        row["steady"] = m.steady
        rows.append(row)
    names = list(dict.fromkeys(name for row in rows for name in row))
    return {name: [row.get(name) for row in rows] for name in names}


def window_columns(measured: MeasuredSession) -> Mapping[str, list[Any]]:
    """Return the windows of the cases as columns [s]; None where a case has none."""
    columns: dict[str, list[Any]] = {}
    for window in ("unloaded", "loaded", "unloaded_after"):
        spans = [getattr(m.case, f"{window}_s") for m in measured.cases]
        for k, end in enumerate(("start", "end")):
            columns[f"{window}_{end}_s"] = [None if span is None else float(span[k]) for span in spans]
    return columns


def write_table(columns: Mapping[str, list[Any]], file: Path, about: Mapping[str, Any]) -> Path:
    """Write columns as CSV and beside it, as NAME.csv.json, what they are.

    Args:
        columns: of one length.
        file: of the table.
        about: what else the JSON file shall say, such as session, software and sources.

    Returns:
        the path of the JSON file. It holds the table's SHA-256, so that a table of another export is found out.
    """
    beside = file.parent / f"{file.name}.json"
    with replacing(beside) as temporary:
        write_columns(columns, file, "csv")
        body = {
            "format": TABLE_FORMAT,
            "table": file.name,
            "table_sha256": sha256_of(file),
            "rows": len(next(iter(columns.values()))),
            "texts": DEFUSED,
            **about,
            "columns": describe_columns(list(columns)),
        }
        temporary.write_text(json.dumps(body, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return beside


def describe_columns(names: Sequence[str], force_frame: str = MOUNT_FRAME) -> list[dict[str, str | None]]:
    """Return name, unit, frame and meaning of columns; the unit of a text is None, that of a pure number 1."""
    out = []
    for name in names:
        unit, meaning = _MEANINGS.get(name, (None, ""))
        frame = None
        if axis := re.fullmatch(r"(predicted_|residual_)?([FT])([xyz])(_sd)?_(N|Nmm)", name):
            unit = {"N": "N", "Nmm": "N mm"}[axis[5]]
            frame = force_frame
            what = {"F": "force on the cell", "T": "torque on the cell"}[axis[2]]
            kind = {"predicted_": "predicted ", "residual_": "measured less predicted "}.get(axis[1], "")
            meaning = f"{'standard uncertainty of the ' if axis[4] else ''}{kind}{what} along {axis[3]}"
            meaning = meaning.replace("along", "about") if axis[2] == "T" else meaning
        elif name.endswith("_deg"):
            unit, meaning = "deg", f"angle of {name.removesuffix('_deg')}, flexion positive"
        elif name.endswith("_g"):
            unit, meaning = "g", f"mass hung on {name.removesuffix('_g')}"
        elif window := re.fullmatch(r"(unloaded|loaded|unloaded_after)_(start|end)_s", name):
            unit, meaning = "s", f"{window[2]} of the window {window[1]}_s"
        out.append({"name": name, "unit": unit, "frame": frame, "meaning": meaning})
    return out


def software() -> str:
    """Return name and version of this software."""
    from importlib.metadata import version

    return f"fingertwin {version('fingertwin')}"


def sources_of(session: Session, file: Path | None = None) -> dict[str, str]:
    """Return the SHA-256 of the files that a session came from, by their names.

    Args:
        session: as read from its folder.
        file: its description, `session.yaml`.
    """
    files = [f for f in (file, session.readings_path) if f is not None]
    return {f.name: sha256_of(f) for f in files}


def sha256_of(file: Path) -> str:
    """Return the SHA-256 of a file's bytes."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
