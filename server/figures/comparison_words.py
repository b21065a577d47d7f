"""A comparison in plain words and as tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from daq.quoting import counted
from fingermodel.comparison.comparison import CaseComparison, Comparison, ErrorSummary
from fingermodel.fingers import Plane
from server.figures.compared import Compared
from server.figures.report import Table
from server.figures.style import PLANE_NAMES, fixed, in_order, load_text, number, other_plane

Floats = NDArray[np.float64]


def sentences(compared: Compared) -> list[str]:
    """Say in plain words what was compared and how far the two are apart."""
    comparison, plane = compared.comparison, compared.model.finger.judged_in
    cases = comparison.cases
    postures = len({c.posture for c in cases})
    where = "in the sagittal plane" if plane == "sagittal" else "in space"
    out = [
        f"Compared: {counted(len(cases), 'load case')} in {counted(postures, 'posture')}. "
        "Forces are those that the finger exerts on the load cell: at the tip in the axes of the distal "
        "phalanx, at the bone in those of the metacarpal (x proximal, y dorsal, z radial)."
    ]
    for role, location in dict.fromkeys((c.role, c.location) for c in cases):
        errors = comparison.select(role, location).errors(plane)
        said = (
            f"In the {counted(errors.cases, f'{role} case')} at the {location}, {compared.name} is off by an RMSE of "
        )
        said += f"{number(errors.rmse_N)} N {where}, {number(errors.rmse_rel_pct, 1)} % of the mean measured force"
        if compared.before is not None:
            name, before = compared.before
            was = before.select(role, location).errors(plane)
            said += f"; {name} was off by {number(was.rmse_N)} N ({number(was.rmse_rel_pct, 1)} %)"
        out.append(said + ".")
    if plane == "sagittal":
        out.append(
            "This finger is judged in the sagittal plane: the tip clamp carries more than the joint torques determine, "
            "so the force out of that plane is reported but not held against the model."
        )
    if comparison.noise_assumed:
        out.append("Some cases state no uncertainty of their own; the budget's stands in for it.")
    return out


def error_tables(compared: Compared) -> list[Table]:
    """Tabulate the errors by role and place, and by loaded tendon, in the plane in which the finger is judged."""
    comparison, plane = compared.comparison, compared.model.finger.judged_in
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
        rows = [_error_row(label, [one.select(**pick) for _, one in compared.models], plane) for label, pick in chosen]
        if rows:
            note = "; before → after" if compared.before else ""
            caption = f"Errors by {words}, {PLANE_NAMES[plane]} unless said otherwise{note}."
            tables.append(Table(header, rows, caption))
    return tables


def _error_row(label: str, models: Sequence[Comparison], judged: Plane) -> list[str]:
    """Return the errors of some cases under each model."""
    own, other = ([one.errors(plane) for one in models] for plane in (judged, other_plane(judged)))

    def each(errors: Sequence[ErrorSummary], key: str, digits: int) -> str:
        return " → ".join(number(getattr(e, key), digits) for e in errors)

    digits = {
        "rmse_N": 3,
        "rmse_rel_pct": 1,
        "magnitude_error_N": 3,
        "magnitude_error_pct": 1,
        "direction_error_deg": 1,
    }
    count = str(len(models[-1].cases))
    return [label, count, *(each(own, key, n) for key, n in digits.items()), each(other, "rmse_N", 3)]


def case_table(compared: Compared) -> Table:
    """Tabulate every case: load, forces, residual and z."""
    comparison, plane = compared.comparison, compared.model.finger.judged_in
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
