"""Write a session's measured cases as a table, one row a load case, with units in the column names."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from daq.errors import InputError
from daq.files import replacing
from daq.measured import MeasuredSession
from daq.readings import HEADERS
from daq.vocabulary import JOINT_ANGLES, TENDONS

AXES = HEADERS[1:]


def export_cases(measured: MeasuredSession, path: str | Path) -> Path:
    """Write the measured cases to CSV or Parquet, by the file's ending; the name appears when it is complete.

    Forces and torques are in mount axes, right-hand-equivalent; the standard uncertainties include the tares'. What was
    not read or states no uncertainty is empty.

    Raises:
        InputError: the ending is neither `.csv` nor `.parquet`.
    """
    file = Path(path)
    ending = file.suffix.lower()
    if ending not in (".csv", ".parquet"):
        raise InputError(f"{file.name} ends in {ending!r}", "a name ending in .csv or .parquet")
    write_columns(case_columns(measured), file, "csv" if ending == ".csv" else "parquet")
    return file


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


def case_columns(measured: MeasuredSession) -> Mapping[str, list[Any]]:
    """Return the table as columns; None is what is unknown."""
    session = measured.session
    rows = []
    for i, m in enumerate(measured.cases):
        case = m.case
        sd = np.sqrt(np.diag(measured.case_covariance(i)))
        posture = session.postures_deg[case.posture].model_dump()
        known = {j: posture[j] for j in JOINT_ANGLES} | {j: a for j, a in posture.items() if j not in JOINT_ANGLES}
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
        row |= {f"{joint}_deg": float(angle) for joint, angle in known.items()}
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
