"""Forces as vectors at the finger, posture by posture: at the tip, and net on the metacarpal with its joint's load.

After Synek et al. 2019, Figures 7 and 8.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fingermodel.comparison.comparison import CaseComparison, Comparison
from server.figures import graph_objects as go
from server.figures.arrows import area_of, arrow_traces, sector_trace
from server.figures.compared import Compared
from server.figures.panels import (
    force_scale,
    head_mm,
    heading,
    load_colors,
    panels_figure,
    panels_of,
    thinned,
)
from server.figures.poses import FingerPose, reach_mm
from server.figures.sheet import key, panel_axes
from server.figures.style import INK, NothingToDrawError, load_text, mix, plain, rgba

Floats = NDArray[np.float64]
MEASURED_PX, PREDICTED_PX = 3.2, 1.6


class Beside(NamedTuple):
    """Further forces by case, beside the measured and the predicted ones."""

    name: str = ""  # of the forces in the legend
    force_N: Mapping[str, Floats] = MappingProxyType({})  # (3,) by the case's id


def chosen_cases(comparison: Comparison, location: str, ids: Iterable[str] | None = None) -> list[CaseComparison]:
    """Return the cases of a location that are asked for; by default those of validation, else of identification.

    Raises:
        NothingToDrawError: there is none.
    """
    here = comparison.select(location=location)
    if ids is not None:
        wanted = set(ids)
        cases = [c for c in here.cases if c.id in wanted]
    else:
        cases = list(here.select("validation").cases) or list(here.select("identification").cases)
    if not cases:
        raise NothingToDrawError(f"None of these load cases was measured at the {location}.")
    return cases


def vector_line(kind: str, color: str) -> dict[str, Any]:
    """Return the line of a kind of vector: predicted ones are thinner and darker, to show upon measured ones."""
    if kind == "measured":
        return {"color": color, "width": MEASURED_PX}
    if kind == "predicted":
        return {"color": mix(color, "#000000", 0.45), "width": PREDICTED_PX, "dash": "6px,3px"}
    if kind == "before_predicted":
        return {"color": "#8a8a8a", "width": 1.6, "dash": "2px,2px"}
    return {"color": mix(color, INK, 0.7), "width": 1.4, "dash": "1.5px,2.5px"}


def load_keys(colors: Mapping[str, str], meanings: Iterable[str]) -> list[go.Scatter]:
    """Return entries of the legend: the two kinds of vector, the areas, and the colour of each load."""
    grey = "#8a8a8a"
    out = [
        key("measured", line=vector_line("measured", grey)),
        key("predicted", line=vector_line("predicted", grey) | {"color": INK}),
    ]
    fill: dict[str, Any] = {
        "fill": "toself",
        "fillcolor": rgba(grey, 0.22),
        "line": {"color": rgba(grey, 0.35), "width": 0.8},
    }
    out += [key(meaning, **fill) for meaning in sorted(meanings)]
    return out + [key(plain(text), line={"color": color, "width": 6}) for text, color in colors.items()]


def vector_figure(compared: Compared, cases: Iterable[str] | None = None, beside: Beside | None = None) -> go.Figure:
    """Draw the finger of each posture with measured and predicted tip forces at the load point.

    Forces are turned from the distal phalanx to the metacarpal by the posture that was set.

    Args:
        compared: model, session and comparison.
        cases: ids of the cases to draw.
        beside: forces that another model predicts.

    Raises:
        NothingToDrawError: no tip force.
    """
    return forces_figure(
        compared,
        chosen_cases(compared.comparison, "tip", cases),
        lambda pose: (pose.load_point, pose.tip_rotation),
        longest=0.6,
        title="Tip forces",
        subtitle="Forces on the load cell",
        beside=beside,
    )


def bone_figure(compared: Compared, cases: Iterable[str] | None = None, beside: Beside | None = None) -> go.Figure:
    """Draw measured and predicted net bone forces at the MCP joint, and the load that the joint itself carries.

    Args:
        compared: model, session and comparison.
        cases: ids of the cases to draw.
        beside: forces that another model predicts.

    Raises:
        NothingToDrawError: no bone force.
    """
    first = compared.model.finger.topology.joints[0]
    drawn = chosen_cases(compared.comparison, "bone", cases)
    # The load of the first joint (3,) [N] in each case: of the child bone on the first bone, in its axes.
    joint = np.asarray(compared.model.predict(compared.observations.inputs, compared.theta).joint)[:, 0]
    loads = dict(zip(compared.observations.ids, joint, strict=True))
    return forces_figure(
        compared,
        drawn,
        lambda pose: (pose.origins[first.child], np.eye(3)),
        longest=0.75,
        title="Net metacarpal bone forces",
        subtitle="Net force on the metacarpal",
        joint=Beside(f"{first.name} joint load, predicted", loads),
        beside=beside,
    )


def forces_figure(
    compared: Compared,
    cases: Sequence[CaseComparison],
    place: Callable[[FingerPose], tuple[Floats, Floats]],
    *,
    longest: float,
    title: str,
    subtitle: str,
    joint: Beside | None = None,
    beside: Beside | None = None,
) -> go.Figure:
    """Draw the finger of each posture with measured and predicted forces at one place.

    Args:
        compared: model, session and comparison.
        cases: to draw.
        place: where the forces begin [mm], and the rotation that takes them to the axes of the first bone.
        longest: length of the longest force over that of the finger.
        title: kind of force.
        subtitle: the force in full.
        joint: loads of the joint alone, in the axes of the first bone.
        beside: forces that another model predicts, in the same axes as those of the cases.
    """
    finger, comparison, values = compared.model.finger, compared.comparison, compared.values
    drawn, note = thinned(cases)
    joint, beside = joint or Beside(), beside or Beside()
    panels = panels_of(finger, values, compared.observations, drawn)
    colors = load_colors(drawn)
    reach = reach_mm(values)
    head = head_mm(len(panels), reach)
    scale = force_scale(
        [f for c in drawn for f in (c.measured_N, c.predicted_N, joint.force_N.get(c.id, np.zeros(3)))], longest * reach
    )
    meanings: set[str] = set()
    for index, panel in enumerate(panels):
        axes, (origin, rotation) = panel_axes(index), place(panel.pose)
        panel.heading = heading(panel, finger, comparison)
        # The longest first, so that shorter ones along the same line show upon it.
        ordered = sorted(panel.cases, key=lambda c: -_size(c.measured_N))
        forces = [("measured", c, rotation @ c.measured_N) for c in ordered]
        for _, case, force in forces:
            area = area_of(case, comparison.noise_assumed, compared.spread)
            meanings.add(area.meaning)
            color = colors[load_text(case.masses_g)]
            panel.traces.append(sector_trace(case, force[:2], area, origin, scale, color, axes))
        forces += [("predicted", c, rotation @ c.predicted_N) for c in ordered]
        own = sorted((c for c in ordered if c.id in joint.force_N), key=lambda c: -_size(joint.force_N[c.id]))
        forces += [("joint", c, joint.force_N[c.id]) for c in own]
        forces += [("before_predicted", c, rotation @ beside.force_N[c.id]) for c in ordered if c.id in beside.force_N]
        words = {"joint": "joint load, predicted", "before_predicted": f"{plain(beside.name)},"}
        for kind, case, force in forces:
            look: dict[str, Any] = {"case": case, "line": vector_line(kind, colors[load_text(case.masses_g)])}
            look |= {"head_mm": head if kind != "joint" else 0.9 * head, "hollow": kind.endswith("predicted")}
            panel.traces += arrow_traces(force[:2], origin, scale, axes, kind=kind, words=words.get(kind, ""), **look)
    keys = load_keys(colors, meanings)
    if joint.force_N:
        keys.insert(2, key(joint.name, line=vector_line("joint", INK)))
    if beside.force_N:
        keys.insert(2, key(plain(beside.name), line=vector_line("before_predicted", INK)))
    roles = sorted({c.role for c in drawn})
    subtitle = f"{subtitle}, sagittal plane, seen from the radial side; {' and '.join(roles)} cases."
    return panels_figure(
        panels,
        finger,
        values,
        scale,
        keys,
        title=f"{title}: {plain(compared.name)}",
        subtitle=f"{subtitle}<br>{note}" if note else subtitle,
    )


def _size(force: Floats) -> float:
    return float(np.linalg.norm(force))
