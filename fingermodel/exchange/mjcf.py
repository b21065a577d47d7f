"""A finger as MuJoCo's MJCF: a muscle is one spatial tendon, whose pulleys share its tension out in the hood.

Behind a pulley of divisor d a tendon pulls with 1/d of its tension, and d = 1/share makes Winslow's rhombus of it: who
sets a muscle's control to its tension [N] gets every slip's. The segments are there a second time, each as a tendon
that nothing pulls, to read their moment arms.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree as ET

import numpy as np

from fingermodel.exchange.joint_heads import TendonLine, tendon_lines
from fingermodel.exchange.sharing import UNSHARED, segment_shares
from fingermodel.exchange.writing import (
    INERTIA_KGM2,
    LOAD_POINT,
    MASS_KG,
    METRES,
    Floats,
    Written,
    about_text,
    check_names,
    child,
    cited,
    inexact,
    number,
    numbers,
    segment_names,
    share_table,
    xml,
)
from fingermodel.fingers import COMPONENTS, Finger

GREATEST_N = 1000.0
_THICK_M, _LONG_M = 0.0005, 0.003


def write_mjcf(finger: Finger, made: str) -> Written:
    """Write a finger as MJCF.

    Args:
        finger: to write.
        made: by what and of what, for the file's comment.

    Raises:
        ModelError: a finger that MJCF cannot name, or that is no chain.
    """
    check_names(finger)
    names, lines = segment_names(finger), tendon_lines(finger)
    root = ET.Element("mujoco", model=finger.id)
    child(root, "compiler", angle="radian", autolimits="true")
    child(child(root, "option", gravity="0 0 0"), "flag", contact="disable")
    child(child(root, "custom"), "text", name="fingertwin", data=about_text(finger))
    bones, carriers = _bones(root, finger, lines)
    child(bones[-1], "site", name=LOAD_POINT, pos=_metres(finger.values.load_point), size=number(2 * _THICK_M))
    _points(finger, names, lines, bones, carriers)
    tendons, actuators = child(root, "tendon"), child(root, "actuator")
    limits = {"gear": "-1", "ctrllimited": "true", "ctrlrange": numbers((0.0, GREATEST_N))}
    shares = segment_shares(finger)
    for muscle, share in zip(finger.topology.muscles, () if shares is None else shares.T, strict=shares is not None):
        if not share.any():
            continue
        tendon = child(tendons, "spatial", name=muscle, width=number(_THICK_M), rgba="0.8 0.2 0.2 1")
        _muscle(tendon, names, lines, share, [s.proximal_bone for s in finger.topology.segments])
        child(actuators, "motor", name=muscle, tendon=muscle, **limits)
    for name, line in zip(names, lines, strict=True):
        tendon = child(tendons, "spatial", name=name, width=number(_THICK_M / 2), rgba="0.3 0.3 0.8 1", group="4")
        _piece(tendon, name, line)
        if shares is None:
            child(actuators, "motor", name=name, tendon=name, **limits)
    notes = [n for n in (inexact(finger, names, lines, "MJCF"), UNSHARED if shares is None else "") if n]
    return Written(xml(root, [made, *_comment(finger, names, shares), *notes]), tuple(notes))


def _comment(finger: Finger, names: Sequence[str], shares: Floats | None) -> list[str]:
    topology = finger.topology
    clamp = ", ".join(COMPONENTS[i] for i in topology.reactions)
    driven = (
        "The control of an actuator is the tension of its muscle [N]; a pulley of divisor 1/share leads to each slip.",
        f"Tendons without an actuator ({names[0]}, ...) are the segments, to read their moment arms.",
    )
    return [
        "MJCF has no units: here lengths are metres, forces newtons, angles radians.",
        "Axes of every bone at zero angles: x proximal, y dorsal, z radial (right hand). Positive flexion bends.",
        *(driven if shares is not None else ()),
        f"The tip clamp holds the site {LOAD_POINT} and carries {clamp} in the last bone's axes: solve J' w = torque",
        "with these rows of its Jacobian (mj_jacSite, turned into the site's axes) for the tip force w.",
        f"Masses and inertia are placeholders ({MASS_KG} kg, {INERTIA_KGM2} kg m2): the finger's are not known.",
        *cited(finger),
        *share_table(finger, names, shares),
    ]


def _bones(
    root: ET.Element, finger: Finger, lines: Sequence[TendonLine]
) -> tuple[list[ET.Element], dict[int, ET.Element]]:
    """Bodies of the bones, and of the frames that carry joint heads where these turn with a joint's first rotations."""
    topology, values = finger.topology, finger.values
    axes, centres = np.asarray(values.axis), np.asarray(values.centre)
    turning = {line.head.joint for line in lines if line.head is not None and line.head.before > 0}
    bones = [child(child(root, "worldbody"), "body", name=topology.bones[0])]
    carriers: dict[int, ET.Element] = {}
    first = 0
    for index, joint in enumerate(topology.joints):
        place = {"pos": _metres(centres[index])}
        body = bones[-1]
        if index in turning:
            body = child(body, "body", name=f"{joint.name}.head", **place)
            carriers[index], place = body, {}
        hinges = [
            ET.Element("joint", name=name, type="hinge", axis=numbers(axis))
            for name, axis in zip(joint.rotations, axes[first:], strict=False)
        ]
        within = joint.flexion if index in turning else 0
        bone = child(body, "body", name=topology.bones[joint.child], **place)
        for element, own in ((body, hinges[:within]), (bone, hinges[within:])):
            element.extend(own)
            if own:
                inertia = numbers([INERTIA_KGM2] * 3)
                child(element, "inertial", pos="0 0 0", mass=number(MASS_KG), diaginertia=inertia)
        end = centres[index + 1] if index + 1 < len(topology.joints) else np.asarray(values.load_point)
        if np.linalg.norm(end) > 0.0:
            shape = {"type": "capsule", "fromto": f"0 0 0 {_metres(end)}", "size": number(_LONG_M)}
            child(bone, "geom", name=f"{topology.bones[joint.child]}.shape", **shape, **_SHOWN)
        bones.append(bone)
        first += len(joint.rotations)
    return bones, carriers


