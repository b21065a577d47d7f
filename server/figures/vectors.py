"""Tip forces as vectors at the finger, posture by posture (after Synek et al. 2019, Figure 7)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from fingermodel.comparison.comparison import CaseComparison, Comparison
from server.figures import graph_objects as go
from server.figures.arrows import Spread, area_of, arrow_traces, sector_trace
from server.figures.compared import Compared
from server.figures.panels import (
    Panel,
    force_scale,
    head_mm,
    heading,
    key,
    load_colors,
    panels_figure,
    panels_of,
    thinned,
)
from server.figures.poses import reach_mm
from server.figures.sheet import panel_axes
from server.figures.style import INK, NothingToDrawError, load_text, mix, plain, rgba

Floats = NDArray[np.float64]
MEASURED_PX, PREDICTED_PX = 3.2, 1.6


def chosen_cases(comparison: Comparison, location: str, ids: Iterable[str] | None = None) -> list[CaseComparison]:
    """Return the cases of a location that are asked for; by default those of validation, else of identification.

    Raises:
        NothingToDrawError: there is none.
    """
    here = comparison.select(location=location)
    if ids is not None:
        wanted = set(ids)
        cases = [c for c in here.cases if c.id in wanted]
    else:
        cases = list(here.select("validation").cases) or list(here.select("identification").cases)
    if not cases:
        raise NothingToDrawError(f"No force was measured at the {location}.")
    return cases


def measured_and_predicted(
    panel: Panel,
    axes: Mapping[str, str],
    origin: Floats,
    rotation: Floats,
    mm_per_N: float,
    colors: Mapping[str, str],
    head: float,
    comparison: Comparison,
    spread: Mapping[str, Spread] | None,
) -> set[str]:
    """Add areas, measured and predicted vectors of a panel's cases; return what the areas stand for."""
    meanings = set()
    # The longest first, so that shorter ones along the same line show upon it.
    ordered = sorted(panel.cases, key=lambda c: -float(np.linalg.norm(c.measured_N)))
    rotated = [((rotation @ c.measured_N)[:2], (rotation @ c.predicted_N)[:2], c) for c in ordered]
    for measured, _, case in rotated:
        area = area_of(case, comparison.noise_assumed, spread)
        meanings.add(area.meaning)
        color = colors[load_text(case.masses_g)]
        panel.traces.append(sector_trace(case, measured, area, origin, mm_per_N, color, axes))
    for measured, _, case in rotated:
        line = {"color": colors[load_text(case.masses_g)], "width": MEASURED_PX}
        panel.traces += arrow_traces(
            measured, origin, mm_per_N, axes, kind="measured", case=case, line=line, head_mm=head
        )
    for _, predicted, case in rotated:
        line = predicted_line(colors[load_text(case.masses_g)])
        panel.traces += arrow_traces(
            predicted, origin, mm_per_N, axes, kind="predicted", case=case, line=line, head_mm=head, hollow=True
        )
    return meanings


def predicted_line(color: str) -> dict[str, object]:
    """Line of a predicted vector: thin, dashed and darker than the measured one, so that it shows upon it."""
    return {"color": mix(color, "#000000", 0.45), "width": PREDICTED_PX, "dash": "6px,3px"}


def load_keys(colors: Mapping[str, str], meanings: Iterable[str]) -> list[go.Scatter]:
    """Entries of the legend: the two kinds of vector, the areas, and the colour of each load."""
    grey = "#8a8a8a"
    out = [
        key("measured", line={"color": grey, "width": MEASURED_PX}),
        key("predicted", line=predicted_line(grey) | {"color": INK}),
    ]
    fill = {"fill": "toself", "fillcolor": rgba(grey, 0.22), "line": {"color": rgba(grey, 0.35), "width": 0.8}}
    out += [key(meaning, **fill) for meaning in sorted(meanings)]
    return out + [key(plain(text), line={"color": color, "width": 6}) for text, color in colors.items()]


def vector_figure(compared: Compared, cases: Iterable[str] | None = None) -> go.Figure:
    """Draw the finger of each posture with measured and predicted tip forces at the load point.

    Forces are turned from the distal phalanx to the metacarpal by the posture that was set.

    Args:
        compared: model, session and comparison.
        cases: ids of the cases to draw.

    Raises:
        NothingToDrawError: no tip force.
    """
    finger, comparison, values = compared.model.finger, compared.comparison, compared.values
    drawn, note = thinned(chosen_cases(comparison, "tip", cases))
    panels = panels_of(finger, values, compared.observations, drawn)
    colors = load_colors(drawn)
    reach = reach_mm(values)
    scale = force_scale([f for c in drawn for f in (c.measured_N, c.predicted_N)], 0.6 * reach)
    meanings: set[str] = set()
    for index, panel in enumerate(panels):
        panel.heading = heading(panel, finger, comparison)
        meanings |= measured_and_predicted(
            panel,
            panel_axes(index),
            panel.pose.load_point,
            panel.pose.tip_rotation,
            scale,
            colors,
            head_mm(len(panels), reach),
            comparison,
            compared.spread,
        )
    roles = sorted({c.role for c in drawn})
    subtitle = f"Forces on the load cell, sagittal plane, seen from the radial side; {' and '.join(roles)} cases."
    return panels_figure(
        panels,
        finger,
        values,
        scale,
        load_keys(colors, meanings),
        title=f"Tip forces: {plain(compared.name)}",
        subtitle=f"{subtitle}<br>{note}" if note else subtitle,
    )
