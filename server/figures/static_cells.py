"""Plotly's bars and heatmaps drawn on Matplotlib axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from server.figures.static_points import each, error_bars, numbers, put_word
from server.figures.static_text import PT, color

Floats = NDArray[np.float64]
Trace = Mapping[str, Any]


def bar_slots(traces: Sequence[Trace], layout: Trace) -> list[dict[str, float]]:
    """Share a category's place among the bar traces of one subplot: offset from its middle, and width."""
    room = 1.0 - float(layout.get("bargap", 0.2))
    if layout.get("barmode") == "overlay":
        return [{"width": room, "offset": 0.0}] * len(traces)
    of_trace = [str(t.get("offsetgroup", i)) for i, t in enumerate(traces)]
    groups = list(dict.fromkeys(of_trace))
    step = room / len(groups)
    width = step * (1.0 - float(layout.get("bargroupgap", 0.0)))
    return [{"width": width, "offset": (groups.index(g) + 0.5) * step - room / 2} for g in of_trace]


def draw_bar(axes: Axes, trace: Trace, x: Floats, y: Floats, slot: Trace, zorder: float) -> None:
    """Draw bars in their slot of `bar_slots`, with error bars and words."""
    flat = trace.get("orientation") == "h"
    place, height = (y, x) if flat else (x, y)
    spacing = float(np.min(np.diff(np.unique(place)))) if len(np.unique(place)) > 1 else 1.0
    width = np.array(each(trace.get("width") or slot["width"] * spacing, len(place)), dtype=float)
    middle = place + slot["offset"] * spacing
    base = np.array(each(trace.get("base") or 0.0, len(place)), dtype=float)
    marker = trace.get("marker") or {}
    rim = marker.get("line") or {}
    looks: dict[str, Any] = {
        "color": [color(c) for c in each(marker["color"], len(place))],
        "edgecolor": color(rim.get("color", "none")),
        "linewidth": float(rim.get("width", 0)) * PT,
        "zorder": zorder,
    }
    if flat:
        axes.barh(middle, height, height=width, left=base, **looks)
    else:
        axes.bar(middle, height, width=width, bottom=base, **looks)
    ends = base + height
    for which in ("error_x", "error_y"):
        if bars := trace.get(which):
            at = (ends, middle) if flat else (middle, ends)
            error_bars(axes, bars, which, at[0], at[1], zorder)
    if trace.get("text") is not None:
        font = trace.get("textfont") or {}
        for m, e, h, word in zip(middle, ends, height, each(trace["text"], len(place)), strict=True):
            up = 1.0 if h >= 0 else -1.0
            if word and np.isfinite(e) and flat:
                put_word(axes, word, (e, m), font, ("left" if up > 0 else "right", "center"), (4 * up, 0), zorder)
            elif word and np.isfinite(e):
                put_word(axes, word, (m, e), font, ("center", "bottom" if up > 0 else "top"), (0, 3 * up), zorder)


def draw_heatmap(axes: Axes, trace: Trace, x_names: list[str] | None, y_names: list[str] | None, zorder: float) -> None:
    """Draw a heatmap with its words and its colour bar."""
    from matplotlib.colors import LinearSegmentedColormap

    z = np.array([[np.nan if v is None else float(v) for v in row] for row in trace["z"]], dtype=float)
    x = numbers(trace.get("x") or list(range(z.shape[1])), x_names)
    y = numbers(trace.get("y") or list(range(z.shape[0])), y_names)
    cmap = LinearSegmentedColormap.from_list("plotly", [(float(s), color(c)) for s, c in trace["colorscale"]])
    gap = max(float(trace.get("xgap") or 0), float(trace.get("ygap") or 0)) * PT
    mesh = axes.pcolormesh(
        _edges(x),
        _edges(y),
        np.ma.masked_invalid(z),
        cmap=cmap,
        vmin=trace.get("zmin"),
        vmax=trace.get("zmax"),
        zorder=zorder,
        edgecolors="white" if gap else "none",
        linewidth=gap,
    )
    if trace.get("texttemplate"):
        for i, row in enumerate(trace["text"]):
            for k, word in enumerate(row):
                if word:
                    put_word(
                        axes, word, (x[k], y[i]), trace.get("textfont") or {}, ("center", "center"), (0, 0), zorder
                    )
    if trace.get("showscale") is not False:
        _color_bar(axes, mesh, trace.get("colorbar") or {})


def _edges(centres: Floats) -> Floats:
    if len(centres) == 1:
        return np.array([centres[0] - 0.5, centres[0] + 0.5])
    middle = (centres[1:] + centres[:-1]) / 2
    return np.concatenate([[2 * centres[0] - middle[0]], middle, [2 * centres[-1] - middle[-1]]])


def _color_bar(axes: Axes, mesh: Any, bar: Trace) -> None:
    parent = axes.get_figure(root=True)
    assert parent is not None  # noqa: S101 - axes are made by add_axes
    box = axes.get_position(original=True)
    width_px, length = parent.get_figwidth() * 96, float(bar.get("len", 1.0))
    thick = float(bar.get("thickness", 30)) / width_px
    place = parent.add_axes(
        (box.x1 + 10 / width_px, box.y0 + box.height * (1 - length) / 2, thick, box.height * length)
    )
    drawn = parent.colorbar(mesh, cax=place)
    drawn.outline.set_linewidth(float(bar.get("outlinewidth", 1)) * PT)
    font = bar.get("tickfont") or {}
    place.tick_params(labelsize=float(font.get("size", 11)) * PT, labelcolor=color(font.get("color", "#222222")))
    if bar.get("tickvals") is not None:
        drawn.set_ticks(list(bar["tickvals"]), labels=[str(t) for t in bar.get("ticktext") or bar["tickvals"]])
    title = bar.get("title") or {}
    if title.get("text"):
        font = title.get("font") or {}
        size, ink = float(font.get("size", 12)) * PT, color(font.get("color", "#222222"))
        place.set_title(title["text"], fontsize=size, color=ink, loc="left")
