"""All figures of a comparison, and its report: `compare.html` with PNG and SVG beside it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from fingermodel.fingers.finger import Plane
from server.figures.compared import Compared
from server.figures.comparison_words import case_table, error_tables, sentences
from server.figures.plot import Plan
from server.figures.report import Part, Section, by_heading, plot_or_reason, write_report
from server.figures.report_front import closing_sections, folded, read_first
from server.figures.scatter import scatter_figure
from server.figures.summary import errors_figure
from server.figures.vectors import Beside, bone_figure, vector_figure
from server.figures.zscores import z_figure


def comparison_report(
    folder: Path,
    compared: Compared,
    *,
    session: str,
    notes: Sequence[str] = (),
    first: Sequence[str] = (),
    origin: Mapping[str, object] | None = None,
    static: bool = True,
) -> Path:
    """Write `compare.html`, and every figure as PNG and SVG.

    Args:
        folder: made where it is absent.
        compared: what is drawn.
        session: its id.
        notes: further sentences for the summary.
        first: what has to be known before it.
        origin: what the report rests on (see `origin_of`).
        static: whether to write PNG and SVG.

    Returns:
        The page.
    """
    sections = [*read_first(first), *comparison_sections(compared, notes), *closing_sections(origin or {})]
    return write_report(
        folder / "compare.html", sections, report_title(session), f"Model: {compared.name}", static=static
    )


def report_title(session: str) -> str:
    """Return the title of a comparison's page."""
    return f"Predicted and measured forces: {session}"


def comparison_sections(compared: Compared, notes: Sequence[str] = ()) -> list[Section]:
    """Return the parts of the page of `comparison_report`, whose arguments these are."""
    summary: list[Part] = [*sentences(compared), *notes, *error_tables(compared)]
    plots = by_heading((p.heading, plot_or_reason(p.name, p.draw, p.caption)) for p in comparison_plans(compared))
    return [
        Section("Summary", summary),
        *folded([*plots, Section("Load cases", [case_table(compared)])]),
    ]


def comparison_plans(
    compared: Compared,
    cases: Collection[str] | None = None,
    *,
    plane: Plane | None = None,
    role: str = "identification",
    location: str = "tip",
    beside: Beside | None = None,
) -> list[Plan]:
    """Return every figure of a comparison to come.

    Args:
        compared: what is drawn.
        cases: that are drawn on the finger, by default those of validation.
        plane: of the force components; by default that in which the finger is judged.
        role: of the cases whose force components are drawn against each other: identification or validation.
        location: of these: tip or bone.
        beside: forces of another model, drawn on the finger.
    """
    model = compared.model
    drawn_in = plane or model.finger.judged_in
    both = compared.models
    held = "The same cases under both models. " if len(both) > 1 else ""
    unpredicted = drawn_in == model.finger.judged_in == "sagittal"
    no_Fz = " Fz is left out, which this finger does not predict." if unpredicted else ""
    hinge = model.finger.topology.joints[0].name
    arrows = (
        "Solid arrows are measured, dashed ones predicted; the coloured areas are the measurement with its spread. "
        "The finger is drawn from the model's joint centres and tendon points; the bones' outlines are schematic."
    )
    return [
        Plan(
            "scatter",
            "Force components",
            f"{held}On the grey line prediction and measurement agree. Each symbol is one load case.",
            lambda: scatter_figure(both, plane=drawn_in, role=role, location=location),
        ),
        Plan(
            "scatter_validation",
            "Force components",
            f"{held}Validation cases never enter a fit.",
            lambda: scatter_figure(both, plane=drawn_in, role="validation", location=location),
        ),
        Plan("vectors", "Tip forces in each posture", arrows, lambda: vector_figure(compared, cases, beside)),
        Plan(
            "bone",
            "Net forces on the metacarpal",
            f"{arrows} Dotted: the load of the {hinge} joint alone, without what tendons and pulleys pass to the bone.",
            lambda: bone_figure(compared, cases, beside),
        ),
        Plan(
            "errors",
            "Where the errors are",
            "RMSE over the force components of the cases named on the left (Synek et al. 2019, Eqs 6 and 7).",
            lambda: errors_figure(both, plane=drawn_in),
        ),
        Plan(
            "z",
            "Where the errors are",
            "A case to the right of the dashed line misses by more than its measurement's noise alone would explain."
            + no_Fz,
            lambda: z_figure(both, plane=drawn_in),
        ),
    ]
