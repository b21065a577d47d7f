"""Plotly's subplots as Matplotlib axes: domains, ranges, ticks and equal scale."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter, NullLocator
from matplotlib.transforms import Bbox, BboxTransformTo, Transform, TransformedBbox, blended_transform_factory

from server.figures.static_schema import UnsupportedFigureError
from server.figures.static_text import PT, color, flat

Attributes = Mapping[str, Any]


@dataclass
class Canvas:
    """A figure under construction."""

    figure: Figure  # of Matplotlib
    layout: Attributes  # of Plotly
    plot: tuple[float, float, float, float]  # left, bottom, width, height of the plotting area, in parts of the figure
    # Axes by the ids of their x and y axis, such as ("x2", "y2").
    subplots: dict[tuple[str, str], Axes] = field(default_factory=dict)
    categories: dict[str, list[str]] = field(default_factory=dict)  # names on each category axis, by axis id

    @property
    def font(self) -> Attributes:
        """Size and colour of text that says nothing of its own."""
        return {"size": 12, "color": "#222222"} | dict(self.layout.get("font") or {})

    def axis(self, name: str) -> Attributes:
        """Return the layout of an axis by its id (`x`, `y2`)."""
        found: Attributes = self.layout.get(f"{name[0]}axis{name[1:]}") or {}
        return found

    def of_axis(self, name: str) -> Axes:
        """Return any subplot that uses an axis."""
        for pair, axes in self.subplots.items():
            if name in pair:
                return axes
        return self.subplot(name if name[0] == "x" else "x", name if name[0] == "y" else "y")

    def subplot(self, x: str, y: str) -> Axes:
        """Return the axes of a pair of axis ids, made on first use."""
        if (x, y) not in self.subplots:
            self.subplots[x, y] = self._make(x, y)
        return self.subplots[x, y]

    def _make(self, x: str, y: str) -> Axes:
        left, bottom, width, height = self.plot
        (x0, x1), (y0, y1) = (self.axis(n).get("domain") or (0.0, 1.0) for n in (x, y))
        axes = self.figure.add_axes((left + x0 * width, bottom + y0 * height, (x1 - x0) * width, (y1 - y0) * height))
        axes.set_facecolor(color(self.layout.get("plot_bgcolor", "none")))
        axes.set_axisbelow(True)
        for name in (x, y):
            if self.axis(name).get("type") == "log":
                (axes.set_xscale if name[0] == "x" else axes.set_yscale)("log")
        return axes

    def transform(self, x_reference: str, y_reference: str) -> Transform:
        """Return the transform of a point given in `paper`, an axis id, or `<axis id> domain`."""
        return blended_transform_factory(self._along(x_reference or "paper"), self._along(y_reference or "paper"))

    def _along(self, reference: str) -> Transform:
        if reference == "paper":
            return BboxTransformTo(TransformedBbox(Bbox.from_bounds(*self.plot), self.figure.transFigure))
        name, _, domain = reference.partition(" ")
        axes = self.of_axis(name)
        return axes.transAxes if domain == "domain" else axes.transData

    def along(self, name: str, value: Any) -> float:
        """Return a coordinate on an axis as a number."""
        if name.partition(" ")[0] in self.categories and isinstance(value, str):
            return float(self.categories[name].index(value))
        if self.axis(name).get("type") == "log" and " " not in name and name != "paper":
            return 10.0 ** float(value)  # Plotly gives annotations and shapes on a log axis as exponents
        return float(value)


def finish_axes(canvas: Canvas) -> None:
    """Set ranges, ticks, titles and scale of every subplot, after its traces."""
    for (x, y), axes in canvas.subplots.items():
        _range(canvas, axes, x)
        _range(canvas, axes, y)
        _look(canvas, axes, x)
        _look(canvas, axes, y)
        _equal(canvas, axes, x, y)


def _range(canvas: Canvas, axes: Axes, name: str) -> None:
    layout = canvas.axis(name)
    place = axes.set_xlim if name[0] == "x" else axes.set_ylim
    low, high = axes.get_xlim() if name[0] == "x" else axes.get_ylim()
    if layout.get("range"):
        low, high = (float(v) for v in layout["range"])
        if layout.get("type") == "log":
            low, high = 10.0**low, 10.0**high
    elif name in canvas.categories:
        low, high = -0.5, len(canvas.categories[name]) - 0.5
    elif layout.get("rangemode") == "tozero":
        low, high = min(low, 0.0), max(high, 0.0)
    place(low, high)


def _look(canvas: Canvas, axes: Axes, name: str) -> None:
    layout, flat_axis = canvas.axis(name), name[0] == "x"
    line = axes.xaxis if flat_axis else axes.yaxis
    if layout.get("visible") is False:
        layout = {"showgrid": False, "showticklabels": False, "showline": False, "ticks": "", "zeroline": False}
    for spine in ("bottom", "top") if flat_axis else ("left", "right"):
        shown = bool(layout.get("showline")) and (spine in ("bottom", "left") or layout.get("mirror") is True)
        axes.spines[spine].set_visible(shown)
        axes.spines[spine].set_color(color(layout.get("linecolor", "#444444")))
        axes.spines[spine].set_linewidth(float(layout.get("linewidth", 1)) * PT)
    font = dict(canvas.font) | dict(layout.get("tickfont") or {})
    labels, ticks = layout.get("showticklabels") is not False, layout.get("ticks") or ""
    line.set_tick_params(
        which="major",
        direction="out",
        length=float(layout.get("ticklen", 5)) * PT if ticks else 0.0,
        width=PT,
        color=color(layout.get("tickcolor", "#444444")),
        labelsize=float(font["size"]) * PT,
        labelcolor=color(font["color"]),
        labelrotation=-float(layout.get("tickangle") or 0.0),
        **{"bottom" if flat_axis else "left": bool(ticks), "labelbottom" if flat_axis else "labelleft": labels},
    )
    line.set_minor_locator(NullLocator())
    line.set_minor_formatter(NullFormatter())
    _ticks(canvas, axes, name)
    if layout.get("showgrid") is not False:
        line.grid(
            True, color=color(layout.get("gridcolor", "#eeeeee")), linewidth=float(layout.get("gridwidth", 1)) * PT
        )
    if layout.get("zeroline"):
        put = axes.axvline if flat_axis else axes.axhline
        put(
            0.0,
            color=color(layout.get("zerolinecolor", "#444444")),
            lw=float(layout.get("zerolinewidth", 1)) * PT,
            zorder=0.9,
        )
    title = layout.get("title") or {}
    if title.get("text"):
        font = dict(canvas.font) | dict(title.get("font") or {})
        line.set_label_text(flat(title["text"]), fontsize=float(font["size"]) * PT, color=color(font["color"]))
        line.labelpad = 0.5 * float(title.get("standoff", 8)) * PT


def _ticks(canvas: Canvas, axes: Axes, name: str) -> None:
    layout, line = canvas.axis(name), axes.xaxis if name[0] == "x" else axes.yaxis
    if layout.get("tickvals") is not None:
        values = [canvas.along(name, v) if isinstance(v, str) else float(v) for v in layout["tickvals"]]
        words = layout.get("ticktext") or [f"{v:g}" for v in values]
        line.set_ticks(values, labels=[flat(w) for w in words])
    elif name in canvas.categories:
        line.set_ticks(range(len(canvas.categories[name])), labels=[flat(w) for w in canvas.categories[name]])
    else:
        if layout.get("type") != "log":
            line.set_major_locator(MaxNLocator(int(layout.get("nticks") or 6), steps=[1, 2, 5, 10]))
        low, high = line.get_view_interval()
        line.set_major_formatter(FuncFormatter(lambda v, _: _tick_text(v, abs(high - low))))


def _tick_text(value: float, span: float) -> str:
    """Write a tick as Plotly does: no more digits than it needs, no common factor apart."""
    return f"{0.0 if abs(value) < 1e-9 * span else value:.6g}".replace("-", "\N{MINUS SIGN}")


def _equal(canvas: Canvas, axes: Axes, x: str, y: str) -> None:
    for name, other in ((x, y), (y, x)):
        layout = canvas.axis(name)
        if anchor := layout.get("scaleanchor"):
            if anchor != other:
                raise UnsupportedFigureError(f"axis {name} is scaled to {anchor}, which is not of its subplot")
            ratio = float(layout.get("scaleratio", 1.0))
            both = [canvas.axis(n).get("constrain") for n in (x, y)]
            axes.set_aspect(ratio if name == y else 1.0 / ratio, adjustable="box" if "domain" in both else "datalim")
