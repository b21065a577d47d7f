"""Forces in a pressing finger without and with its hood: bars beside the published means and their spread."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from server.figures import graph_objects as go
from server.figures.style import INK, axis, domain, figure, heading, legend, mix, number

COLORS = {"minimal": "#0072B2", "chao": "#D55E00"}
_PANEL, _GAP, _TOP, _BOTTOM = 190, 52, 96, 84  # [px]
_WIDE, _NARROW = 0.36, 0.18


@dataclass(frozen=True)
class Panel:
    """One posture.

    Attributes:
        title: of the panel.
        columns: names of the forces.
        published: model → (mean, spread) of each column.
        ours: model → each column.
    """

    title: str
    columns: Sequence[str]
    published: Mapping[str, Sequence[tuple[float, float]]]
    ours: Mapping[str, Sequence[float]]


def pressing_figure(panels: Sequence[Panel], models: Mapping[str, str]) -> go.Figure:
    """Draw the panels one below the other: published means wide and pale with their spread, ours narrow before them.

    Args:
        panels: from the top.
        models: model → its name for the reader, two of them.
    """
    plot = len(panels) * _PANEL + (len(panels) - 1) * _GAP
    data: list[go.Bar | go.Scatter] = []
    layout: dict[str, object] = {"barmode": "overlay", "annotations": []}
    notes: list[dict[str, object]] = []
    for k, panel in enumerate(panels):
        suffix = "" if k == 0 else str(k + 1)
        top = 1.0 - k * (_PANEL + _GAP) / plot
        at = np.arange(len(panel.columns), dtype=float)
        for model, shift in zip(models, (-0.2, 0.2), strict=True):
            place = at + shift
            mean = [m for m, _ in panel.published[model]]
            spread = [s for _, s in panel.published[model]]
            name, ours = models[model], panel.ours[model]
            data.append(_bars(place, mean, mix(COLORS[model], "#ffffff", 0.72), _WIDE, f"{name}, published", suffix, k))
            data.append(_bars(place, ours, COLORS[model], _NARROW, f"{name}, ours", suffix, k))
            data[-1].hovertext = [f"{c}: {number(x)} P" for c, x in zip(panel.columns, ours, strict=True)]
            data.append(_spreads(place, mean, spread, suffix))
        layout[f"xaxis{suffix}"] = axis(
            range=[-0.6, len(at) - 0.4],
            tickvals=at.tolist(),
            ticktext=list(panel.columns),
            showgrid=False,
            ticks="",
            anchor=f"y{suffix}",
        )
        layout[f"yaxis{suffix}"] = axis(
            "force / load [1]",
            domain=domain(top - _PANEL / plot, top),
            anchor=f"x{suffix}",
            zeroline=True,
            zerolinecolor=INK,
            zerolinewidth=1,
            nticks=6,
        )
        notes.append(heading(panel.title, top, 6))
    layout["annotations"] = notes
    layout["legend"] = legend(-36, plot)
    return figure(
        data,
        layout,
        title="Forces in the pressing index finger, divided by the load",
        subtitle="Muscles, then contact forces. Wide and pale: published mean, with its spread; narrow: ours."
        "<br>A force below zero is a muscle that the closure asks to push, which none can.",
        height=plot + _TOP + _BOTTOM,
        margin={"l": 72, "r": 24, "t": _TOP, "b": _BOTTOM},
    )


def _bars(
    place: np.ndarray, height: Sequence[float], color: str, width: float, name: str, suffix: str, panel: int
) -> go.Bar:
    return go.Bar(
        x=place.tolist(),
        y=list(height),
        width=width,
        marker={"color": color},
        name=name,
        xaxis=f"x{suffix}",
        yaxis=f"y{suffix}",
        showlegend=panel == 0,
        hoverinfo="text",
    )


def _spreads(place: np.ndarray, mean: Sequence[float], spread: Sequence[float], suffix: str) -> go.Scatter:
    """Published spreads, before all bars."""
    return go.Scatter(
        x=place.tolist(),
        y=list(mean),
        mode="markers",
        marker={"size": 3, "color": INK},
        error_y={"type": "data", "array": list(spread), "color": INK, "thickness": 1, "width": 3, "visible": True},
        xaxis=f"x{suffix}",
        yaxis=f"y{suffix}",
        showlegend=False,
        hoverinfo="skip",
    )
