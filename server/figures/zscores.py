"""Each case's residual against its own measurement uncertainty, as a strip for every tendon and place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fingermodel.comparison.comparison import CaseComparison, Comparison
from fingermodel.fingers import Plane
from server.figures import graph_objects as go
from server.figures import marks
from server.figures.sheet import Sheet, key
from server.figures.style import (
    INK,
    NothingToDrawError,
    axis,
    case_text,
    in_order,
    load_styles,
    named_axis,
    number,
    plain,
)

# 95 % of chi with as many degrees of freedom as there are components.
CHI_95: dict[Plane, float] = {"sagittal": 2.4477, "space": 2.7955}
COMPONENTS: dict[Plane, str] = {"sagittal": "Fx and Fy", "space": "Fx, Fy and Fz"}
_ROW, _MARGINS = 26, (110, 30, 84, 96)  # [px]
_TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)


def z_figure(models: Sequence[tuple[str, Comparison]], *, plane: Plane = "space") -> go.Figure:
    """Draw the Mahalanobis norm of every case's force residual, a row for every place and loaded tendon.

    Args:
        models: one comparison, or the one before, drawn pale, and the one after, each with its model's name.
        plane: whose force components count; a finger that cannot predict Fz is judged without it.

    Raises:
        NothingToDrawError: no case states an uncertainty.
    """
    comparisons = [_sagittal(c) if plane == "sagittal" else c for _, c in models]
    comparison, limit = comparisons[-1], CHI_95[plane]
    *earlier, cases = ([c for c in one.cases if c.z is not None and np.isfinite(c.z)] for one in comparisons)
    if not cases:
        raise NothingToDrawError("No case has an uncertainty against which its residual could be judged.")
    places = [p for p in ("tip", "bone") if any(c.location == p for c in cases)]
    rows = [(p, m) for p in places for m in in_order(c.muscles for c in cases if c.location == p)]
    labels = [f"{p}  {plain(m)}" for p, m in rows]
    largest = max(float(c.z or 0.0) for some in (cases, *earlier) for c in some)
    bent = largest > 15.0  # a logarithmic axis only where the strip would otherwise be all on the left
    low, high = (0.1, 1.25 * max(largest, 3.0)) if bent else (0.0, 1.08 * max(largest, 3.0))
    styles = load_styles(in_order(c.muscles for c in cases))
    data: list[go.Scatter] = []
    if earlier and earlier[0]:
        marker: dict[str, Any] = {"color": "#bdbdbd", "symbol": "circle-open", "size": 7}
        data.append(_points(earlier[0], rows, labels, marker, low, name=plain(models[0][0]), shift="before"))
    for role, hollow in (("identification", ""), ("validation", "-open")):
        for muscle, style in styles.items():
            own = [c for c in cases if c.muscles == muscle and c.role == role]
            if own:
                marker = {"color": style.color, "symbol": style.symbol + hollow, "size": 9}
                data.append(_points(own, rows, labels, marker, low, name="", shift="after"))
    for symbol, name in (("circle", "identification"), ("circle-open", "validation")):
        if any(c.role == name for c in cases):
            marker = {"color": INK, "symbol": symbol, "size": 8}
            data.append(key(name, "markers", marker=marker))
    end = len(rows) - 0.5
    scale: dict[str, Any] = {"range": [low, high], "nticks": 8}
    if bent:
        shown = [t for t in _TICKS if low <= t <= high]
        scale = {
            "type": "log",
            "range": [float(np.log10(low)), float(np.log10(high))],
            "tickvals": shown,
            "ticktext": [f"{t:g}" for t in shown],
        }
    sheet = Sheet(len(rows) * _ROW, _MARGINS)
    sheet.panel(
        axis("z: norm of the force residual in standard uncertainties [1]", **scale),
        named_axis(range(len(labels)), labels, (end, -0.5), showline=False),
    )
    dashed = {"color": INK, "width": 1, "dash": "dash"}
    name = f"95 % limit of noise alone, {number(limit, 1)}"
    sheet.data += [marks.line([limit, limit], [-0.5, end], dashed, name=name), *data]
    return sheet.drawn(
        "Residual of every case against its measurement uncertainty",
        _subtitle(comparison, cases, plane, bent=bent),
        legend_px=-50,
    )


def _sagittal(comparison: Comparison) -> Comparison:
    return Comparison(tuple(replace(c, z=c.z_sagittal) for c in comparison.cases), comparison.noise_assumed)


def _subtitle(comparison: Comparison, cases: list[CaseComparison], plane: Plane, *, bent: bool) -> str:
    beyond = sum(float(c.z or 0.0) > CHI_95[plane] for c in cases)
    said = " (assumed)" if comparison.noise_assumed else ""
    parts = [
        f"{beyond} of {len(cases)} cases beyond the 95 % limit of measurement noise{said}; {COMPONENTS[plane]} together"
    ]
    if missing := len(comparison.cases) - len(cases):
        parts.append(f"{missing} without any uncertainty are left out")
    if bent and any(float(c.z or 0.0) < 0.1 for c in cases):
        parts.append("below 0.1 drawn at 0.1")
    return "; ".join(parts) + "."


def _points(
    cases: list[CaseComparison],
    rows: list[tuple[str, str]],
    labels: list[str],
    marker: dict[str, Any],
    low: float,
    *,
    name: str,
    shift: str,
) -> go.Scatter:
    """Return points of some cases; those before lie a little lower than those after."""
    placed = [c for c in cases if (c.location, c.muscles) in rows]
    where = [rows.index((c.location, c.muscles)) for c in placed]
    offset = 0.22 if shift == "before" else 0.0
    values = [float(c.z or 0.0) for c in placed]
    return marks.points(
        [max(v, low) for v in values],
        [w + offset for w in where],
        marker,
        text=[f"{case_text(c)}<br>z = {number(v, 1)}" for c, v in zip(placed, values, strict=True)],
        hoverinfo="text",
        name=name,
        showlegend=bool(name),
        meta={"kind": shift, "cases": [c.id for c in placed], "rows": [labels[w] for w in where]},
    )
