"""A movement over time: tip force, angles and torques in one figure, the muscles' forces in another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fingermodel.studies.movement import MovementResult
from server.figures import graph_objects as go
from server.figures.plot import Plot
from server.figures.report import Section, Table, write_report
from server.figures.sheet import Sheet, shape
from server.figures.style import MUTED, ZERO_LINE, axis, number, plain

Floats = NDArray[np.float64]
COLORS = ("#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9")
TOTAL, ACTIVE, PASSIVE, OTHER = "#222222", "#0072B2", "#D55E00", "#8a8a8a"
_COLUMNS = 2
_MARGINS, _GAP_X, _GAP_Y, _HEIGHT = (64, 16, 104, 52), 62, 46, 170  # [px]


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
        title="Muscle forces",
        subtitle="Min/max recruitment of what the passive forces leave. Each muscle has its own scale.",
    )


def movement_plots(result: MovementResult, reference: Reference | None = None) -> list[Plot]:
    """Return the figures of a movement, for reports, pages and studies.

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
    sections = [*(Section(p.heading, [p]) for p in plots), Section("Peaks", [peaks])]
    subtitle = f"{result.motion} with {result.finger}, muscles {result.muscle_set}"
    title = "A movement and its muscle forces"
    return write_report(folder / "movement.html", sections, title, subtitle, static=static)


def _grid(result: MovementResult, panels: Sequence[Panel], *, title: str, subtitle: str) -> go.Figure:
    """Draw panels in two columns, one scale of time below them."""
    rows = -(-len(panels) // _COLUMNS)
    sheet = Sheet(rows * _HEIGHT + (rows - 1) * _GAP_Y, _MARGINS, showlegend=True)
    times = [float(result.times_s[0]), float(result.times_s[-1])]
    named: set[str] = set()
    for index, panel in enumerate(panels):
        row, column = divmod(index, _COLUMNS)
        span = _span(panel.lines)
        axes = sheet.panel(
            axis("time [s]" if index + _COLUMNS >= len(panels) else "", range=times, nticks=7),
            axis(panel.unit, range=span, nticks=5, **ZERO_LINE | {"zerolinecolor": MUTED}),
            **sheet.grid(row, column, _COLUMNS, _HEIGHT, (_GAP_X, _GAP_Y)),
            heading=plain(panel.heading),
            above=3,
        )
        dotted = {"color": MUTED, "width": 1, "dash": "dot"}
        on = (axes["xaxis"], axes["yaxis"])
        sheet.shapes += [shape((at, at), span, on, line=dotted) for at in result.contact_s() or ()]
        for line in panel.lines:
            times_s = result.times_s if line.times is None else line.times
            sheet.data.append(
                go.Scatter(
                    x=np.round(times_s, 6).tolist(),
                    y=[float(f"{v:.6g}") for v in line.values],
                    name=plain(line.name),
                    legendgroup=line.name,
                    showlegend=line.name not in named,
                    mode="lines",
                    line={"color": line.color, "width": 1.8, "dash": line.dash},
                    **axes,
                )
            )
            named.add(line.name)
    return sheet.drawn(title, subtitle, legend_px=24)


def _span(lines: Sequence[Line]) -> list[float]:
    """Return the range of the vertical axis: all curves and zero, with a margin."""
    low = min(0.0, *(float(line.values.min()) for line in lines))
    high = max(0.0, *(float(line.values.max()) for line in lines))
    room = 0.06 * (high - low) or 1.0
    return [low - (room if low < 0.0 else 0.0), high + room]
