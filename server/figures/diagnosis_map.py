"""Map of residuals in standard uncertainties by loaded tendon and posture, a panel for each mount."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from fingermodel.fingers import PLANES, Plane
from server.figures import graph_objects as go
from server.figures import marks
from server.figures.diagnosis_answer import (
    Answer,
    after_which_fit,
    in_tendon_order,
    locations_in_order,
    mount_name,
    muscles_of,
    plane_of,
    rows,
    shortened,
    value,
)
from server.figures.sheet import Sheet
from server.figures.style import (
    GRID,
    INK,
    SMALL_PX,
    WIDTH,
    NothingToDrawError,
    colorbar,
    named_axis,
    number,
    plain,
    posture_name,
)

# One scale for every session, so that colours compare: pale where noise explains the residual, dark far beyond.
_COLORS = ("#eef1f5", "#fbe6c0", "#f0b35c", "#dd7a2b")
_LOW, _HIGH = 0.5, 20.0
_TICKS = (0.5, 1, 2, 5, 10, 20)
_ROW, _TOP, _BOTTOM, _RIGHT, _BETWEEN = 27, 100, 64, 90, 34  # [px]
_WIDEST, _NARROWEST = 96, 34  # of a cell [px]
_LONGEST = 24  # of a label [characters]
_FRAME: dict[str, Any] = {"showgrid": False, "linecolor": GRID, "mirror": True}


class Cell(NamedTuple):
    """Residuals of the cases of one tendon, posture and mount."""

    cases: int
    rmse_N: float | None
    z_rms: float | None


def residual_map(answer: Answer) -> go.Figure:
    """Draw the root mean square z of every tendon and posture after a fit; what was not tested stays empty.

    Args:
        answer: of a diagnosis.

    Raises:
        NothingToDrawError: no cell.
    """
    cells = _cells(answer)
    if not any(c.z_rms is not None for c in cells.values()):
        raise NothingToDrawError("There is no residual to show by tendon and posture.")
    locations = locations_in_order(where for where, _, _ in cells)
    muscles = in_tendon_order(m for _, m, _ in cells)
    postures = list(dict.fromkeys(p for _, _, p in cells))
    left = 30 + 8 * max(len(shortened(m, _LONGEST)) for m in muscles)
    room = WIDTH - left - _RIGHT - _BETWEEN * (len(locations) - 1)
    width = max(_NARROWEST, min(_WIDEST, room // (len(locations) * len(postures)))) * len(postures)
    plot = width * len(locations) + _BETWEEN * (len(locations) - 1)
    turned = width / len(postures) < 6.4 * max(len(line) for p in postures for line in _lines(p).split("<br>"))
    bottom = round(6.4 * max(len(_name(p)) for p in postures)) + 20 if turned else _BOTTOM
    margins = (left, max(WIDTH - left - plot, _RIGHT), _TOP, bottom)
    sheet = Sheet(_ROW * len(muscles), margins, wide=plot)
    across = [_name(p) if turned else _lines(p) for p in postures]
    down = [plain(shortened(m, _LONGEST)) for m in muscles]
    for index, location in enumerate(locations):
        axes = sheet.panel(
            named_axis(
                range(len(postures)), across, (-0.5, len(postures) - 0.5), tickangle=-90 if turned else 0, **_FRAME
            ),
            named_axis(range(len(muscles)), down, (len(muscles) - 0.5, -0.5), showticklabels=index == 0, **_FRAME),
            left=index * (width + _BETWEEN),
            wide=width,
            heading=plain(shortened(mount_name(location), 40)),
        )
        sheet.data.append(_panel(cells, location, muscles, postures, axes, last=index == len(locations) - 1))
    return sheet.drawn(f"Where the model fails, {plain(after_which_fit(answer))}", _subtitle(cells, plane_of(answer)))


def _cells(answer: Answer) -> dict[tuple[str, str, str], Cell]:
    """Return cells by mount, tendons and posture; those that come twice are pooled."""
    out: dict[tuple[str, str, str], Cell] = {}
    for row in rows(answer, "where", "cells"):
        key = (str(row.get("location", "")), muscles_of(row), str(row.get("posture", "")))
        new = Cell(int(value(row.get("cases")) or 1), value(row.get("rmse_N")), value(row.get("z_rms")))
        out[key] = _pooled(out[key], new) if key in out else new
    return out


def _pooled(a: Cell, b: Cell) -> Cell:
    def both(x: float | None, y: float | None) -> float | None:
        if x is None or y is None:
            return y if x is None else x
        return math.sqrt((a.cases * x**2 + b.cases * y**2) / (a.cases + b.cases))

    return Cell(a.cases + b.cases, both(a.rmse_N, b.rmse_N), both(a.z_rms, b.z_rms))


def _panel(
    cells: dict[tuple[str, str, str], Cell],
    location: str,
    muscles: Sequence[str],
    postures: Sequence[str],
    axes: dict[str, str],
    *,
    last: bool,
) -> go.Heatmap:
    grid = [[cells.get((location, m, p)) for p in postures] for m in muscles]
    shown = [[None if c is None else c.z_rms for c in line] for line in grid]
    common = {"role": "identification", "location": location}
    ticks = [f"{t:g}" for t in _TICKS[:-1]] + [f"≥ {_TICKS[-1]:g}"]
    return marks.cells(
        [[None if z is None else math.log10(min(max(z, _LOW), _HIGH)) for z in line] for line in shown],
        (math.log10(_LOW), math.log10(_HIGH)),
        [(k / (len(_COLORS) - 1), c) for k, c in enumerate(_COLORS)],
        [["" if z is None else number(z, 0 if z >= 99.95 else 1) for z in line] for line in shown],
        [[_hover(location, m, p, cells.get((location, m, p))) for p in postures] for m in muscles],
        textfont={"size": SMALL_PX + 1, "color": INK},
        xgap=2,
        ygap=2,
        meta={"select": [[common | {"muscles": m, "posture": p} for p in postures] for m in muscles]},
        showscale=last,
        colorbar=colorbar("z", [math.log10(t) for t in _TICKS], ticks),
        **axes,
    )


def _hover(location: str, muscles: str, posture: str, cell: Cell | None) -> str:
    if cell is None:
        return ""
    many = f"{cell.cases} case{'' if cell.cases == 1 else 's'}"
    what = f"<b>{plain(muscles)}</b> {posture_name(posture)}, {plain(location)}: {many}"
    return f"{what}<br>z {number(cell.z_rms, 1)}, RMSE {number(cell.rmse_N, 3)} N"


def _subtitle(cells: dict[tuple[str, str, str], Cell], plane: Plane) -> str:
    (location, muscles, posture), worst = max(cells.items(), key=lambda item: item[1].z_rms or 0.0)
    case = f"{plain(shortened(muscles, _LONGEST))}, {_name(posture).lower()}, {plain(shortened(location, _LONGEST))}"
    found = f"Worst: {case}, z = {number(worst.z_rms, 1)}"
    noise = number(math.sqrt(PLANES[plane]), 1)
    what = f"Norm of the residual in standard uncertainties, z, root mean square over cases (noise alone: {noise})."
    return f"{what}<br>{found}. Empty: not tested."


def _name(posture: str) -> str:
    return posture_name(shortened(posture, _LONGEST))


def _lines(posture: str) -> str:
    """Return a posture's name, a long one on two lines."""
    name = _name(posture)
    return name.replace(" ", "<br>", 1) if len(name) > 9 else name
