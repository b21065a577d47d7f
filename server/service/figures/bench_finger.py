"""The finger as it is held at the bench, as lines to be drawn, so that a page can put live forces beside it.

Lengths are in mm in the axes of the first bone: x proximal, y dorsal, z radial. Two views are told, each with the
matrix that lays a vector of these axes on the paper: from the radial side, and from above. Joint centres, load point
and tendon points are the model's; the bones' outlines are schematic, as the model knows no bone surface.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.sessions.models import Mount
from daq.signals.calibration import mount_transform
from fingermodel.fingers import Finger, FingerValues
from server.figures.poses import FingerPose, bone_lengths, finger_pose, reach_mm, stub_mm
from server.figures.tendon_lines import hood_feeds, leaving, tendon_paths
from server.service.figures.held_finger import HeldFinger

Floats = NDArray[np.float64]

# Seen from the radial side y is up; seen from above the radial side is below, where it is nearest to who looks so.
_VIEWS: Mapping[str, Floats] = {
    "side": np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "above": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
}
# Radius of a joint against the length of the bone beyond it: about 8, 5 and 3 mm from MCP to DIP.
_ROUND = 0.17
_WAIST = 0.3


def bench_finger(held: HeldFinger) -> dict[str, Any]:
    """Return a finger in its posture with what hangs on it, and the forces that may be seen."""
    finger, hung = held.finger, held.hung
    pose = finger_pose(finger, finger.values, held.angles)
    masses = {} if hung is None else {m: float(g) for m, g in hung.masses_g.items() if g}
    gravity = float(held.document.get("gravity_m_s2", 9.81))
    return {
        "model": held.loaded.id,
        "posture": held.posture,
        "angles_deg": dict(zip(finger.topology.rotations, np.rad2deg(held.angles).tolist(), strict=True)),
        "case": None if hung is None else hung.case,
        "role": None if hung is None else hung.role,
        "location": None if hung is None else hung.location,
        "masses_g": masses,
        "weight_N": 1e-3 * gravity * sum(masses.values()),
        "reach_mm": reach_mm(finger.values),
        "stub_mm": stub_mm(finger.values),
        "views": {k: _view(finger, pose, p, masses) for k, p in _VIEWS.items()},
        "places": _places(held.document, finger, pose),
        "measured_N": None if hung is None or hung.measured_N is None else hung.measured_N.tolist(),
        "measured_sd_N": None if hung is None or hung.measured_sd_N is None else hung.measured_sd_N.tolist(),
        "predicted_N": None if hung is None or hung.predicted_N is None else np.asarray(hung.predicted_N).tolist(),
        "note": "" if hung is None else hung.note,
    }


def _places(document: Mapping[str, Any], finger: Finger, pose: FingerPose) -> dict[str, Any]:
    """Return the cell's positions, and the matrices from mount axes and cell axes to those of the drawing."""
    mounts = (document.get("load_cell") or {}).get("mounts") or {}
    side = str((document.get("specimen") or {}).get("side"))
    first = pose.origins[finger.topology.joints[0].child]
    out = {}
    for name, point, rotation in (("tip", pose.load_point, pose.tip_rotation), ("bone", first, np.eye(3))):
        mount = Mount.model_validate(mounts[name]) if mounts.get(name) else None
        turned = rotation @ mount_transform(mount, side).matrix[:3, :3]
        out[name] = {"at_mm": point.tolist(), "from_mount": rotation.tolist(), "from_cell": turned.tolist()}
    return out


