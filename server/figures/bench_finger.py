"""The finger as it is held at the bench: posture, weights on the tendons, and the force on the cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fingermodel.comparison.comparison import CaseComparison, muscles_of
from fingermodel.fingers import Finger, FingerValues
from server.figures import graph_objects as go
from server.figures import marks
from server.figures.arrows import area_of, arrow_traces, sector_trace
from server.figures.panels import Panel, angles_text, force_scale, head_mm, panels_figure
from server.figures.poses import FingerPose, finger_pose, reach_mm, stub_mm
from server.figures.sheet import key, panel_axes
from server.figures.skeleton import TENDON
from server.figures.style import (
    INK,
    SMALL_PX,
    load_styles,
    load_text,
    number,
    plain,
    posture_name,
    rgba,
)
from server.figures.tendon_lines import leaving, tendon_paths
from server.figures.vectors import vector_line

Floats = NDArray[np.float64]
GRAVITY_M_S2 = 9.81
# The longest force is so much of the stretched finger; where none is known, that of all weights together would be.
_LONGEST = 0.6


@dataclass(frozen=True)
class Hung:
    """Weights on the tendons, and the known forces on the cell."""

    masses_g: Mapping[str, float]  # on each tendon
    location: str = "tip"  # of the cell: tip or bone
    case: str = ""  # its id, empty where none is meant
    role: str = ""  # of the case
    measured_N: Floats | None = None  # (3,) in mount axes; None where it is not known
    measured_sd_N: Floats | None = None  # (3,) its standard uncertainty
    predicted_N: Floats | None = None  # (3,); None where it is not known, or may not be seen
    note: str = ""  # a sentence, such as why no prediction is shown
    beside: tuple[str, Floats] | None = None  # a second prediction, with its name in the legend


def finger_figure(
    finger: Finger, values: FingerValues, posture: str, posture_rad: Floats, hung: Hung, model_name: str = ""
) -> go.Figure:
    """Draw the finger in a posture with its weights, and the measured and the predicted force.

    Args:
        finger: whose topology it is.
        values: its numbers, possibly fitted.
        posture: its name.
        posture_rad: (rotations,) angles.
        hung: weights and forces.
        model_name: for the title.

    Returns:
        the figure; `layout.meta` tells where and how large forces are drawn, so that another one, such as the live
        one, can be put beside them: `mm_per_N`, and of `tip` and `bone` the `origin_mm` (2,) and the `rotation` (3, 3)
        from mount axes.
    """
    pose = finger_pose(finger, values, posture_rad)
    forces = [f for f in (hung.measured_N, hung.predicted_N) if f is not None]
    first = pose.origins[finger.topology.joints[0].child]
    places = {"tip": (pose.load_point, pose.tip_rotation), "bone": (first, np.eye(3))}
    origin, rotation = places[hung.location]
    reach = reach_mm(values)
    weight_N = 1e-3 * GRAVITY_M_S2 * sum(hung.masses_g.values())
    scale = force_scale([rotation @ f for f in forces] or [np.array([weight_N or 1.0, 0.0])], _LONGEST * reach)
    axes = panel_axes(0)
    panel = Panel(posture, pose, [])
    panel.heading = _heading(finger, posture, pose, hung)
    panel.traces += _loaded(finger, values, pose, hung.masses_g, axes)
    panel.traces += _weights(finger, values, pose, hung.masses_g, axes)
    keys = _arrows(panel, hung, origin, rotation, scale, head_mm(1, reach), axes)
    out = panels_figure(
        [panel],
        finger,
        values,
        scale,
        keys,
        title=f"The finger in {posture_name(posture).lower()}" + (f": {plain(model_name)}" if model_name else ""),
        subtitle=_subtitle(hung),
    )
    out.layout.meta = {
        "mm_per_N": scale,
        "location": hung.location,
        "case": hung.case,
        **{k: {"origin_mm": o[:2].tolist(), "rotation": r.tolist()} for k, (o, r) in places.items()},
    }
    return out


def _arrows(
    panel: Panel, hung: Hung, origin: Floats, rotation: Floats, scale: float, head: float, axes: dict[str, str]
) -> list[go.Scatter]:
    """Add the forces to a panel; return what stands for them in the legend."""
    [style] = load_styles([muscles_of(hung.masses_g)]).values()
    color, unknown = style.color, np.full(3, np.nan)
    measured, sd, predicted = (
        unknown if f is None else f for f in (hung.measured_N, hung.measured_sd_N, hung.predicted_N)
    )
    masses = {m: float(g) for m, g in hung.masses_g.items()}
    known = (hung.case, hung.role, panel.posture, hung.location, masses)
    case = CaseComparison(*known, measured, sd, predicted, None, None, None)
    keys = []
    if hung.measured_N is not None:
        force = (rotation @ hung.measured_N)[:2]
        if np.isfinite(sd).all() and (sd > 0).any():
            area = area_of(case, noise_assumed=False, spread=None)
            panel.traces.append(sector_trace(case, force, area, origin, scale, color, axes))
            keys.append(
                key(area.meaning, fill="toself", fillcolor=rgba(color, 0.22), line={"color": rgba(color, 0.35)})
            )
    name, beside = hung.beside or ("", None)
    for kind, named, force_N, place in (
        ("measured", "measured", hung.measured_N, 0),
        ("predicted", "predicted", hung.predicted_N, len(keys) + 1),
        ("before_predicted", plain(name), beside, 2),
    ):
        if force_N is not None:
            look: dict[str, Any] = {"case": case, "line": vector_line(kind, color), "head_mm": head}
            look |= {"words": f"{named}," if kind == "before_predicted" else "", "hollow": kind != "measured"}
            panel.traces += arrow_traces((rotation @ force_N)[:2], origin, scale, axes, kind=kind, **look)
            keys.insert(place, key(named, line=look["line"]))
    return keys or [key("tendon", line={"color": TENDON, "width": 1.2})]


def _loaded(
    finger: Finger, values: FingerValues, pose: FingerPose, masses_g: Mapping[str, float], axes: dict[str, str]
) -> list[go.Scatter]:
    """Return paths of the tendons that carry a weight, upon all others."""
    styles = load_styles(masses_g)
    traces = []
    for segment, path in zip(finger.topology.segments, tendon_paths(finger, values, pose), strict=True):
        if masses_g.get(segment.slip):
            look = {"color": styles[segment.slip].color, "width": 3}
            traces.append(marks.line(*marks.xy(path.round(4)), look, showlegend=False, meta="loaded", **axes))
    return traces


def _weights(
    finger: Finger, values: FingerValues, pose: FingerPose, masses_g: Mapping[str, float], axes: dict[str, str]
) -> list[go.Scatter]:
    """Return the string of each loaded tendon, over a pulley beyond the clamp, and the weight on its end; schematic."""
    hung = {m: leaving(finger, values, pose, m)[:, :2] for m in finger.topology.muscles if masses_g.get(m)}
    styles = load_styles(hung)
    stub = stub_mm(values)
    heaviest = max((masses_g[m] for m in hung), default=1.0)
    lowest = min((float(string[-1, 1]) for string in hung.values()), default=0.0)
    top, wide = lowest - 0.6 * stub, 0.17 * stub
    traces: list[go.Scatter] = []
    # The lowest string hangs nearest, so that none crosses a weight.
    for place, muscle in enumerate(sorted(hung, key=lambda m: float(hung[m][-1, 1]))):
        string, color, mass_g = hung[muscle], styles[muscle].color, float(masses_g[muscle])
        pulley, high = (1.25 + 0.42 * place) * stub, 0.34 * stub * (0.4 + 0.6 * mass_g / heaviest)
        path = np.concatenate([string, [[pulley, string[-1, 1]], [pulley, top]]]).round(4)
        line = {"color": color, "width": 1.5}
        traces.append(marks.line(*marks.xy(path), line, showlegend=False, meta="string", **axes))
        left, right, under = pulley - wide, pulley + wide, top - high
        traces.append(
            marks.area(
                [left, right, right, left, left],
                [top, top, under, under, top],
                rgba(color, 0.55),
                line,
                hoveron="fills",
                hoverinfo="text",
                text=f"{plain(muscle)} {mass_g:g} g",
                meta={"kind": "weight", "tendon": muscle, "mass_g": mass_g},
                **axes,
            )
        )
        # The words keep clear of the weight's lower edge. Two places without words make the drawing wide and high
        # enough for them.
        traces.append(
            go.Scatter(
                x=[pulley, left - wide, right + wide],
                y=[under - 0.06 * stub, under - 0.5 * stub, under - 0.5 * stub],
                mode="text",
                text=[f"{plain(muscle)}<br>{mass_g:g} g", "", ""],
                textposition="bottom center",
                textfont={"size": SMALL_PX + 1, "color": INK},
                hoverinfo="skip",
                showlegend=False,
                meta="weight_text",
                **axes,
            )
        )
    return traces


def _heading(finger: Finger, posture: str, pose: FingerPose, hung: Hung) -> str:
    lines = [f"<b>{posture_name(posture)}</b>", angles_text(finger, pose)]
    if hung.measured_N is not None and hung.predicted_N is not None:
        lines.append(f"measured − predicted {_size(hung.measured_N - hung.predicted_N)} in the plane")
    return "<br>".join(lines)


def _subtitle(hung: Hung) -> str:
    told = ["Seen from the radial side."]
    if hung.case or hung.masses_g:
        case = f"{plain(hung.case)}, {plain(hung.role)}: " if hung.case else ""
        told = [f"{case}{plain(load_text(hung.masses_g))}, cell at the {plain(hung.location)}. {told[0]}"]
    forces: Sequence[tuple[str, Floats | None]] = (("measured", hung.measured_N), ("predicted", hung.predicted_N))
    sizes = [f"{name} {_size(force)}" for name, force in forces if force is not None]
    if sizes:
        told.append(f"Force on the cell in the sagittal plane: {', '.join(sizes)}.")
    return "<br>".join([*told, *([plain(hung.note)] if hung.note else [])])


def _size(force: Floats) -> str:
    return f"{number(float(np.hypot(*force[:2])))} N"
