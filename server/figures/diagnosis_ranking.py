"""The explanations that were tried, most probable first, with what each gains on the data and on validation cases."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from fingermodel.parameters import with_unit
from server.figures import graph_objects as go
from server.figures import marks
from server.figures.diagnosis_answer import (
    EFFECT_COLOR,
    ELSE_COLOR,
    NOTHING_COLOR,
    Answer,
    explanation_name,
    gains_of,
    kind,
    named_rows,
    probability_text,
    ranked,
    rows,
    shortened,
    value,
    with_sd,
)
from server.figures.sheet import Sheet, note, shape
from server.figures.style import BAND, INK, MUTED, OUTSIDE, SMALL_PX, NothingToDrawError, axis, mix, plain

MOST_ROWS = 12
_ROW, _MARGINS = 30, (20, 136, 40)  # [px]; margins at the right, above and below
_LONGEST = 38  # of a label [characters]
_KINDS = {
    "effects": (EFFECT_COLOR, "effects of the catalogue"),
    "nothing": (NOTHING_COLOR, "nothing missing"),
    "else": (ELSE_COLOR, "something outside the catalogue"),
}
_SYMBOLS = {"effects": "square", "nothing": "circle", "else": "diamond"}
_INKS = {"effects": INK, "nothing": MUTED, "else": "#8a5f00"}
# One axis spans the whole width: a sign of the kind, bars from 0 to 1, then columns of numbers.
_BEGIN, _END = -0.05, 2.75
_COLUMNS = (
    (0.58, "ln<br>evidence"),
    (0.78, "validation RMSE [N]<br>before → after"),
    (1.0, "size [N]<br>(95 %)"),
)


def shown_rows(answer: Answer) -> list[Answer]:
    """Return the rows that are drawn: the most probable, those that the verdict names, nothing, something else.

    A probability of exactly 0 marks an explanation that was fitted but not weighed against the others.
    """
    order, named = ranked(answer), named_rows(answer)
    kept = [r for r in order if value(r.get("probability")) != 0][:MOST_ROWS]
    return [r for r in order if r in kept or kind(r) != "effects" or r in named]


def ranking_figure(answer: Answer) -> go.Figure:
    """Draw the probability of every explanation as a bar, with its evidence, validation error and size beside it.

    Args:
        answer: of a diagnosis.

    Raises:
        NothingToDrawError: no explanation.
    """
    shown, named = shown_rows(answer), named_rows(answer)
    if not shown:
        raise NothingToDrawError("No explanation was ranked.")
    names = [_label(r) for r in shown]
    left = 34 + round(6.8 * max(len(line) for n in names for line in n))
    sheet = Sheet(_ROW * len(shown), (left, *_MARGINS), barmode="overlay", showlegend=True)
    sheet.panel(
        axis(
            range=[_BEGIN, _END],
            tickvals=[0, 0.25, 0.5, 0.75, 1.0],
            ticktext=["0", "0.25", "0.5", "0.75", "1"],
            showline=False,
            ticks="",
        ),
        axis(range=[len(shown) - 0.5, -0.5], visible=False),
    )
    sheet.data += [trace for which in _KINDS for trace in _bars(shown, named, which)]
    sheet.notes += [*_labels(shown, names, named), *_columns(shown)]
    # A pale band behind each row that the verdict names.
    sheet.shapes += [
        shape((0.0, 1.0), (i - 0.5, i + 0.5), ("paper", "y"), fillcolor=BAND) for i, r in enumerate(shown) if r in named
    ]
    return sheet.drawn("Explanations, most probable first", _subtitle(answer, shown, named), legend_px=38)


def _bars(shown: Sequence[Answer], named: Sequence[Answer], which: str) -> list[go.Bar | go.Scatter]:
    """Return bars of one kind of explanation, each with the sign of its kind before it."""
    color, name = _KINDS[which]
    own = [(i, r) for i, r in enumerate(shown) if kind(r) == which]
    if not own:
        return []
    inks = [color if r in named or which != "effects" else mix(color, "#ffffff", 0.45) for _, r in own]
    places = [i for i, _ in own]
    shown_bars = marks.bars(
        [value(r.get("probability")) or 0.0 for _, r in own],
        places,
        inks,
        [_hover(r) for _, r in own],
        orientation="h",
        width=0.62,
        text=[plain(probability_text(r.get("probability"))) for _, r in own],
        **OUTSIDE,
        textfont={"size": SMALL_PX + 1, "color": INK},
        name=name,
        legendgroup=which,
        showlegend=False,
    )
    sign = {"symbol": _SYMBOLS[which], "size": 9, "color": color}
    return [shown_bars, marks.points([0.5 * _BEGIN] * len(own), places, sign, name=name, legendgroup=which)]


def _labels(shown: Sequence[Answer], names: Sequence[Sequence[str]], named: Sequence[Answer]) -> list[dict[str, Any]]:
    """Return names of the rows, bold what the verdict names, and what the bars are."""
    start = -_BEGIN / (_END - _BEGIN)
    out = [_word("probability", start, 1.0, "paper", MUTED, 4) | {"xanchor": "left", "align": "left"}]
    for i, (row, lines) in enumerate(zip(shown, names, strict=True)):
        text = "<br>".join(f"<b>{plain(line)}</b>" if row in named else plain(line) for line in lines)
        out.append(_word(text, 0.0, i, "y", _INKS[kind(row)], 0) | {"xshift": -6})
    return out


def _columns(shown: Sequence[Answer]) -> list[dict[str, Any]]:
    out = []
    for (x, title), texts in zip(_COLUMNS, zip(*map(gains_of, shown), strict=True), strict=True):
        out.append(_word(title, x, 1.0, "paper", MUTED, 4))
        out += [_word(plain(text), x, i, "y", INK, 0) for i, text in enumerate(texts)]
    return out


def _label(row: Answer) -> list[str]:
    """Return lines of an explanation's name: two effects on two where they are long."""
    name = explanation_name(row) + (" *" if row.get("in_range") is False else "")
    first, plus, second = name.partition(" + ")
    lines = [f"{first} +", second] if plus and len(name) > 34 else [name]
    return [shortened(line, _LONGEST) for line in lines]


def _hover(row: Answer) -> str:
    lines = [f"<b>{plain(explanation_name(row))}</b>", f"probability {plain(probability_text(row.get('probability')))}"]
    for parameter in rows(row, "parameters"):
        found, sd = with_sd(parameter.get("value"), parameter.get("sd"))
        said = with_unit(f"{parameter.get('name', '')} = {found} ± {sd}", str(parameter.get("unit", "")))
        lines.append(plain(said))
    return "<br>".join(lines)


def _subtitle(answer: Answer, shown: Sequence[Answer], named: Sequence[Answer]) -> str:
    parts = ["Shaded: what the verdict names" if named else "The verdict names none of them"]
    rest = [r for r in ranked(answer) if r not in shown]
    if rest:
        together = sum(value(r.get("probability")) or 0.0 for r in rest)
        parts.append(f"{len(rest)} more, together {plain(probability_text(together))}, are not drawn")
    if any(r.get("in_range") is False for r in shown):
        parts.append("* a value outside its plausible range")
    return "; ".join(parts) + "."


def _word(text: str, x: float, y: float, yref: str, ink: str, shift: int) -> dict[str, Any]:
    at = ("right", "middle" if yref == "y" else "bottom")
    look: dict[str, Any] = {"size": SMALL_PX + 1, "color": ink, "align": "right"}
    return note(text, x, y, ("paper", yref), at=at, shift=(0, shift), **look)
