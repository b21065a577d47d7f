"""Two fingers to one scale with their tip forces, and their bones, moment arms and force ratios as bars."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fingermodel.comparison.comparison import CaseComparison
from fingermodel.studies.published import published_table
from fingermodel.studies.species import SpeciesResult
from fingermodel.studies.species_sides import Load, Side, Spread, same_angles, shared
from server.figures import graph_objects as go
from server.figures import marks
from server.figures.arrows import arrow_traces
from server.figures.panels import Panel, drawing_axes
from server.figures.plot import Plot
from server.figures.poses import finger_pose, reach_mm
from server.figures.report import Section, Table, write_report
from server.figures.scales import scale_bars
from server.figures.sheet import Sheet, key, note, panel_axes
from server.figures.skeleton import finger_traces
from server.figures.style import INK, WIDTH, axis, mix, named_axis, number, plain, whiskers
from server.figures.style import posture_name as named

Floats = NDArray[np.float64]
COLORS = ("#0072B2", "#D55E00")
MEASURED_PX, PREDICTED_PX = 3.2, 1.6
_SIDE, _TOP, _BOTTOM, _GAP_X = 14, 140, 46, 70  # [px]
_BARS, _BETWEEN = 230, 72  # [px] height of the bars, and between them and the fingers
_WIDE = 0.36
_THIN = {"color": INK, "width": 1.0}
_PRINTED = {"symbol": "diamond", "size": 8, "color": "#ffffff", "line": _THIN}
_ARROW_SHARE = 0.5  # of the shorter finger's reach, for the largest arrow


@dataclass(frozen=True)
class Bars:
    """One panel of bars: names, and for each of the two sides its bar, printed number, and measured spread."""

    heading: str
    unit: str
    names: Sequence[str]
    model: Sequence[Sequence[float | None]]
    reach: Sequence[Sequence[Spread | None]] | None = None
    measured: Sequence[Sequence[Spread | None]] | None = None
    printed: Sequence[Sequence[float | None]] | None = None


def species_plots(result: SpeciesResult) -> list[Plot]:
    """Return the comparison's figure with its caption."""
    caption = (
        "Arrows: tip force of one newton of tension, shared among the tendons as the weights were; seen from the "
        "radial side. The ratios below are of norms in space, their whiskers from least to most over postures and "
        "loads. Outlines of bones are schematic."
    )
    return [Plot("species", "Two fingers", species_figure(result), caption)]


def species_report(result: SpeciesResult, folder: Path, *, static: bool = True) -> Path:
    """Write `species.html`, and its figure as PNG and SVG, into a folder; return the page."""
    sections = [Section("Side by side", [*species_plots(result), *result.assumptions])]
    if result.steps:
        rows = [[s.what, number(s.tension_to_tip), number(s.bone_to_tip)] for s in result.steps]
        sections.append(Section("Step by step", [Table(["finger", "tension / tip", "bone / tip"], rows)]))
    if result.rows:
        header, lines, notes = published_table(result.rows)
        sections.append(Section("Published and ours", [Table(header, lines), *notes]))
    subtitle = f"{result.of.label} and {result.other.label}"
    return write_report(folder / "species.html", sections, "Two fingers side by side", subtitle, static=static)


def species_figure(result: SpeciesResult) -> go.Figure:
    """Draw both fingers in one posture to one scale with their tip forces per unit tension, and bars below."""
    sides = (result.of, result.other)
    posture, same = _posture(result)
    panels, mm_per_unit = _fingers(result, posture)
    extents = np.array([panel.extent() for panel in panels])
    wide, high = (1.04 * (extents[:, 1] - extents[:, 0]).max(axis=0)).tolist()
    strip = 0.1 * wide  # the scale bars stand in a strip of their own
    high += strip
    across = (WIDTH - 2 * _SIDE - _GAP_X) / 2
    px_per_mm = min(across / wide, 350.0 / high)
    tall = px_per_mm * high
    sheet = Sheet(tall + _BETWEEN + _BARS, (_SIDE, _SIDE, _TOP, _BOTTOM), barmode="overlay", showlegend=True)
    size = np.array([across / px_per_mm, high])
    for i, panel in enumerate(panels):
        low = extents[i].mean(axis=0) - size / 2 - [0.0, strip / 2]
        left = i * (across + _GAP_X)
        names = sheet.panel(*drawing_axes(low, size), left=left, wide=across, high=tall)
        rulers, words = scale_bars(low, size, mm_per_unit, names, first=i == 0)
        sheet.data += [*panel.traces, *rulers]
        sheet.notes.append(note(panel.heading, left / sheet.wide, 1.0, shift=(0, 6)))
        sheet.notes += [w | {"text": f"{w['text']} per N"} if w["text"].endswith(" N") else w for w in words]
    _draw_bars(_bars(result), sheet)
    sheet.data += _keys(sides, result)
    first = plain(result.of.label)
    angles = "the same angles" if same else "each with its own angles"
    return sheet.drawn(
        f"{first[:1].upper()}{first[1:]} and {plain(result.other.label)}",
        f"{named(posture)}, {angles}, to one scale. {plain(result.main)}: tip force per tension, sagittal plane.",
        legend_px=50,
    )


