"""Forces in a pressing finger without and with its hood: bars beside the published means and their spread."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from server.figures import graph_objects as go
from server.figures import marks
from server.figures.sheet import Sheet
from server.figures.style import INK, ZERO_LINE, axis, mix, named_axis, number, plain, whiskers

COLORS = {"minimal": "#0072B2", "chao": "#D55E00"}
_PANEL, _GAP, _MARGINS = 190, 52, (72, 24, 96, 84)  # [px]
_WIDE, _NARROW = 0.36, 0.18


@dataclass(frozen=True)
class Panel:
    """One posture."""

    title: str  # of the panel
    columns: Sequence[str]  # names of the forces
    published: Mapping[str, Sequence[tuple[float, float]]]  # model → (mean, spread) of each column
    ours: Mapping[str, Sequence[float]]  # model → each column


def pressing_figure(panels: Sequence[Panel], models: Mapping[str, str]) -> go.Figure:
    """Draw the panels one below the other: published means wide and pale with their spread, ours narrow before them.

    Args:
        panels: from the top.
        models: model → its name for the reader, two of them.
    """
    sheet = Sheet(len(panels) * _PANEL + (len(panels) - 1) * _GAP, _MARGINS, barmode="overlay")
    for k, panel in enumerate(panels):
        at = np.arange(len(panel.columns), dtype=float)
        axes = sheet.panel(
            named_axis(at, panel.columns, (-0.6, len(at) - 0.4), showgrid=False),
            axis("force / load [1]", nticks=6, **ZERO_LINE),
            top=k * (_PANEL + _GAP),
            high=_PANEL,
            heading=plain(panel.title),
            above=6,
        )
        for model, shift in zip(models, (-0.2, 0.2), strict=True):
            place = (at + shift).tolist()
            mean = [m for m, _ in panel.published[model]]
            spread = whiskers([s for _, s in panel.published[model]], INK)
            name, ours = models[model], panel.ours[model]
            shared: dict[str, Any] = {"x": place, "showlegend": k == 0, "hoverinfo": "text", **axes}
            pale = {"color": mix(COLORS[model], "#ffffff", 0.72)}
            words = [f"{c}: {number(x)} P" for c, x in zip(panel.columns, ours, strict=True)]
            sheet.data += [
                go.Bar(y=mean, width=_WIDE, marker=pale, name=f"{name}, published", **shared),
                go.Bar(
                    y=list(ours),
                    width=_NARROW,
                    marker={"color": COLORS[model]},
                    name=f"{name}, ours",
                    hovertext=words,
                    **shared,
                ),
                # Published spreads, before all bars.
                marks.points(place, mean, {"size": 3, "color": INK}, error_y=spread, showlegend=False, **axes),
            ]
    return sheet.drawn(
        "Forces in the pressing index finger, divided by the load",
        "Muscles, then contact forces. Wide and pale: published mean, with its spread; narrow: ours."
        "<br>A force below zero is a muscle that the closure asks to push, which none can.",
        legend_px=-36,
    )
