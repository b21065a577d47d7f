"""The elastic hood drawn: its network from the side and unrolled, and its springs' forces beside printed ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from server.figures import graph_objects as go
from server.figures import marks
from server.figures.sheet import On, Sheet, note, shape
from server.figures.style import (
    BARE,
    INK,
    MUTED,
    SMALL_PX,
    WIDTH,
    axis,
    fixed,
    mix,
    named_axis,
    number,
    plain,
    whiskers,
)

Floats = NDArray[np.float64]
TAUT, SLACK, REST, BONE = "#0072B2", "#D55E00", "#b4b4b4", "#d9d2c3"
PUBLISHED = mix("#222222", "#ffffff", 0.72)
_LEFT, _RIGHT, _TOP, _BOTTOM, _GAP = 24, 24, 104, 72, 44  # [px]
_SIDE, _BETWEEN = 300, 20  # width of the view from the side and its distance to the other [px]
_BARS, _BARS_GAP = 190, 56  # [px]


@dataclass(frozen=True)
class NetworkPanel:
    """A network in one posture."""

    title: str  # of the panel
    # (nodes, 2) along (proximal) and round the bone (radial), where nothing pulls, on the straight finger.
    home_mm: Floats
    moved_mm: Floats  # (nodes, 2) displacement under load, in the same axes
    force_N: Floats  # (springs,), 0 where slack
    bones_mm: Floats  # (points, 2) the bones' axes from the tip to the hand, seen from the radial side
    side_mm: Floats  # (nodes, 2) the nodes under load, seen from the radial side


def network_figure(
    panels: Sequence[NetworkPanel],
    nodes: Sequence[str],
    springs: Sequence[str],
    ends: Sequence[tuple[int, int]],
    joints_mm: Mapping[str, float],
) -> go.Figure:
    """Draw a network in several postures, one below the other, each from the side and on the unrolled dorsum.

    Args:
        panels: from the top.
        nodes: names.
        springs: names.
        ends: of each spring, indices of its nodes.
        joints_mm: where the joints lie along the straight finger (proximal of its first joint).
    """
    plan = WIDTH - _LEFT - _RIGHT - _SIDE - _BETWEEN
    places = np.concatenate([p.home_mm for p in panels] + [p.home_mm + p.moved_mm for p in panels])
    room = np.array([4.0, 3.5])
    low, high = places.min(axis=0) - room, places.max(axis=0) + room
    tall = plan * float(high[1] - low[1]) / float(high[0] - low[0])
    sheet = Sheet(len(panels) * tall + (len(panels) - 1) * _GAP, (_LEFT, _RIGHT, _TOP, _BOTTOM))
    most = max(float(p.force_N.max()) for p in panels)
    for k, panel in enumerate(panels):
        moved = panel.home_mm + panel.moved_mm
        at: dict[str, Any] = {"top": k * (tall + _GAP), "high": tall}
        side = sheet.panel(*_bare_axes(*_square(panel, _SIDE / tall)), wide=_SIDE, heading=plain(panel.title), **at)
        ranges = [low[0], high[0]], [low[1], high[1]]
        unrolled = sheet.panel(*_bare_axes(*ranges), left=_SIDE + _BETWEEN, wide=plan, **at)
        sheet.data += _side_view(panel, ends, side, most)
        sheet.data += [_line(panel.home_mm[list(e)], REST, 1.0, "solid", unrolled) for e in ends]
        sheet.data += [
            _spring(moved[list(e)], f, _width(f, most), unrolled) for e, f in zip(ends, panel.force_N, strict=True)
        ]
        sheet.data.append(_dots(moved, unrolled, 6.0))
        on = (unrolled["xaxis"], unrolled["yaxis"])
        sheet.notes += _labels(panel, moved, nodes, ends, on)
        dotted = {"color": MUTED, "width": 1, "dash": "dot"}
        for name, x in joints_mm.items():
            sheet.shapes.append(shape((x, x), (float(low[1]), float(high[1])), on, line=dotted))
            sheet.notes.append(note(name, x, float(low[1]), on, shift=(4, 3), size=SMALL_PX, color=MUTED))
    sheet.data += _key()
    return sheet.drawn(
        "The extensor hood as a network of springs",
        "Left: from the radial side, the plate below the tip. Right: unrolled, tip to the left, radial above."
        "<br>Numbers: force of each spring [N]; the wider a line, the more it carries.",
        legend_px=-12,
    )


def forces_figure(
    titles: Sequence[str],
    springs: Sequence[str],
    published: Sequence[Sequence[float]],
    ours: Sequence[Floats],
    within: Sequence[Floats],
) -> go.Figure:
    """Draw forces of all springs, one panel a posture: published wide and pale, ours narrow before them.

    Args:
        titles: of the panels, from the top.
        springs: names.
        published: (panels, springs) [N].
        ours: likewise.
        within: what the published inputs' digits allow of ours [N].
    """
    at = np.arange(len(springs), dtype=float).tolist()
    sheet = Sheet(len(titles) * _BARS + (len(titles) - 1) * _BARS_GAP, (72, 24, 88, 92), barmode="overlay")
    for k, title in enumerate(titles):
        axes = sheet.panel(
            named_axis(at, springs, (-0.6, len(at) - 0.4), showgrid=False),
            axis("force [N]", rangemode="tozero", nticks=6),
            top=k * (_BARS + _BARS_GAP),
            high=_BARS,
            heading=plain(title),
            above=6,
        )
        numbers = zip(springs, published[k], ours[k], strict=True)
        texts = [f"{s}: published {number(p)} N, ours {number(o)} N" for s, p, o in numbers]
        common: dict[str, Any] = {"x": at, "showlegend": k == 0, "hoverinfo": "text", "hovertext": texts, **axes}
        sheet.data += [
            go.Bar(y=list(published[k]), width=0.8, marker={"color": PUBLISHED}, name="published", **common),
            go.Bar(
                y=ours[k].tolist(),
                width=0.4,
                marker={"color": TAUT},
                name="ours",
                error_y=whiskers(within[k].tolist(), INK),
                **common,
            ),
        ]
    return sheet.drawn(
        "Forces of the hood's springs",
        "Wide and pale: published; narrow: ours. A spring without a bar is slack.",
        legend_px=-36,
    )


def _side_view(
    panel: NetworkPanel, ends: Sequence[tuple[int, int]], axes: dict[str, str], most: float
) -> list[go.Scatter]:
    bones = _line(panel.bones_mm, BONE, 9.0, "solid", axes)
    joints = _dots(panel.bones_mm[1:-1], axes, 7.0)
    lines = [
        _spring(panel.side_mm[list(e)], f, 0.6 * _width(f, most), axes)
        for e, f in zip(ends, panel.force_N, strict=True)
    ]
    return [bones, joints, *lines, _dots(panel.side_mm, axes, 4.0)]


def _square(panel: NetworkPanel, shape: float) -> tuple[list[float], list[float]]:
    """Return ranges of the side view with one scale on both axes, `shape` times as wide as it is tall."""
    every = np.concatenate([panel.bones_mm, panel.side_mm])
    low, high = every.min(axis=0) - 3.0, every.max(axis=0) + 3.0
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    tall = max(float(half[1]), float(half[0]) / shape)
    return [middle[0] - tall * shape, middle[0] + tall * shape], [middle[1] - tall, middle[1] + tall]


def _bare_axes(*ranges: Sequence[float]) -> list[dict[str, Any]]:
    return [axis(range=[float(v) for v in span], **BARE) for span in ranges]


def _line(points: Floats, color: str, width: float, dash: str, axes: dict[str, str]) -> go.Scatter:
    look = {"color": color, "width": width, "dash": dash}
    return marks.line(*marks.xy(points.round(3)), look, showlegend=False, **axes)


def _spring(points: Floats, force: float, width: float, axes: dict[str, str]) -> go.Scatter:
    return _line(points, *((TAUT, width, "solid") if force > 0.0 else (SLACK, width, "dot")), axes)


def _dots(points: Floats, axes: dict[str, str], size: float) -> go.Scatter:
    return marks.points(*marks.xy(points.round(3)), {"color": INK, "size": size}, showlegend=False, **axes)


def _width(force: float, most: float) -> float:
    return 1.2 if force <= 0.0 else 1.2 + 8.0 * float(force) / most


def _labels(
    panel: NetworkPanel, moved: Floats, nodes: Sequence[str], ends: Sequence[tuple[int, int]], on: On
) -> list[dict[str, Any]]:
    """Return names of the nodes and forces of the springs."""
    out = []
    for name, (x, y) in zip(nodes, moved.tolist(), strict=True):
        at, shift = ("top", -6) if y < -1.0 else ("bottom", 6)
        out.append(note(f"<b>{name}</b>", x, y, on, at=("center", at), shift=(0, shift), size=SMALL_PX))
    for force, (a, b) in zip(panel.force_N, ends, strict=True):
        # Off the middle, where the springs that cross would have their numbers on one place.
        x, y = (0.42 * moved[a] + 0.58 * moved[b]).tolist()
        text = fixed(float(force), 0 if force >= 9.95 else 1) if force > 0.0 else "slack"
        look: dict[str, Any] = {"size": SMALL_PX, "color": TAUT if force > 0.0 else SLACK, "bgcolor": "#ffffff"}
        out.append(note(text, x, y, on, at=("center", "middle"), **look))
    return out


def _key() -> list[go.Scatter]:
    kinds = (("taut", TAUT, 4.0, "solid"), ("slack", SLACK, 1.2, "dot"), ("where nothing pulls", REST, 1.0, "solid"))
    return [
        go.Scatter(
            x=[None], y=[None], mode="lines", line={"color": c, "width": w, "dash": d}, name=n, xaxis="x", yaxis="y"
        )
        for n, c, w, d in kinds
    ]
