"""A finger as an OpenSim model: a path actuator for every segment, and the muscles' shares in each as a table.

OpenSim has no pulleys: who sets muscle tensions multiplies them by the table. A resting tendon runs over a cylinder
where that is the same, and is given by formulas of its length and moment arms where it is not.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from daq.errors import ModelError
from fingermodel.exchange.arm_formulas import path_formulas
from fingermodel.exchange.joint_heads import JointHead, TendonLine, tendon_lines
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
    number,
    numbers,
    segment_names,
    share_table,
    xml,
)
from fingermodel.fingers import COMPONENTS, Finger

VERSION = "40600"
ABOUT = "fingertwin: "
_LONG_M = 0.02


def write_osim(finger: Finger, made: str) -> Written:
    """Write a finger as `.osim`.

    Args:
        finger: to write.
        made: by what and of what, for the file's comment.

    Raises:
        ModelError: a finger that OpenSim cannot name or has no joint for, or that is no chain.
    """
    check_names(finger)
    _check_joints(finger)
    names, lines = segment_names(finger), tendon_lines(finger)
    formulas = [name for name, line in zip(names, lines, strict=True) if not line.exact]
    note = ""
    if formulas:
        note = (
            f"OpenSim's wrapping cannot hold the resting line of {', '.join(formulas)} as Landsmeer's first model "
            "does: they are given by formulas of length and moment arm (FunctionBasedPath), which have our moment arms "
            "but are not drawn; markers show their ends"
        )
    root = ET.Element("OpenSimDocument", Version=VERSION)
    model = child(root, "Model", name=re.sub(r"[^\w.-]", "_", finger.id))
    child(child(model, "Ground", name="ground"), "WrapObjectSet", name="wrapobjectset")
    child(model, "credits", ABOUT + about_text(finger))
    child(model, "publications", finger.title)
    child(model, "length_units", "meters")
    child(model, "force_units", "N")
    child(model, "gravity", "0 0 0")
    bodies = _objects(model, "BodySet", "bodyset")
    wraps = [_body(bodies, name) for name in finger.topology.bones]
    _joints(_objects(model, "JointSet", "jointset"), finger)
    forces, markers = _objects(model, "ForceSet", "forceset"), _objects(model, "MarkerSet", "markerset")
    _marker(markers, LOAD_POINT, finger.topology.bones[-1], finger.values.load_point)
    for index, (name, line) in enumerate(zip(names, lines, strict=True)):
        actuator = child(forces, "PathActuator", name=name)
        if line.exact:
            _path(actuator, finger, index, name, line)
            if line.head is not None:
                _cylinder(wraps[finger.topology.joints[line.head.joint].parent], name, line)
        else:
            _formulas(actuator, markers, finger, index, name)
        child(actuator, "optimal_force", "1")
    notes = [n for n in (note, UNSHARED if segment_shares(finger) is None else "") if n]
    return Written(xml(root, [made, *_comment(finger, names), note]), tuple(notes))


def _check_joints(finger: Finger) -> None:
    axes, first = np.asarray(finger.values.axis), 0
    for joint in finger.topology.joints:
        own = axes[first : first + len(joint.rotations)]
        first += len(joint.rotations)
        if len(own) > 3 or np.linalg.matrix_rank(own, tol=1e-3) < len(own):
            raise ModelError(
                f"joint {joint.name} turns about {len(own)} axes, not all apart",
                "at most three axes that are not in one plane, as OpenSim's CustomJoint has",
                "Export it as mjcf",
            )


def _comment(finger: Finger, names: Sequence[str]) -> list[str]:
    topology, shares = finger.topology, segment_shares(finger)
    clamp = ", ".join(COMPONENTS[i] for i in topology.reactions)
    return [
        "Lengths are metres, forces newtons, angles radians.",
        "Axes of every bone at zero angles: x proximal, y dorsal, z radial (right hand). Positive flexion bends.",
        "Each path actuator is a piece of tendon; its control is its tension [N].",
        *([] if shares is None else _SHARED),
        f"The tip clamp holds the marker {LOAD_POINT} and carries {clamp} in the last bone's axes: solve J' w = torque",
        "with these rows of the Jacobian of that point in that bone for the tip force w.",
        f"Masses and inertia are placeholders ({MASS_KG} kg, {INERTIA_KGM2} kg m2): the finger's are not known.",
        *cited(finger),
        *share_table(finger, names, shares),
    ]


_SHARED = (
    "Multiply the muscles' tensions by the shares below to have each actuator's: OpenSim has no element that shares a",
    "tendon's tension out.",
)


def _objects(model: ET.Element, tag: str, name: str) -> ET.Element:
    group = child(model, tag, name=name)
    objects = child(group, "objects")
    child(group, "groups")
    return objects


def _body(bodies: ET.Element, name: str) -> ET.Element:
    """Write a bone; return where its wrap objects go."""
    body = child(bodies, "Body", name=name)
    wraps = _objects(body, "WrapObjectSet", "wrapobjectset")
    child(body, "mass", number(MASS_KG))
    child(body, "mass_center", "0 0 0")
    child(body, "inertia", numbers([INERTIA_KGM2] * 3 + [0.0] * 3))
    return wraps


def _joints(joints: ET.Element, finger: Finger) -> None:
    topology, values = finger.topology, finger.values
    base = child(joints, "WeldJoint", name=f"{topology.bones[0]}_to_ground")
    _frames(base, "/ground", np.zeros(3), f"/bodyset/{topology.bones[0]}")
    axes, first = np.asarray(values.axis), 0
    for joint, centre in zip(topology.joints, np.asarray(values.centre), strict=True):
        element = child(joints, "CustomJoint", name=joint.name)
        _frames(element, f"/bodyset/{topology.bones[joint.parent]}", centre, f"/bodyset/{topology.bones[joint.child]}")
        coordinates = child(element, "coordinates")
        for name in joint.rotations:
            coordinate = child(coordinates, "Coordinate", name=name)
            child(coordinate, "default_value", "0")
            child(coordinate, "range", numbers((-np.pi, np.pi)))
            child(coordinate, "clamped", "false")
        own = axes[first : first + len(joint.rotations)]
        first += len(joint.rotations)
        transform = child(element, "SpatialTransform")
        for i, axis in enumerate(_completed(own)):
            _transform_axis(transform, f"rotation{i + 1}", axis, joint.rotations[i] if i < len(own) else "")
        for i, axis in enumerate(np.eye(3)):
            _transform_axis(transform, f"translation{i + 1}", axis, "")


def _completed(axes: Floats) -> Floats:
    """Three axes, not in one plane, that begin with those given."""
    chosen = list(axes)
    while len(chosen) < 3:
        apart = [np.linalg.svd(np.array([*chosen, axis]), compute_uv=False)[-1] for axis in np.eye(3)]
        chosen.append(np.eye(3)[int(np.argmax(apart))])
    return np.array(chosen)


def _transform_axis(transform: ET.Element, name: str, axis: Floats, coordinate: str) -> None:
    element = child(transform, "TransformAxis", name=name)
    child(element, "coordinates", coordinate)
    child(element, "axis", numbers(axis))
    if coordinate:
        child(child(element, "LinearFunction", name="function"), "coefficients", "1 0")
    else:
        child(child(element, "Constant", name="function"), "value", "0")


def _frames(joint: ET.Element, parent: str, centre: Floats, bone: str) -> None:
    child(joint, "socket_parent_frame", "parent_offset")
    child(joint, "socket_child_frame", "child_offset")
    frames = child(joint, "frames")
    for name, body, place in (("parent_offset", parent, centre), ("child_offset", bone, np.zeros(3))):
        frame = child(frames, "PhysicalOffsetFrame", name=name)
        child(frame, "socket_parent", body)
        child(frame, "translation", _metres(place))
        child(frame, "orientation", "0 0 0")


def _path(actuator: ET.Element, finger: Finger, index: int, name: str, line: TendonLine) -> None:
    topology = finger.topology
    segment = topology.segments[index]
    path = child(actuator, "GeometryPath", name="path")
    points = _objects(path, "PathPointSet", "pathpointset")
    for end, bone, place in (
        ("proximal", segment.proximal_bone, line.proximal),
        ("distal", segment.distal_bone, line.distal),
    ):
        point = child(points, "PathPoint", name=f"{name}.{end}")
        child(point, "socket_parent_frame", f"/bodyset/{topology.bones[bone]}")
        child(point, "location", _metres(place))
    if line.head is not None:
        wrap = child(_objects(path, "PathWrapSet", "pathwrapset"), "PathWrap", name=f"{name}.wrap")
        child(wrap, "wrap_object", f"{name}.head")
        child(wrap, "method", "hybrid")


def _cylinder(wraps: ET.Element, name: str, line: TendonLine) -> None:
    head = line.head
    assert head is not None  # noqa: S101 - the caller has looked
    element = child(wraps, "WrapCylinder", name=f"{name}.head")
    # Its own axis is z; the quadrant +y chooses among the tangents.
    up = _quadrant(line.proximal - head.centre, head)
    frame = np.stack([np.cross(up, head.axis), up, head.axis], axis=1)
    child(element, "active", "true")
    child(element, "xyz_body_rotation", numbers(Rotation.from_matrix(frame).as_euler("XYZ")))
    child(element, "translation", _metres(head.centre))
    child(element, "quadrant", "+y")
    child(element, "radius", number(head.radius * METRES))
    child(element, "length", number(_LONG_M))


def _quadrant(proximal: Floats, head: JointHead) -> Floats:
    """Unit vector of the side on which OpenSim finds the right tangents at every angle.

    It takes the proximal end's tangent that lies on this side where the other one does not. The two lie an angle to
    either side of that end, so the side is a square angle away from it, less half as much to have the end on it too.
    """
    end = proximal - head.axis * (head.axis @ proximal)
    reach = float(np.linalg.norm(end))
    turn = np.pi / 2.0 - np.arccos(head.radius / reach) / 2.0
    across = np.cross(head.axis, end) * np.sign(head.axis @ np.cross(end, head.side))
    side: Floats = (end * np.cos(turn) + across * np.sin(turn)) / reach
    return side


def _formulas(actuator: ET.Element, markers: ET.Element, finger: Finger, index: int, name: str) -> None:
    topology, values = finger.topology, finger.values
    segment = topology.segments[index]
    written = path_formulas(finger, index, METRES)
    variables = " ".join(f"q{i + 1}" for i in range(len(written.rotations)))
    of = {rotation: joint.name for joint in topology.joints for rotation in joint.rotations}
    path = child(actuator, "FunctionBasedPath", name="path")
    child(path, "coordinate_paths", " ".join(f"/jointset/{of[r]}/{r}" for r in written.rotations))
    length = child(child(path, "length_function"), "ExpressionBasedFunction")
    child(length, "expression", written.length)
    child(length, "variables", variables)
    arms = child(path, "moment_arm_functions")
    for formula in written.moment_arms:
        arm = child(arms, "ExpressionBasedFunction")
        child(arm, "expression", formula)
        child(arm, "variables", variables)
    _marker(
        markers, f"{name}.proximal", topology.bones[segment.proximal_bone], np.asarray(values.proximal_point)[index]
    )
    _marker(markers, f"{name}.distal", topology.bones[segment.distal_bone], np.asarray(values.distal_point)[index])


def _marker(markers: ET.Element, name: str, bone: str, place: object) -> None:
    marker = child(markers, "Marker", name=name)
    child(marker, "socket_parent_frame", f"/bodyset/{bone}")
    child(marker, "location", _metres(place))
    child(marker, "fixed", "true")


def _metres(point: object) -> str:
    return numbers(np.asarray(point, dtype=float) * METRES)
