"""A finger chain out of an OpenSim model: bodies, pin and custom joints, path points, cylinders that paths wrap on."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from daq.errors import ModelError
from fingermodel.exchange.arm_formulas import path_formulas
from fingermodel.exchange.chains import finger_document_of
from fingermodel.exchange.described import Cylinder, Described, Hinge, Imported, Link, Obstacle, Piece, Point
from fingermodel.exchange.engine_check import held_against
from fingermodel.exchange.opensim_arms import OpensimArms, OpensimFailedError, installed
from fingermodel.exchange.osim import ABOUT
from fingermodel.exchange.reading import MILLIMETRES, Floats, about_of, read_root, vector
from fingermodel.exchange.writing import LOAD_POINT, METRES, segment_names
from fingermodel.fingers import Finger

WANTED = "an OpenSim model (.osim)"
OLDEST = 40000
# What of these elements is read, or changes no moment arm.
_READ = {
    "WrapCylinder": "active xyz_body_rotation translation quadrant radius Appearance color display_preference",
    "PathWrap": "wrap_object method range",
    "GeometryPath": "PathPointSet PathWrapSet Appearance default_color",
    "PathPoint": "socket_parent_frame location",
    "TransformAxis": "coordinates axis function Constant LinearFunction MultiplierFunction SimmSpline "
    "NaturalCubicSpline PiecewiseLinearFunction",
    "PhysicalOffsetFrame": "socket_parent translation orientation FrameGeometry attached_geometry WrapObjectSet",
}
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
    stated = root.get("Version", "")
    model = root.find("./Model")
    if root.tag != "OpenSimDocument" or model is None:
        raise ModelError(f"{where} begins with <{root.tag}>", WANTED)
    if not stated.isdigit() or int(stated) < OLDEST:
        raise ModelError(f"{where} has version {stated or '?'}", f"{OLDEST} or later", "Open and save it in OpenSim 4")
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
    scaled = model.find("./JointSet//MultiplierFunction") is not None
    _check_formulas(imported.finger, file.formulas, bool(about), scaled, where)
    if scaled and file.formulas:
        note = (
            f"OpenSim's Scale Tool left the formulas of {', '.join(file.formulas)} as they were: their moment arms "
            "were taken from their scaled markers"
        )
        imported = replace(imported, notes=(*imported.notes, note))
    if unread := _unread(model):
        imported = replace(imported, read=f"{imported.read}; not read: {', '.join(unread)}")
    if about:  # its paths were held against the formulas that they came from
        return imported
    unmeasured = "it is not installed"
    if installed():
        try:
            return held_against(imported, f"OpenSim {version('opensim')}", OpensimArms(root).moment_arms)
        except OpensimFailedError:
            unmeasured = "it could not open this file"
    note = f"moment arms were not held against OpenSim's: {unmeasured}"
    return replace(imported, notes=(*imported.notes, note))


def _unread(model: ET.Element) -> list[str]:
    """What may change a moment arm and is not read."""
    found = {
        f"{part.tag} of {element.tag}"
        for element in model.iter()
        if element.tag in _READ
        for part in element
        if part.tag not in _READ[element.tag].split()
    }
    return sorted(found | {part.tag for part in model.findall("./components/*")})


def _check_formulas(finger: Finger, formulas: dict[str, list[str]], ours: bool, scaled: bool, where: str) -> None:
    """Refuse formulas that are not those of a line between their markers, but for the numbers of a scaled model."""
    names = segment_names(finger)
    for name, given in formulas.items():
        wanted: list[str] = []
        if ours and name in names:
            written = path_formulas(finger, names.index(name), METRES)
            wanted = [written.length, *written.moment_arms]
        if len(given) != len(wanted) or not all(_same(a, b, scaled) for a, b in zip(given, wanted, strict=True)):
            raise ModelError(
                f"{where}: {name} is given by formulas that are not those of a tendon between its markers",
                "path points, or the formulas that fingertwin exported",
                "Export the finger again",
            )


def _same(given: str, wanted: str, scaled: bool) -> bool:
    """Whether two formulas are alike but for the rounding of their numbers, or for the numbers."""
    texts = [re.sub(r"\s", "", text) for text in (given, wanted)]
    if _NUMBER.sub("#", texts[0]) != _NUMBER.sub("#", texts[1]):
        return False
    if scaled:
        return True
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

    def _wraps(self) -> dict[str, tuple[Cylinder | Obstacle, ...]]:
        """Shapes by name; one that is not active is none."""
        out: dict[str, tuple[Cylinder | Obstacle, ...]] = {}
        grounds = [("ground", ground) for ground in self.model.findall("./Ground")]
        for body, element in [*grounds, *self.bodies.items()]:
            for shape in element.findall("./WrapObjectSet/objects/*"):
                name = shape.get("name", "")
                if (shape.findtext("active") or "true").strip() == "false":
                    out[name] = ()
                    continue
                if shape.tag != "WrapCylinder":
                    out[name] = (Obstacle(f"{name}, a {shape.tag}"),)
                    continue
                what = f"{self.where}: {name}"
                angles = vector(shape.findtext("xyz_body_rotation"), 3, f"{what}: xyz_body_rotation", "0 0 0")
                place = vector(shape.findtext("translation"), 3, f"{what}: translation", "0 0 0") * MILLIMETRES
                radius = float(vector(shape.findtext("radius"), 1, f"{what}: radius")[0]) * MILLIMETRES
                turn = Rotation.from_euler("XYZ", angles).as_matrix()
                quadrant = (shape.findtext("quadrant") or "all").strip().lower()
                side: Floats | None = None
                if quadrant.lstrip("+-") in ("x", "y"):
                    # Far outside the cylinder.
                    sign = -1.0 if quadrant.startswith("-") else 1.0
                    side = turn[:, "xy".index(quadrant[-1])] * sign * 2.0 * radius
                out[name] = (Cylinder(body, place, turn[:, 2], radius, side),)
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
            if "true" in [(coordinate.findtext(tag) or "").strip() for tag in ("locked", "prescribed")]
        }
        if stuck:
            raise ModelError(
                f"{self.where}: {sorted(stuck)[0]} is locked or prescribed", "joints that turn", "Weld it, or unlock it"
            )
        return found

    def _axis(self, element: ET.Element, joint: str) -> Iterator[tuple[str, Floats]]:
        """A custom joint's axis, where an angle turns about it."""
        label = element.get("name", "")
        words = (element.findtext("coordinates") or "").split()
        what = f"{self.where}: {label} of joint {joint}"
        function = next((part for part in element if part.get("name") == "function"), None)
        if function is None:
            function = next(iter(element.findall("./function/*")), None)
        slope, start = (0.0, 0.0) if function is None else self._line(function, what)
        if function is None or (slope == 0.0 and start == 0.0):
            return
        if slope == 0.0:
            raise ModelError(f"{what} is moved by {start:g}", "0", "Move the joint's frame instead")
        if len(words) != 1 or abs(slope) != 1.0 or start != 0.0 or label.startswith("translation"):
            found = f"{what} follows a {function.tag} of {' '.join(words) or 'nothing'}"
            raise ModelError(found, "rotations by one angle each")
        axis = vector(element.findtext("axis"), 3, what)
        if not np.linalg.norm(axis) > 0.0:
            raise ModelError(f"{what} has no axis", "a vector")
        yield words[0], axis * slope

    def _line(self, function: ET.Element, what: str) -> tuple[float, float]:
        """Slope and value at 0 of a function that is a straight line.

        Raises:
            ModelError: it is none, or of a kind that is not read.
        """
        if function.tag == "Constant":
            return 0.0, float(vector(function.findtext("value"), 1, what, "0")[0])
        if function.tag == "LinearFunction":
            slope, start = vector(function.findtext("coefficients"), 2, what, "1 0")
            return float(slope), float(start)
        if function.tag == "MultiplierFunction" and (inner := function.find("./function/*")) is not None:
            # What OpenSim's Scale Tool leaves.
            scale = float(vector(function.findtext("scale"), 1, what, "1")[0])
            slope, start = self._line(inner, what)
            return slope * scale, start * scale
        if function.tag in ("SimmSpline", "NaturalCubicSpline", "PiecewiseLinearFunction"):
            given = [function.findtext(k) or "" for k in ("x", "y")]
            x, y = (vector(text, len(text.split()), what) for text in given)
            if len(x) == len(y) >= 2 and x[-1] > x[0]:
                slope = float((y[-1] - y[0]) / (x[-1] - x[0]))
                if np.allclose(y, y[0] + slope * (x - x[0]), rtol=0.0, atol=1e-12):
                    return slope, float(y[0] - slope * x[0])
        raise ModelError(f"{what} follows a {function.tag}", "a straight line, as rotations by one angle each have")

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
        wraps: list[tuple[Cylinder | Obstacle, float, float]] = []
        for wrap in path.findall("./PathWrapSet/objects/PathWrap"):
            given = (wrap.findtext("wrap_object") or "").strip()
            if given not in self.shapes:
                raise ModelError(f"{self.where}: {name} wraps on {given!r}", "a wrap object of the file")
            first, last = vector(wrap.findtext("range"), 2, f"{self.where}: range of {name} on {given}", "-1 -1")
            wraps += [(shape, first, last if last >= 1.0 else np.inf) for shape in self.shapes[given]]
        points: list[Point] = []
        for element in path.findall("./PathPointSet/objects/*"):
            what = f"{self.where}: point {element.get('name', '')} of {name}"
            if element.tag != "PathPoint":
                raise ModelError(f"{what} is a {element.tag}", "a PathPoint, which stays on its body")
            body = self._body(element.findtext("socket_parent_frame"))
            if body is None:
                raise ModelError(f"{what} lies on {element.findtext('socket_parent_frame')!r}", "a body of the model")
            points.append(Point(body, vector(element.findtext("location"), 3, what) * MILLIMETRES))
        # OpenSim tries every shape on every stretch between the points of its range.
        for number, ends in enumerate(pairwise(points), 1):
            on = tuple(shape for shape, first, last in wraps if first <= number < last)
            yield Piece(name, ends, on if ends[0].body != ends[1].body else ())

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
        felt = re.search(r"(min|max)\(q\d+, ([^)]*)\)", texts[0])
        rule = "straight" if felt is None else {"min": "landsmeer1_dorsal", "max": "landsmeer1_palmar"}[felt[1]]
        resting = vector(felt[2] if felt else "0", 1, f"{self.where}: the angle at which {name} comes to rest")
        return Piece(name, (ends[0], ends[1]), (), rule, float(resting[0]))
