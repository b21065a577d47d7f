"""Plotly's shapes, texts and arrows drawn over Matplotlib axes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.transforms import Transform

from server.figures.static_axes import Canvas
from server.figures.static_schema import UnsupportedFigureError
from server.figures.static_text import PT, color, dashes, put_text

Attributes = Mapping[str, Any]


def draw_shapes(canvas: Canvas) -> None:
    """Draw lines and rectangles."""
    for shape in canvas.layout.get("shapes") or ():
        x_of, y_of = shape.get("xref") or "x", shape.get("yref") or "y"
        x = [canvas.along(x_of, shape[k]) for k in ("x0", "x1")]
        y = [canvas.along(y_of, shape[k]) for k in ("y0", "y1")]
        corners = [(x[0], y[0]), (x[1], y[1])]
        if shape["type"] == "rect":
            corners = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1]), (x[0], y[0])]
        line = shape.get("line") or {}
        width = float(line.get("width", 2))
        face = color(shape.get("fillcolor", "none")) if shape["type"] == "rect" else "none"
        patch = PathPatch(
            Path(corners),
            facecolor=face,
            edgecolor=color(line.get("color", "#444444")),
            linewidth=width * PT,
            linestyle=dashes(line.get("dash"), width),
            transform=canvas.transform(x_of, y_of),
            zorder=0.5 if shape.get("layer") == "below" else 6.0,
        )
        # Within a subplot the shape belongs to it, so that it can lie below the traces.
        owner = canvas.of_axis(x_of.partition(" ")[0]) if x_of != "paper" else None
        if owner is None and y_of != "paper":
            owner = canvas.of_axis(y_of.partition(" ")[0])
        if owner is None:
            canvas.figure.add_artist(patch)
        else:
            limits = owner.get_xlim(), owner.get_ylim()
            owner.add_artist(patch)
            owner.set_xlim(limits[0])
            owner.set_ylim(limits[1])


def draw_annotations(canvas: Canvas, overlay: Axes) -> None:
    """Write texts and draw arrows; `overlay` covers the figure and lies above everything."""
    centred = {"auto": "center", "middle": "center"}
    for note in canvas.layout.get("annotations") or ():
        x_of, y_of = note.get("xref") or "x", note.get("yref") or "y"
        transform = canvas.transform(x_of, y_of)
        at = (canvas.along(x_of, note["x"]), canvas.along(y_of, note["y"]))
        if note.get("showarrow") is not False:
            _arrow(canvas, overlay, note, at, transform)
        if not note.get("text"):
            continue
        sides = [centred.get(side, side) for side in (note.get(k) or "auto" for k in ("xanchor", "yanchor"))]
        behind = note.get("bgcolor")
        put_text(
            canvas.figure,
            note["text"],
            at,
            transform,
            dict(canvas.font) | dict(note.get("font") or {}),
            anchor=(sides[0], sides[1]),
            align=note.get("align"),
            shift_px=(float(note.get("xshift") or 0), float(note.get("yshift") or 0)),
            zorder=20.0,
            **({"bbox": {"facecolor": color(behind), "edgecolor": "none", "pad": 1.5}} if behind else {}),
        )


def _arrow(canvas: Canvas, overlay: Axes, note: Attributes, at: tuple[float, float], transform: Transform) -> None:
    """Draw an annotation's arrow, whose tail is a point of the data."""
    x_of, y_of = note.get("axref") or "pixel", note.get("ayref") or "pixel"
    if note.get("text") or "pixel" in (x_of, y_of):
        raise UnsupportedFigureError("an arrow with a text, or whose tail is given in pixels")
    width = float(note.get("arrowwidth") or 2.0)
    size = 3.0 * width * float(note.get("arrowsize") or 1.0) * PT
    look = {
        "arrowstyle": f"-|>,head_length={size / 10:.4f},head_width={size / 20:.4f}",
        "mutation_scale": 10,
        "shrinkA": 0,
        "shrinkB": 0,
        "linewidth": width * PT,
        "color": color(note.get("arrowcolor", "#444444")),
    }
    overlay.annotate(
        "",
        xy=at,
        xycoords=transform,
        xytext=(canvas.along(x_of, note["ax"]), canvas.along(y_of, note["ay"])),
        textcoords=canvas.transform(x_of, y_of),
        arrowprops=look,
        annotation_clip=False,
    )
