"""Measured against predicted components of the tip force, tendon by tendon (after Synek et al. 2019, Figure 6)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fingermodel.comparison.comparison import CaseComparison, Comparison
from fingermodel.fingers import PLANES, Plane
from server.figures import graph_objects as go
from server.figures import marks
from server.figures.sheet import Sheet, key, note
from server.figures.style import (
    BAND,
    COMPONENT_AXES,
    COMPONENT_SENSES,
    MUTED,
    PLANE_NAMES,
    SMALL_PX,
    WIDTH,
    LoadStyle,
    NothingToDrawError,
    axis,
    case_text,
    in_order,
    load_styles,
    number,
    plain,
    rmse_text,
)

_LEFT, _GAP, _HEADING, _UNDER, _TOP = 66, 66, 34, 52, 84  # [px]


def scatter_figure(
    models: Sequence[tuple[str, Comparison]],
    *,
    plane: Plane = "sagittal",
    role: str | None = "identification",
    location: str = "tip",
) -> go.Figure:
    """Draw predicted over measured force components, one row a model and one column a component.

    Args:
        models: one comparison, or the one before and the one after, each with its model's name.
        plane: which components: x and y, or z too.
        role: which cases; None takes all.
        location: tip or bone.

    Raises:
        NothingToDrawError: no such case.
    """
    chosen = [(name, comparison.select(role, location)) for name, comparison in models]
    if not chosen or not chosen[-1][1].cases:
        a_case = {"identification": "an identification case", "validation": "a validation case"}.get(role or "", "one")
        raise NothingToDrawError(f"None of these load cases is {a_case} at the {location}.")
    components = range(PLANES[plane])
    columns, rows = len(components), len(chosen)
    beside = columns < 3  # where the legend is: beside two panels, below three
    right = 300 if beside else 20
    side = (WIDTH - _LEFT - right - (columns - 1) * _GAP) / columns
    muscles = in_order(c.muscles for c in chosen[-1][1].cases)
    bottom = _UNDER + (0 if beside else 44 + 20 * -(-(len(muscles) + 2) // 3))
    sheet = Sheet(rows * (side + _HEADING) + (rows - 1) * _UNDER, (_LEFT, right, _TOP, bottom))
    limits = [_limits([c for _, part in chosen for c in part.cases], k) for k in components]
    for row, (name, comparison) in enumerate(chosen):
        top = row * (side + _HEADING + _UNDER) + _HEADING
        named = f"<b>{plain(name)}: RMSE {rmse_text(comparison.errors(plane))} {PLANE_NAMES[plane]}</b>"
        sheet.notes.append(note(named, 0.0, 1.0 - (top - _HEADING) / sheet.high, at=("left", "top")))
        for column in components:
            words = f"{COMPONENT_AXES[column]} [N]"
            shared = {"range": list(limits[column]), "nticks": 7 if beside else 6}
            names = sheet.panel(
                axis(f"measured {words}, {COMPONENT_SENSES[column]} +", **shared),
                axis(f"predicted {words}", constrain="domain", **shared),
                left=column * (side + _GAP),
                top=top,
                wide=side,
                high=side,
                equal=True,
            )
            sheet.data += _identity(comparison, column, limits[column], names, first=row + column == 0)
            sheet.data += _points(comparison, column, muscles, names)
    sheet.data += _keys(chosen, muscles, plane)
    explained = "RMSE by tendon (of its mean force)"
    explained += f"{'<br>' if beside else ' '}before → after" if len(chosen) > 1 else ""
    look: dict[str, Any] = {"size": SMALL_PX + 1, "color": MUTED}
    if not beside:  # beside its entries, a title would push them out of the figure
        sheet.notes.append(note(explained, 0.0, -_UNDER / sheet.high, at=("left", "top"), **look))
    cases = f"{len(chosen[-1][1].cases)} {role + ' ' if role else ''}cases"
    frame = "distal phalanx" if location == "tip" else "metacarpal"
    return sheet.drawn(
        f"Measured and predicted {location} force components",
        f"{cases}; axes of the {frame}; grey: identity ± 2 SD of the measurement",
        legend={
            "x": 1.0 + 20 / sheet.wide if beside else 0.0,
            "y": 1.0 if beside else -(_UNDER + 20) / sheet.high,
            "xanchor": "left",
            "yanchor": "top",
            "orientation": "v" if beside else "h",
            "font": {"size": SMALL_PX + 1},
        }
        | ({"title": {"text": explained, "font": look}} if beside else {}),
    )


def _limits(cases: Sequence[CaseComparison], component: int) -> tuple[float, float]:
    """Return common limits of both axes with some room, never of no width."""
    values = np.array([v[component] for c in cases for v in (c.measured_N, c.predicted_N)] + [0.0])
    values = values[np.isfinite(values)]
    low, high = float(values.min()), float(values.max())
    room = 0.08 * (high - low) or 1e-3
    return low - room, high + room


def _identity(
    comparison: Comparison, component: int, limits: tuple[float, float], axes: dict[str, str], *, first: bool
) -> list[go.Scatter]:
    """Return the line of identity, and about it twice the median standard uncertainty of the measurement."""
    low, high = limits
    sd = np.array([c.measured_sd_N[component] for c in comparison.cases], dtype=float)
    sd = sd[np.isfinite(sd)]
    half = 2.0 * float(np.median(sd)) if len(sd) else 0.0
    said = "assumed" if comparison.noise_assumed else "measured"
    shared: dict[str, Any] = {"showlegend": first, **axes}
    grey = {"color": "#8a8a8a", "width": 1}
    identity = marks.line([low, high], [low, high], grey, name="identity", legendrank=2000, **shared)
    if half <= 0:
        return [identity]
    # Drawn beyond the axes, so that the corners are filled; the axes cut it.
    a, b = low - half, high + half
    band = marks.area(
        [a, b, b, a, a],
        [a - half, b - half, b + half, a + half, a - half],
        BAND,
        {"color": BAND, "width": 0},
        name=f"± 2 SD, {said} (Fx ± {number(half)} N)" if first else "",
        legendrank=2001,
        meta={"kind": "band", "half_N": half},
        **shared,
    )
    return [band, identity]


def _points(comparison: Comparison, component: int, muscles: Sequence[str], axes: dict[str, str]) -> list[go.Scatter]:
    styles = load_styles(muscles)
    out = []
    for muscle in muscles:
        cases = comparison.select(muscles=muscle).cases
        if not cases:
            continue
        style = styles[muscle]
        measured = [float(c.measured_N[component]) for c in cases]
        predicted = [float(c.predicted_N[component]) for c in cases]
        words = [
            f"{case_text(c)}<br>{COMPONENT_AXES[component]} measured {number(m)}"
            f" ± {number(float(c.measured_sd_N[component]))} N, predicted {number(p)} N"
            for c, m, p in zip(cases, measured, predicted, strict=True)
        ]
        out.append(
            marks.points(
                measured,
                predicted,
                _marker(style, 9 if style.symbol != "cross" else 10),
                text=words,
                hoverinfo="text",
                meta={"cases": [c.id for c in cases]},
                name=muscle,
                legendgroup=muscle,
                showlegend=False,
                **axes,
            )
        )
    return out


def _marker(style: LoadStyle, size: int) -> dict[str, Any]:
    """Return a tendon's symbol with a white rim."""
    return {"color": style.color, "symbol": style.symbol, "size": size, "line": {"color": "#ffffff", "width": 0.8}}


def _keys(chosen: Sequence[tuple[str, Comparison]], muscles: Sequence[str], plane: Plane) -> list[go.Scatter]:
    """Return entries of the legend: every tendon with its RMSE under each model."""
    styles = load_styles(muscles)
    out = []
    for muscle in muscles:
        parts = [comparison.select(muscles=muscle).errors(plane) for _, comparison in chosen]
        absolute = " → ".join(number(e.rmse_N) for e in parts)
        relative = " → ".join(number(e.rmse_rel_pct, 0) for e in parts)
        name = f"{plain(muscle)}  {absolute} N ({relative} %)"
        out.append(key(name, "markers", marker=_marker(styles[muscle], 9), legendgroup=muscle))
    return out
