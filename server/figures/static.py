"""PNG and SVG of a Plotly figure without a browser: what our figures use is drawn, anything else is refused.

A figure drawn twice gives the same bytes. Text in the SVG stays text.
"""

from __future__ import annotations

import io
import threading
import warnings
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from daq.files import replacing
from server.figures.static_axes import Canvas, finish_axes
from server.figures.static_cells import bar_slots
from server.figures.static_notes import draw_annotations, draw_shapes
from server.figures.static_schema import UnsupportedFigureError, is_axis, require_supported
from server.figures.static_text import PT, color, flat, put_text
from server.figures.static_traces import draw_trace, legend_handle

__all__ = ["UnsupportedFigureError", "render", "write_static"]

# Of names in other scripts, where they are installed: what comes with Matplotlib has no Chinese, Japanese or Korean.
_FURTHER_FONTS = (
    "Noto Sans CJK SC",
    "Noto Sans CJK JP",
    "Microsoft YaHei",
    "Yu Gothic",
    "Malgun Gothic",
    "PingFang SC",
    "Hiragino Sans",
    "Apple SD Gothic Neo",
    "WenQuanYi Zen Hei",
)
_SETTINGS: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "fingertwin",
    "lines.scale_dashes": False,
    "axes.unicode_minus": True,
    "path.simplify": False,
    "text.parse_math": False,  # a "$" in a name is no formula
}
_METADATA: dict[str, dict[str, str | None]] = {
    "png": {"Software": "fingertwin"},
    "svg": {"Date": None, "Creator": "fingertwin"},
}
# The settings are process-wide while a figure is drawn.
_LOCK = threading.Lock()


def render(figure: Any, file_format: str, scale: float = 2.0) -> bytes:
    """Draw a Plotly figure as `png` or `svg`.

    Args:
        figure: a `go.Figure`, or its JSON as a dict.
        file_format: png or svg.
        scale: pixels of the PNG in one of the figure's.

    Raises:
        UnsupportedFigureError: it uses what the converter does not draw.
    """
    if file_format not in _METADATA:
        raise ValueError(f"format {file_format!r}; expected png or svg")
    return _rendered(figure, (file_format,), scale)[0]


def _rendered(figure: Any, formats: Sequence[str], scale: float) -> list[bytes]:
    """Lay a figure out once, and draw it in each format."""
    parts = figure if isinstance(figure, Mapping) else figure.to_dict()
    require_supported(parts)
    outs = [io.BytesIO() for _ in formats]
    with _LOCK, mpl.rc_context(_SETTINGS | {"font.family": _fonts()}), warnings.catch_warnings():
        # A glyph that no font has is drawn as a box; SVG and page keep the text.
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        drawn = _draw(parts)
        for out, file_format in zip(outs, formats, strict=True):
            drawn.savefig(out, format=file_format, dpi=96 * scale, metadata=_METADATA[file_format])
    return [out.getvalue() for out in outs]


@cache
def _fonts() -> list[str]:
    """Families in which a glyph is looked for, one after another."""
    from matplotlib.font_manager import fontManager

    installed = {font.name for font in fontManager.ttflist}
    return ["DejaVu Sans", *(name for name in _FURTHER_FONTS if name in installed)]