def _view(finger: Finger, pose: FingerPose, paper: Floats, masses_g: Mapping[str, float]) -> dict[str, Any]:
    values, topology = finger.values, finger.topology
    feeds = hood_feeds(topology)
    pulled = _pulled(feeds, masses_g)
    near = [pose.place(s.proximal_bone, values.proximal_point[k]) for k, s in enumerate(topology.segments)]
    far = [pose.place(s.distal_bone, values.distal_point[k]) for k, s in enumerate(topology.segments)]
    tendons = []
    for k, (segment, path) in enumerate(zip(topology.segments, tendon_paths(finger, values, pose), strict=True)):
        across = np.linspace(near[k][2], far[k][2], len(path))
        tendons.append(_tendon(segment.slip, segment.slip in pulled, np.column_stack([path, across]) @ paper.T))
        # Along the bone to the next segment, its own or one that it pulls.
        for i, following in enumerate(topology.segments):
            if following.proximal_bone != segment.distal_bone:
                continue
            if following.slip == segment.slip or following.slip in feeds.get(segment.slip, ()):
                loaded = segment.slip in pulled and following.slip in pulled
                tendons.append(_tendon(following.slip, loaded, np.stack([far[k], near[i]]) @ paper.T))
    centres = pose.origins[[j.child for j in topology.joints]] @ paper.T
    return {
        "paper": paper.tolist(),
        "bones_mm": [o.round(2).tolist() for o in _outlines(finger, values, pose, paper)],
        "joints": [
            {"joint": j.name, "at_mm": c.round(2).tolist()} for j, c in zip(topology.joints, centres, strict=True)
        ],
        "tendons": tendons,
        "strings": [
            {"tendon": m, "mass_g": g, "line_mm": (leaving(finger, values, pose, m) @ paper.T).round(2).tolist()}
            for m, g in masses_g.items()
        ],
    }


def _tendon(name: str, loaded: bool, line: Floats) -> dict[str, Any]:
    return {"tendon": name, "loaded": loaded, "line_mm": line.round(2).tolist()}


def _pulled(feeds: Mapping[str, set[str]], masses_g: Mapping[str, float]) -> set[str]:
    """Return the names of all tendons that the weights pull, through the hood too."""
    out, new = set(masses_g), list(masses_g)
    while new:
        more = feeds.get(new.pop(), set()) - out
        out |= more
        new += more
    return out


def _outlines(finger: Finger, values: FingerValues, pose: FingerPose, paper: Floats) -> list[Floats]:
    """Return closed outlines of all bones on the paper, that of the clamped one first."""
    lengths = bone_lengths(values)
    radii = [_ROUND * length for length in lengths]
    centres = [pose.origins[j.child] for j in finger.topology.joints]
    last = 0.7 * radii[-1]
    along = pose.load_point - centres[-1]
    tip = centres[-1] + along * (lengths[-1] - last) / max(float(np.linalg.norm(along)), 1e-9)
    ends, heads = [*centres[1:], tip], [*radii[1:], last]
    stub = centres[0] + np.array([stub_mm(values), 0.0, 0.0])
    shapes = [_outline(paper @ stub, paper @ centres[0], radii[0], radii[0])]
    for begin, end, base, head in zip(centres, ends, radii, heads, strict=True):
        shapes.append(_outline(paper @ begin, paper @ end, base, head))
    return shapes


def _outline(begin: Floats, end: Floats, base: float, head: float) -> Floats:
    """Return the outline (n, 2) of a bone between two round ends, narrower between them where it is long enough."""
    length = float(np.linalg.norm(end - begin))
    if length <= abs(base - head) + 1e-6:
        centre, radius = (begin, base) if base >= head else (end, head)
        turn = np.linspace(0.0, 2.0 * np.pi, 33)
        return np.asarray(centre + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1))
    lean = np.arccos((base - head) / length)
    t = np.linspace(0.0, 1.0, 13)
    narrow = _WAIST * min(length / (3.0 * max(base, head)), 1.0)
    a, b = base * np.array([np.cos(lean), np.sin(lean)]), head * np.array([np.cos(lean), np.sin(lean)])
    upper = np.stack([a[0] + (length + b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t], axis=1)
    upper[:, 1] *= 1.0 - narrow * np.sin(np.pi * t) ** 2
    turn = np.linspace(lean, -lean, 17)[1:-1]
    far = np.stack([length + head * np.cos(turn), head * np.sin(turn)], axis=1)
    turn = np.linspace(-lean, lean - 2.0 * np.pi, 17)[1:]
    near = np.stack([base * np.cos(turn), base * np.sin(turn)], axis=1)
    local = np.concatenate([upper, far, upper[::-1] * [1.0, -1.0], near])
    axis = (end - begin) / length
    side = np.array([-axis[1], axis[0]])
    return np.asarray(begin + local[:, :1] * axis + local[:, 1:] * side)
