"""Parts of every drawn trace: coordinates, attributes for each point, error bars and words at points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from server.figures.static_schema import UnsupportedFigureError
from server.figures.static_text import PT, color, put_text

Floats = NDArray[np.float64]
Trace = Mapping[str, Any]


def numbers(values: Any, categories: Sequence[str] | None) -> Floats:
    """Return coordinates as numbers: gaps as NaN, categories as their positions."""
    if categories is not None:
        return np.array([np.nan if v is None else categories.index(str(v)) for v in values], dtype=float)
    if any(isinstance(v, str) for v in values):
        raise UnsupportedFigureError("words on an axis that is not declared as type='category'")
    return np.array([np.nan if v is None else float(v) for v in values], dtype=float)


def each(value: Any, count: int) -> list[Any]:
    """Repeat an attribute for every point unless it is a list already."""
    if isinstance(value, list | tuple | np.ndarray):
        if len(value) != count:
            raise UnsupportedFigureError(f"{len(value)} values of an attribute for {count} points")
        return list(value)
    return [value] * count


def error_bars(axes: Axes, bars: Trace, which: str, x: Floats, y: Floats, zorder: float) -> None:
    """Draw the error bars `which` (error_x or error_y) of points."""
    up = np.array([np.nan if v is None else v for v in bars["array"]], dtype=float)
    down = bars.get("arrayminus") if bars.get("symmetric") is not True else None
    low = up if down is None else np.array([np.nan if v is None else v for v in down], dtype=float)
    thick = float(bars.get("thickness", 2)) * PT
    spread: dict[str, Any] = {"xerr" if which == "error_x" else "yerr": np.stack([low, up])}
    axes.errorbar(
        x,
        y,
        **spread,
        fmt="none",
        ecolor=color(bars.get("color", "#000000")),
        elinewidth=thick,
        capthick=thick,
        capsize=float(bars.get("width", 4)) * PT,
        zorder=zorder + 1e-5,
    )


def put_word(
    axes: Axes,
    word: str,
    at: tuple[float, float],
    font: Trace,
    anchor: tuple[str, str],
    shift: tuple[float, float],
    zorder: float,
) -> None:
    """Write a word at a point of the data, moved by a shift [px]."""
    parent = axes.get_figure(root=True)
    assert parent is not None  # noqa: S101 - axes are made by add_axes
    own = {"size": 11, "color": "#000000"} | dict(font)
    put_text(parent, word, at, axes.transData, own, anchor=anchor, shift_px=shift, zorder=10 + zorder)
