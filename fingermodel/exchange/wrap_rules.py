"""The rule of wrapping that a cylinder of other software stands for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from fingermodel.exchange.described import Cylinder, Floats

SAME_MM = 1e-6
_TOUCH_MM = 1e-3
_TURNED = 1e-6


class NoRuleError(Exception):
    """What a path wraps on for which there is no rule of ours."""


def rule_of(joint: Mapping[str, Any], proximal: Floats, distal: Floats, cylinder: Cylinder) -> tuple[str, float]:
    """Landsmeer's rule that a cylinder about the flexion axis stands for, and the angle of rest [rad].

    Args:
        joint: of the finger file.
        proximal: end, from the joint's centre at 0°.
        distal: end, from there too.
        cylinder: as the joint sees it.

    Raises:
        NoRuleError: there is none.
    """
    bending = [np.array(r["axis"]) for r in joint["rotations"] if r.get("flexion")]
    axis = bending[0] if bending else np.zeros(3)
    off = float(np.linalg.norm(np.cross(axis, cylinder.place)))
    if not bending or np.linalg.norm(np.cross(axis, cylinder.axis)) > _TURNED or off > _TOUCH_MM:
        raise NoRuleError("a cylinder that is not the head of its joint")
    ends = [v - axis * (axis @ v) for v in (proximal, distal)]
    along = ends[0] - ends[1]
    length = float(np.linalg.norm(along))
    if length == 0.0:
        raise NoRuleError("a cylinder between ends that stand one above the other")
    moment = float(axis @ np.cross(ends[1], along))
    foot = ends[0] - along * (ends[0] @ along) / length**2
    side = foot if cylinder.side is None else cylinder.side - axis * (axis @ cylinder.side)
    if cylinder.side is not None and np.linalg.norm(side) < cylinder.radius:
        raise NoRuleError("a cylinder that holds it inside")
    if abs(abs(moment) - cylinder.radius * length) <= SAME_MM * length and foot @ side > 0.0:
        return ("landsmeer1_palmar" if moment > 0.0 else "landsmeer1_dorsal"), 0.0
    reach = [float(np.linalg.norm(end)) for end in ends]
    if min(reach) <= cylinder.radius or not np.linalg.norm(side) > 0.0:
        raise NoRuleError("a cylinder that its ends or its line run through")
    # Angles about the axis; a palmar tendon's way from its distal end to its proximal one grows shorter in flexion.
    across = np.cross(axis, ends[1])
    swept = math.atan2(float(ends[0] @ across), float(ends[0] @ ends[1])) % math.tau
    middle = ends[1] * math.cos(swept / 2.0) + across * math.sin(swept / 2.0)
    touching = sum(math.acos(cylinder.radius / r) for r in reach)
    palmar = bool(middle @ side > 0.0)
    rests_at = swept - touching if palmar else touching - (math.tau - swept)
    return ("landsmeer1_palmar" if palmar else "landsmeer1_dorsal"), max(-math.pi, min(math.pi, rests_at))
