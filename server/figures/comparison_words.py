"""A comparison in plain words and as tables."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fingermodel.comparison.comparison import CaseComparison, Comparison, ErrorSummary
from fingermodel.fingers import Plane
from fingermodel.model import Model
from server.figures.report import Table
from server.figures.style import PLANE_NAMES, fixed, in_order, load_text, number, other_plane

Floats = NDArray[np.float64]


def sentences(
    model: Model, comparison: Comparison, before: Comparison | None, before_name: str, model_name: str
) -> list[str]:
    """Say in plain words what was compared and how far the two are apart."""
    cases, plane = comparison.cases, model.finger.judged_in
    postures = len({c.posture for c in cases})
    where = "in the sagittal plane" if plane == "sagittal" else "in space"
    out = [
        f"Compared: {counted(len(cases), 'load case')} in {counted(postures, 'posture')}. "
        "Forces are those that the finger exerts on the load cell: at the tip in the axes of the distal "
        "phalanx, at the bone in those of the metacarpal (x proximal, y dorsal, z radial)."
    ]
    for role, location in dict.fromkeys((c.role, c.location) for c in cases):
        errors = comparison.select(role, location).errors(plane)
        said = f"In the {counted(errors.cases, f'{role} case')} at the {location}, {model_name} is off by an RMSE of "
        said += f"{number(errors.rmse_N)} N {where}, {number(errors.rmse_rel_pct, 1)} % of the mean measured force"
        if before is not None:
            was = before.select(role, location).errors(plane)
            said += f"; {before_name} was off by {number(was.rmse_N)} N ({number(was.rmse_rel_pct, 1)} %)"
        out.append(said + ".")
    if plane == "sagittal":
        out.append(
            "This finger is judged in the sagittal plane: the tip clamp carries more than the joint torques determine, "
            "so the force out of that plane is reported but not held against the model."
        )
    if comparison.noise_assumed:
        out.append("Some cases state no uncertainty of their own; the budget's stands in for it.")
    return out


def counted(count: int, noun: str) -> str:
    """Write `1 case` or `2 cases`."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def error_tables(comparison: Comparison, before: Comparison | None, plane: Plane) -> list[Table]:
    """Tabulate the errors in a plane by role and place, and by loaded tendon."""
    other = other_plane(plane)
    header = [
        "cases",
        "n",
        "RMSE [N]",
        "RMSE [%]",
        "magnitude [N]",
        "magnitude [%]",
        "direction [°]",
        f"RMSE {PLANE_NAMES[other]} [N]",
    ]
    tables = []
    roles = dict.fromkeys((c.role, c.location) for c in comparison.cases)
    tendons = in_order(c.muscles for c in comparison.select(location="tip").cases)
    for words, chosen in (
        ("role and place", [(f"{r}, {p}", {"role": r, "location": p}) for r, p in roles]),
        ("loaded tendon, tip", [(m, {"location": "tip", "muscles": m}) for m in tendons]),
    ):
        rows = [
            _error_row(label, comparison.select(**pick), before.select(**pick) if before else None, plane)
            for label, pick in chosen
        ]
        if rows:
            note = "; before → after" if before else ""
            caption = f"Errors by {words}, {PLANE_NAMES[plane]} unless said otherwise{note}."
            tables.append(Table(header, rows, caption))
    return tables


def _error_row(label: str, after: Comparison, before: Comparison | None, judged: Plane) -> list[str]:
    def both(read: Callable[[ErrorSummary], float | None], digits: int, plane: str = judged) -> str:
        now = number(read(after.errors(plane)), digits)
        return now if before is None else f"{number(read(before.errors(plane)), digits)} → {now}"

    return [
        label,
        str(len(after.cases)),
        both(lambda e: e.rmse_N, 3),
        both(lambda e: e.rmse_rel_pct, 1),
        both(lambda e: e.magnitude_error_N, 3),
        both(lambda e: e.magnitude_error_pct, 1),
        both(lambda e: e.direction_error_deg, 1),
        both(lambda e: e.rmse_N, 3, other_plane(judged)),
    ]


def case_table(comparison: Comparison, plane: Plane) -> Table:
    """Tabulate every case: load, forces, residual and z."""
    largest = max((float(np.abs(c.measured_N).max()) for c in comparison.cases), default=1.0)
    digits = 3 if largest >= 0.1 else 6
    header = ["case", "role", "at", "load", "measured [N]", "predicted [N]", "measured − predicted [N]", "z"]
    rows = [_case_row(c, digits, plane) for c in comparison.cases]
    caption = f"Forces as (Fx, Fy, Fz); z is the residual's norm {PLANE_NAMES[plane]} in standard uncertainties."
    return Table(header, rows, caption)


def _case_row(case: CaseComparison, digits: int, plane: Plane) -> list[str]:
    def force(v: Floats) -> str:
        return f"({', '.join(fixed(float(x), digits) for x in v)})"

    forces = (case.measured_N, case.predicted_N, case.measured_N - case.predicted_N)
    # Many ids begin with the posture already.
    name = case.id if case.posture in case.id else f"{case.id} {case.posture}"
    named = [name, case.role, case.location, load_text(case.masses_g)]
    return [*named, *(force(f) for f in forces), number(case.z_in(plane), 1)]
