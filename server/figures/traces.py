"""A recording's channels over time, one panel for each unit, with plateaus shaded."""

from __future__ import annotations

from daq.lab.traces import Traces
from server.figures import graph_objects as go
from server.figures.sheet import Sheet, shape
from server.figures.style import axis, load_styles, plain

_PANEL, _GAP, _MARGINS = 220, 62, (70, 20, 96, 60)  # [px]
_SHADED = "rgba(0,114,178,0.10)"


def traces_figure(traces: Traces, title: str, what: str = "candidates, not yet load cases") -> go.Figure:
    """Draw a recording.

    Args:
        traces: its channels.
        title: name of the recording.
        what: the plateaus are.
    """
    panels = list(dict.fromkeys(traces.units))
    styles = load_styles(traces.names)
    sheet = Sheet(len(panels) * (_PANEL + _GAP) - _GAP, _MARGINS)
    for number, unit in enumerate(panels):
        axes = sheet.panel(
            axis(f"time ({plain(traces.unit)})" if number == len(panels) - 1 else ""),
            axis(plain(unit or "unit not stated")),
            top=number * (_PANEL + _GAP),
            high=_PANEL,
        )
        on = (axes["xaxis"], f"{axes['yaxis']} domain")
        sheet.shapes += [shape(span, (0.0, 1.0), on, fillcolor=_SHADED) for span in traces.plateaus]
        for index in (i for i, own in enumerate(traces.units) if own == unit):
            t, values = traces.lines[index]
            name = traces.names[index]
            line = {"width": 1, "color": styles[name].color}
            sheet.data.append(
                go.Scatter(x=t.tolist(), y=values.tolist(), mode="lines", name=plain(name), line=line, **axes)
            )
    said = f"{traces.readings} readings, {len(traces.plateaus)} plateaus (shaded): {what}"
    return sheet.drawn(plain(title), said, legend_px=4)
