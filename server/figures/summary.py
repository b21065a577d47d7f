"""Errors in summary: RMSE by tendon, posture and location, and each case against its own uncertainty."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fingermodel.comparison.comparison import Comparison, ErrorSummary
from fingermodel.fingers import Plane
from server.figures import graph_objects as go
from server.figures import marks
from server.figures.sheet import Sheet
from server.figures.style import (
    INK,
    MUTED,
    OUTSIDE,
    PLANE_NAMES,
    SMALL_PX,
    NothingToDrawError,
    axis,
    in_order,
    number,
    plain,
    posture_name,
    rmse_text,
)

AFTER, BEFORE = "#3b5b7a", "#b9c6d3"
_BAR, _GROUP_GAP, _LEFT, _RIGHT, _TOP, _BOTTOM = 22, 40, 150, 60, 84, 54  # [px]

_SHARED = ("role", "location", "muscles", "posture")
# Label, and what the cases have in common.
Row = tuple[str, str | None, str | None, str | None, str | None]
Rows = list[Row]


def errors_figure(
    comparison: Comparison,
    *,
    before: Comparison | None = None,
    before_name: str = "before",
    model_name: str = "",
    plane: Plane = "sagittal",
) -> go.Figure:
    """Draw the RMSE by loaded tendon, by posture and by role, tip and bone apart, before and after.

    Args:
        comparison: of the model.
        before: of the model that it is held against.
        before_name: of that model.
        model_name: of this one.
        plane: in which the errors are taken.

    Raises:
        NothingToDrawError: no case.
    """
    groups = _groups(comparison)
    if not groups:
        raise NothingToDrawError("There is no load case to summarise.")
    per_bar = _BAR if before is None else _BAR + 8
    heights = [per_bar * len(rows) for _, rows in groups]
    half_gap = round(_GROUP_GAP / 2)
    sheet = Sheet(
        sum(heights) + _GROUP_GAP * len(groups),
        (_LEFT, _RIGHT, _TOP - half_gap, _BOTTOM),
        barmode="group",
        bargap=0.25,
        showlegend=before is not None,
    )
    half = (sheet.wide - 60) / 2
    measures = (("rmse_N", "RMSE [N]", 2), ("rmse_rel_pct", "RMSE [% of the mean measured force]", 1))
    models = [(model_name or "model", comparison, AFTER)]
    if before is not None:
        models.insert(0, (before_name, before, BEFORE))
    tops = [_largest(groups, models, plane, key) for key, _, _ in measures]
    top = 0
    for index, ((title, rows), height) in enumerate(zip(groups, heights, strict=True)):
        top += _GROUP_GAP
        last = index == len(groups) - 1
        for column, (key, unit, digits) in enumerate(measures):
            axes = sheet.panel(
                axis(
                    unit if last else "",
                    range=[0.0, 1.16 * tops[column]],
                    showticklabels=last,
                    ticks="outside" if last else "",
                    showline=last,
                    nticks=6,
                ),
                axis(
                    type="category",
                    categoryorder="array",
                    categoryarray=[r[0] for r in reversed(rows)],
                    range=[-0.5, len(rows) - 0.5],
                    showgrid=False,
                    showticklabels=column == 0,
                    ticks="",
                    linecolor=MUTED,
                ),
                left=column * (half + 60),
                top=top,
                wide=half,
                high=height,
                heading=plain(title[:1].upper() + title[1:]) if column == 0 else "",
                above=3,
            )
            for k, (name, one, color) in enumerate(models):
                shown = index == 0 and column == 0
                sheet.data.append(_bars(one, rows, plane, key, digits, name, color, axes, k, shown=shown))
        top += height
    return sheet.drawn(
        "Errors by tendon, posture and role",
        f"RMSE {PLANE_NAMES[plane]}; on the right relative to the mean measured force of the same cases",
        legend_px=8,
        at_right=True,
    )


def _groups(comparison: Comparison) -> list[tuple[str, Rows]]:
    """Return rows of (label, role, location, muscles, posture) under their headings."""
    groups: list[tuple[str, Rows]] = []
    for location in ("tip", "bone"):
        cases = comparison.select(location=location).cases
        if not cases:
            continue
        muscles = in_order(c.muscles for c in cases)
        postures = list(dict.fromkeys(c.posture for c in cases))
        if len(muscles) > 1:
            groups.append((f"{location}, by loaded tendon", [(plain(m), None, location, m, None) for m in muscles]))
        if len(postures) > 1:
            groups.append((f"{location}, by posture", [(posture_name(p), None, location, None, p) for p in postures]))
    keys = dict.fromkeys((c.role, c.location) for c in comparison.cases)
    if keys:
        groups.append(("by role and place", [(f"{r}, {loc}", r, loc, None, None) for r, loc in keys]))
    return groups


def _errors(comparison: Comparison, row: Row, plane: Plane) -> ErrorSummary:
    _, role, location, muscles, posture = row
    return comparison.select(role, location, muscles, posture).errors(plane)


def _largest(
    groups: Sequence[tuple[str, Rows]], models: Sequence[tuple[str, Comparison, str]], plane: Plane, key: str
) -> float:
    values = [getattr(_errors(one, row, plane), key) for _, rows in groups for row in rows for _, one, _ in models]
    return max((float(v) for v in values if v is not None and np.isfinite(v)), default=0.0) or 1e-3


def _bars(
    comparison: Comparison,
    rows: Rows,
    plane: Plane,
    key: str,
    digits: int,
    name: str,
    color: str,
    axes: dict[str, str],
    slot: int,
    *,
    shown: bool,
) -> go.Bar:
    errors = [_errors(comparison, row, plane) for row in rows]
    values = [getattr(e, key) for e in errors]
    return marks.bars(
        values,
        [row[0] for row in rows],
        color,
        [f"{row[0]}: {e.cases} cases, RMSE {rmse_text(e)}" for row, e in zip(rows, errors, strict=True)],
        orientation="h",
        # The first of a group lies lowest, so the model after comes first.
        offsetgroup=str(1 - slot),
        text=[number(v, digits) for v in values],
        **OUTSIDE,
        textfont={"size": SMALL_PX, "color": INK},
        name=plain(name),
        legendgroup=name,
        showlegend=shown,
        meta={"select": [{k: v for k, v in zip(_SHARED, row[1:], strict=True) if v is not None} for row in rows]},
        **axes,
    )