_SHOWN = {"contype": "0", "conaffinity": "0", "group": "2", "rgba": "0.9 0.85 0.75 0.4"}


def _points(
    finger: Finger,
    names: Sequence[str],
    lines: Sequence[TendonLine],
    bones: Sequence[ET.Element],
    carriers: dict[int, ET.Element],
) -> None:
    for name, line, segment in zip(names, lines, finger.topology.segments, strict=True):
        for end, bone, point in (
            ("proximal", segment.proximal_bone, line.proximal),
            ("distal", segment.distal_bone, line.distal),
        ):
            child(bones[bone], "site", name=f"{name}.{end}", pos=_metres(point), size=number(_THICK_M))
        head = line.head
        if head is None:
            continue
        parent = bones[finger.topology.joints[head.joint].parent]
        body, centre = (carriers[head.joint], np.zeros(3)) if head.before else (parent, head.centre)
        along = head.axis * _LONG_M / METRES
        ends = f"{_metres(centre - along)} {_metres(centre + along)}"
        shape = {"type": "cylinder", "fromto": ends, "size": _metres([head.radius])}
        child(body, "geom", name=f"{name}.head", **shape, **_SHOWN)
        side = centre + 2.0 * head.radius * head.side
        child(body, "site", name=f"{name}.side", pos=_metres(side), size=number(_THICK_M), group="4")


def _muscle(
    tendon: ET.Element, names: Sequence[str], lines: Sequence[TendonLine], share: Floats, proximal: Sequence[int]
) -> None:
    """The path of a muscle: its own segments in one branch, then the hood's, each behind its pulley."""
    # From the hand outwards, as the tendon runs.
    for i in sorted(np.flatnonzero(share == 1.0).tolist(), key=proximal.__getitem__):
        _piece(tendon, names[i], lines[i])
    for i in np.flatnonzero((share != 1.0) & (share != 0.0)).tolist():
        child(tendon, "pulley", divisor=number(1.0 / share[i]))
        _piece(tendon, names[i], lines[i])


def _piece(tendon: ET.Element, name: str, line: TendonLine) -> None:
    child(tendon, "site", site=f"{name}.proximal")
    if line.head is not None:
        child(tendon, "geom", geom=f"{name}.head", sidesite=f"{name}.side")
    child(tendon, "site", site=f"{name}.distal")


def _metres(point: object) -> str:
    return numbers(np.asarray(point, dtype=float) * METRES)
