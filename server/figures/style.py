"""Common style of all figures: colours and symbols of the tendons, fonts, axes, number formats.

Colours are those of Okabe and Ito, told apart with every common colour blindness; a symbol says the same again.
"""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from fingermodel.comparison.comparison import CaseComparison, ErrorSummary
    from fingermodel.fingers import Plane

WIDTH = 960
FONT = "Helvetica, Arial, 'Liberation Sans', 'DejaVu Sans', sans-serif"
INK = "#222222"
MUTED = "#6b6b6b"
GRID = "#e6e6e6"
BAND = "#e2eaf4"
TEXT_PX = 13
SMALL_PX = 11

PLANE_NAMES = {"sagittal": "in the sagittal plane", "space": "in space"}
COMPONENT_AXES = ("Fx", "Fy", "Fz")
COMPONENT_SENSES = ("proximal", "dorsal", "radial")


class NothingToDrawError(ValueError):
    """A figure has no case to show; the message is a sentence for the reader."""

    @property
    def sentence(self) -> str:
        """Sentence in place of the figure."""
        text = str(self)
        return f"No figure: {text[:1].lower()}{text[1:]}"


@dataclass(frozen=True)
class LoadStyle:
    """Colour and Plotly symbol of one loaded tendon or combination of tendons."""

    color: str
    symbol: str


TENDONS = {
    "FDP": LoadStyle("#0072B2", "circle"),
    "FDS": LoadStyle("#56B4E9", "square"),
    "EDC": LoadStyle("#E69F00", "triangle-up"),
    "RI": LoadStyle("#D55E00", "diamond"),
    "UI": LoadStyle("#CC79A7", "triangle-down"),
    "LU": LoadStyle("#009E73", "cross"),
    "FDP+FDS": LoadStyle("#5B2A86", "x"),
    "EDC+FDP": LoadStyle("#7A6A00", "hexagon"),
    "FDP+LU": LoadStyle("#0B5345", "pentagon"),
    "none": LoadStyle("#7f7f7f", "circle"),
}
_OTHERS = tuple(
    LoadStyle(color, symbol)
    for symbol in ("star", "pentagon", "hexagon", "x", "diamond")
    for color in ("#332288", "#117733", "#AA4499", "#882255", "#44AA99", "#444444")
)


def load_styles(names: Iterable[str]) -> dict[str, LoadStyle]:
    """Give every tendon or combination its style; those not known here take the next free one in their order."""
    out: dict[str, LoadStyle] = {}
    free = 0
    for name in dict.fromkeys(names):
        if name in TENDONS:
            out[name] = TENDONS[name]
        else:
            out[name] = _OTHERS[free % len(_OTHERS)]
            free += 1
    return out


def in_order(names: Iterable[str]) -> list[str]:
    """Sort tendons as the palette has them, single ones before combinations, unknown ones last."""
    known = list(TENDONS)
    present = list(dict.fromkeys(names))
    return sorted(present, key=lambda n: (n.count("+"), known.index(n) if n in known else len(known)))


def mix(color: str, other: str, share: float) -> str:
    """Return `color` with a share (0–1) of `other`, both `#rrggbb`."""
    a, b = (np.array([int(c[i : i + 2], 16) for i in (1, 3, 5)]) for c in (color, other))
    return "#" + "".join(f"{round(v):02x}" for v in (1.0 - share) * a + share * b)


