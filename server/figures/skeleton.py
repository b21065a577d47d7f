"""The finger as a drawing: bones, joints and tendons of a posture in the metacarpal's sagittal plane [mm].

Seen from the radial side: x to the right is proximal, so the metacarpal is on the right; y up is dorsal. Joint centres,
load point and tendon points are the model's. The bones' outlines are schematic: the model knows no bone surface.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fingermodel.fingers import Finger, FingerValues
from server.figures import graph_objects as go
from server.figures import marks
from server.figures.poses import FingerPose, bone_lengths, stub_mm
from server.figures.style import rgba
from server.figures.tendon_lines import tendon_connections, tendon_paths

Floats = NDArray[np.float64]

BONE_FILL = "#f3efe6"
BONE_LINE = "#9a917d"
TENDON = "#8c5a4a"
# Radius of a joint against the length of the bone beyond it: about 8, 5 and 3 mm from MCP to DIP.
_ROUND = 0.17


def finger_traces(finger: Finger, values: FingerValues, pose: FingerPose, axes: dict[str, str]) -> list[go.Scatter]:
    """Draw clamp, bones, joints and tendons.

    Args:
        finger: whose topology it is.
        values: its numbers, possibly fitted.
        pose: of `finger_pose`.
        axes: `xaxis` and `yaxis` of the panel.
    """
    outlines = _outlines(finger, values, pose)
    shared: dict[str, Any] = {"showlegend": False, **axes}
    stub, jaw = stub_mm(values), 1.7 * _ROUND * bone_lengths(values)[0]
    left, right = 0.72 * stub, 1.08 * stub
    first = pose.origins[finger.topology.joints[0].child][:2]
    block = first + np.array([[left, -jaw], [left, jaw], [right, jaw], [right, -jaw], [left, -jaw]])
    traces = [
        marks.area(*_joined([block]), "#e4e4e4", {"color": "#bdbdbd", "width": 1}, meta="clamp", **axes),
        marks.area(*_joined(outlines), BONE_FILL, {"color": BONE_LINE, "width": 1}, meta="bones", **axes),
    ]
    for paths, width, alpha in (
        (tendon_connections(finger, values, pose), 0.7, 0.45),
        (tendon_paths(finger, values, pose), 1.2, 0.9),
    ):
        if paths:
            look = {"color": rgba(TENDON, alpha), "width": width}
            traces.append(marks.line(*_joined(paths), look, meta="tendons", **shared))
    centres = pose.origins[[j.child for j in finger.topology.joints]]
    ring = {"size": 5, "color": "#ffffff", "symbol": "circle", "line": {"color": BONE_LINE, "width": 1.2}}
    return [*traces, marks.points(*marks.xy(centres[:, :2]), ring, meta="joints", **shared)]


def _joined(lines: list[Floats]) -> tuple[list[float | None], list[float | None]]:
    """Return coordinates of several lines (n, 2) in one trace, with a gap between them."""
    x: list[float | None] = []
    y: list[float | None] = []
    for line in lines:
        if x:
            x.append(None)
            y.append(None)
        x += [round(float(v), 4) for v in line[:, 0]]
        y += [round(float(v), 4) for v in line[:, 1]]
    return x, y


def _outlines(finger: Finger, values: FingerValues, pose: FingerPose) -> list[Floats]:
    """Return closed outlines of all bones, heads round and bases hollow."""
    lengths = bone_lengths(values)
    radii = [_ROUND * length for length in lengths]
    shapes = []
    for index, joint in enumerate(finger.topology.joints):
        begin = pose.origins[joint.child][:2]
        if index + 1 < len(lengths):
            end = pose.origins[finger.topology.joints[index + 1].child][:2]
            head = radii[index + 1]
        else:
            head = 0.7 * radii[index]
            along = pose.load_point[:2] - begin
            end = begin + along * (lengths[index] - head) / max(float(np.linalg.norm(along)), 1e-9)
        shapes.append(_bone(begin, end, radii[index], head))
    first = pose.origins[finger.topology.joints[0].child][:2]
    shapes.append(_bone(np.array([first[0] + stub_mm(values), first[1]]), first, 0.0, radii[0]))
    return shapes


def _bone(begin: Floats, end: Floats, base: float, head: float) -> Floats:
    """Return the outline (n, 2) of a bone from its base joint to the centre of its head; base 0: cut off straight."""
    axis = (end - begin) / max(float(np.linalg.norm(end - begin)), 1e-9)
    side = np.array([-axis[1], axis[0]])
    length = float(np.linalg.norm(end - begin))
    hollow = np.deg2rad(np.linspace(-52.0, 52.0, 13)) if base else np.array([])
    rim = 1.15 * base
    bottom = np.stack([rim * np.cos(hollow), rim * np.sin(hollow)], axis=1) if base else np.zeros((0, 2))
    start, width = (bottom[-1, 0], bottom[-1, 1]) if base else (0.0, 0.8 * head)
    stop = length - head * np.cos(np.deg2rad(70.0))
    high = head * np.sin(np.deg2rad(70.0))
    t = np.linspace(0.0, 1.0, 17)
    waist = 0.35 if base else 0.15
    profile = (width + (high - width) * t) * (1.0 - waist * np.sin(np.pi * t) ** 2)
    upper = np.stack([start + (stop - start) * t, profile], axis=1)
    round_end = np.deg2rad(np.linspace(110.0, -110.0, 23))
    cap = np.stack([length + head * np.cos(round_end), head * np.sin(round_end)], axis=1)
    lower = upper[::-1] * [1.0, -1.0]
    local = np.concatenate([bottom, upper, cap, lower])
    local = np.concatenate([local, local[:1]])
    return np.asarray(begin + local[:, :1] * axis + local[:, 1:] * side)
