"""Plotly's traces drawn on Matplotlib axes, and their handles for the legend."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from server.figures.static_cells import draw_bar, draw_heatmap
from server.figures.static_points import each, error_bars, numbers, put_word
from server.figures.static_schema import SYMBOLS, UnsupportedFigureError
from server.figures.static_text import PT, color, dashes

Floats = NDArray[np.float64]
Trace = Mapping[str, Any]
# Matplotlib's markers against Plotly's of the same nominal size.
_SIZES = {"*": 1.4, "D": 0.92}
# Plotly's layers: heatmaps below bars below points and lines, whatever the order of the traces.
_LAYER = {"heatmap": 1.0, "bar": 2.0, "scatter": 3.0}


def draw_trace(
    axes: Axes, trace: Trace, order: int, categories: tuple[list[str] | None, list[str] | None], slot: Trace
) -> None:
    """Draw one trace.

    Args:
        axes: of its subplot.
        trace: as a dict, already checked.
        order: position among the traces.
        categories: of the x and of the y axis, None where it is numeric.
        slot: for bars, how their group shares its place (see `bar_slots`).
    """
    kind = trace.get("type", "scatter")
    zorder = _LAYER[kind] + order * 1e-4
    x_names, y_names = categories
    if kind == "heatmap":
        draw_heatmap(axes, trace, x_names, y_names, zorder)
        return
    y_values = trace.get("y") or []
    x_values = trace.get("x") or list(range(len(y_values)))
    x, y = numbers(x_values, x_names), numbers(y_values, y_names)
    if kind == "bar":
        draw_bar(axes, trace, x, y, slot, zorder)
    else:
        _scatter(axes, trace, x, y, zorder)


def _pieces(x: Floats, y: Floats) -> list[Floats]:
    """Split a line at its gaps."""
    fine = np.isfinite(x) & np.isfinite(y)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], fine.astype(int), [0]])))
    return [np.stack([x[a:b], y[a:b]], axis=1) for a, b in edges.reshape(-1, 2)]


def _scatter(axes: Axes, trace: Trace, x: Floats, y: Floats, zorder: float) -> None:
    mode = trace["mode"]
    clip = trace.get("cliponaxis") is not False
    if trace.get("fill") == "toself":
        for piece in _pieces(x, y):
            codes = [Path.MOVETO, *[Path.LINETO] * (len(piece) - 1), Path.CLOSEPOLY]
            face = color(trace["fillcolor"])
            path = Path(np.concatenate([piece, piece[:1]]), codes)
            axes.add_patch(PathPatch(path, facecolor=face, edgecolor="none", zorder=zorder, clip_on=clip))
            axes.update_datalim(piece)
    if "lines" in mode:
        ends: dict[str, Any] = {"solid_capstyle": "butt", "dash_capstyle": "butt", "solid_joinstyle": "miter"}
        axes.plot(x, y, **_stroke(trace.get("line") or {}), **ends, zorder=zorder + 1e-5, clip_on=clip)
    for which in ("error_x", "error_y"):
        if bars := trace.get(which):
            error_bars(axes, bars, which, x, y, zorder)
    if "markers" in mode:
        _markers(axes, trace.get("marker") or {}, x, y, zorder + 2e-5, clip)
    if "text" in mode.split("+"):
        _labels(axes, trace, x, y, zorder)


def _markers(axes: Axes, marker: Trace, x: Floats, y: Floats, zorder: float, clip: bool) -> None:
    count = len(x)
    rim = marker.get("line") or {}
    inks = each(marker["color"], count)
    sizes = each(marker.get("size", 6), count)
    rims, rim_widths = each(rim.get("color", "none"), count), each(rim.get("width", 0), count)
    symbols = each(marker.get("symbol", "circle"), count)
    for symbol in dict.fromkeys(symbols):
        rows = [i for i, s in enumerate(symbols) if s == symbol and np.isfinite(x[i]) and np.isfinite(y[i])]
        shape, hollow = _symbol(symbol)
        axes.scatter(
            x[rows],
            y[rows],
            s=[(sizes[i] * PT * _SIZES.get(shape, 1.0)) ** 2 for i in rows],
            marker=shape,
            facecolors=["none" if hollow else color(inks[i]) for i in rows],
            edgecolors=[color(inks[i] if hollow else rims[i]) for i in rows],
            linewidths=[max(rim_widths[i], 1.3 if hollow else 0) * PT for i in rows],
            zorder=zorder,
            clip_on=clip,
        )


def _symbol(name: str) -> tuple[str, bool]:
    base = str(name).removesuffix("-open")
    if base not in SYMBOLS:
        raise UnsupportedFigureError(f"marker symbol {name!r} is not drawn")
    return SYMBOLS[base], base != name


def _labels(axes: Axes, trace: Trace, x: Floats, y: Floats, zorder: float) -> None:
    place = str(trace.get("textposition") or "middle center").split()
    up = {"top": (6.0, "bottom"), "middle": (0.0, "center"), "bottom": (-6.0, "top")}[place[0]]
    side = {"left": (-6.0, "right"), "center": (0.0, "center"), "right": (6.0, "left")}[place[1]]
    font = trace.get("textfont") or {}
    for px, py, word in zip(x, y, each(trace.get("text") or "", len(x)), strict=True):
        if word and np.isfinite(px) and np.isfinite(py):
            put_word(axes, word, (px, py), font, (side[1], up[1]), (side[0], up[0]), zorder)


def _stroke(line: Trace) -> dict[str, Any]:
    """Return a line's look in Matplotlib's terms."""
    width = float(line.get("width", 2))
    ink, dash = color(line.get("color", "#000000")), dashes(line.get("dash"), width)
    return {"color": ink, "linewidth": width * PT, "linestyle": dash}


def legend_handle(trace: Trace) -> Artist:
    """Return the sign that stands for a trace in the legend."""
    marker, line, mode = trace.get("marker") or {}, trace.get("line") or {}, trace.get("mode", "")
    one: Callable[[Any], Any] = lambda v: v[0] if isinstance(v, list | tuple | np.ndarray) else v  # noqa: E731
    rim = marker.get("line") or {}
    edge, width = color(one(rim.get("color", "none"))), float(one(rim.get("width", 0)))
    if trace.get("type") == "bar":
        return Patch(facecolor=color(one(marker["color"])), edgecolor=edge, linewidth=width * PT)
    if trace.get("fill") == "toself":
        edge = color(line.get("color", "none")) if "lines" in mode else "none"
        return Patch(facecolor=color(trace["fillcolor"]), edgecolor=edge, linewidth=float(line.get("width", 2)) * PT)
    look = _stroke(line) if "lines" in mode else {"linestyle": "none"}
    if "markers" in mode:
        shape, hollow = _symbol(one(marker.get("symbol", "circle")))
        ink, size = color(one(marker["color"])), min(float(one(marker.get("size", 6))), 14.0)
        look |= {
            "marker": shape,
            "markersize": size * PT * _SIZES.get(shape, 1.0),
            "markerfacecolor": "none" if hollow else ink,
            "markeredgecolor": ink if hollow else edge,
            "markeredgewidth": max(width, 1.3 if hollow else 0.0) * PT,
        }
    return Line2D([], [], **look)
