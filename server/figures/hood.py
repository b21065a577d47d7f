"""The elastic hood drawn: its network from the side and unrolled, and its springs' forces beside printed ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from server.figures import graph_objects as go
from server.figures.style import INK, MUTED, SMALL_PX, WIDTH, axis, domain, figure, fixed, heading, legend, mix, number

Floats = NDArray[np.float64]
TAUT, SLACK, REST, BONE = "#0072B2", "#D55E00", "#b4b4b4", "#d9d2c3"
PUBLISHED = mix("#222222", "#ffffff", 0.72)
_LEFT, _RIGHT, _TOP, _BOTTOM, _GAP = 24, 24, 104, 72, 44  # [px]
_SIDE, _BETWEEN = 300, 20  # width of the view from the side and its distance to the other [px]
_BARS, _BARS_GAP = 190, 56  # [px]


@dataclass(frozen=True)
class NetworkPanel:
    """A network in one posture.

    Attributes:
        title: of the panel.
        home_mm: (nodes, 2) along (proximal) and round the bone (radial), where nothing pulls, on the straight finger.
        moved_mm: (nodes, 2) displacement under load, in the same axes.
        force_N: (springs,), 0 where slack.
        bones_mm: (points, 2) the bones' axes from the tip to the hand, seen from the radial side.
        side_mm: (nodes, 2) the nodes under load, seen from the radial side.
    """

    title: str
    home_mm: Floats
    moved_mm: Floats
    force_N: Floats
    bones_mm: Floats
    side_mm: Floats


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
    across = WIDTH - _LEFT - _RIGHT
    plan = across - _SIDE - _BETWEEN
    places = np.concatenate([p.home_mm for p in panels] + [p.home_mm + p.moved_mm for p in panels])
    room = np.array([4.0, 3.5])
    low, high = places.min(axis=0) - room, places.max(axis=0) + room
    tall = plan * float(high[1] - low[1]) / float(high[0] - low[0])
    up = len(panels) * tall + (len(panels) - 1) * _GAP
    most = max(float(p.force_N.max()) for p in panels)
    data: list[go.Scatter] = []
    layout: dict[str, Any] = {"annotations": [], "shapes": []}
    for k, panel in enumerate(panels):
        top = 1.0 - k * (tall + _GAP) / up
        height = domain(top - tall / up, top)
        side, unrolled = (str(2 * k + i + 1) if 2 * k + i else "" for i in (0, 1))
        layout |= _plain_axes(side, height, domain(0.0, _SIDE / across), *_square(panel, _SIDE / tall))
        layout |= _plain_axes(unrolled, height, domain(1.0 - plan / across, 1.0), [low[0], high[0]], [low[1], high[1]])
        moved = panel.home_mm + panel.moved_mm
        data += _side_view(panel, ends, side, most)
        data += [_line(panel.home_mm[list(e)], REST, 1.0, "solid", unrolled) for e in ends]
        data += [
            _spring(moved[list(e)], f, _width(f, most), unrolled) for e, f in zip(ends, panel.force_N, strict=True)
        ]
        data.append(_dots(moved, unrolled, 6.0))
        layout["annotations"] += _labels(panel, moved, nodes, springs, ends, unrolled)
        layout["annotations"].append(heading(panel.title, top, 4))
        for name, at in joints_mm.items():
            layout["shapes"].append(_upright(at, [low[1], high[1]], unrolled))
            layout["annotations"].append(
                _note(name, at, float(low[1]), unrolled, MUTED, "bottom", "left", 3) | {"xshift": 4}
            )
    margin = {"l": _LEFT, "r": _RIGHT, "t": _TOP, "b": _BOTTOM}
    data += _key()
    layout["legend"] = legend(-12, up)
    return figure(
        data,
        layout,
        title="The extensor hood as a network of springs",
        subtitle="Left: from the radial side, the plate below the tip. Right: unrolled, tip to the left, radial above."
        "<br>Numbers: force of each spring [N]; the wider a line, the more it carries.",
        height=round(up) + _TOP + _BOTTOM,
        margin=margin,
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
    plot = len(titles) * _BARS + (len(titles) - 1) * _BARS_GAP
    at = np.arange(len(springs), dtype=float).tolist()
    data: list[go.Bar] = []
    layout: dict[str, Any] = {"barmode": "overlay", "annotations": []}
    for k, title in enumerate(titles):
        suffix = str(k + 1) if k else ""
        top = 1.0 - k * (_BARS + _BARS_GAP) / plot
        common = {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}", "showlegend": k == 0, "hoverinfo": "text"}
        numbers = zip(springs, published[k], ours[k], strict=True)
        texts = [f"{s}: published {number(p)} N, ours {number(o)} N" for s, p, o in numbers]
        data.append(
            go.Bar(
                x=at,
                y=list(published[k]),
                width=0.8,
                marker={"color": PUBLISHED},
                name="published",
                hovertext=texts,
                **common,
            )
        )
        data.append(
            go.Bar(
                x=at,
                y=ours[k].tolist(),
                width=0.4,
                marker={"color": TAUT},
                name="ours",
                hovertext=texts,
                error_y={
                    "type": "data",
                    "array": within[k].tolist(),
                    "color": INK,
                    "thickness": 1,
                    "width": 3,
                    "visible": True,
                },
                **common,
            )
        )
        layout[f"xaxis{suffix}"] = axis(
            range=[-0.6, len(at) - 0.4],
            tickvals=at,
            ticktext=list(springs),
            showgrid=False,
            ticks="",
            anchor=f"y{suffix}",
        )
        layout[f"yaxis{suffix}"] = axis(
            "force [N]", domain=domain(top - _BARS / plot, top), anchor=f"x{suffix}", rangemode="tozero", nticks=6
        )
        layout["annotations"].append(heading(title, top, 6))
    layout["legend"] = legend(-36, plot)
    return figure(
        data,
        layout,
        title="Forces of the hood's springs",
        subtitle="Wide and pale: published; narrow: ours. A spring without a bar is slack.",
        height=plot + _TOP + 76,
        margin={"l": 72, "r": 24, "t": _TOP - 16, "b": 92},
    )


def _side_view(panel: NetworkPanel, ends: Sequence[tuple[int, int]], suffix: str, most: float) -> list[go.Scatter]:
    bones = _line(panel.bones_mm, BONE, 9.0, "solid", suffix)
    joints = _dots(panel.bones_mm[1:-1], suffix, 7.0)
    lines = [
        _spring(panel.side_mm[list(e)], f, 0.6 * _width(f, most), suffix)
        for e, f in zip(ends, panel.force_N, strict=True)
    ]
    return [bones, joints, *lines, _dots(panel.side_mm, suffix, 4.0)]


def _square(panel: NetworkPanel, shape: float) -> tuple[list[float], list[float]]:
    """Ranges of the side view with one scale on both axes, `shape` times as wide as it is tall."""
    every = np.concatenate([panel.bones_mm, panel.side_mm])
    low, high = every.min(axis=0) - 3.0, every.max(axis=0) + 3.0
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    tall = max(float(half[1]), float(half[0]) / shape)
    return [middle[0] - tall * shape, middle[0] + tall * shape], [middle[1] - tall, middle[1] + tall]


def _plain_axes(suffix: str, y: list[float], x: list[float], x_range: Any, y_range: Any) -> dict[str, Any]:
    bare: dict[str, Any] = {
        "showline": False,
        "showgrid": False,
        "showticklabels": False,
        "ticks": "",
        "zeroline": False,
    }
    return {
        f"xaxis{suffix}": axis(domain=x, anchor=f"y{suffix}", range=[float(v) for v in x_range], **bare),
        f"yaxis{suffix}": axis(domain=y, anchor=f"x{suffix}", range=[float(v) for v in y_range], **bare),
    }


def _line(points: Floats, color: str, width: float, dash: str, suffix: str) -> go.Scatter:
    return go.Scatter(
        x=points[:, 0].round(3).tolist(),
        y=points[:, 1].round(3).tolist(),
        mode="lines",
        line={"color": color, "width": width, "dash": dash},
        xaxis=f"x{suffix}",
        yaxis=f"y{suffix}",
        showlegend=False,
        hoverinfo="skip",
    )


def _spring(points: Floats, force: float, width: float, suffix: str) -> go.Scatter:
    return _line(points, *((TAUT, width, "solid") if force > 0.0 else (SLACK, width, "dot")), suffix)


def _dots(points: Floats, suffix: str, size: float) -> go.Scatter:
    return go.Scatter(
        x=points[:, 0].round(3).tolist(),
        y=points[:, 1].round(3).tolist(),
        mode="markers",
        marker={"color": INK, "size": size},
        xaxis=f"x{suffix}",
        yaxis=f"y{suffix}",
        showlegend=False,
        hoverinfo="skip",
    )


def _width(force: float, most: float) -> float:
    return 1.2 if force <= 0.0 else 1.2 + 8.0 * float(force) / most


def _labels(
    panel: NetworkPanel,
    moved: Floats,
    nodes: Sequence[str],
    springs: Sequence[str],
    ends: Sequence[tuple[int, int]],
    suffix: str,
) -> list[dict[str, Any]]:
    out = []
    for name, (x, y) in zip(nodes, moved, strict=True):
        down = y < -1.0
        out.append(
            _note(
                f"<b>{name}</b>",
                float(x),
                float(y),
                suffix,
                INK,
                "top" if down else "bottom",
                "center",
                -6 if down else 6,
            )
        )
    for force, (a, b) in zip(panel.force_N, ends, strict=True):
        # Off the middle, where the springs that cross would have their numbers on one place.
        x, y = 0.42 * moved[a] + 0.58 * moved[b]
        text = fixed(float(force), 0 if force >= 9.95 else 1) if force > 0.0 else "slack"
        out.append(
            _note(text, float(x), float(y), suffix, TAUT if force > 0.0 else SLACK, "middle", "center", 0)
            | {"bgcolor": "#ffffff"}
        )
    return out


def _note(
    text: str, x: float, y: float, suffix: str, color: str, yanchor: str, xanchor: str, up: int
) -> dict[str, Any]:
    return {
        "text": text,
        "x": x,
        "y": y,
        "xref": f"x{suffix}",
        "yref": f"y{suffix}",
        "xanchor": xanchor,
        "yanchor": yanchor,
        "yshift": up,
        "showarrow": False,
        "font": {"size": SMALL_PX, "color": color},
    }


def _upright(x: float, y_range: Sequence[float], suffix: str) -> dict[str, Any]:
    return {
        "type": "line",
        "xref": f"x{suffix}",
        "yref": f"y{suffix}",
        "x0": x,
        "x1": x,
        "y0": float(y_range[0]),
        "y1": float(y_range[1]),
        "line": {"color": MUTED, "width": 1, "dash": "dot"},
        "layer": "below",
    }


def _key() -> list[go.Scatter]:
    kinds = (("taut", TAUT, 4.0, "solid"), ("slack", SLACK, 1.2, "dot"), ("where nothing pulls", REST, 1.0, "solid"))
    return [
        go.Scatter(
            x=[None], y=[None], mode="lines", line={"color": c, "width": w, "dash": d}, name=n, xaxis="x", yaxis="y"
        )
        for n, c, w, d in kinds
    ]
