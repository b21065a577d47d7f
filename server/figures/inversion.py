"""Forces that an inverse analysis assigns, with two standard deviations, beside the weights that really hung."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fingermodel.comparison.comparison import muscles_of
from fingermodel.studies.inverted import Assigned, Inversion, InvertedCase
from server.figures import graph_objects as go
from server.figures import marks
from server.figures.plot import Plot
from server.figures.report import Section, Table, write_report
from server.figures.report_front import read_first
from server.figures.sheet import Sheet, shape
from server.figures.style import (
    BAND,
    INK,
    SMALL_PX,
    ZERO_LINE,
    axis,
    in_order,
    load_styles,
    load_text,
    named_axis,
    number,
    plain,
    posture_name,
    whiskers,
)

JOINT_COLOR = "#5B2A86"
_PANEL, _GAP, _TOP, _BOTTOM, _BOTTOM_LEVEL, _LEFT, _RIGHT = 150, 44, 122, 78, 36, 64, 16  # [px]
# Empty places between the loads.
_BREAK = 1.0
_SIDE = 1.0
# Pages draw no figure narrower than this (plot_size.js) [px].
_LEAST = 720
# Half the width of a dash, in places.
_HALF = 0.4


@dataclass(frozen=True)
class _Panel:
    """One force over all cases: what it is called, its colour, its values as drawn, and whether it can be negative."""

    title: str
    color: str
    forces: Sequence[Assigned]
    signed: bool


@dataclass(frozen=True)
class _Order:
    """Cases as they stand from left to right: side by side under what hung, then by posture."""

    cases: tuple[InvertedCase, ...]
    at: tuple[float, ...]
    loads: tuple[tuple[str, float, float], ...]


def inversion_plots(inversion: Inversion) -> list[Plot]:
    """Draw an inversion: its muscles in one figure, its joints in another."""
    order = _ordered(inversion.cases)
    signed = inversion.closure != "least_squares"
    sign = (
        "Below zero, hollow: the closure asks the muscle to push, which none can." if signed else "Muscles only pull."
    )
    styles = load_styles(m.merged[0] for m in inversion.muscles)
    muscles = [
        _Panel(
            m.name if m.merged == (m.name,) else f"{m.name} (stands for {' and '.join(m.merged)})",
            styles[m.merged[0]].color,
            [c.muscles[m.name] for c in order.cases],
            signed,
        )
        for m in inversion.muscles
    ]
    joints = [
        _Panel(f"{name} contact", JOINT_COLOR, [c.contacts[name] for c in order.cases], False)
        for name in inversion.cases[0].contacts
    ]
    closure = f"{inversion.title[:1].upper()}{inversion.title[1:]}"
    said = f"{closure}. One place for each load case, side by side over what hung."
    title, size = "Contact forces between the bones", "Magnitude of the force of the child bone on its parent."
    return [
        Plot(
            "inversion-muscles",
            "Muscle forces",
            _strips(muscles, order, "really hung", "Muscle forces behind the measured tip forces", f"{said}<br>{sign}"),
            "Where dot and dash part by more than the bar, the closure finds another muscle than the one that pulled. "
            "A bar that meets the frame goes on beyond it.",
        ),
        Plot(
            "inversion-contacts",
            "Joint contact forces",
            _strips(joints, order, "the model's, of the weights that hung", title, f"{said}<br>{size}"),
            "No load cell reads these: dots follow from the tip force and the closure, dashes from the known weights.",
        ),
    ]


def inversion_report(
    folder: Path,
    inversion: Inversion,
    title: str,
    model: str,
    notes: Sequence[str] = (),
    first: Sequence[str] = (),
) -> Path:
    """Write `inversion.html`, and every figure as PNG and SVG; return the page.

    Args:
        folder: made where it is absent.
        inversion: to draw.
        title: of the page.
        model: its name, for the line below.
        notes: further sentences for the beginning.
        first: what has to be known before it.
    """
    plots = inversion_plots(inversion)
    muscles = Table(
        ["muscle", "stands for", "RMS of assigned less hung [N]", "within 2 sd", "asked to push", "beyond 2 sd"],
        [
            [
                m.name,
                "+".join(m.merged),
                number(m.rms_error_N),
                f"{m.within_2sd} of {len(inversion.cases)}",
                str(m.pushes),
                str(m.pushes_beyond_2sd),
            ]
            for m in inversion.muscles
        ],
    )
    sections = [
        *read_first(first),
        Section("Summary", [*inversion.verdicts(), muscles, *inversion.notes, *notes]),
        *(Section(p.heading, [p]) for p in plots),
        Section("Load cases", [_case_table(inversion)]),
    ]
    subtitle = f"Model: {model}. Closure: {inversion.title}."
    return write_report(folder / "inversion.html", sections, title, subtitle)


def _case_table(inversion: Inversion) -> Table:
    muscles, joints = [m.name for m in inversion.muscles], list(inversion.cases[0].contacts)
    rows = []
    for case in inversion.cases:
        forces = [*(case.muscles[m] for m in muscles), *(case.contacts[j] for j in joints)]
        cells = [f"{number(a.force_N)} ± {number(a.sd_N)} ({number(a.hung_N)})" for a in forces]
        rows.append([case.id, posture_name(case.posture), load_text(case.masses_g), *cells])
    return Table(
        ["case", "posture", "hung", *muscles, *(f"{j} contact" for j in joints)],
        rows,
        "Force ± sd (what hung; for contacts the model's, of the weights that hung) [N]",
    )


def _ordered(cases: Sequence[InvertedCase]) -> _Order:
    def load(case: InvertedCase) -> str:
        return muscles_of(case.masses_g)

    names, postures = in_order(map(load, cases)), list(dict.fromkeys(c.posture for c in cases))
    # Single tendons first; sorted() keeps the session's order where all else is equal.
    ordered = sorted(cases, key=lambda c: (names.index(load(c)), postures.index(c.posture), sum(c.masses_g.values())))
    at: list[float] = []
    loads: list[tuple[str, float, float]] = []
    place = 0.0
    for name in names:
        mine = sum(load(c) == name for c in ordered)
        loads.append((name, place - 0.5, place + mine - 0.5))
        at += [place + i for i in range(mine)]
        place += mine + _BREAK
    return _Order(tuple(ordered), tuple(at), tuple(loads))


def _strips(panels: Sequence[_Panel], order: _Order, known: str, title: str, subtitle: str) -> go.Figure:
    """Draw one panel below the other, cases from left to right over bands for the loads; dashes are what is known."""
    crowded = _crowded(order)
    margins = (_LEFT, _RIGHT, _TOP, _BOTTOM if crowded else _BOTTOM_LEVEL)
    sheet = Sheet(len(panels) * _PANEL + (len(panels) - 1) * _GAP, margins, showlegend=True)
    reach = [order.loads[0][1] - _SIDE, order.loads[-1][2] + _SIDE]
    for k, panel in enumerate(panels):
        span = _span(panel)
        axes = sheet.panel(
            named_axis(
                [0.5 * (begin + end) for _, begin, end in order.loads],
                [plain(name) for name, _, _ in order.loads],
                reach,
                showgrid=False,
                tickangle=-40 if crowded else 0,
                showticklabels=k == len(panels) - 1,
            ),
            axis("force [N]", range=span, nticks=5, **ZERO_LINE),
            top=k * (_PANEL + _GAP),
            high=_PANEL,
            heading=plain(panel.title),
        )
        on = (axes["xaxis"], axes["yaxis"])
        sheet.shapes += [shape((begin, end), span, on, fillcolor=BAND) for _, begin, end in order.loads]
        sheet.data += _traces(panel, order, known, axes, first=k == 0)
    return sheet.drawn(title, subtitle, legend_px=26)


def _crowded(order: _Order) -> bool:
    """Return whether the loads' names would touch if they stood level, on the narrowest page."""
    places = order.loads[-1][2] - order.loads[0][1] + 2.0 * _SIDE
    per_place = (_LEAST - _LEFT - _RIGHT) / places
    return any(len(name) * 0.62 * SMALL_PX > (end - begin + _BREAK) * per_place for name, begin, end in order.loads)


