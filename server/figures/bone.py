"""Net forces on the metacarpal as vectors, with the MCP joint's load (after Synek et al. 2019, Figure 8)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from fingermodel.comparison.observations import Observations
from fingermodel.model import Model
from server.figures import graph_objects as go
from server.figures.arrows import arrow_traces
from server.figures.compared import Compared
from server.figures.panels import (
    force_scale,
    head_mm,
    heading,
    key,
    load_colors,
    panels_figure,
    panels_of,
    thinned,
)
from server.figures.poses import reach_mm
from server.figures.sheet import panel_axes
from server.figures.style import INK, load_text, mix, plain
from server.figures.vectors import chosen_cases, load_keys, measured_and_predicted

Floats = NDArray[np.float64]


def joint_loads(model: Model, observations: Observations, theta: Floats | None = None) -> dict[str, Floats]:
    """Return each case's load of the first joint (3,) [N]: of the child bone on the first bone, in its axes."""
    joint = np.asarray(model.predict(observations.inputs, theta).joint)
    return {case_id: joint[i, 0] for i, case_id in enumerate(observations.ids)}


def bone_figure(compared: Compared, cases: Iterable[str] | None = None) -> go.Figure:
    """Draw measured and predicted net bone forces at the MCP joint, and the load that the joint itself carries.

    Args:
        compared: model, session and comparison.
        cases: ids of the cases to draw.

    Raises:
        NothingToDrawError: no bone force.
    """
    finger, comparison, values = compared.model.finger, compared.comparison, compared.values
    drawn, note = thinned(chosen_cases(comparison, "bone", cases))
    panels = panels_of(finger, values, compared.observations, drawn)
    loads = joint_loads(compared.model, compared.observations, compared.theta)
    colors = load_colors(drawn)
    reach = reach_mm(values)
    forces = [f for c in drawn for f in (c.measured_N, c.predicted_N, loads[c.id])]
    scale = force_scale(forces, 0.75 * reach)
    head = head_mm(len(panels), reach)
    meanings: set[str] = set()
    for index, panel in enumerate(panels):
        axes, origin = panel_axes(index), panel.pose.origins[finger.topology.joints[0].child]
        panel.heading = heading(panel, finger, comparison)
        meanings |= measured_and_predicted(
            panel, axes, origin, np.eye(3), scale, colors, head, comparison, compared.spread
        )
        for case in sorted(panel.cases, key=lambda c: -float(np.linalg.norm(loads[c.id]))):
            line = {"color": mix(colors[load_text(case.masses_g)], INK, 0.7), "width": 1.4, "dash": "1.5px,2.5px"}
            panel.traces += arrow_traces(
                loads[case.id][:2], origin, scale, axes, kind="joint", case=case, line=line, head_mm=0.9 * head
            )
    keys = load_keys(colors, meanings)
    name = finger.topology.joints[0].name
    keys.insert(2, key(f"{name} joint load, predicted", line={"color": INK, "width": 1.4, "dash": "1.5px,2.5px"}))
    roles = sorted({c.role for c in drawn})
    subtitle = f"Net force on the metacarpal, sagittal plane, seen from the radial side; {' and '.join(roles)} cases."
    return panels_figure(
        panels,
        finger,
        values,
        scale,
        keys,
        title=f"Net metacarpal bone forces: {plain(compared.name)}",
        subtitle=f"{subtitle}<br>{note}" if note else subtitle,
    )
