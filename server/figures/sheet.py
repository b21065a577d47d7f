"""The frame of a figure: panels placed in pixels on its plotting area, with notes and shapes at their places."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from server.figures import graph_objects as go
from server.figures.style import FONT, INK, MUTED, SMALL_PX, TEXT_PX, WIDTH, legend

On = tuple[str, str]
PAPER: On = ("paper", "paper")
# Of every figure: its title at the upper left, and the common style.
_HEADING: dict[str, Any] = {
    "x": 0.0,
    "xref": "container",
    "xanchor": "left",
    "yref": "container",
    "yanchor": "top",
    "pad": {"l": 14},
    "font": {"size": 16, "color": INK},
}
_COMMON: dict[str, Any] = {
    "template": {},
    "width": WIDTH,
    "font": {"family": FONT, "size": TEXT_PX, "color": INK},
    "paper_bgcolor": "#ffffff",
    "plot_bgcolor": "#ffffff",
    "hovermode": "closest",
    "hoverlabel": {"bgcolor": "#ffffff", "font": {"size": TEXT_PX, "color": INK}},
}


class Sheet:
    """A figure under construction.

    Args:
        high: height of the plotting area [px].
        margins: left, right, top and bottom of it [px].
        wide: its width, in which panels are placed [px]; by default what the margins leave.
        layout: whatever else Plotly's layout holds.

    Attributes:
        high: as given.
        wide: as given.
        data: traces.
        notes: annotations, see `note`.
        shapes: see `shape`.
    """

    def __init__(
        self, high: float, margins: tuple[int, int, int, int], wide: float | None = None, **layout: Any
    ) -> None:
        left, right, _, _ = self._margins = margins
        self.high, self.wide = high, WIDTH - left - right if wide is None else wide
        self.data: list[Any] = []
        self.notes: list[dict[str, Any]] = []
        self.shapes: list[dict[str, Any]] = []
        self._layout, self._panels = layout, 0

    def panel(
        self,
        x: dict[str, Any],
        y: dict[str, Any],
        *,
        left: float = 0.0,
        top: float = 0.0,
        wide: float | None = None,
        high: float | None = None,
        heading: str = "",
        above: int = 4,
        size: int = TEXT_PX,
        equal: bool = False,
    ) -> dict[str, str]:
        """Place a panel; return the names of its axes, for its traces.

        Args:
            x: its horizontal axis.
            y: its vertical axis.
            left: edge of the panel from that of the plotting area [px].
            top: likewise.
            wide: of the panel [px]; by default of the whole area.
            high: likewise.
            heading: stands bold over its left edge; marked up.
            above: distance of the heading [px].
            size: of the heading [px].
            equal: whether both axes have one scale.
        """
        names = panel_axes(self._panels)
        self._panels += 1
        across = _within(left / self.wide, (left + (wide or self.wide)) / self.wide)
        up = _within(1.0 - (top + (high or self.high)) / self.high, 1.0 - top / self.high)
        self._layout["xaxis" + names["xaxis"][1:]] = x | {"domain": across, "anchor": names["yaxis"]}
        self._layout["yaxis" + names["yaxis"][1:]] = y | {"domain": up, "anchor": names["xaxis"]}
        if equal:
            self._layout["yaxis" + names["yaxis"][1:]] |= {"scaleanchor": names["xaxis"], "scaleratio": 1}
        if heading:
            self.notes.append(note(f"<b>{heading}</b>", across[0], up[1], shift=(0, above), size=size))
        return names

    def grid(
        self, row: int, column: int, across: int, high: float, gaps: tuple[float, float], head: float = 0.0
    ) -> dict[str, Any]:
        """Return the place of a panel among others of its size.

        Args:
            row: from the top.
            column: from the left.
            across: number of columns.
            high: of each panel [px].
            gaps: between columns and between rows [px].
            head: room above each panel [px].
        """
        wide = (self.wide - gaps[0] * (across - 1)) / across
        return {"left": column * (wide + gaps[0]), "top": row * (high + gaps[1]) + head, "wide": wide, "high": high}

    def drawn(
        self,
        title: str,
        subtitle: str = "",
        *,
        legend_px: float | None = None,
        at_right: bool = False,
        **layout: Any,
    ) -> go.Figure:
        """Return the figure.

        Args:
            title: of the figure.
            subtitle: below the title; `<br>` breaks lines.
            legend_px: where its legend stands, see `legend`; None for Plotly's own place, or none.
            at_right: whether that legend stands at the right.
            layout: whatever else Plotly's layout holds.
        """
        left, right, top, bottom = self._margins
        height = round(self.high + top + bottom)
        heading = _HEADING | {"text": title, "y": 1.0 - 14 / height}
        if subtitle:
            heading["subtitle"] = {"text": subtitle, "font": {"size": SMALL_PX + 1, "color": MUTED}}
        layout |= self._layout | {"title": heading, "annotations": self.notes, "height": height}
        layout["margin"] = {"l": left, "r": right, "t": top, "b": bottom}
        if self.shapes:
            layout["shapes"] = self.shapes
        if legend_px is not None:
            layout["legend"] = legend(legend_px, self.high, at_right=at_right)
        return go.Figure(data=self.data, layout=_COMMON | layout)


def panel_axes(index: int) -> dict[str, str]:
    """Return the names of the axes of the panel with that index."""
    suffix = str(index + 1) if index else ""
    return {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}"}


def _within(begin: float, end: float) -> list[float]:
    """Keep a panel's place within 0 to 1 against rounding."""
    return [min(max(begin, 0.0), 1.0), min(max(end, 0.0), 1.0)]


def note(
    text: str,
    x: float,
    y: float,
    on: On = PAPER,
    *,
    at: tuple[str, str] = ("left", "bottom"),
    shift: tuple[int, int] = (0, 0),
    size: int = TEXT_PX,
    color: str = INK,
    **more: Any,
) -> dict[str, Any]:
    """Return a text at a place.

    Args:
        text: marked up.
        x: place along the axis `on[0]`, 0 to 1 on paper.
        y: place along the axis `on[1]`.
        on: names of axes, or paper.
        at: which side of the text is there: left, center or right; top, middle or bottom; or auto.
        shift: to the right and upwards [px].
        size: of the font [px].
        color: of the text.
        more: of Plotly's annotation.
    """
    out = {"text": text, "x": x, "y": y, "xref": on[0], "yref": on[1], "xanchor": at[0], "yanchor": at[1]}
    out |= {"showarrow": False, "font": {"size": size, "color": color}}
    return out | {name: by for name, by in zip(("xshift", "yshift"), shift, strict=True) if by} | more


def shape(
    x: Sequence[float], y: Sequence[float], on: On, *, line: dict[str, Any] | None = None, **more: Any
) -> dict[str, Any]:
    """Return a line between two points or, with `fillcolor`, a band without an edge; below the traces.

    Args:
        x: of its two ends.
        y: of its two ends.
        on: names of axes, or paper.
        line: color, width and dash.
        more: of Plotly's shape.
    """
    ends = {"x0": x[0], "x1": x[1], "y0": y[0], "y1": y[1], "xref": on[0], "yref": on[1]}
    kind = "rect" if "fillcolor" in more else "line"
    return ends | {"type": kind, "line": line or {"width": 0}, "layer": "below"} | more


def key(name: str, mode: str = "lines", **look: Any) -> go.Scatter:
    """Return a trace without data that stands for its entry in the legend."""
    return go.Scatter(x=[None], y=[None], name=name, mode=mode, hoverinfo="skip", **look)
