"""A movement over time: tip force, angles and torques in one figure, the muscles' forces in another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fingermodel.studies.movement import MovementResult
from server.figures import graph_objects as go
from server.figures.plot import Plot
from server.figures.report import Picture, Section, Table, write_report
from server.figures.static import write_static
from server.figures.style import (
    INK,
    MUTED,
    TEXT_PX,
    WIDTH,
    axis,
    domain,
    figure,
    legend,
    number,
    plain,
)

Floats = NDArray[np.float64]
COLORS = ("#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9")
TOTAL, ACTIVE, PASSIVE, OTHER = "#222222", "#0072B2", "#D55E00", "#8a8a8a"
_LEFT, _RIGHT, _TOP, _BOTTOM, _GAP_X, _GAP_Y, _HEIGHT = 64, 16, 104, 52, 62, 46, 170  # [px]


@dataclass(frozen=True)
class Line:
    """One curve: its name in the key, values over time, colour and dash; `times` where they are its own."""

    name: str
    values: Floats
    color: str
    dash: str = "solid"
    times: Floats | None = None


class Reference(NamedTuple):
    """Muscle forces of another computation: its name in the key, times [s] and, by muscle, forces [N]."""

    name: str
    times_s: Floats
    force: dict[str, Floats]


@dataclass(frozen=True)
class Panel:
    """One small plot with its heading and what is on its vertical axis."""

    heading: str
    unit: str
    lines: list[Line] = field(default_factory=list)


def movement_figure(result: MovementResult) -> go.Figure:
    """Draw tip force, angles, rates, accelerations and torques over time (as Figs 3 and 4 of Wu et al. 2008)."""
    moving = [i for i in range(len(result.rotations)) if np.ptp(result.posture_rad[:, i]) > 0.0]

    def lines(values: Floats) -> list[Line]:
        return [Line(result.rotations[i], values[:, i], COLORS[k % len(COLORS)]) for k, i in enumerate(moving)]

    axes = zip(("proximal", "dorsal", "radial"), result.tip_force_N.T, strict=True)
    shown = [(name, f) for name, f in axes if np.abs(f).max() > 0.0]
    force = [Line(f"tip force, {name}", f, c) for (name, f), c in zip(shown, (TOTAL, MUTED, OTHER), strict=False)]
    panels = [
        Panel("Force on the tip", "N", force),
        Panel("Joint torque of all muscles", "N mm", lines(result.torque_Nmm)),
        Panel("Joint angle", "deg", lines(np.rad2deg(result.posture_rad))),
        Panel("Rate", "rad/s", lines(result.rate_rad_s)),
        Panel("Acceleration", "rad/s²", lines(result.acceleration_rad_s2)),
    ]
    return _grid(
        result,
        [p for p in panels if p.lines],
        columns=2,
        title="What moves, and the torques behind it",
        subtitle="Flexion positive. Dotted: first and last contact of the tip.",
    )


def muscles_figure(result: MovementResult, reference: Reference | None = None) -> go.Figure:
    """Draw total, active and passive force of every muscle over time (as Fig 5 of Wu et al. 2008).

    Args:
        result: of the movement.
        reference: drawn beside.
    """
    panels = []
    for i, name in enumerate(result.muscles):
        lines = [
            Line("total", result.force[:, i], TOTAL),
            Line("active", result.active_N[:, i], ACTIVE, "dash"),
            Line("passive", result.passive_N[:, i], PASSIVE, "dot"),
        ]
        if reference and name in reference.force:
            lines.append(Line(reference.name, reference.force[name], OTHER, "dashdot", reference.times_s))
        panels.append(Panel(name, "N", lines))
    return _grid(
        result,
        panels,
        columns=2,
        title="Muscle forces",
        subtitle="Min/max recruitment of what the passive forces leave. Each muscle has its own scale.",
    )


def movement_plots(result: MovementResult, reference: Reference | None = None) -> list[Plot]:
    """The figures of a movement, for reports, pages and studies.

    Args:
        result: of the movement.
        reference: drawn beside the muscle forces.
    """
    contact = result.contact_s()
    touched = "" if contact is None else f" The tip touches from {contact[0]:.3f} to {contact[1]:.3f} s."
    who = ", ".join(f"{p['muscle']} {number(p['peak_N'])} N" for p in result.peaks())
    return [
        Plot(
            "movement",
            "Movement",
            movement_figure(result),
            f"{result.motion} with {result.finger}.{touched} Torques are those that the muscles exert together.",
        ),
        Plot(
            "muscles",
            "Muscles",
            muscles_figure(result, reference),
            f"Muscles {result.muscle_set}. Peaks of the total force: {who}.",
        ),
    ]


def movement_report(result: MovementResult, folder: Path, *, static: bool = True) -> Path:
    """Write `movement.html` and, as PNG and SVG, its figures into a folder; return the page."""
    plots = movement_plots(result)
    rows = [
        [
            p["muscle"],
            number(p["peak_N"]),
            number(p["at_s"], 3),
            number(100.0 * p["passive_share"], 1),
            number(p["over_tip_force"]),
        ]
        for p in result.peaks()
    ]
    peaks = Table(["muscle", "peak [N]", "at [s]", "of it passive [%]", "over peak tip force"], rows)
    sections = [*(Section(p.heading, [Picture(p.figure, p.caption)]) for p in plots), Section("Peaks", [peaks])]
    subtitle = f"{result.motion} with {result.finger}, muscles {result.muscle_set}"
    page = write_report(folder / "movement.html", sections, "A movement and its muscle forces", subtitle)
    if static:
        write_static(folder, {p.name: p.figure for p in plots})
    return page


def _grid(result: MovementResult, panels: Sequence[Panel], *, columns: int, title: str, subtitle: str) -> go.Figure:
    rows = -(-len(panels) // columns)
    height = _TOP + _BOTTOM + rows * _HEIGHT + (rows - 1) * _GAP_Y
    across, up = WIDTH - _LEFT - _RIGHT, height - _TOP - _BOTTOM
    wide = (across - (columns - 1) * _GAP_X) / columns
    contact = result.contact_s()
    first, last = float(result.times_s[0]), float(result.times_s[-1])
    data: list[go.Scatter] = []
    layout: dict[str, Any] = {"annotations": [], "shapes": [], "showlegend": True}
    named: set[str] = set()
    for index, panel in enumerate(panels):
        row, column = divmod(index, columns)
        suffix = str(index + 1) if index else ""
        left, top = column * (wide + _GAP_X), row * (_HEIGHT + _GAP_Y)
        lowest = index + columns >= len(panels)
        layout[f"xaxis{suffix}"] = axis(
            "time [s]" if lowest else "",
            domain=domain(left / across, (left + wide) / across),
            anchor=f"y{suffix}",
            range=[first, last],
            nticks=7,
        )
        layout[f"yaxis{suffix}"] = axis(
            panel.unit,
            domain=domain(1.0 - (top + _HEIGHT) / up, 1.0 - top / up),
            anchor=f"x{suffix}",
            range=_span(panel.lines),
            nticks=5,
            zeroline=True,
            zerolinecolor=MUTED,
            zerolinewidth=1,
        )
        layout["annotations"].append(_heading(panel.heading, left / across, 1.0 - top / up))
        for at in contact or ():
            layout["shapes"].append(
                {
                    "type": "line",
                    "xref": f"x{suffix}",
                    "yref": f"y{suffix}",
                    "x0": at,
                    "x1": at,
                    "y0": layout[f"yaxis{suffix}"]["range"][0],
                    "y1": layout[f"yaxis{suffix}"]["range"][1],
                    "line": {"color": MUTED, "width": 1, "dash": "dot"},
                    "layer": "below",
                }
            )
        for line in panel.lines:
            times = result.times_s if line.times is None else line.times
            data.append(
                go.Scatter(
                    x=np.round(times, 6).tolist(),
                    y=[float(f"{v:.6g}") for v in line.values],
                    name=plain(line.name),
                    legendgroup=line.name,
                    showlegend=line.name not in named,
                    mode="lines",
                    line={"color": line.color, "width": 1.8, "dash": line.dash},
                    xaxis=f"x{suffix}",
                    yaxis=f"y{suffix}",
                )
            )
            named.add(line.name)
    layout["legend"] = legend(24, up)
    margin = {"l": _LEFT, "r": _RIGHT, "t": _TOP, "b": _BOTTOM}
    return figure(data, layout, title=title, subtitle=subtitle, height=height, margin=margin)


def _span(lines: Sequence[Line]) -> list[float]:
    """Range of the vertical axis: all curves and zero, with a margin."""
    low = min(0.0, *(float(line.values.min()) for line in lines))
    high = max(0.0, *(float(line.values.max()) for line in lines))
    room = 0.06 * (high - low) or 1.0
    return [low - (room if low < 0.0 else 0.0), high + room]


def _heading(text: str, x: float, y: float) -> dict[str, Any]:
    return {
        "text": f"<b>{plain(text)}</b>",
        "x": x,
        "y": y,
        "xref": "paper",
        "yref": "paper",
        "xanchor": "left",
        "yanchor": "bottom",
        "yshift": 3,
        "showarrow": False,
        "font": {"size": TEXT_PX, "color": INK},
    }
