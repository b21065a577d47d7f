"""A recording's channels over time, one panel for each unit, with plateaus shaded."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.lab.traces import Traces
from daq.recordings.windows import Span
from server.figures import graph_objects as go
from server.figures.style import axis, domain, figure, load_styles, plain

Floats = NDArray[np.float64]

_PANEL_PX, _GAP_PX, _TOP_PX, _BOTTOM_PX = 220, 62, 96, 60
# Of a channel: so many stretches of time, each drawn from its least to its greatest value.
_STRETCHES = 1500
_SHADED = "rgba(0,114,178,0.10)"


def traces_figure(
    traces: Traces, plateaus: list[Span], name: str, what: str = "candidates, not yet load cases"
) -> go.Figure:
    """Draw a recording.

    Args:
        traces: its channels.
        plateaus: spans to shade, in the traces' time.
        name: of the recording.
        what: the plateaus are.
    """
    panels = list(dict.fromkeys(traces.units))
    height = len(panels) * (_PANEL_PX + _GAP_PX) - _GAP_PX + _TOP_PX + _BOTTOM_PX
    inner = height - _TOP_PX - _BOTTOM_PX
    styles = load_styles(traces.names)
    data: list[Any] = []
    layout: dict[str, Any] = {"shapes": [], "annotations": []}
    for number, unit in enumerate(panels):
        suffix = "" if number == 0 else str(number + 1)
        top = 1.0 - number * (_PANEL_PX + _GAP_PX) / inner
        place = domain(top - _PANEL_PX / inner, top)
        last = number == len(panels) - 1
        layout[f"xaxis{suffix}"] = axis(f"time ({plain(traces.unit)})" if last else "", anchor=f"y{suffix}")
        layout[f"yaxis{suffix}"] = axis(plain(unit or "unit not stated"), anchor=f"x{suffix}", domain=place)
        layout["shapes"] += [_shade(span, place, f"x{suffix}") for span in plateaus]
        for index in (i for i, own in enumerate(traces.units) if own == unit):
            t, values = thinned(traces.t, traces.values[:, index])
            data.append(
                go.Scatter(
                    x=t.tolist(),
                    y=values.tolist(),
                    mode="lines",
                    name=plain(traces.names[index]),
                    line={"width": 1, "color": styles[traces.names[index]].color},
                    xaxis=f"x{suffix}",
                    yaxis=f"y{suffix}",
                )
            )
    layout["legend"] = {"orientation": "h", "x": 0.0, "xanchor": "left", "y": 1.0 + 4 / inner, "yanchor": "bottom"}
    said = f"{len(traces.t)} readings, {len(plateaus)} plateaus (shaded): {what}"
    margin = {"l": 70, "r": 20, "t": _TOP_PX, "b": _BOTTOM_PX}
    return figure(data, layout, title=plain(name), subtitle=said, height=height, margin=margin)


def _shade(span: Span, place: list[float], x_axis: str) -> dict[str, Any]:
    ends = {"x0": span[0], "x1": span[1], "y0": place[0], "y1": place[1], "xref": x_axis, "yref": "paper"}
    return {"type": "rect", "fillcolor": _SHADED, "line": {"width": 0}, "layer": "below", **ends}


def thinned(t: Floats, values: Floats) -> tuple[Floats, Floats]:
    """The same line (n,) with at most some thousands of points: the least and the greatest of each stretch of time."""
    width = len(t) // _STRETCHES
    if width < 3:
        return t, values
    count = len(t) // width
    blocks = values[: count * width].reshape(count, width)
    ends = np.stack([blocks.argmin(axis=1), blocks.argmax(axis=1)]) + np.arange(count) * width
    picks = np.unique(np.append(ends, np.arange(count * width, len(t))))
    return t[picks], values[picks]
