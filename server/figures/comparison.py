"""All figures of a comparison, and its report: `compare.html` with PNG and SVG beside it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from server.figures import graph_objects as go
from server.figures.bone import bone_figure
from server.figures.compared import Compared
from server.figures.comparison_words import case_table, error_tables, sentences
from server.figures.report import Picture, Section, write_report
from server.figures.report_front import closing_sections, folded
from server.figures.scatter import scatter_figure
from server.figures.static import write_static
from server.figures.style import NothingToDrawError
from server.figures.summary import errors_figure
from server.figures.vectors import vector_figure
from server.figures.zscores import z_figure

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Plan:
    """Figure still to be drawn: its name, place in the report and caption."""

    name: str
    heading: str
    caption: str
    draw: Callable[[], go.Figure]


def comparison_report(
    folder: Path,
    compared: Compared,
    *,
    session: str,
    notes: Sequence[str] = (),
    origin: Mapping[str, object] | None = None,
    static: bool = True,
) -> list[Path]:
    """Write `compare.html`, and every figure as PNG and SVG.

    Args:
        folder: made where it is absent.
        compared: what is drawn.
        session: its id.
        notes: further sentences for the beginning.
        origin: what the report rests on (see `origin_of`).
        static: whether to write PNG and SVG.

    Returns:
        The files written, the report first.
    """
    sections, figures = comparison_sections(compared, notes)
    closing = closing_sections(origin or {})
    report = write_report(
        folder / "compare.html", [*sections, *closing], report_title(session), f"Model: {compared.name}"
    )
    return [report, *(write_static(folder, figures) if static else [])]


def report_title(session: str) -> str:
    """Return the title of a comparison's page."""
    return f"Predicted and measured forces: {session}"


def comparison_sections(compared: Compared, notes: Sequence[str] = ()) -> tuple[list[Section], dict[str, go.Figure]]:
    """Return the parts of the page of `comparison_report`, whose arguments these are, and its figures by name."""
    model, comparison, before = compared.model, compared.comparison, compared.before
    plans = comparison_plans(compared)
    figures, missing = drawn(plans)
    sections = [
        Section(
            "Summary",
            [
                *sentences(model, comparison, before, compared.before_name, compared.name),
                *notes,
                *error_tables(comparison, before, model.finger.judged_in),
            ],
        )
    ]
    for plan in plans:
        part = Picture(figures[plan.name], plan.caption) if plan.name in figures else missing[plan.name]
        if sections[-1].heading == plan.heading:
            sections[-1] = Section(plan.heading, [*sections[-1].parts, part])
        else:
            sections.append(Section(plan.heading, [part]))
    sections = [
        sections[0],
        *folded([*sections[1:], Section("Load cases", [case_table(comparison, model.finger.judged_in)])]),
    ]
    return sections, figures


def drawn(plans: Sequence[Plan]) -> tuple[dict[str, go.Figure], dict[str, str]]:
    """Draw what has cases to show, by name, and say of the rest why there is nothing to draw."""
    figures, missing = {}, {}
    for plan in plans:
        try:
            figures[plan.name] = plan.draw()
        except NothingToDrawError as nothing:
            missing[plan.name] = nothing.sentence
    return figures, missing


def comparison_plans(compared: Compared, cases: Collection[str] | None = None) -> list[Plan]:
    """Return every figure of a comparison to come.

    Args:
        compared: what is drawn.
        cases: that are drawn on the finger, by default those of validation.
    """
    model, comparison = compared.model, compared.comparison
    before, before_name = compared.before, compared.before_name
    plane = model.finger.judged_in
    both = [(before_name, before)] if before is not None else []
    both = [*both, (compared.name, comparison)]
    held = "The same cases under both models. " if before is not None else ""
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
            lambda: scatter_figure(both, plane=plane),
        ),
        Plan(
            "scatter_validation",
            "Force components",
            f"{held}Validation cases never enter a fit.",
            lambda: scatter_figure(both, plane=plane, role="validation"),
        ),
        Plan("vectors", "Tip forces in each posture", arrows, lambda: vector_figure(compared, cases)),
        Plan(
            "bone",
            "Net forces on the metacarpal",
            f"{arrows} Dotted: the load of the {hinge} joint alone, without what tendons and pulleys pass to the bone.",
            lambda: bone_figure(compared, cases),
        ),
        Plan(
            "errors",
            "Where the errors are",
            "RMSE over the force components of the cases named on the left (Synek et al. 2019, Eqs 6 and 7).",
            lambda: errors_figure(
                comparison, before=before, before_name=before_name, model_name=compared.name, plane=plane
            ),
        ),
        Plan(
            "z",
            "Where the errors are",
            "A case to the right of the dashed line misses by more than its measurement's noise alone would explain."
            + (" Fz is left out, which this finger does not predict." if plane == "sagittal" else ""),
            lambda: z_figure(comparison, before=before, before_name=before_name, plane=plane),
        ),
    ]
