"""Size of a finding: change of the force [N] by load, a panel for each posture and mount, a line a tendon."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from server.figures import graph_objects as go
from server.figures import marks
from server.figures.diagnosis_answer import (
    Answer,
    explanation_name,
    in_tendon_order,
    locations_in_order,
    named_rows,
    rows,
    shortened,
    text,
    vector,
)
from server.figures.sheet import Sheet
from server.figures.style import (
    TEXT_PX,
    NothingToDrawError,
    axis,
    load_styles,
    number,
    plain,
    posture_name,
    rgba,
)

MOST_PANELS = 20
_ACROSS, _PANEL, _GAP, _HEAD = 5, 150, 26, 30  # panels in a row; [px] height, beside, above
_MARGINS = (66, 20, 106, 56)  # [px]
_LONGEST = 18  # of a posture or mount in a heading [characters]


class Curve(NamedTuple):
    """The change of the force under one tendon: loads [g], change [N], and its 95 % band [N]."""

    posture: str
    location: str
    muscle: str
    load_g: list[float]
    change_N: list[float]
    low_N: list[float] | None
    high_N: list[float] | None


def curves(answer: Answer) -> list[Curve]:
    """Return the curves that state loads and changes."""
    out = []
    for row in rows(answer, "size", "curves"):
        load, change = vector(row.get("load_g")), vector(row.get("change_N"))
        if load is None or change is None or len(load) != len(change):
            continue
        low, high = vector(row.get("low_N")), vector(row.get("high_N"))
        whole = low is not None and high is not None and len(low) == len(high) == len(load)
        out.append(
            Curve(
                text(row, "posture"),
                text(row, "location"),
                text(row, "muscle", "none"),
                load,
                change,
                low if whole else None,
                high if whole else None,
            )
        )
    return out


def size_figure(answer: Answer) -> go.Figure:
    """Draw the change of the force against the load, all panels on one scale.

    Args:
        answer: of a diagnosis.

    Raises:
        NothingToDrawError: nothing was found, or its size was not worked out.
    """
    found = curves(answer)
    if not found:
        raise NothingToDrawError("The size is worked out for an effect that is found, and there is none.")
    places = locations_in_order(c.location for c in found)
    keys = [k for place in places for k in dict.fromkeys((c.posture, c.location) for c in found) if k[1] == place]
    total, keys = len(keys), keys[:MOST_PANELS]
    across = min(_ACROSS, max(sum(k[1] == place for k in keys) for place in places))
    spots = _spots(keys, across)
    sheet = Sheet((1 + max(row for row, _ in spots)) * (_PANEL + _HEAD), _MARGINS, showlegend=True)
    shown = [c for c in found if (c.posture, c.location) in keys]
    top = 1.06 * max(v for c in shown for v in [*c.change_N, *(c.high_N or [])]) or 1.0
    heaviest = 1.04 * max(v for c in shown for v in c.load_g) or 1.0
    order = in_tendon_order(c.muscle for c in shown)
    styles = load_styles(order)
    told: set[str] = set()
    for key, (row, column) in zip(keys, spots, strict=True):
        lowest = not any(r > row and c == column for r, c in spots)
        words = (posture_name(shortened(key[0], _LONGEST)), plain(shortened(key[1], _LONGEST)))
        axes = sheet.panel(
            axis("load [g]" if lowest else "", range=[0.0, heaviest], nticks=5, showticklabels=lowest),
            axis("change [N]" if column == 0 else "", range=[0.0, top], nticks=5, showticklabels=column == 0),
            **sheet.grid(row, column, across, _PANEL, (_GAP, _HEAD), _HEAD),
            heading=", at the ".join(t for t in words if t),
            size=TEXT_PX - 1,
        )
        own = [c for muscle in order for c in shown if (c.posture, c.location) == key and c.muscle == muscle]
        for curve in own:
            sheet.data += _traces(curve, styles[curve.muscle], axes, named=curve.muscle not in told)
            told.add(curve.muscle)
    named = [shortened(explanation_name(r), 50) for r in named_rows(answer)]
    cut = f" The first {len(keys)} of {total} panels." if total > len(keys) else ""
    return sheet.drawn(
        "Size of the effect" + (f": {plain(named[0])}" if named else ""),
        f"Norm of the force's change under each tendon alone; bands: 95 %. All panels on one scale.{cut}",
        legend_px=6,
    )


def _spots(keys: Sequence[tuple[str, str]], across: int) -> list[tuple[int, int]]:
    """Return the row and column of each panel; each mount begins a row of its own."""
    out: list[tuple[int, int]] = []
    row, column = 0, -1
    for k, key in enumerate(keys):
        column += 1
        if column == across or (k and key[1] != keys[k - 1][1]):
            row, column = row + 1, 0
        out.append((row, column))
    return out


def _traces(curve: Curve, style: Any, axes: dict[str, str], *, named: bool) -> list[go.Scatter]:
    place: dict[str, Any] = {"legendgroup": curve.muscle, **axes}
    out = []
    if curve.low_N is not None and curve.high_N is not None and len(curve.load_g) > 1:
        out.append(marks.band(curve.load_g, curve.low_N, curve.high_N, rgba(style.color, 0.18), place))
    out.append(
        marks.points(
            curve.load_g,
            curve.change_N,
            {"symbol": style.symbol, "size": 6, "color": style.color},
            _hover(curve),
            mode="lines+markers",
            line={"color": style.color, "width": 2},
            name=plain(curve.muscle),
            showlegend=named,
            **place,
        )
    )
    return out


def _hover(curve: Curve) -> list[str]:
    band = zip(curve.low_N or [], curve.high_N or [], strict=True)
    bands = [f" ({number(a, 3)}–{number(b, 3)})" for a, b in band] or [""] * len(curve.load_g)
    return [
        f"{plain(curve.muscle)} {load:g} g changes it by {number(change, 3)} N{said}"
        for load, change, said in zip(curve.load_g, curve.change_N, bands, strict=True)
    ]
