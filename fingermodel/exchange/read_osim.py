"""A finger chain out of an OpenSim model: bodies, pin and custom joints, path points, cylinders that paths wrap on."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from daq.errors import ModelError
from fingermodel.exchange.arm_formulas import path_formulas
from fingermodel.exchange.chains import (
    Cylinder,
    Described,
    Hinge,
    Imported,
    Link,
    Obstacle,
    Piece,
    Point,
    finger_document_of,
)
from fingermodel.exchange.osim import ABOUT
from fingermodel.exchange.reading import MILLIMETRES, Floats, about_of, read_root, vector
from fingermodel.exchange.writing import LOAD_POINT, METRES, segment_names
from fingermodel.fingers import Finger

WANTED = "an OpenSim model (.osim)"
OLDEST = 40000
_NUMBER = re.compile(r"\d+\.?\d*(?:e[-+]?\d+)?")
_SAME_NUMBER = 1e-9


def read_osim(path: Path, source: str, load_point_mm: Floats | None = None) -> Imported:
    """Read a finger out of an OpenSim model.

    Args:
        path: of the file.
        source: what its numbers come from, as the finger file cites it.
        load_point_mm: (3,) of the last body, in its own axes; overrides the file's.

    Raises:
        ModelError: not an OpenSim model, or no finger chain that a finger/1 file can hold.
    """
    root, where = read_root(path, WANTED), path.name
    version = root.get("Version", "")
    model = root.find("./Model")
    if root.tag != "OpenSimDocument" or model is None:
        raise ModelError(f"{where} begins with <{root.tag}>", WANTED)
    if not version.isdigit() or int(version) < OLDEST:
        raise ModelError(f"{where} has version {version or '?'}", f"{OLDEST} or later", "Open and save it in OpenSim 4")
    for tag, wanted in (("length_units", "meters"), ("force_units", "N")):
        given = (model.findtext(tag) or wanted).strip()
        if given not in (wanted, "m" if wanted == "meters" else wanted):
            raise ModelError(f"{where} has {tag} {given!r}", wanted)
    if len(model.findall("./ConstraintSet/objects/*")):
        raise ModelError(f"{where} ties joints together (ConstraintSet)", "joints that move by themselves")
    credit = (model.findtext("credits") or "").strip()
    about = about_of(credit.removeprefix(ABOUT) if credit.startswith(ABOUT) else None, where)
    file = _File(model, where)
    links = file.links()
    pieces = tuple(file.pieces())
    load_point = file.markers.get(LOAD_POINT)
    moving = [link.body for link in links if link.hinges]
    if load_point_mm is not None and moving:
        load_point = Point(moving[-1], load_point_mm)
    described = Described(
        model.get("name") or path.stem, "ground", tuple(links), pieces, load_point, about, tuple(file.notes)
    )
    imported = finger_document_of(described, where, source)
    _check_formulas(imported.finger, file.formulas, bool(about), where)
    return imported


def _check_formulas(finger: Finger, formulas: dict[str, list[str]], ours: bool, where: str) -> None:
    """Refuse formulas that are not those of a line between their markers."""
    names = segment_names(finger)
    for name, given in formulas.items():
        wanted: list[str] = []
        if ours and name in names:
            written = path_formulas(finger, names.index(name), METRES)
            wanted = [written.length, *written.moment_arms]
        if len(given) != len(wanted) or not all(_same(a, b) for a, b in zip(given, wanted, strict=True)):
            raise ModelError(
                f"{where}: {name} is given by formulas that are not those of a tendon between its markers",
                "path points, or the formulas that fingertwin exported",
                "Export the finger again",
            )


def _same(given: str, wanted: str) -> bool:
    """Whether two formulas are alike but for the rounding of their numbers."""
    texts = [re.sub(r"\s", "", text) for text in (given, wanted)]
    if _NUMBER.sub("#", texts[0]) != _NUMBER.sub("#", texts[1]):
        return False
    a, b = (np.array([float(x) for x in _NUMBER.findall(text)]) for text in texts)
    return bool(np.all(np.abs(a - b) <= _SAME_NUMBER * np.maximum(np.abs(b), 1e-6)))


class _File:
    """Elements of a model by name."""

    def __init__(self, model: ET.Element, where: str) -> None:
        self.model, self.where = model, where
        self.bodies = {body.get("name", ""): body for body in model.findall("./BodySet/objects/Body")}
        self.notes: list[str] = []
        self.formulas: dict[str, list[str]] = {}
        self.markers: dict[str, Point] = {}
        for marker in model.findall("./MarkerSet/objects/Marker"):
            name = marker.get("name", "")
            body = self._body(marker.findtext("socket_parent_frame"))
            if body is not None:
                place = vector(marker.findtext("location"), 3, f"{where}: location of {name}")
                self.markers[name] = Point(body, place * MILLIMETRES)
        self.shapes = self._wraps()

    def _body(self, socket: str | None) -> str | None:
        """Name of the body that an absolute path leads to; None for anything else."""
        text = (socket or "").strip()
        if text == "/ground":
            return "ground"
        name = text.removeprefix("/bodyset/")
        return name if text.startswith("/bodyset/") and name in self.bodies else None

    def _wraps(self) -> dict[str, Cylinder | Obstacle]:
        out: dict[str, Cylinder | Obstacle] = {}
        grounds = [("ground", ground) for ground in self.model.findall("./Ground")]
        for body, element in [*grounds, *self.bodies.items()]:
            for shape in element.findall("./WrapObjectSet/objects/*"):
                name = shape.get("name", "")
                if shape.tag != "WrapCylinder":
                    out[name] = Obstacle(f"{name}, a {shape.tag}")
                    continue
                what = f"{self.where}: {name}"
                angles = vector(shape.findtext("xyz_body_rotation"), 3, f"{what}: xyz_body_rotation", "0 0 0")
                place = vector(shape.findtext("translation"), 3, f"{what}: translation", "0 0 0") * MILLIMETRES
                radius = float(vector(shape.findtext("radius"), 1, f"{what}: radius")[0]) * MILLIMETRES
                axis = Rotation.from_euler("XYZ", angles).as_matrix()[:, 2]
                out[name] = Cylinder(body, place, axis, radius)
        return out

    def links(self) -> list[Link]:
        """Joints, parents before children."""
        found = [self._link(joint) for joint in self.model.findall("./JointSet/objects/*")]
        children = [link.body for link in found]
        twice = {name for name in children if children.count(name) > 1}
        if twice:
            raise ModelError(f"{self.where} is no chain: {sorted(twice)[0]} hangs on two joints", "one for each body")
        out: list[Link] = []
        known = {"ground"}
        while found:
            ready = [link for link in found if link.parent in known]
            if not ready:
                raise ModelError(
                    f"{self.where} is no chain: {found[0].body} does not hang on ground", "joints to ground"
                )
            out += ready
            known |= {link.body for link in ready}
            found = [link for link in found if link.body not in known]
        return out

    def _link(self, joint: ET.Element) -> Link:
        name = joint.get("name", "")
        parent, in_parent, turn_parent = self._frame(joint, "socket_parent_frame", name)
        body, in_body, turn_body = self._frame(joint, "socket_child_frame", name)
        hinges = tuple(Hinge(label, turn_parent @ axis) for label, axis in self._hinges(joint, name))
        return Link(body, parent, name, hinges, turn_parent @ turn_body.T, in_parent, in_body)

    def _frame(self, joint: ET.Element, socket: str, name: str) -> tuple[str, Floats, Floats]:
        """Body of a joint's frame, the frame's place [mm] and its orientation there."""
        text = (joint.findtext(socket) or "").strip()
        if (body := self._body(text)) is not None:
            return body, np.zeros(3), np.eye(3)
        for frame in joint.findall("./frames/PhysicalOffsetFrame"):
            body = self._body(frame.findtext("socket_parent"))
            if frame.get("name") == text.rsplit("/", 1)[-1] and body is not None:
                what = f"{self.where}: frame {text} of {name}"
                place = vector(frame.findtext("translation"), 3, what, "0 0 0") * MILLIMETRES
                angles = vector(frame.findtext("orientation"), 3, what, "0 0 0")
                return body, place, Rotation.from_euler("XYZ", angles).as_matrix()
        raise ModelError(f"{self.where}: joint {name} stands in {text or 'no frame'!r}", "a body, or an offset of one")

    def _hinges(self, joint: ET.Element, name: str) -> list[tuple[str, Floats]]:
        """Coordinates with their axes in the joint's parent frame."""
        if joint.tag == "WeldJoint":
            return []
        coordinates = joint.findall("./coordinates/Coordinate")
        names = [c.get("name") or f"{name}_coord_{i}" for i, c in enumerate(coordinates)]
        if joint.tag in ("PinJoint", "UniversalJoint"):
            axes = {"PinJoint": [[0.0, 0.0, 1.0]], "UniversalJoint": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]}[joint.tag]
            names += [f"{name}_coord_{i}" for i in range(len(names), len(axes))]
            found = [(label, np.array(axis)) for label, axis in zip(names, axes, strict=False)]
        elif joint.tag == "CustomJoint":
            found = [
                hinge for axis in joint.findall("./SpatialTransform/TransformAxis") for hinge in self._axis(axis, name)
            ]
        else:
            raise ModelError(
                f"{self.where}: joint {name} is a {joint.tag}", "a PinJoint, UniversalJoint, CustomJoint or WeldJoint"
            )
        stuck = {
            label
            for label, coordinate in zip(names, coordinates, strict=False)
            if (coordinate.findtext("locked") or "").strip() == "true"
        }
        if stuck:
            raise ModelError(f"{self.where}: {sorted(stuck)[0]} is locked", "joints that turn", "Weld it, or unlock it")
        return found

    def _axis(self, element: ET.Element, joint: str) -> Iterator[tuple[str, Floats]]:
        """A custom joint's axis, where an angle turns about it."""
        label = element.get("name", "")
        words = (element.findtext("coordinates") or "").split()
        function = next((part for part in element if part.get("name") == "function"), None)
        if function is None:
            function = next(iter(element.findall("./function/*")), None)
        kind = "Constant" if function is None else function.tag
        what = f"{self.where}: {label} of joint {joint}"
        if kind == "Constant":
            fixed = 0.0 if function is None else float(vector(function.findtext("value"), 1, what, "0")[0])
            if fixed != 0.0:
                raise ModelError(f"{what} is moved by {fixed:g}", "0", "Move the joint's frame instead")
            return
        slope = 0.0
        if kind == "LinearFunction" and function is not None:
            factor, start = vector(function.findtext("coefficients"), 2, what, "1 0")
            slope = float(factor) if start == 0.0 else 0.0
        if len(words) != 1 or abs(slope) != 1.0 or label.startswith("translation"):
            raise ModelError(
                f"{what} follows a {kind} of {' '.join(words) or 'nothing'}", "rotations by one angle each"
            )
        axis = vector(element.findtext("axis"), 3, what)
        if not np.linalg.norm(axis) > 0.0:
            raise ModelError(f"{what} has no axis", "a vector")
        yield words[0], axis * slope

    def pieces(self) -> Iterator[Piece]:
        """Pieces between the path points of every force that has a path."""
        seen: set[str] = set()
        left_out = 0
        for force in self.model.findall("./ForceSet/objects/*"):
            name = force.get("name", "")
            path, formulas = force.find("./GeometryPath"), force.find("./FunctionBasedPath")
            if path is None and formulas is None:
                left_out += 1
                continue
            if name in seen:
                raise ModelError(f"{self.where}: two forces are called {name!r}", "a name for each")
            seen.add(name)
            if path is not None:
                yield from self._path(path, name)
            elif formulas is not None:
                yield self._given(formulas, name)
        if left_out:
            self.notes.append(f"{left_out} forces without a path of points are left out")

    def _path(self, path: ET.Element, name: str) -> Iterator[Piece]:
        wraps = [
            (wrap.findtext("wrap_object") or "").strip() for wrap in path.findall("./PathWrapSet/objects/PathWrap")
        ]
        for wrap in wraps:
            if wrap not in self.shapes:
                raise ModelError(f"{self.where}: {name} wraps on {wrap!r}", "a wrap object of the file")
        points: list[Point] = []
        for element in path.findall("./PathPointSet/objects/*"):
            what = f"{self.where}: point {element.get('name', '')} of {name}"
            if element.tag != "PathPoint":
                raise ModelError(f"{what} is a {element.tag}", "a PathPoint, which stays on its body")
            body = self._body(element.findtext("socket_parent_frame"))
            if body is None:
                raise ModelError(f"{what} lies on {element.findtext('socket_parent_frame')!r}", "a body of the model")
            points.append(Point(body, vector(element.findtext("location"), 3, what) * MILLIMETRES))
        # OpenSim tries every shape on every stretch, so one can only be told of a path with a single stretch.
        for ends in pairwise(points):
            on: Cylinder | Obstacle | None = None
            if len(wraps) == 1 and len(points) == 2:
                on = self.shapes[wraps[0]]
            elif wraps and ends[0].body != ends[1].body:
                on = Obstacle(", ".join(wraps))
            yield Piece(name, ends, on)

    def _given(self, formulas: ET.Element, name: str) -> Piece:
        """A path by formulas, whose ends are markers."""
        ends = [self.markers.get(f"{name}.{end}") for end in ("proximal", "distal")]
        if ends[0] is None or ends[1] is None:
            raise ModelError(
                f"{self.where}: {name} has no path points", "points, or the markers that fingertwin exports"
            )
        given = [formulas.find("./length_function/ExpressionBasedFunction")]
        given += formulas.findall("./moment_arm_functions/ExpressionBasedFunction")
        texts = [(f.findtext("expression") or "").strip() if f is not None else "" for f in given]
        self.formulas[name] = texts
        rule = (
            "landsmeer1_dorsal" if "min(q" in texts[0] else "landsmeer1_palmar" if "max(q" in texts[0] else "straight"
        )
        return Piece(name, (ends[0], ends[1]), None, rule)
