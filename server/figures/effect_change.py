"""Change of the forces by an effect in the cases of a session, beside the model's residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fingermodel.comparison.comparison import CaseComparison, Comparison
from fingermodel.fingers import PLANES, Plane
from server.figures import graph_objects as go
from server.figures import marks
from server.figures.sheet import Sheet, shape
from server.figures.style import (
    COMPONENT_AXES,
    COMPONENT_SENSES,
    GRID,
    INK,
    MUTED,
    ZERO_LINE,
    NothingToDrawError,
    axis,
    case_text,
    in_order,
    load_styles,
    named_axis,
    number,
    plain,
)

Floats = NDArray[np.float64]

# Beyond so many cases a bar is no longer seen.
MOST_CASES = 150
_PANEL, _GAP, _MARGINS = 170, 30, (66, 20, 112, 118)  # [px]
# Less than this is nothing that a cell could read [N].
_NOTHING_N = 1e-6


@dataclass(frozen=True)
class Setting:
    """A parameter of the effect and the value that it is given."""

    name: str  # of the parameter
    value: float  # that it is given
    unit: str  # of that value
    why: str  # where the value comes from, in a few words


def effect_figure(
    title: str,
    without: Comparison,
    within: Comparison,
    settings: Sequence[Setting],
    *,
    plane: Plane = "space",
    held: bool = False,
) -> go.Figure:
    """Draw the change of every predicted force component as bars, and as circles what the model misses without it.

    Args:
        title: of the effect.
        without: the session compared with the model, the effect at its null.
        within: the same cases, the effect at its settings.
        settings: of its parameters.
        plane: which components: x and y, or z too.
        held: whether the model holds the effect as fitted; `layout.meta` tells it beside the case changed most.

    Raises:
        NothingToDrawError: no case, nothing that the effect acts on, or no force that it changes.
    """
    if not settings:
        raise NothingToDrawError("This finger has nothing that the effect acts on.")
    after = {c.id: c for c in within.cases}
    pairs = [(c, after[c.id].predicted_N - c.predicted_N) for c in _sorted(without.cases)]
    count = PLANES[plane]
    sizes = [float(np.linalg.norm(change[:count])) for _, change in pairs]
    if not sizes or not np.isfinite(sizes).all():
        raise NothingToDrawError("There is no load case whose change could be drawn.")
    if max(sizes) < _NOTHING_N:
        raise NothingToDrawError("The effect changes no force of these load cases.")
    # Of changes that are alike the first one, as wherever else the case that is changed most is named.
    largest = min(range(len(sizes)), key=lambda k: (-round(sizes[k], 3), pairs[k][0].id))
    said = f"{number(sizes[largest], 3)} N in {plain(pairs[largest][0].id)}"
    least = sorted(sizes, reverse=True)[:MOST_CASES][-1]
    drawn = [p for p, size in zip(pairs, sizes, strict=True) if size >= least][:MOST_CASES]
    meta = {"case": pairs[largest][0].id, "held": held}
    sheet = Sheet(count * _PANEL + (count - 1) * _GAP, _MARGINS, bargap=0.15, showlegend=True, meta=meta)
    for index in range(count):
        _panel(sheet, drawn, index, last=index == count - 1)
    left_out = len(pairs) - len(drawn)
    cut = f" The {len(drawn)} cases that it changes most, {left_out} others are left out." if left_out else ""
    return sheet.drawn(
        f"What it would change here: {plain(title)}",
        f"{_given(settings)}<br>Largest change: {said}.{cut}",
        legend_px=34 - _MARGINS[3],
    )


def _sorted(cases: Sequence[CaseComparison]) -> list[CaseComparison]:
    """Return cases by mount, tendons, posture and weight, as they stand on the axis."""
    muscles, postures = in_order(c.muscles for c in cases), list(dict.fromkeys(c.posture for c in cases))
    places = {"tip": 0, "bone": 1}
    return sorted(
        cases,
        key=lambda c: (
            places.get(c.location, 2),
            muscles.index(c.muscles),
            postures.index(c.posture),
            sum(c.masses_g.values()),
        ),
    )


def _panel(sheet: Sheet, pairs: Sequence[tuple[CaseComparison, Floats]], index: int, *, last: bool) -> None:
    """Draw bars and circles of one component, and the bounds between tendons."""
    cases = [c for c, _ in pairs]
    changes = [float(change[index]) for _, change in pairs]
    missing = [float(c.measured_N[index] - c.predicted_N[index]) for c in cases]
    styles = load_styles(in_order(c.muscles for c in cases))
    words = [
        f"{case_text(c)}<br>{COMPONENT_AXES[index]}: the effect changes it by {number(change, 3)} N"
        f"<br>measured − predicted without it {number(rest, 3)} N"
        for c, change, rest in zip(cases, changes, missing, strict=True)
    ]
    at = list(range(len(cases)))
    groups = _groups(cases)
    axes = sheet.panel(
        named_axis(
            [0.5 * (a + b - 1) for _, a, b in groups],
            [name for name, _, _ in groups],
            (-0.7, len(cases) - 0.3),
            tickangle=-60,
            showticklabels=last,
            showgrid=False,
            showline=False,
        ),
        axis(f"{COMPONENT_AXES[index]} [N], {COMPONENT_SENSES[index]} +", nticks=5, **ZERO_LINE)
        | {"zerolinecolor": MUTED},
        top=index * (_PANEL + _GAP),
        high=_PANEL,
    )
    on = (axes["xaxis"], f"{axes['yaxis']} domain")
    sheet.shapes += [
        shape((begin - 0.5, begin - 0.5), (0, 1), on, line={"color": GRID, "width": 1}) for _, begin, _ in groups[1:]
    ]
    circle = {"color": INK, "symbol": "circle-open", "size": 6, "line": {"width": 1.2}}
    colors, ids = [styles[c.muscles].color for c in cases], [c.id for c in cases]
    shared: dict[str, Any] = {"showlegend": index == 0, **axes}
    name = "change by the effect (colour: the loaded tendon)"
    sheet.data.append(
        marks.bars(at, changes, colors, words, name=name, meta={"kind": "change", "cases": ids}, **shared)
    )
    name = "measured − predicted without the effect"
    sheet.data.append(marks.points(at, missing, circle, name=name, meta={"kind": "missing", "cases": ids}, **shared))


def _groups(cases: Sequence[CaseComparison]) -> list[tuple[str, int, int]]:
    """Return (name, first, end) of neighbouring cases of one mount and one set of tendons."""
    out: list[tuple[str, int, int]] = []
    for name, own in groupby(f"{case.location} {plain(case.muscles)}" for case in cases):
        first = out[-1][2] if out else 0
        out.append((name, first, first + len(list(own))))
    return out


def _given(settings: Sequence[Setting]) -> str:
    """Say what the parameters are set to, the first few of them."""
    units = {"1": ""}
    told = [f"{plain(s.name)} = {_short(s.value)} {units.get(s.unit, plain(s.unit))}".rstrip() for s in settings[:3]]
    more = f" and {len(settings) - 3} more" if len(settings) > 3 else ""
    whys = ", ".join(dict.fromkeys(s.why for s in settings))
    return f"{', '.join(told)}{more} ({whys})."


def _short(value: float) -> str:
    return f"{value:.3g}".replace("-", "\N{MINUS SIGN}")