def _span(panel: _Panel) -> list[float]:
    """Return the vertical range: forces, hung weights and bars, but no bar beyond 1.5 times the forces."""
    force = np.array([a.force_N for a in panel.forces])
    hung = np.array([a.hung_N or 0.0 for a in panel.forces])
    below, above = (np.array(bar) for bar in _bars(panel))
    low, high = min(0.0, force.min(), hung.min()), max(0.0, force.max(), hung.max())
    room = 0.5 * (high - low) or 1.0
    low, high = max(low - room, min(low, (force - below).min())), min(high + room, max(high, (force + above).max()))
    edge = 0.05 * (high - low)
    return [float(low - edge), float(high + edge)]


def _bars(panel: _Panel) -> tuple[list[float], list[float]]:
    """Return the lengths of each error bar down and up; a force that cannot be negative has none below zero."""
    above = [2.0 * a.sd_N for a in panel.forces]
    if panel.signed:
        return above, above
    return [min(bar, max(a.force_N, 0.0)) for bar, a in zip(above, panel.forces, strict=True)], above


def _traces(panel: _Panel, order: _Order, known: str, axes: dict[str, str], *, first: bool) -> list[go.Scatter]:
    words = [
        f"<b>{plain(c.id)}</b> {plain(load_text(c.masses_g))}, {posture_name(c.posture)}"
        f"<br>{number(a.force_N)} ± {number(2.0 * a.sd_N)} N; {known}: {number(a.hung_N)} N"
        for c, a in zip(order.cases, panel.forces, strict=True)
    ]
    own: dict[str, Any] = {"showlegend": first, **axes}
    pushed = [a.force_N < -1e-9 for a in panel.forces]
    below, above = _bars(panel)
    return [
        marks.line(
            [x for at in order.at for x in (at - _HALF, at + _HALF, None)],
            [y for a in panel.forces for y in (a.hung_N, a.hung_N, None)],
            {"color": INK, "width": 2},
            name=known,
            legendgroup="hung",
            **own,
        ),
        marks.points(
            order.at,
            [a.force_N for a in panel.forces],
            {"color": panel.color, "size": 6, "symbol": ["circle-open" if p else "circle" for p in pushed]},
            words,
            error_y=whiskers(above, panel.color, below, thickness=1.2, width=0),
            name="assigned ± 2 sd",
            legendgroup="assigned",
            **own,
        ),
    ]
