"""Errors in summary: RMSE by tendon, posture and location, and each case against its own uncertainty."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fingermodel.comparison.comparison import Comparison
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

# Label, and what the cases have in common.
Rows = list[tuple[str, dict[str, str]]]


def errors_figure(models: Sequence[tuple[str, Comparison]], *, plane: Plane = "sagittal") -> go.Figure:
    """Draw the RMSE by loaded tendon, by posture and by role, tip and bone apart, before and after.

    Args:
        models: one comparison, or the one before and the one after, each with its model's name.
        plane: in which the errors are taken.

    Raises:
        NothingToDrawError: no case.
    """
    groups = _groups(models[-1][1])
    if not groups:
        raise NothingToDrawError("There is no load case to summarise.")
    per_bar = _BAR if len(models) == 1 else _BAR + 8
    heights = [per_bar * len(rows) for _, rows in groups]
    half_gap = round(_GROUP_GAP / 2)
    sheet = Sheet(
        sum(heights) + _GROUP_GAP * len(groups),
        (_LEFT, _RIGHT, _TOP - half_gap, _BOTTOM),
        barmode="group",
        bargap=0.25,
        showlegend=len(models) > 1,
    )
    half = (sheet.wide - 60) / 2
    measures = (("rmse_N", "RMSE [N]", 2), ("rmse_rel_pct", "RMSE [% of the mean measured force]", 1))
    colors = (AFTER,) if len(models) == 1 else (BEFORE, AFTER)
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
            for k, ((name, comparison), color) in enumerate(zip(models, colors, strict=True)):
                errors = [comparison.select(**pick).errors(plane) for _, pick in rows]
                values = [getattr(e, key) for e in errors]
                words = [
                    f"{label}: {e.cases} cases, RMSE {rmse_text(e)}" for (label, _), e in zip(rows, errors, strict=True)
                ]
                sheet.data.append(
                    marks.bars(
                        values,
                        [label for label, _ in rows],
                        color,
                        words,
                        orientation="h",
                        # The first of a group lies lowest, so the model after comes first.
                        offsetgroup=str(1 - k),
                        text=[number(v, digits) for v in values],
                        **OUTSIDE,
                        textfont={"size": SMALL_PX, "color": INK},
                        name=plain(name),
                        legendgroup=name,
                        showlegend=index == 0 and column == 0,
                        meta={"select": [pick for _, pick in rows]},
                        **axes,
                    )
                )
        top += height
    return sheet.drawn(
        "Errors by tendon, posture and role",
        f"RMSE {PLANE_NAMES[plane]}; on the right relative to the mean measured force of the same cases",
        legend_px=8,
        at_right=True,
    )


def _groups(comparison: Comparison) -> list[tuple[str, Rows]]:
    """Return rows of a label and what its cases have in common, under their headings."""
    groups: list[tuple[str, Rows]] = []
    for location in ("tip", "bone"):
        cases = comparison.select(location=location).cases
        muscles, postures = in_order(c.muscles for c in cases), list(dict.fromkeys(c.posture for c in cases))
        if len(muscles) > 1:
            rows: Rows = [(plain(m), {"location": location, "muscles": m}) for m in muscles]
            groups.append((f"{location}, by loaded tendon", rows))
        if len(postures) > 1:
            rows = [(posture_name(p), {"location": location, "posture": p}) for p in postures]
            groups.append((f"{location}, by posture", rows))
    places = dict.fromkeys((c.role, c.location) for c in comparison.cases)
    if places:
        groups.append(("by role and place", [(f"{r}, {at}", {"role": r, "location": at}) for r, at in places]))
    return groups


def _largest(
    groups: Sequence[tuple[str, Rows]], models: Sequence[tuple[str, Comparison]], plane: Plane, key: str
) -> float:
    picks = [pick for _, rows in groups for _, pick in rows]
    values = [getattr(one.select(**pick).errors(plane), key) for pick in picks for _, one in models]
    return max((float(v) for v in values if v is not None and np.isfinite(v)), default=0.0) or 1e-3