def _posture(result: SpeciesResult) -> tuple[str, bool]:
    """Return the posture to draw: one that both have with the same angles, else of the same name, else the first's."""
    a, b = result.of, result.other
    loaded = [load.posture for load in a.of_tendons(result.main)]
    common = [p for p in dict.fromkeys(loaded) if any(load.posture == p for load in b.of_tendons(result.main))]
    for name in common:
        if same_angles(a, b, name):
            return name, True
    return (common or loaded)[0], False


def _fingers(result: SpeciesResult, posture: str) -> tuple[list[Panel], float]:
    """Return a panel a side, the finger with its heaviest main load's tip force per tension, and mm per N per N."""
    sides = (result.of, result.other)
    chosen = [_heaviest(side, result.main, posture) for side in sides]
    largest = max(
        float(np.linalg.norm(f)) / load.tension_N
        for load in chosen
        for f in (load.tip_N, load.measured_tip_N)
        if f is not None
    )
    reach = min(reach_mm(side.finger.values) for side in sides)
    mm_per_unit = _ARROW_SHARE * reach / largest
    panels = []
    for index, (side, load, color) in enumerate(zip(sides, chosen, COLORS, strict=True)):
        pose = finger_pose(side.finger, side.finger.values, side.postures_rad[load.posture])
        axes = panel_axes(index)
        panel = Panel(load.posture, pose, [], finger_traces(side.finger, side.finger.values, pose, axes))
        case = _case(load)
        scale = mm_per_unit / load.tension_N
        turned = [(f, k) for f, k in ((load.measured_tip_N, "measured"), (load.tip_N, "predicted")) if f is not None]
        for force, kind in turned:
            look: dict[str, Any] = {"case": case, "line": _line(color, kind), "head_mm": 0.06 * reach}
            look["hollow"] = kind == "predicted"
            seen = (pose.tip_rotation @ force)[:2]
            panel.traces += arrow_traces(seen, pose.load_point, scale, axes, kind=kind, **look)
        ratio, read = (load.ratios(measured=m, plane="sagittal")["tip_per_tension"] for m in (False, True))
        words = f"predicted {number(ratio)}" + (f", measured {number(read)}" if read is not None else "")
        panel.heading = f"<b>{plain(result.names[index])}</b><br>tip force per tension: {words}"
        panels.append(panel)
    return panels, mm_per_unit


def _heaviest(side: Side, tendons: str, posture: str) -> Load:
    own = side.of_tendons(tendons)
    here = [load for load in own if load.posture == posture] or own
    return max(here, key=lambda load: load.tension_N)


def _case(load: Load) -> CaseComparison:
    """Return the load as a case of a comparison, for the arrows' hover texts."""
    nothing = np.full(3, np.nan)
    measured = nothing if load.measured_tip_N is None else load.measured_tip_N
    known = (load.tendons, "tip force", load.posture, "tip", load.masses_g)
    return CaseComparison(*known, measured, nothing, load.tip_N, None, None, None)


def _line(color: str, kind: str) -> dict[str, Any]:
    if kind == "measured":
        return {"color": mix(color, "#ffffff", 0.45), "width": MEASURED_PX}
    return {"color": mix(color, "#000000", 0.3), "width": PREDICTED_PX, "dash": "6px,3px"}


def _bars(result: SpeciesResult) -> list[Bars]:
    a, b = result.of, result.other
    rows = {r.quantity: r.published for r in result.rows}

    def printed(quantities: Sequence[str]) -> list[list[float | None]] | None:
        both = [[rows.get(f"{who} {q}") for q in quantities] for who in ("human", "bonobo")]
        return both if any(x is not None for side in both for x in side) else None

    bones = [name for name, _, _ in shared(a.lengths_mm, b.lengths_mm)]
    arms = [n for n, _, _ in shared(a.arms_mm, b.arms_mm) if n.rpartition(".")[2] in result.main.split("+")]
    keys = ("tension_to_tip", "bone_to_tip")
    words = ("tension to tip force", "bone to tip force")
    predicted, measured = (
        [[side.spread(result.main, k, measured=m) for k in keys] for side in (a, b)] for m in (False, True)
    )
    means = [[None if s is None else s.mean for s in row] for row in predicted]
    return [
        Bars(
            "Bone lengths",
            "mm",
            bones,
            [[side.lengths_mm.get(n) for n in bones] for side in (a, b)],
            printed=printed([f"{n} length" for n in bones]),
        ),
        Bars(
            "Mean flexion moment arms",
            "mm",
            [n.replace(".", "<br>") for n in arms],
            [[side.arms_mm.get(n) for n in arms] for side in (a, b)],
            printed=printed([f"{n} mean moment arm" for n in arms]),
        ),
        Bars(
            f"{result.main}: force ratios",
            "1",
            ("tension<br>/ tip force", "bone force<br>/ tip force"),
            means,
            predicted,
            measured,
            printed([f"{w}, mean" for w in words]),
        ),
    ]


