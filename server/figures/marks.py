"""Marks of which figures are made: points, lines, areas and bars, each with what the pointer is told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from server.figures import graph_objects as go

Floats = NDArray[np.float64]
Look = Mapping[str, Any]


def xy(places: Floats) -> tuple[list[float], list[float]]:
    """Return the coordinates of places (n, 2) as Plotly takes them."""
    x, y = places.T.tolist()
    return x, y


def hover(words: Sequence[Any] | None) -> dict[str, Any]:
    """Return what the pointer is told: words for each point, or nothing at all."""
    return {"hoverinfo": "skip"} if words is None else {"hoverinfo": "text", "hovertext": words}


def points(x: Sequence[Any], y: Sequence[Any], marker: Look, words: Sequence[str] | None = None, **more: Any) -> Any:
    """Return points with a marker, words for the pointer, and more of Plotly's scatter, such as another mode."""
    return go.Scatter(x=list(x), y=list(y), marker=marker, **hover(words) | {"mode": "markers"} | more)


def line(x: Sequence[Any], y: Sequence[Any], look: Look, **more: Any) -> Any:
    """Return a line of a colour, width and dash, with gaps where there is None; the pointer is told nothing."""
    return go.Scatter(x=list(x), y=list(y), mode="lines", line=look, **hover(None) | more)


def area(x: Sequence[Any], y: Sequence[Any], color: str, edge: Look, **more: Any) -> Any:
    """Return areas filled with a colour within an edge, with gaps where there is None; out of the legend."""
    shared = {"mode": "lines", "fill": "toself", "showlegend": False}
    return go.Scatter(x=list(x), y=list(y), fillcolor=color, line=edge, **hover(None) | shared | more)


def bars(x: Sequence[Any], y: Sequence[Any], color: Any, words: Sequence[str] | None, **more: Any) -> Any:
    """Return bars of one colour, or of a colour each, without an edge, with words for the pointer."""
    return go.Bar(x=list(x), y=list(y), marker={"color": color, "line": {"width": 0}}, **hover(words), **more)


def cells(
    values: Sequence[Sequence[float | None]],
    span: tuple[float, float],
    colors: Sequence[tuple[float, str]],
    words: Sequence[Sequence[str]],
    told: Sequence[Sequence[str]],
    **more: Any,
) -> Any:
    """Return rows of coloured cells, from the top, with words on each and others for the pointer.

    Args:
        values: that the colours stand for; None leaves a cell empty.
        span: the values of the first and of the last colour.
        colors: with their places between the first, 0, and the last, 1.
        words: on each cell.
        told: for the pointer.
        more: of Plotly's heatmap.
    """
    places = {"x": list(range(len(values[0]))), "y": list(range(len(values)))}
    scale = {"zmin": span[0], "zmax": span[1], "colorscale": [[at, color] for at, color in colors]}
    shown = {"text": words, "texttemplate": "%{text}", "hoverongaps": False, **hover(told)}
    return go.Heatmap(z=values, **places, **scale, **shown, **more)


def band(x: Sequence[Any], low: Sequence[float], high: Sequence[float], color: str, axes: Look) -> Any:
    """Return a filled area between two lines, without an edge or a place in the legend."""
    return area([*x, *reversed(x)], [*high, *reversed(low)], color, {"width": 0}, **axes)
