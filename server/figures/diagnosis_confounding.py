"""Separability of effects by the load cases: similarity of the traces of every two, with their classes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from server.figures import graph_objects as go
from server.figures import marks
from server.figures.diagnosis_answer import DETECTABLE, Answer, effect_name, part, shortened, value, words
from server.figures.sheet import Sheet, shape
from server.figures.style import (
    GRID,
    INK,
    SMALL_PX,
    WIDTH,
    NothingToDrawError,
    colorbar,
    fixed,
    named_axis,
    number,
    plain,
)

MOST = 32
_TOP, _BOTTOM, _RIGHT = 92, 20, 90  # [px]
_LEAST_CELL, _MOST_CELL = 19, 46  # [px]
_LONGEST = 30  # of a label [characters]
_COLORS = ((0.0, "#f4f6f8"), (0.5, "#d3dfea"), (0.9, "#7fb0d6"), (1.0, "#4f94c8"))


def classes_of(answer: Answer) -> list[list[str]]:
    """Return the classes of two effects and more that the data cannot tell apart."""
    found = part(answer, "confounding").get("classes")
    several = [words(c) for c in found] if isinstance(found, list | tuple) else []
    return [c for c in several if len(c) > 1]


def confounding_figure(answer: Answer) -> go.Figure:
    """Draw the largest canonical correlation of every two effects, classes next to each other and outlined.

    Args:
        answer: of a diagnosis.

    Raises:
        NothingToDrawError: fewer than two effects.
    """
    names, matrix = _matrix(answer)
    if len(names) < 2:
        raise NothingToDrawError("There are not two effects whose traces could be compared.")
    detectability = {str(k): value(v) for k, v in part(answer, "detectability").items()}
    total = len(names)
    if total > MOST:
        weight = {n: (any(n in c for c in classes_of(answer)), detectability.get(n) or 0.0) for n in names}
        names = sorted(names, key=lambda n: weight[n], reverse=True)[:MOST]
    order, classes = _by_class(names, classes_of(answer))
    labels = [_label(n, detectability) for n in order]
    columns = [shortened(effect_name(n), _LONGEST) for n in order]
    left = 24 + round(6.4 * max(len(t) for t in labels))
    room = WIDTH - left - _RIGHT
    cell = max(_LEAST_CELL, min(_MOST_CELL, room // len(order)))
    plot, below = cell * len(order), round(6.2 * max(len(t) for t in columns)) + 12
    z = [[1.0 if a == b else matrix.get((a, b)) for b in order] for a in order]
    heat = marks.cells(
        z,
        (0.0, 1.0),
        _COLORS,
        [[_number(v, i == k, cell) for k, v in enumerate(line)] for i, line in enumerate(z)],
        [[_hover(a, b, matrix.get((a, b))) for b in order] for a in order],
        textfont={"size": 9 if cell < 26 else SMALL_PX, "color": INK},
        xgap=1,
        ygap=1,
        colorbar=colorbar("alike", [0, 0.5, 0.9, 1], ["0", "0.5", "0.9", "1"]),
    )
    frame: dict[str, Any] = {"showgrid": False, "linecolor": GRID}
    sheet = Sheet(plot, (left, max(WIDTH - left - plot, _RIGHT), _TOP, _BOTTOM + below))
    sheet.panel(
        named_axis(range(len(order)), map(plain, columns), (-0.5, len(order) - 0.5), tickangle=-90, **frame),
        named_axis(range(len(order)), map(plain, labels), (len(order) - 0.5, -0.5), **frame),
    )
    sheet.data.append(heat)
    for first, last in classes:
        ends, line = (first - 0.5, last + 0.5), {"color": INK, "width": 2}
        sheet.shapes.append(shape(ends, ends, ("x", "y"), line=line, type="rect", layer="above"))
    return sheet.drawn("What these load cases can tell apart", _subtitle(total, len(order), classes, detectability))


def _matrix(answer: Answer) -> tuple[list[str], dict[tuple[str, str], float | None]]:
    names = words(part(answer, "confounding").get("effects"))
    lines = part(answer, "confounding").get("correlation")
    found: dict[tuple[str, str], float | None] = {}
    for a, line in zip(names, lines if isinstance(lines, list | tuple) else (), strict=False):
        for b, v in zip(names, line if isinstance(line, list | tuple) else (), strict=False):
            found[a, b] = value(v)
    return (names if found else []), found


def _by_class(names: Sequence[str], classes: Sequence[Sequence[str]]) -> tuple[list[str], list[tuple[int, int]]]:
    """Order effects so that a class stands together; return the first and last place of each class too."""
    order: list[str] = []
    places = []
    for one in classes:
        own = [n for n in one if n in names and n not in order]
        if len(own) > 1:
            places.append((len(order), len(order) + len(own) - 1))
            order += own
    return [*order, *(n for n in names if n not in order)], places


def _label(name: str, detectability: dict[str, float | None]) -> str:
    d = detectability.get(name)
    spoken = shortened(effect_name(name), _LONGEST)
    return spoken if d is None else f"{spoken}, d = {number(d, 1)}"


def _number(v: float | None, own: bool, cell: int) -> str:
    """Return the correlation for a cell; small ones are left to the colour where cells are small."""
    if v is None or own or (cell < 40 and v < 0.5):
        return ""
    return fixed(v, 2).removeprefix("0") if v < 0.995 else "1"


def _hover(a: str, b: str, v: float | None) -> str:
    return "" if v is None or a == b else f"{plain(effect_name(a))}<br>{plain(effect_name(b))}<br>{number(v, 3)}"


def _subtitle(total: int, shown: int, classes: Sequence[Any], detectability: dict[str, float | None]) -> str:
    text = "1: two effects leave the same trace in the readings; 0: quite different ones."
    if classes:
        text += " Outlined: one class, not to be told apart."
    if any(v is not None for v in detectability.values()):
        text += f"<br>d: typical size of an effect against noise and budget; below {DETECTABLE:g} it cannot be seen."
    return text + (f" {shown} of {total} effects are drawn." if shown < total else "")
