"""Tip force of each muscle in the sagittal and the coronal plane, and what deficits do to size and direction."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fingermodel.studies.activation_result import PLANES, ActivationResult
from server.figures import graph_objects as go
from server.figures import marks
from server.figures.arrows import arrow_head
from server.figures.plot import Plot
from server.figures.report import Section, Table, write_report
from server.figures.sheet import Sheet, note
from server.figures.style import MUTED, SMALL_PX, WIDTH, ZERO_LINE, axis, number, plain

Floats = NDArray[np.float64]
_LEFT, _RIGHT, _TOP, _GAP = 62, 16, 108, 70  # [px]
# Okabe and Ito's, and three more; a symbol says the same again.
_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#5B2A86", "#7A6A00", "#444444")
_SYMBOLS = ("circle", "square", "triangle-up", "diamond", "triangle-down", "cross", "x", "star", "hexagon")
# A muscle that changes the force by less is named, not drawn [N].
_UNSEEN_N = 1e-3
_ENDS = {"sagittal": ("proximal", "dorsal", "palmar"), "coronal": ("proximal", "radial", "ulnar")}


def activation_plots(result: ActivationResult) -> list[Plot]:
    """Return the figures of a result: each muscle alone, and the deficits of each."""
    baseline = ", ".join(
        f"{m} {100.0 * a:.0f} %" for m, a in zip(result.muscles, result.activation, strict=True) if a > 0.0
    )
    return [
        Plot("alone", "Each muscle alone", alone_figure(result), "Force of the finger on the clamp."),
        Plot("deficits", "Deficits", deficits_figure(result), f"Baseline: {baseline or 'all muscles at rest'}."),
    ]


def alone_figure(result: ActivationResult) -> go.Figure:
    """Draw the tip force of every muscle per newton of its tension (as Figs 2 and 3 of Barry et al. 2018)."""
    wide = (WIDTH - _LEFT - _RIGHT - _GAP) / 2.0
    names = [m.muscle for m in result.alone]
    colors = [_COLORS[i % len(_COLORS)] for i in range(len(names))]
    # One scale for both, so that lengths can be compared.
    parts = {plane: np.array([m.per_newton[list(axes)] for m in result.alone]) for plane, axes in PLANES.items()}
    every = np.concatenate([*parts.values(), np.zeros((1, 2))])
    low, high = every.min(axis=0), every.max(axis=0)
    room = 0.14 * float((high - low).max())
    low, high = low - room * np.array([1.6, 1.0]), high + room * np.array([1.6, 1.0])
    zero = {"nticks": 6, **ZERO_LINE, "zerolinecolor": MUTED}
    sheet = Sheet(wide * (high[1] - low[1]) / (high[0] - low[0]), (_LEFT, _RIGHT, _TOP, 56), showlegend=False)
    for k, (plane, forces) in enumerate(parts.items()):
        along, up, down = _ENDS[plane]
        axes = sheet.panel(
            axis(f"{along} [N/N]", range=[low[0], high[0]], **zero),
            axis(f"{up} [N/N]", range=[low[1], high[1]], **zero),
            left=k * (wide + _GAP),
            wide=wide,
            heading=f"{plane.capitalize()} plane ({up} up, {down} down)",
            above=6,
        )
        head = 0.035 * float((high - low).max())
        for name, force, color in zip(names, forces, colors, strict=True):
            sheet.data += _arrow(name, force, head, color, axes)
        sheet.notes += _labels(names, forces, colors, low, high, axes)
    angles = ", ".join(f"{n} {a:g}" for n, a in zip(result.rotations, result.posture_deg, strict=True))
    return sheet.drawn(
        f"Tip force of each muscle alone, per newton of tension: {plain(result.finger)}",
        f"Force of the finger on the clamp, axes of the distal phalanx. Posture: {plain(angles)} deg.",
    )


def deficits_figure(result: ActivationResult) -> go.Figure:
    """Draw size and direction of the tip force while each muscle loses activation."""
    moving = [np.abs(d.force_N - d.force_N[0]).max() > _UNSEEN_N for d in result.deficits]
    sheet = Sheet(300, (_LEFT, _RIGHT, _TOP, 104), showlegend=True)
    levels = result.deficits[0].levels_pct.tolist()
    for k, (name, unit) in enumerate((("Size", "tip force [N]"), ("Direction", "turned by [deg]"))):
        courses = [d.magnitudes.tolist() if k == 0 else d.change_deg() for d in result.deficits]
        courses = [[None if v is None else float(f"{v:.6g}") for v in course] for course in courses]
        tops = [v for course, moves in zip(courses, moving, strict=True) if moves for v in course if v is not None]
        top = 1.06 * max([*tops, 1e-3])
        axes = sheet.panel(
            axis("activation left to the muscle [%]", range=[103.0, -3.0], tickvals=levels),
            axis(unit, range=[-0.02 * top, top], nticks=7),
            **sheet.grid(0, k, 2, sheet.high, (_GAP, 0)),
            heading=name,
            above=6,
        )
        for i, (d, course) in enumerate(zip(result.deficits, courses, strict=True)):
            if moving[i]:
                color = _COLORS[i % len(_COLORS)]
                marker = {"color": color, "symbol": _SYMBOLS[i % len(_SYMBOLS)], "size": 7}
                look: dict[str, Any] = {"mode": "lines+markers", "line": {"color": color, "width": 1.8}, **axes}
                look |= {"name": plain(d.muscle), "legendgroup": d.muscle, "showlegend": k == 0}
                sheet.data.append(go.Scatter(x=d.levels_pct.tolist(), y=course, marker=marker, **look))
    size = number(float(np.linalg.norm(result.force_N)))
    still = [plain(d.muscle) for d, moves in zip(result.deficits, moving, strict=True) if not moves]
    nothing = f" Without them nothing changes: {', '.join(still)}." if still else ""
    return sheet.drawn(
        f"One muscle loses activation: {plain(result.finger)}",
        f"The others keep theirs; {size} N at full activation.{nothing}",
        legend_px=-58,
    )


def activation_report(result: ActivationResult, folder: Path, *, static: bool = True) -> Path:
    """Write `activation.html` and, as PNG and SVG, its figures into a folder; return the page."""
    plots = activation_plots(result)
    rows = [[m.muscle, number(m.tension_N, 1), *(number(float(x)) for x in m.force_N)] for m in result.alone]
    levels = result.deficits[0].levels_pct
    deficits = [
        [d.muscle, *(f"{number(float(x))} ({number(t, 1)})" for x, t in zip(d.magnitudes, d.change_deg(), strict=True))]
        for d in result.deficits
    ]
    tables = {
        "alone": Table(["muscle", "tension [N]", "proximal [N]", "dorsal [N]", "radial [N]"], rows, "Fully active."),
        "deficits": Table(["muscle", *(f"{x:g} %" for x in levels)], deficits, "Tip force [N] (turned by [deg])."),
    }
    sections = [Section(p.heading, [p, tables[p.name]]) for p in plots]
    if result.notes:
        sections.append(Section("Notes", list(result.notes)))
    subtitle = f"{result.finger} with muscles {result.muscle_set}"
    title = "Active muscles and the tip force"
    return write_report(folder / "activation.html", sections, title, subtitle, static=static)


def _arrow(name: str, force: Floats, head: float, color: str, axes: dict[str, str]) -> list[go.Scatter]:
    size = float(np.hypot(*force))
    if size == 0.0:
        return []
    neck, outline = arrow_head(force, force / size, min(head, 0.45 * size))
    text = f"{plain(name)}: {number(float(force[0]), 3)}, {number(float(force[1]), 3)} N/N"
    told: dict[str, Any] = {"hoverinfo": "text", "text": text, "showlegend": False, **axes}
    shaft = marks.xy(np.stack([np.zeros(2), neck]))
    return [
        marks.line(*shaft, {"color": color, "width": 2.2}, **told),
        marks.area(*marks.xy(outline), color, {"color": color, "width": 1.0}, **told),
    ]


def _labels(
    names: Sequence[str], forces: Floats, colors: Sequence[str], low: Floats, high: Floats, axes: dict[str, str]
) -> list[dict[str, Any]]:
    """Return names beyond the arrows' heads, moved apart upwards and downwards where they would cover each other."""
    span = float(high[0] - low[0])
    right = forces[:, 0] > 0.0
    middle = forces[:, 0] + np.where(right, 1.0, -1.0) * 0.07 * span
    heights = _apart(middle, forces[:, 1], 0.13 * span, 0.055 * span)
    on = (axes["xaxis"], axes["yaxis"])
    out = []
    for name, force, color, side, y in zip(names, forces, colors, right, heights, strict=True):
        look: dict[str, Any] = {"at": ("left" if side else "right", "middle"), "shift": (7 if side else -7, 0)}
        look |= {"size": SMALL_PX + 1, "color": color}
        out.append(note(f"<b>{plain(name)}</b>", float(force[0]), float(y), on, **look))
    return out


def _apart(across: Floats, up: Floats, wide: float, tall: float) -> Floats:
    """Return heights moved until no two labels of that size cover each other."""
    out = np.array(up, dtype=float)
    order = np.argsort(out, kind="stable")
    for _ in range(100):
        moved = False
        for k, i in enumerate(order):
            for j in order[k + 1 :]:
                short = tall - (out[j] - out[i])
                if abs(across[i] - across[j]) < wide and short > 1e-6 * tall:
                    out[i] -= 0.5 * short
                    out[j] += 0.5 * short
                    moved = True
        if not moved:
            break
    return out