def _draw_bars(bars: Sequence[Bars], sheet: Sheet) -> None:
    """Draw the panels of bars along the lower edge."""
    counts = [len(panel.names) for panel in bars]
    # A panel with whiskers and marks of its own needs more room for each bar.
    shares = [(n + 0.4) * (1.6 if panel.measured else 1.0) for n, panel in zip(counts, bars, strict=True)]
    gap, left = 58.0, 44.0
    unit = (sheet.wide - left - gap * (len(bars) - 1)) / sum(shares)
    for panel, count, share in zip(bars, counts, shares, strict=True):
        axes = sheet.panel(
            named_axis(range(count), panel.names, (-0.7, count - 0.3), showgrid=False),
            axis("" if panel.unit == "1" else panel.unit, rangemode="tozero", nticks=6),
            left=left,
            top=sheet.high - _BARS,
            wide=unit * share,
            high=_BARS,
        )
        title = f"<b>{plain(panel.heading)}</b>"
        sheet.notes.append(note(title, (left - 34) / sheet.wide, _BARS / sheet.high, shift=(0, 8)))
        sheet.data += _panel_traces(panel, axes)
        left += unit * share + gap


def _panel_traces(panel: Bars, axes: dict[str, str]) -> list[go.Bar | go.Scatter]:
    traces: list[go.Bar | go.Scatter] = []
    for k, (color, shift) in enumerate(zip(COLORS, (-0.2, 0.2), strict=True)):
        there = [(i, n, v) for i, (n, v) in enumerate(zip(panel.names, panel.model[k], strict=True)) if v is not None]
        bar = go.Bar(
            x=[i + shift for i, _, _ in there],
            y=[v for _, _, v in there],
            width=_WIDE,
            marker={"color": mix(color, "#ffffff", 0.25)},
            hovertext=[f"{n.replace('<br>', ' ')}: {number(v)}" for _, n, v in there],
            hoverinfo="text",
            showlegend=False,
            **axes,
        )
        if panel.reach is not None:
            reaches = [r for r in panel.reach[k] if r is not None]
            bar.error_y = _whiskers(reaches, mix(color, "#000000", 0.45))
        traces.append(bar)
        if panel.measured is not None and any(panel.measured[k]):
            found = [(i + shift + 0.08, m) for i, m in enumerate(panel.measured[k]) if m is not None]
            marker = {"symbol": "circle", "size": 8, "color": mix(color, "#ffffff", 0.72), "line": _THIN}
            spread = _whiskers([m for _, m in found], INK)
            words = [f"measured {number(m.mean)}" for _, m in found]
            x, means = [x for x, _ in found], [m.mean for _, m in found]
            traces.append(marks.points(x, means, marker, words, error_y=spread, showlegend=False, **axes))
        if panel.printed is not None:
            known = [(i + shift - 0.08 * bool(panel.measured), v) for i, v in enumerate(panel.printed[k])]
            known = [(x, v) for x, v in known if v is not None]
            words = [f"printed {number(v)}" for _, v in known]
            x, values = [x for x, _ in known], [v for _, v in known]
            traces.append(marks.points(x, values, _PRINTED, words, showlegend=False, **axes))
    return traces


def _whiskers(spreads: Sequence[Spread], color: str) -> dict[str, Any]:
    """Return error bars from the least to the greatest value about the mean."""
    up, down = [s.most - s.mean for s in spreads], [s.mean - s.least for s in spreads]
    return whiskers(up, color, down, thickness=1.2)


def _keys(sides: tuple[Side, Side], result: SpeciesResult) -> list[go.Scatter]:
    grey = "#8a8a8a"
    out = [
        key(plain(name), line={"color": mix(color, "#ffffff", 0.25), "width": 8})
        for name, color in zip(result.names, COLORS, strict=True)
    ]
    out.append(key("predicted", line=_line(grey, "predicted") | {"color": INK}))
    if any(side.session for side in sides):
        out.append(key("measured", line=_line(grey, "measured") | {"color": grey}))
        marker = {"symbol": "circle", "size": 8, "color": "#ffffff", "line": _THIN}
        out.append(key("measured mean", "markers", marker=marker))
    if result.rows:
        out.append(key("printed (Synek et al. 2019)", "markers", marker=_PRINTED))
    return out
