"""The validation cases before and after: how far prediction and measurement are apart in each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from server.figures import graph_objects as go
from server.figures import marks
from server.figures.diagnosis_answer import (
    BETTER,
    WORSE,
    Answer,
    change_text,
    masses_of,
    plane_of,
    rows,
    shortened,
    vector,
)
from server.figures.sheet import Sheet, note
from server.figures.style import (
    COMPONENT_AXES,
    INK,
    PLANE_NAMES,
    SMALL_PX,
    NothingToDrawError,
    axis,
    load_text,
    named_axis,
    number,
    plain,
)

MOST_ROWS = 40
_ROW, _MARGINS = 22, (84, 112, 60)  # [px]; margins at the right, above and below
_LONGEST = 62  # of a label [characters]


class Held(NamedTuple):
    """One validation case: norms of its residual before and after [N], and of its uncertainty."""

    label: str
    before_N: float
    after_N: float
    sd_N: float | None
    hover: str


def held_out(answer: Answer) -> list[Held]:
    """Return the validation cases that state a force and both predictions, the worst before first."""
    count = 2 if plane_of(answer) == "sagittal" else 3
    out = []
    for case in rows(answer, "cases"):
        forces = [vector(case.get(k)) for k in ("measured_N", "before_N", "after_N")]
        if case.get("role") != "validation" or any(f is None or len(f) < count for f in forces):
            continue
        measured, before, after = ([*(f or ())][:count] for f in forces)
        sd = vector(case.get("measured_sd_N"))
        out.append(
            Held(
                _label(case),
                math.dist(measured, before),
                math.dist(measured, after),
                math.hypot(*sd[:count]) if sd else None,
                _hover(case, measured, before, after),
            )
        )
    return sorted(out, key=lambda h: -h.before_N)


def held_out_figure(answer: Answer) -> go.Figure:
    """Draw the residual of every validation case before and after, joined by a line, the worst before on top.

    Args:
        answer: of a diagnosis.

    Raises:
        NothingToDrawError: no validation case with both predictions.
    """
    cases = held_out(answer)
    if not cases:
        raise NothingToDrawError("There is no validation case with a prediction before and after.")
    total, cases = len(cases), cases[:MOST_ROWS]
    top = 1.06 * max(max(c.before_N, c.after_N, c.sd_N or 0.0) for c in cases) or 1.0
    labels = [shortened(c.label, _LONGEST) for c in cases]
    left = 30 + round(6.4 * max(len(t) for t in labels))
    fell = sum(c.after_N < c.before_N for c in cases)
    places = list(range(len(cases)))
    sheet = Sheet(_ROW * len(cases), (left, *_MARGINS), showlegend=True)
    minus = "\N{MINUS SIGN}"
    sheet.panel(
        axis(f"‖predicted {minus} measured‖ {PLANE_NAMES[plane_of(answer)]} [N]", range=[-0.015 * top, top]),
        named_axis(places, map(plain, labels), (len(cases) - 0.4, -0.6), showline=False),
    )
    sheet.data += [*_lines(cases), *_noise(cases, places), *_points(cases, places)]
    sheet.notes += [_change(c, i) for i, c in enumerate(cases)]
    many = f"The worst {len(cases)} of {total} cases" if total > len(cases) else f"{total} cases"
    return sheet.drawn(
        "Residuals of the validation cases, before and after",
        f"{many} for validation; the residual falls in {fell} of them. At the right the change [N].",
        legend_px=10,
    )


def _lines(cases: Sequence[Held]) -> list[go.Scatter]:
    out: list[go.Scatter] = []
    for falls, color, name in ((True, BETTER, "falls"), (False, WORSE, "rises")):
        own = [(i, c) for i, c in enumerate(cases) if (c.after_N <= c.before_N) == falls]
        if own:
            x = [v for _, c in own for v in (c.before_N, c.after_N, None)]
            y = [v for i, _ in own for v in (i, i, None)]
            out.append(marks.line(x, y, {"color": color, "width": 2.5}, name=name, legendrank=1003 + len(out)))
    return out


def _points(cases: Sequence[Held], places: Sequence[int]) -> list[go.Scatter]:
    return [
        marks.points(
            values,
            places,
            {"symbol": symbol, "size": 9, "color": INK},
            [c.hover for c in cases],
            name=name,
            legendrank=rank,
        )
        for rank, name, symbol, values in (
            (1001, "before", "circle-open", [c.before_N for c in cases]),
            (1002, "after", "circle", [c.after_N for c in cases]),
        )
    ]


def _noise(cases: Sequence[Held], places: Sequence[int]) -> list[go.Scatter]:
    known = [(c.sd_N, i) for c, i in zip(cases, places, strict=True) if c.sd_N is not None]
    x = [v for sd, _ in known for v in (sd, sd, None)]
    y = [v for _, i in known for v in (i - 0.34, i + 0.34, None)]
    return [marks.line(x, y, {"color": "#8a8a8a", "width": 2}, name="noise, 1 sd", legendrank=1005)] if known else []


def _change(case: Held, row: int) -> dict[str, Any]:
    color = BETTER if case.after_N <= case.before_N else WORSE
    text = change_text(case.before_N, case.after_N)
    return note(text, 1.0, row, ("paper", "y"), at=("left", "middle"), shift=(12, 0), size=SMALL_PX, color=color)


def _label(case: Answer) -> str:
    where = [str(w).replace("_", " ") for k in ("posture", "location") if (w := case.get(k))]
    return f"{case.get('id', '')}  {load_text(masses_of(case))}, {', '.join(where)}"


def _hover(case: Answer, measured: Sequence[float], before: Sequence[float], after: Sequence[float]) -> str:
    def force(values: Sequence[float]) -> str:
        return ", ".join(f"{a} {number(v, 3)}" for a, v in zip(COMPONENT_AXES, values, strict=False))

    lines = [f"<b>{plain(_label(case))}</b>", f"measured {force(measured)} N"]
    return "<br>".join([*lines, f"before {force(before)} N", f"after {force(after)} N"])
