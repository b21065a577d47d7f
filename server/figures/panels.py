"""Panels of one scale: the finger in each posture with its vectors, equally large, equal in both directions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fingermodel.comparison.comparison import CaseComparison, Comparison
from fingermodel.comparison.observations import Observations
from fingermodel.fingers import Finger, FingerValues
from server.figures import graph_objects as go
from server.figures.poses import FingerPose, finger_pose
from server.figures.scales import scale_bars
from server.figures.sheet import Sheet, note, panel_axes
from server.figures.skeleton import finger_traces
from server.figures.style import (
    BARE,
    SMALL_PX,
    TEXT_PX,
    WIDTH,
    in_order,
    legend,
    load_styles,
    load_text,
    mix,
    number,
    plain,
    posture_name,
)

Floats = NDArray[np.float64]
MAX_LOADS = 9
_GAP, _HEADING, _SIDE = 18, 64, 14  # [px] between panels, above each, beside all


@dataclass
class Panel:
    """One posture: its pose, what is drawn over the finger and its heading."""

    posture: str
    pose: FingerPose
    cases: list[CaseComparison]
    traces: list[go.Scatter] = field(default_factory=list)
    heading: str = ""

    def extent(self) -> Floats:
        """Return (2, 2) lowest and highest x and y of everything drawn [mm]."""
        pairs = [pair for t in self.traces for pair in zip(t.x or (), t.y or (), strict=True) if pair[0] is not None]
        points = np.array(pairs, dtype=float)
        return np.stack([points.min(axis=0), points.max(axis=0)])


def panels_of(
    finger: Finger, values: FingerValues, observations: Observations, cases: Sequence[CaseComparison]
) -> list[Panel]:
    """Return one panel a posture, in the order of the cases, each with its own cases."""
    where = {case_id: i for i, case_id in enumerate(observations.ids)}
    postures = np.asarray(observations.inputs.posture)
    panels = []
    for posture in dict.fromkeys(c.posture for c in cases):
        own = [c for c in cases if c.posture == posture]
        panels.append(Panel(posture, finger_pose(finger, values, postures[where[own[0].id]]), own))
    return panels


def thinned(cases: Sequence[CaseComparison]) -> tuple[list[CaseComparison], str]:
    """Keep a panel readable: where a posture has too many cases, only the heaviest of each tendon or combination.

    Returns:
        The cases to draw, and a sentence that says what was left out (empty if nothing).
    """
    counts = [sum(c.posture == p for c in cases) for p in {c.posture for c in cases}]
    if max(counts, default=0) <= MAX_LOADS:
        return list(cases), ""
    heaviest: dict[tuple[str, str], CaseComparison] = {}
    for case in cases:
        key = (case.posture, case.muscles)
        if key not in heaviest or sum(case.masses_g.values()) > sum(heaviest[key].masses_g.values()):
            heaviest[key] = case
    kept = [c for c in cases if heaviest[c.posture, c.muscles] is c]
    return kept, f"Heaviest load of each tendon or combination only: {len(kept)} of {len(cases)} cases."


def load_colors(cases: Iterable[CaseComparison]) -> dict[str, str]:
    """Return the colour of every load by its text: the tendon's own, paler for lighter loads of the same tendons."""
    rows = list(cases)
    out: dict[str, str] = {}
    styles = load_styles(in_order(c.muscles for c in rows))
    for muscles, style in styles.items():
        loads = {load_text(c.masses_g): sum(c.masses_g.values()) for c in rows if c.muscles == muscles}
        ordered = sorted(loads, key=loads.__getitem__)
        for i, text in enumerate(ordered):
            pale = 0.5 * (1.0 - i / (len(ordered) - 1)) if len(ordered) > 1 else 0.0
            out[text] = mix(style.color, "#ffffff", pale)
    return out


def force_scale(forces: Iterable[Floats], length_mm: float) -> float:
    """Return the scale [mm/N] at which the longest force is `length_mm` long; 0 where there is no force."""
    longest = max((float(np.hypot(f[0], f[1])) for f in forces), default=0.0)
    return length_mm / longest if longest > 0 else 0.0


def head_mm(panels: int, length_mm: float) -> float:
    """Return the length of an arrow's head in a figure of so many panels: about as large on the page in all of them."""
    return length_mm * (0.028 if panels == 1 else 0.042 if panels <= 4 else 0.055)