def rgba(color: str, alpha: float) -> str:
    """Return `#rrggbb` with an opacity."""
    r, g, b = (int(color[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({r},{g},{b},{alpha:g})"


def plain(text: object) -> str:
    """Escape a name that a user chose, so that Plotly shows it as it is."""
    return html.escape(" ".join(str(text).split()), quote=False)


def posture_name(name: str) -> str:
    """Write a posture's name for reading: `major_flexion` as `Major flexion`, `HyperExt` as `Hyper ext`."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name.replace("_", " ")).strip()
    return plain(words[:1].upper() + words[1:].lower()) if words.isascii() else plain(words)


def number(value: float | None, digits: int = 2) -> str:
    """Write a number with a proper minus sign; what is too small for the digits in two significant ones."""
    if value is None or not np.isfinite(value):
        return "–"
    small = 0 < abs(value) < 0.5 * 10.0**-digits
    return f"{value:.2g}".replace("-", "\N{MINUS SIGN}") if small else fixed(value, digits)


def fixed(value: float, digits: int) -> str:
    """Write a number with so many decimals and a proper minus sign."""
    return f"{value:z.{digits}f}".replace("-", "\N{MINUS SIGN}")


def other_plane(plane: Plane) -> Plane:
    """Return that of sagittal and space which is not the given one."""
    return "space" if plane == "sagittal" else "sagittal"


def rmse_text(errors: ErrorSummary) -> str:
    """Write RMSE and relative RMSE, such as `0.11 N (10.7 %)`."""
    return f"{number(errors.rmse_N)} N ({number(errors.rmse_rel_pct, 1)} %)"


def load_text(masses_g: Mapping[str, float]) -> str:
    """Name a load with its masses, not escaped: `FDP 950 g`, `FDP+FDS 300 g each`, `FDP+LU 600 + 200 g`."""
    hung = {m: mass for m, mass in sorted(masses_g.items()) if mass}
    if not hung:
        return "no load"
    name, masses = "+".join(hung), [f"{mass:g}" for mass in hung.values()]
    if len(masses) > 1 and len(set(masses)) == 1:
        return f"{name} {masses[0]} g each"
    return f"{name} {' + '.join(masses)} g"


def case_text(case: CaseComparison) -> str:
    """Name a case for the pointer: id, load, posture, location and role."""
    where = f"{posture_name(case.posture)}, {plain(case.location)}, {plain(case.role)}"
    return f"<b>{plain(case.id)}</b> {plain(load_text(case.masses_g))}<br>{where}"


def axis(title: str = "", **changes: Any) -> dict[str, Any]:
    """Return an axis: thin line and ticks outside, pale grid, no zero line."""
    out: dict[str, Any] = {
        "showline": True,
        "linecolor": INK,
        "linewidth": 1,
        "ticks": "outside",
        "ticklen": 4,
        "tickcolor": INK,
        "tickfont": {"size": SMALL_PX, "color": INK},
        "showgrid": True,
        "gridcolor": GRID,
        "gridwidth": 1,
        "zeroline": False,
    }
    if title:
        out["title"] = {"text": title, "font": {"size": TEXT_PX, "color": INK}, "standoff": 8}
    return out | changes


def named_axis(places: Iterable[float], names: Iterable[str], span: Sequence[float], **changes: Any) -> dict[str, Any]:
    """Return an axis over a span on which names, marked up, stand at places, without ticks."""
    return axis(tickvals=list(places), ticktext=list(names), range=list(span), ticks="") | changes


def colorbar(title: str, values: Sequence[float], words: Sequence[str]) -> dict[str, Any]:
    """Return a heatmap's scale of colours, as high as its panel."""
    return {
        "title": {"text": title, "side": "top", "font": {"size": TEXT_PX, "color": INK}},
        "thickness": 12,
        "len": 1.0,
        "tickfont": {"size": SMALL_PX, "color": INK},
        "tickvals": list(values),
        "ticktext": list(words),
        "outlinewidth": 0,
    }


def legend(offset_px: float, plot_px: float, *, at_right: bool = False) -> dict[str, Any]:
    """Return a legend in one line at the left.

    Args:
        offset_px: of its lower edge above the plot, or if negative of its upper edge below the plot.
        plot_px: height of the plot.
        at_right: whether it stands at the right instead.
    """
    above = offset_px > 0.0
    return {
        "orientation": "h",
        "x": float(at_right),
        "xanchor": "right" if at_right else "left",
        "y": float(above) + offset_px / plot_px,
        "yanchor": "bottom" if above else "top",
        "font": {"size": SMALL_PX + 1},
    }


# Of an axis: nothing of it is seen.
BARE: dict[str, Any] = {"showline": False, "showgrid": False, "showticklabels": False, "ticks": "", "zeroline": False}
# Of an axis: a line at zero.
ZERO_LINE: dict[str, Any] = {"zeroline": True, "zerolinecolor": INK, "zerolinewidth": 1}
# Of bars: their words stand beyond their ends, level, whole, and beyond the axes if need be.
OUTSIDE: dict[str, Any] = {
    "textposition": "outside",
    "textangle": 0,
    "constraintext": "none",
    "cliponaxis": False,
}


def whiskers(
    up: Sequence[float], color: str, down: Sequence[float] | None = None, *, thickness: float = 1, width: int = 3
) -> dict[str, Any]:
    """Return error bars: how far each reaches up, and down where that differs."""
    out = {"type": "data", "array": list(up), "color": color, "thickness": thickness, "width": width, "visible": True}
    return out if down is None else out | {"symmetric": False, "arrayminus": list(down)}
