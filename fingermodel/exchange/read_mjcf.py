"""A finger chain out of MuJoCo's MJCF: bodies with hinges, spatial tendons with sites, cylinders that they wrap on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from daq.errors import ModelError
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
from fingermodel.exchange.reading import MILLIMETRES, Floats, about_of, read_root, vector
from fingermodel.exchange.sharing import segment_shares
from fingermodel.exchange.writing import LOAD_POINT
from fingermodel.fingers import Finger

WANTED = "an MJCF model (<mujoco>)"
# Elements that change the rest of the file in ways that only MuJoCo resolves.
_UNRESOLVED = ("include", "frame", "replicate", "attach", "composite", "flexcomp")
_SAME_SHARE = 1e-9


@dataclass(frozen=True)
class _Stretch:
    """A piece of tendon between two sites, with the names it was made of and the share of tension that it gets."""

    tendon: str
    sites: tuple[str, str]
    piece: Piece
    share: float


def read_mjcf(path: Path, source: str, load_point_mm: Floats | None = None) -> Imported:
    """Read a finger out of an MJCF file.

    Args:
        path: of the file.
        source: what its numbers come from, as the finger file cites it.
        load_point_mm: (3,) of the last body, in its own axes; overrides the file's.

    Raises:
        ModelError: not MJCF, or no finger chain that a finger/1 file can hold.
    """
    root, where = read_root(path, WANTED), path.name
    if root.tag != "mujoco":
        raise ModelError(f"{where} begins with <{root.tag}>", WANTED)
    for tag in _UNRESOLVED:
        if root.find(f".//{tag}") is not None:
            raise ModelError(f"{where} uses <{tag}>", "a model without", "Save it from MuJoCo (mj_saveLastXML) first")
    if len(root.findall("./equality/*")):
        raise ModelError(f"{where} ties joints or bodies together (<equality>)", "joints that move by themselves")
    text = root.find("./custom/text[@name='fingertwin']")
    about = about_of(None if text is None else text.get("data"), where)
    file = _File(root, where)
    links, last = file.links()
    stretches = list(file.stretches())
    driven = {a.get("tendon") for a in root.findall("./actuator/*")} - {None}
    chosen = _chosen(stretches, driven, bool(about), where)
    load_point = file.points.get(LOAD_POINT)
    if load_point_mm is not None:
        load_point = Point(last, load_point_mm)
    name = root.get("model") or path.stem
    described = Described(name, "world", tuple(links), tuple(s.piece for s in chosen), load_point, about)
    imported = finger_document_of(described, where, source)
    if about:
        _check_shares(imported.finger, stretches, chosen, where)
    return imported


def _chosen(stretches: list[_Stretch], driven: set[str | None], ours: bool, where: str) -> list[_Stretch]:
    """One stretch for each segment: in our own files the tendons without an actuator, else those with one."""
    if ours:
        # Of an elastic hood every segment is driven by itself.
        return [s for s in stretches if s.tendon not in driven] or stretches
    if shared := [s for s in stretches if s.share != 1.0]:
        raise ModelError(
            f"{where}: tendon {shared[0].tendon} divides its tension at a pulley",
            "tendons without pulleys, or a file that fingertwin exported",
            "Describe how the hood shares tension in a finger/1 file instead",
        )
    return [s for s in stretches if s.tendon in driven] or stretches


def _check_shares(finger: Finger, stretches: list[_Stretch], chosen: list[_Stretch], where: str) -> None:
    """Refuse pulleys that say something else than the text beside them."""
    of_segment = {s.sites: i for i, s in enumerate(chosen)}
    shares = segment_shares(finger)
    if shares is None:
        return
    muscles = finger.topology.muscles
    found = np.zeros_like(shares)
    own = {s.tendon for s in chosen}
    for s in stretches:
        if s.tendon in own or s.piece.ends[0].body == s.piece.ends[1].body:
            continue
        if s.tendon not in muscles or s.sites not in of_segment:
            raise ModelError(f"{where}: tendon {s.tendon} is none of the finger's muscles", f"{', '.join(muscles)}")
        found[of_segment[s.sites], muscles.index(s.tendon)] += s.share
    wrong = np.argwhere(np.abs(found - shares) > _SAME_SHARE)
    if len(wrong):
        segment, muscle = wrong[0]
        raise ModelError(
            f"{where}: the pulleys of {muscles[muscle]} lead {found[segment, muscle]:.6g} of its tension to "
            f"{finger.topology.segments[segment].name}, the hood beside them {shares[segment, muscle]:.6g}",
            "the same of both",
            "Change the fractions in the text 'fingertwin' too",
        )


class _File:
    """Elements by name, with what their default classes say."""

    def __init__(self, root: ET.Element, where: str) -> None:
        self.root, self.where = root, where
        compiler = [c.attrib for c in root.findall("./compiler")]
        settings = {k: v for attributes in compiler for k, v in attributes.items()}
        if settings.get("coordinate", "local") != "local":
            raise ModelError(f"{where} has {settings['coordinate']} coordinates", "local ones")
        self.degrees = settings.get("angle", "degree") == "degree"
        self.order = settings.get("eulerseq", "xyz")
        if len(self.order) != 3 or set(self.order.lower()) - set("xyz"):
            raise ModelError(f"{where}: eulerseq is {self.order!r}", "three of x y z")
        self.defaults: dict[str, dict[str, dict[str, str]]] = {"main": {}}
        for element in root.findall("./default"):
            self._take_defaults(element, "main", {})
        self.points: dict[str, Point] = {}
        self.shapes: dict[str, Cylinder | Obstacle] = {}

    def _take_defaults(self, element: ET.Element, name: str, inherited: Mapping[str, dict[str, str]]) -> None:
        own = {tag: dict(values) for tag, values in inherited.items()}
        for part in element:
            if part.tag != "default":
                own[part.tag] = {**own.get(part.tag, {}), **part.attrib}
        self.defaults[name] = own
        for part in element.findall("./default"):
            self._take_defaults(part, part.get("class", ""), own)

    def _attributes(self, element: ET.Element, inherited: str) -> dict[str, str]:
        of_class = self.defaults.get(element.get("class", inherited), {})
        return {**of_class.get(element.tag, {}), **element.attrib}

    def links(self) -> tuple[list[Link], str]:
        """Bodies, parents before children, and the last one that moves; takes note of sites and geoms."""
        world = self.root.find("./worldbody")
        if world is None:
            raise ModelError(f"{self.where} has no <worldbody>", WANTED)
        self._attached(world, "world", "main")
        out: list[Link] = []
        names = {"world"}
        last = "world"
        open_bodies = [(body, "world", world.get("childclass", "main")) for body in world.findall("./body")]
        while open_bodies:
            body, parent, inherited = open_bodies.pop(0)
            name = body.get("name") or f"body{len(names)}"
            if name in names:
                raise ModelError(f"{self.where}: two bodies are called {name!r}", "a name for each")
            names.add(name)
            inherited = body.get("childclass", inherited)
            link = self._link(body, name, parent, inherited)
            last = name if link.hinges else last
            out.append(link)
            self._attached(body, name, inherited)
            open_bodies = [(part, name, inherited) for part in body.findall("./body")] + open_bodies
        return out, last

    def _link(self, body: ET.Element, name: str, parent: str, inherited: str) -> Link:
        place = vector(body.get("pos"), 3, f"{self.where}: pos of {name}", "0 0 0") * MILLIMETRES
        turn = self._turn(body.attrib, name)
        hinges: list[Hinge] = []
        centres: list[Floats] = []
        for element in body:
            if element.tag == "freejoint":
                raise ModelError(f"{self.where}: {name} floats freely", "hinges", "Fix the first bone to the world")
            if element.tag != "joint":
                continue
            given = self._attributes(element, inherited)
            label = given.get("name") or f"{name}_joint{len(hinges) + 1}"
            kind = given.get("type", "hinge")
            if kind != "hinge":
                raise ModelError(f"{self.where}: joint {label} is of type {kind}", "hinge: a finger's bones turn")
            if float(vector(given.get("ref"), 1, f"{self.where}: ref of {label}", "0")[0]) != 0.0:
                raise ModelError(f"{self.where}: joint {label} counts its angle from {given['ref']}", "ref 0")
            axis = vector(given.get("axis"), 3, f"{self.where}: axis of {label}", "0 0 1")
            if not np.linalg.norm(axis) > 0.0:
                raise ModelError(f"{self.where}: joint {label} has no axis", "a vector")
            hinges.append(Hinge(label, turn @ axis))
            centres.append(vector(given.get("pos"), 3, f"{self.where}: pos of {label}", "0 0 0") * MILLIMETRES)
        if any(np.linalg.norm(c - centres[0]) > 1e-6 for c in centres):
            raise ModelError(
                f"{self.where}: the hinges of {name} do not meet in a point", "axes through one centre for each body"
            )
        centre = centres[0] if centres else np.zeros(3)
        joint = hinges[0].name if hinges else ""
        return Link(name, parent, joint, tuple(hinges), turn, place + turn @ centre, centre)

    def _attached(self, body: ET.Element, name: str, inherited: str) -> None:
        for element in body:
            label = element.get("name")
            if label is None or element.tag not in ("site", "geom"):
                continue
            given = self._attributes(element, inherited)
            if element.tag == "site":
                self.points[label] = Point(name, self._middle(given, label))
            else:
                self.shapes[label] = self._shape(given, label, name)

    def _middle(self, given: Mapping[str, str], label: str) -> Floats:
        what = f"{self.where}: place of {label}"
        if "fromto" in given:
            ends = vector(given["fromto"], 6, what) * MILLIMETRES
            return (ends[:3] + ends[3:]) / 2.0
        return vector(given.get("pos"), 3, what, "0 0 0") * MILLIMETRES

    def _shape(self, given: Mapping[str, str], label: str, body: str) -> Cylinder | Obstacle:
        if given.get("type", "sphere") != "cylinder":
            return Obstacle(f"{label}, a {given.get('type', 'sphere')}")
        size = (given.get("size") or "0").split()
        radius = float(vector(size[0], 1, f"{self.where}: size of {label}")[0]) * MILLIMETRES
        if "fromto" in given:
            ends = vector(given["fromto"], 6, f"{self.where}: fromto of {label}")
            axis = ends[3:] - ends[:3]
        else:
            axis = self._turn(given, label)[:, 2]
        if not np.linalg.norm(axis) > 0.0:
            raise ModelError(f"{self.where}: {label} has no axis", "two ends apart")
        return Cylinder(body, self._middle(given, label), axis / np.linalg.norm(axis), radius)

    def _turn(self, given: Mapping[str, str], label: str) -> Floats:
        """Orientation of a body or geom: takes its components to its parent's."""
        what = f"{self.where}: orientation of {label}"
        angle = math.pi / 180.0 if self.degrees else 1.0
        try:
            if "quat" in given:
                w, x, y, z = vector(given["quat"], 4, what)
                turned = Rotation.from_quat([x, y, z, w])
            elif "axisangle" in given:
                values = vector(given["axisangle"], 4, what)
                turned = Rotation.from_rotvec(values[:3] / np.linalg.norm(values[:3]) * values[3] * angle)
            elif "euler" in given:
                # Small letters turn with the body, as SciPy's capitals do.
                sequence = self.order.swapcase()
                turned = self._euler(sequence, vector(given["euler"], 3, what) * angle)
            elif "xyaxes" in given:
                values = vector(given["xyaxes"], 6, what)
                x_axis = values[:3] / np.linalg.norm(values[:3])
                y_axis = values[3:] - x_axis * (x_axis @ values[3:])
                y_axis = y_axis / np.linalg.norm(y_axis)
                turned = Rotation.from_matrix(np.stack([x_axis, y_axis, np.cross(x_axis, y_axis)], axis=1))
            elif "zaxis" in given:
                turned = self._from_z(vector(given["zaxis"], 3, what))
            else:
                return np.eye(3)
        except ValueError as error:
            if isinstance(error, ModelError):
                raise
            raise ModelError(f"{what} is no rotation", "a quaternion or axes that are not zero") from error
        matrix: Floats = turned.as_matrix()
        if not np.isfinite(matrix).all():
            raise ModelError(f"{what} is no rotation", "a quaternion or axes that are not zero")
        return matrix

    @staticmethod
    def _euler(sequence: str, angles: Floats) -> Rotation:
        """Turns one after the other: capitals about the turned axes, small letters about the fixed ones."""
        out = Rotation.identity()
        for letter, angle in zip(sequence, angles, strict=True):
            one = Rotation.from_euler(letter.lower(), float(angle))
            out = out * one if letter.isupper() else one * out
        return out

    @staticmethod
    def _from_z(z: Floats) -> Rotation:
        """The least turn that takes z there."""
        z = z / np.linalg.norm(z)
        axis = np.cross([0.0, 0.0, 1.0], z)
        sine = float(np.linalg.norm(axis))
        if sine == 0.0:
            return Rotation.from_rotvec([math.pi if z[2] < 0.0 else 0.0, 0.0, 0.0])
        return Rotation.from_rotvec(axis / sine * math.atan2(sine, float(z[2])))

    def stretches(self) -> Iterator[_Stretch]:
        """Pieces between the sites of every spatial tendon."""
        for tendon in self.root.findall("./tendon/spatial"):
            name = tendon.get("name")
            if not name:
                raise ModelError(f"{self.where}: a spatial tendon has no name", "a name for each")
            share, before, on = 1.0, "", None
            for element in tendon:
                if element.tag == "pulley":
                    divisor = float(vector(element.get("divisor"), 1, f"{self.where}: a divisor of {name}")[0])
                    if divisor <= 0.0:
                        raise ModelError(f"{self.where}: a pulley of {name} has divisor {divisor:g}", "above 0")
                    share, before, on = 1.0 / divisor, "", None
                elif element.tag == "geom":
                    on = self.shapes.get(element.get("geom", ""))
                    if on is None:
                        raise ModelError(f"{self.where}: {name} wraps on {element.get('geom')!r}", "a geom of the file")
                elif element.tag == "site":
                    site = element.get("site", "")
                    if site not in self.points:
                        raise ModelError(f"{self.where}: {name} runs through {site!r}", "a site of the file")
                    if before:
                        piece = Piece(name, (self.points[before], self.points[site]), on)
                        yield _Stretch(name, (before, site), piece, share)
                    before, on = site, None