def heading(panel: Panel, finger: Finger, comparison: Comparison) -> str:
    """Write a panel's heading: posture, joint angles and the errors of the cases drawn."""
    errors = Comparison(tuple(panel.cases), comparison.noise_assumed).errors("sagittal")
    turn = "" if errors.direction_error_deg is None else f"{number(errors.direction_error_deg, 1)}°, "
    size = f"{number(errors.magnitude_error_N)} N ({number(errors.magnitude_error_pct, 1)} %)"
    return f"<b>{posture_name(panel.posture)}</b><br>{angles_text(finger, panel.pose)}<br>mean error {turn}{size}"


def angles_text(finger: Finger, pose: FingerPose) -> str:
    """Write the angles of a posture [deg]; of other than flexions those that are not zero."""
    named = zip(finger.topology.rotations, np.rad2deg(pose.posture), strict=True)
    flexions = {j.name for j in finger.topology.joints}
    return ", ".join(f"{plain(n)} {number(float(a), 0)}°" for n, a in named if n in flexions or abs(a) > 0.05)


def panels_figure(
    panels: Sequence[Panel],
    finger: Finger,
    values: FingerValues,
    mm_per_N: float,
    keys: Sequence[go.Scatter],
    *,
    title: str,
    subtitle: str,
) -> go.Figure:
    """Set panels out in a grid of equal scale and add the scale bars and the key.

    Args:
        panels: with everything but the finger.
        finger: drawn below.
        values: its numbers.
        mm_per_N: scale of the forces.
        keys: traces that stand only for their entry in the legend.
        title: of the figure.
        subtitle: below it.
    """
    for index, panel in enumerate(panels):
        panel.traces[:0] = finger_traces(finger, values, panel.pose, panel_axes(index))
    columns = 1 if len(panels) == 1 else 2 if len(panels) <= 4 else 3
    extents = np.array([p.extent() for p in panels])
    spans = extents[:, 1] - extents[:, 0]
    strip = 0.1 * float(spans.max())  # the scale bars stand in a strip of their own
    across = 1.05 * float(spans[:, 0].max())
    up = [1.05 * float(spans[r : r + columns, 1].max()) + strip for r in range(0, len(panels), columns)]
    width = (WIDTH - 2 * _SIDE - (columns - 1) * _GAP) / columns
    px_per_mm = min(width / across, 480.0 / max(up))
    top = 58 + 15 * subtitle.count("<br>") + (18 if subtitle else 0)
    longest = max(_key_width(k) for k in keys)
    bottom = 40 + 19 * -(-len(keys) // max(1, (WIDTH - 2 * _SIDE) // longest))
    high = sum(up) * px_per_mm + len(up) * _HEADING + (len(up) - 1) * _GAP
    sheet = Sheet(high, (_SIDE, _SIDE, top, int(bottom)), showlegend=True)
    down = 0.0
    for index, panel in enumerate(panels):
        row, column = divmod(index, columns)
        size = np.array([across, up[row]])
        low = extents[index].mean(axis=0) - size / 2 - [0.0, strip / 2]
        if column == 0:
            down += _HEADING + (up[row - 1] * px_per_mm + _GAP if row else 0.0)
        left = column * (width + _GAP)
        names = sheet.panel(
            *drawing_axes(low, size, constrain="domain"),
            left=left,
            top=down,
            wide=width,
            high=up[row] * px_per_mm,
            equal=True,
        )
        place = left / sheet.wide, 1.0 - (down - _HEADING + 6) / high
        sheet.notes.append(note(panel.heading, *place, at=("left", "top"), size=SMALL_PX + 1, align="left"))
        bars, words = scale_bars(low, size, mm_per_N, names, first=index == 0)
        sheet.data += [*panel.traces, *bars]
        sheet.notes += words
    sheet.data += keys
    return sheet.drawn(title, subtitle, legend=legend(-14, high) | {"traceorder": "normal"})


def drawing_axes(low: Floats, size: Floats, **more: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the axes of a drawing, of which nothing is seen, from its lower left corner (2,) and its size [mm]."""
    x, y = (BARE | {"range": [float(a), float(a + b)]} | more for a, b in zip(low, size, strict=True))
    return x, y


def _key_width(trace: go.Scatter) -> int:
    return 52 + int(0.56 * TEXT_PX * len(str(trace.name)))
