"""Plotly's colours, dashes and marked-up text in Matplotlib's terms."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import ScaledTranslation, Transform

from server.figures.static_schema import UnsupportedFigureError

PT = 0.75  # points in a pixel, at 96 pixels an inch
LINE_HEIGHT = 1.3  # Plotly's distance of lines, in font sizes
Color = tuple[float, float, float, float] | str

_TAG = re.compile(r"<[^>]*>")
_RGB = re.compile(r"rgba?\(([^)]*)\)")


def color(value: Any) -> Color:
    """Convert `#rrggbb`, `rgb()`, `rgba()` or a CSS name."""
    from matplotlib.colors import to_rgba

    text = str(value).strip()
    if text in ("", "none", "transparent"):
        return "none"
    if match := _RGB.fullmatch(text.replace(" ", "")):
        parts = [float(v) for v in match[1].split(",")]
        alpha = parts[3] if len(parts) > 3 else 1.0
        return (parts[0] / 255, parts[1] / 255, parts[2] / 255, alpha)
    try:
        return to_rgba(text)
    except ValueError as error:
        raise UnsupportedFigureError(f"colour {text!r} is not understood") from error


def dashes(name: str | None, width_px: float) -> Any:
    """Convert a dash by name or as pixels (`4px,2px`), in points."""
    if name in (None, "", "solid"):
        return "-"
    unit = max(width_px, 3.0)
    named = {"dot": (1, 1), "dash": (3, 3), "longdash": (5, 5), "dashdot": (3, 1, 1, 1), "longdashdot": (5, 2, 1, 2)}
    if name in named:
        return (0, tuple(unit * n * PT for n in named[name]))
    try:
        return (0, tuple(float(p.strip().removesuffix("px")) * PT for p in str(name).split(",")))
    except ValueError as error:
        raise UnsupportedFigureError(f"dash {name!r} is not understood") from error


def text_lines(marked: object) -> list[tuple[str, str, str]]:
    """Split marked-up text into lines of (text, weight, style).

    Raises:
        UnsupportedFigureError: markup other than `<br>`, or than `<b>` and `<i>` about whole lines.
    """
    out = []
    for raw in re.split(r"<br\s*/?>", str(marked)):
        line, weight, style = raw.strip(), "normal", "normal"
        while match := re.fullmatch(r"<(b|i)>(.*)</\1>", line):
            weight, style = ("bold", style) if match[1] == "b" else (weight, "italic")
            line = match[2]
        if tag := _TAG.search(line):
            raise UnsupportedFigureError(f"markup {tag[0]!r} in {str(marked)!r} is not drawn")
        out.append((html.unescape(line), weight, style))
    return out


def flat(marked: object) -> str:
    """Return text without its markup, lines kept."""
    return "\n".join(line for line, _, _ in text_lines(marked))


def put_text(
    figure: Figure,
    marked: object,
    at: tuple[float, float],
    transform: Transform,
    font: Mapping[str, Any],
    *,
    anchor: tuple[str, str],
    align: str | None = None,
    shift_px: tuple[float, float] = (0.0, 0.0),
    zorder: float = 10.0,
    **box: Any,
) -> None:
    """Write marked-up text at a point; lines may differ in weight where the block is aligned as it is anchored.

    Args:
        figure: that it belongs to.
        marked: with `<br>`, and `<b>` and `<i>` about whole lines.
        at: its place.
        transform: of that place.
        font: size [px] and color.
        anchor: which side of the block is there: left, center or right, and top, center or bottom.
        align: of the lines within the block.
        shift_px: right and up.
        zorder: of drawing.
        box: bbox and the like.
    """
    horizontal, vertical = anchor
    size_px, lines = float(font["size"]), text_lines(marked)
    looks = {(weight, style) for _, weight, style in lines}
    blocks = [lines]
    if len(looks) > 1:
        if (align or horizontal) != horizontal:
            raise UnsupportedFigureError(f"mixed weights in {str(marked)!r} need to be aligned as they are anchored")
        blocks = [[line] for line in lines]
    step = size_px * LINE_HEIGHT
    first = {"top": 0.0, "center": (len(blocks) - 1) * step / 2, "bottom": (len(blocks) - 1) * step}[vertical]
    lines_at: Any = align or horizontal
    for index, block in enumerate(blocks):
        x, y = shift_px[0], shift_px[1] + first - index * step
        moved = transform + ScaledTranslation(x * PT / 72, y * PT / 72, figure.dpi_scale_trans)
        text = Text(
            at[0],
            at[1],
            "\n".join(line for line, _, _ in block),
            transform=moved,
            fontsize=size_px * PT,
            color=color(font["color"]),
            weight=block[0][1],
            style=block[0][2],
            ha=horizontal,
            va=vertical,
            multialignment=lines_at,
            linespacing=LINE_HEIGHT * 0.92,
            zorder=zorder,
            **box,
        )
        figure.add_artist(text)
        text.set_clip_on(False)
