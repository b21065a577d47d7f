"""Fall of the error with every revision of the model, on the fitted and on the validation cases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import wrap
from typing import Any, NamedTuple

from server.figures import graph_objects as go
from server.figures.diagnosis_answer import (
    WORSE,
    Answer,
    effect_name,
    locations_in_order,
    mount_name,
    part,
    shortened,
    signed,
    summary_rmse,
    value,
    words,
)
from server.figures.sheet import Sheet
from server.figures.style import INK, OUTSIDE, SMALL_PX, WIDTH, NothingToDrawError, axis, named_axis, number, plain

MOST_STEPS = 8
_PANEL, _BETWEEN, _TOP, _LEFT, _RIGHT, _WIDEST = 190, 42, 104, 70, 20, 84  # [px]
_ROLES = {"identification": ("#3b5b7a", "#d5dee7"), "validation": ("#009E73", "#cdeae1")}


class Step(NamedTuple):
    """One revision: its label, and its RMSE [N] by role and location."""

    lines: list[str]
    rmse_N: dict[str, float]


def steps_of(answer: Answer, history: Sequence[Mapping[str, Any]] | None) -> list[Step]:
    """Return the revisions, oldest first; without a history what the answer says of before and after."""
    if history:
        found = [_step(index, revision) for index, revision in enumerate(history) if isinstance(revision, Mapping)]
        if any(step.rmse_N for step in found):
            return found
    effects = [effect_name(e) for e in words(answer.get("candidates")) or words(answer.get("effects"))]
    joint = " or " if answer.get("verdict") == "one_of" else " + "
    after = ["after", f"with {joint.join(effects)}" if effects else "best explanation"]
    both = [Step(["before", "no effect"], summary_rmse(answer, "before")), Step(after, summary_rmse(answer, "after"))]
    return [step for step in both if step.rmse_N]


def revisions_figure(answer: Answer, history: Sequence[Mapping[str, Any]] | None = None) -> go.Figure:
    """Draw the RMSE at every step, with what it fell by from the step before; tip and bone apart.

    Args:
        answer: of a diagnosis.
        history: of the model's revisions, oldest first.

    Raises:
        NothingToDrawError: no error is known.
    """
    steps = steps_of(answer, history)
    if not steps:
        raise NothingToDrawError("There is no error before or after.")
    total = len(steps)
    steps = steps if total <= MOST_STEPS else [steps[0], *steps[1 - MOST_STEPS :]]
    keys = list(dict.fromkeys(k for s in steps for k in s.rmse_N))
    locations = locations_in_order(_split(k)[1] for k in keys)
    labels = [_wrapped(s.lines, max(14, 104 // len(steps))) for s in steps]
    bottom = 30 + 16 * max(text.count("<br>") + 1 for text in labels)
    roles = _roles(keys)
    room = (WIDTH - _LEFT - _RIGHT) / (len(steps) + 0.2)
    gap = 1.0 - min(0.7, _WIDEST * len(roles) / room)
    sheet = Sheet(
        _PANEL * len(locations) + _BETWEEN * (len(locations) - 1),
        (_LEFT, _RIGHT, _TOP, bottom),
        barmode="group",
        bargap=gap,
        bargroupgap=0.06,
        showlegend=True,
    )
    for index, location in enumerate(locations):
        own = [s.rmse_N.get(f"{role}/{location}") for s in steps for role in roles]
        axes = sheet.panel(
            named_axis(
                range(len(steps)),
                labels,
                (-0.6, len(steps) - 0.4),
                tickangle=0,
                showticklabels=index == len(locations) - 1,
                showgrid=False,
            ),
            axis("RMSE [N]", range=[0.0, 1.2 * max((v for v in own if v is not None), default=0.0) or 1.0], nticks=5),
            top=index * (_PANEL + _BETWEEN),
            high=_PANEL,
            heading=plain(shortened(mount_name(location), 40)),
            above=6,
        )
        for role in roles:
            sheet.data += _bars([s.rmse_N.get(f"{role}/{location}") for s in steps], role, axes, named=index == 0)
    cut = f" The first and the last {MOST_STEPS - 1} of {total} steps." if total > len(steps) else ""
    return sheet.drawn(
        "The error at every revision" if history else "The error before and after",
        f"Root mean square of the force residual. Pale: what it fell by; orange: what it rose by.{cut}",
        legend_px=10,
        at_right=True,
    )


def _step(index: int, revision: Mapping[str, Any]) -> Step:
    lines = [f"+ {effect_name(e)}" for e in words(revision.get("added"))]
    lines += [f"\N{MINUS SIGN} {effect_name(e)}" for e in words(revision.get("removed"))]
    if not lines:
        lines = ["start" if index == 0 else "refit"]
    if value(revision.get("log_evidence_gain")) is not None:
        lines.append(f"ln evidence {signed(revision.get('log_evidence_gain'))}")
    found = {str(k): value(v) for k, v in part(revision, "rmse_N").items()}
    return Step(lines, {k: v for k, v in found.items() if v is not None})


def _split(key: str) -> tuple[str, str]:
    role, _, location = key.partition("/")
    return role, location


def _roles(keys: Sequence[str]) -> list[str]:
    present = [_split(key)[0] for key in keys]
    return [*(r for r in _ROLES if r in present), *(r for r in dict.fromkeys(present) if r not in _ROLES)]


def _bars(values: Sequence[float | None], role: str, axes: dict[str, str], *, named: bool) -> list[go.Bar]:
    """Return solid bars of the error, pale ones above for its fall, and orange ones for its rise."""
    color, pale = _ROLES.get(role, ("#555555", "#dddddd"))
    earlier = [None, *values[:-1]]
    pairs = list(zip(values, earlier, strict=True))
    falls = [b - v if v is not None and b is not None and b > v else 0.0 for v, b in pairs]
    rises = [v - b if v is not None and b is not None and v > b else 0.0 for v, b in pairs]
    changes = ["" if v is None or b is None else f" ({signed(v - b, 3)})" for v, b in pairs]
    hover = [f"{plain(role)}: {number(v, 3)} N{change}" for v, change in zip(values, changes, strict=True)]
    place: dict[str, Any] = {
        "x": list(range(len(values))),
        "offsetgroup": role,
        "legendgroup": role,
        "hoverinfo": "text",
        "hovertext": hover,
        **axes,
    }
    look = {"marker": {"color": color, "line": {"width": 0}}, "name": plain(shortened(role, 30)), "showlegend": named}
    out = [go.Bar(y=[None if v is None else v - r for v, r in zip(values, rises, strict=True)], **look, **place)]
    for heights, bases, ink in (
        (falls, [v or 0.0 for v in values], pale),
        (rises, [(v or 0.0) - r for v, r in zip(values, rises, strict=True)], WORSE),
    ):
        if any(heights):
            out.append(go.Bar(y=heights, base=bases, marker={"color": ink}, showlegend=False, **place))
    # The numbers stand on the level itself, in what it fell by: on bars of no height.
    out.append(
        go.Bar(
            y=[0.0] * len(values),
            base=[v or 0.0 for v in values],
            text=["" if v is None else number(v, 3) for v in values],
            **OUTSIDE,
            textfont={"size": SMALL_PX, "color": INK},
            marker={"color": color},
            showlegend=False,
            **place,
        )
    )
    return out


def _wrapped(lines: Sequence[str], wide: int) -> str:
    """Break lines between words so that neighbouring labels do not meet."""
    rows = [row for text in lines for row in wrap(text, wide, break_long_words=False, break_on_hyphens=False)]
    return "<br>".join(plain(shortened(row, 40)) for row in rows)
