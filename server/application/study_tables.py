"""Tables of studies as CSV, units in the columns' names."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.export.tables import defused
from daq.files import replacing
from fingermodel.studies.activation_result import ActivationResult
from fingermodel.studies.movement import MovementResult

Floats = NDArray[np.float64]


def write_deficits(result: ActivationResult, path: Path) -> int:
    """Write a row a muscle and level as CSV, units in the columns' names; return the number of rows."""
    columns = [
        "muscle", "level_pct", "Fx_proximal_N", "Fy_dorsal_N", "Fz_radial_N", "magnitude_N", "magnitude_change_pct",
        "direction_change_deg", "sagittal_change_deg", "coronal_change_deg",
    ]  # fmt: skip
    rows = []
    for d in result.deficits:
        cells = zip(
            d.levels_pct, d.force_N, d.magnitudes, d.change_pct,
            d.change_deg(), d.change_deg("sagittal"), d.change_deg("coronal"), strict=True,
        )  # fmt: skip
        rows += [[defused(d.muscle), *(_cell(x) for x in (level, *force, *rest))] for level, force, *rest in cells]
    return _write(path, columns, rows)


def write_time_courses(result: MovementResult, path: Path) -> int:
    """Write a row an instant as CSV, units in the columns' names; return the number of rows."""
    columns: dict[str, Floats] = {"time_s": result.times_s}
    for axis, column in zip(("Fx", "Fy", "Fz"), result.tip_force_N.T, strict=True):
        columns[f"tip_{axis}_N"] = column
    for key, values in (("deg", np.rad2deg(result.posture_rad)), ("torque_Nmm", result.torque_Nmm)):
        columns |= {f"{name}_{key}": v for name, v in zip(result.rotations, values.T, strict=True)}
    for key, values in (
        ("force_N", result.force),
        ("passive_N", result.passive_N),
        ("activation", result.activation),
        ("length_mm", result.length_mm),
    ):
        columns |= {f"{name}_{key}": v for name, v in zip(result.muscles, values.T, strict=True)}
    rows = [[f"{x:.9g}" for x in row] for row in zip(*columns.values(), strict=True)]
    return _write(path, map(defused, columns), rows)


def _write(path: Path, columns: Iterable[str], rows: Sequence[Sequence[str]]) -> int:
    """Write rows below their columns; return how many there are."""
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([[*columns], *rows])
    return len(rows)


def _cell(value: float | None) -> str:
    return "" if value is None else f"{value:.9g}"