def write_static(folder: Path, figures: Mapping[str, Any], scale: float = 2.0) -> list[Path]:
    """Write NAME.png and NAME.svg of every figure; a file appears whole or not at all."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, figure in figures.items():
        for file_format, data in zip(_METADATA, _rendered(figure, tuple(_METADATA), scale), strict=True):
            path = folder / f"{name}.{file_format}"
            with replacing(path) as temporary:
                temporary.write_bytes(data)
            written.append(path)
    return written


def _draw(parts: Mapping[str, Any]) -> Figure:
    layout: Mapping[str, Any] = parts.get("layout") or {}
    width, height = float(layout.get("width") or 700), float(layout.get("height") or 450)
    figure = Figure(figsize=(width / 96, height / 96), dpi=96)
    FigureCanvasAgg(figure)
    figure.set_facecolor(color(layout.get("paper_bgcolor", "#ffffff")))
    margin = {"l": 80, "r": 80, "t": 100, "b": 80} | dict(layout.get("margin") or {})
    left, bottom = margin["l"] / width, margin["b"] / height
    plot = (left, bottom, 1.0 - left - margin["r"] / width, 1.0 - bottom - margin["t"] / height)
    canvas = Canvas(figure, layout, plot)
    traces: Sequence[Mapping[str, Any]] = parts.get("data") or ()
    _collect_categories(canvas, traces)
    overlay = figure.add_axes((0.0, 0.0, 1.0, 1.0), zorder=15)
    overlay.set_axis_off()
    bars: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for trace in traces:
        if trace.get("type") == "bar":
            bars.setdefault(_pair(trace), []).append(trace)
    slots = {pair: iter(bar_slots(group, layout)) for pair, group in bars.items()}
    for order, trace in enumerate(traces):
        x, y = _pair(trace)
        slot = next(slots[x, y]) if trace.get("type") == "bar" else {}
        draw_trace(canvas.subplot(x, y), trace, order, (canvas.categories.get(x), canvas.categories.get(y)), slot)
    for name in layout:
        if is_axis(name) and not any(f"{name[0]}{name[5:]}" in pair for pair in canvas.subplots):
            canvas.of_axis(f"{name[0]}{name[5:]}")
    finish_axes(canvas)
    draw_shapes(canvas)
    draw_annotations(canvas, overlay)
    _title(canvas, width, height)
    _legend(canvas, overlay, traces, width)
    return figure


def _pair(trace: Mapping[str, Any]) -> tuple[str, str]:
    return trace.get("xaxis") or "x", trace.get("yaxis") or "y"


def _collect_categories(canvas: Canvas, traces: Sequence[Mapping[str, Any]]) -> None:
    for trace in traces:
        for name, key in zip(_pair(trace), ("x", "y"), strict=True):
            layout = canvas.axis(name)
            if layout.get("type") == "category":
                names = canvas.categories.setdefault(name, [str(v) for v in layout.get("categoryarray") or ()])
                names += [str(v) for v in dict.fromkeys(trace.get(key) or ()) if v is not None and str(v) not in names]


def _title(canvas: Canvas, width: float, height: float) -> None:
    title = canvas.layout.get("title") or {}
    if not title.get("text"):
        return
    font: dict[str, Any] = dict(canvas.font) | {"size": 17} | dict(title.get("font") or {})
    x = float(title.get("x", 0.5)) * width + float((title.get("pad") or {}).get("l", 0))
    y = float(title.get("y", 0.9)) * height
    subtitle, lines = title.get("subtitle") or {}, title["text"].count("<br>") + 1
    small = dict(canvas.font) | dict(subtitle.get("font") or {})
    below = y - float(font["size"]) * 1.3 * lines - 2
    for text, up, look in ((title["text"], y, font), (subtitle.get("text"), below, small)):
        if text:
            at = (x / width, up / height)
            put_text(canvas.figure, text, at, canvas.figure.transFigure, look, anchor=("left", "top"))


def _legend(canvas: Canvas, overlay: Any, traces: Sequence[Mapping[str, Any]], width: float) -> None:
    layout = canvas.layout.get("legend") or {}
    named = [t for t in traces if t.get("name") and t.get("showlegend") is not False and t.get("type") != "heatmap"]
    asked = canvas.layout.get("showlegend")
    if not named or asked is False or (asked is None and len(traces) < 2):
        return
    named.sort(key=lambda t: t.get("legendrank") or 1000)
    font = dict(canvas.font) | dict(layout.get("font") or {})
    size, flow = float(font["size"]), layout.get("orientation") or "v"
    handles, words = [legend_handle(t) for t in named], [flat(t["name"]) for t in named]
    columns = 1
    if flow == "h":
        # As Plotly: one row where all entries fit side by side, else columns as wide as the widest.
        widths, room = [52 + 0.56 * size * len(w) for w in words], canvas.plot[2] * width
        columns = len(words) if sum(widths) <= room else max(1, int(room // max(widths)))
        # Matplotlib fills column by column, Plotly row by row.
        order = [i for c in range(columns) for i in range(c, len(words), columns)]
        handles, words = [handles[i] for i in order], [words[i] for i in order]
    x, y = float(layout.get("x", 1.02)), float(layout.get("y", 1.0))
    vertical = "lower" if layout.get("yanchor") == "bottom" else "upper"
    left, bottom, plot_width, plot_height = canvas.plot
    title = layout.get("title") or {}
    overlay.legend(
        handles,
        words,
        loc=f"{vertical} {layout.get('xanchor') or 'left'}",
        bbox_to_anchor=(left + x * plot_width, bottom + y * plot_height),
        bbox_transform=canvas.figure.transFigure,
        ncols=columns,
        fontsize=size * PT,
        labelcolor=color(font["color"]),
        title=flat(title["text"]) if title.get("text") else None,
        title_fontsize=float((title.get("font") or {}).get("size", size)) * PT,
        alignment="left",
        frameon=False,
        borderaxespad=0.0,
        borderpad=0.2,
        labelspacing=0.55,
        handlelength=2.2,
        handletextpad=0.6,
        columnspacing=1.6,
    )
