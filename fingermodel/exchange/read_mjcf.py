"""A finger chain out of MuJoCo's MJCF: bodies with hinges, spatial tendons with sites, cylinders that they wrap on.

MuJoCo itself compiles the file, so defaults, frames, repeated sections and orientations mean what they mean there.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from daq.errors import ModelError
from fingermodel.exchange.chains import finger_document_of
from fingermodel.exchange.described import Cylinder, Described, Hinge, Imported, Link, Obstacle, Piece, Point
from fingermodel.exchange.engine_check import held_against
from fingermodel.exchange.reading import MILLIMETRES, Floats, about_of, read_root
from fingermodel.exchange.sharing import segment_shares
from fingermodel.exchange.writing import LOAD_POINT
from fingermodel.fingers import Finger

WANTED = "an MJCF model (<mujoco>)"
# Elements that read other files, or grow without bound.
_REFUSED = ("include", "replicate", "attach", "composite", "flexcomp", "plugin")
_LOOKS = ("camera", "light", "material", "texture", "mesh", "motor", "position", "velocity", "general", "muscle")
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
    for tag in _REFUSED:
        if root.find(f".//{tag}") is not None:
            raise ModelError(f"{where} uses <{tag}>", "a model without", "Save it from MuJoCo (mj_saveLastXML) first")
    if len(root.findall("./equality/*")):
        raise ModelError(f"{where} ties joints or bodies together (<equality>)", "joints that move by themselves")
    text = root.find("./custom/text[@name='fingertwin']")
    about = about_of(None if text is None else text.get("data"), where)
    model = _Model(root, where)
    links, stretches = model.links(), list(model.stretches())
    driven = {a.get("tendon") for a in root.findall("./actuator/*")} - {None}
    chosen = _chosen(stretches, driven, bool(about), where)
    load_point = model.points[model.sites.index(LOAD_POINT)] if LOAD_POINT in model.sites else None
    moving = [link.body for link in links if link.hinges]
    if load_point_mm is not None and moving:
        load_point = Point(moving[-1], load_point_mm)
    name = root.get("model") or path.stem
    described = Described(name, "world", tuple(links), tuple(s.piece for s in chosen), load_point, about)
    imported = finger_document_of(described, where, source)
    if about:
        _check_shares(imported.finger, stretches, chosen, where)
    return held_against(imported, f"MuJoCo {mujoco.__version__}", model.moment_arms)


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


class _Model:
    """A compiled model in our units, every name and default resolved."""

    def __init__(self, root: ET.Element, where: str) -> None:
        self.where = where
        self.model = compiled(root, where)
        kinds = mujoco.mjtObj
        self.bodies = ["world", *(self._name(kinds.mjOBJ_BODY, i, "body") for i in range(1, self.model.nbody))]
        self.sites = [self._name(kinds.mjOBJ_SITE, i, "site") for i in range(self.model.nsite)]
        self.joints = [self._name(kinds.mjOBJ_JOINT, i, "joint") for i in range(self.model.njnt)]
        self.tendons = [self._name(kinds.mjOBJ_TENDON, i, "tendon") for i in range(self.model.ntendon)]
        places = self.model.site_pos * MILLIMETRES
        self.points = [Point(self.bodies[b], p) for b, p in zip(self.model.site_bodyid, places, strict=True)]

    def _name(self, kind: Any, index: int, what: str) -> str:
        return mujoco.mj_id2name(self.model, kind, index) or f"{what}{index}"

    def links(self) -> list[Link]:
        """Bodies, parents before children."""
        return [self._link(body) for body in range(1, self.model.nbody)]

    def _link(self, body: int) -> Link:
        model, name = self.model, self.bodies[body]
        place, turn = model.body_pos[body] * MILLIMETRES, _turn(model.body_quat[body])
        first = int(model.body_jntadr[body])
        own = range(first, first + int(model.body_jntnum[body]))
        hinges = []
        for joint in own:
            label = self.joints[joint]
            kind = mujoco.mjtJoint(model.jnt_type[joint]).name.removeprefix("mjJNT_").lower()
            if kind != "hinge":
                raise ModelError(f"{self.where}: joint {label} is of type {kind}", "hinge: a finger's bones turn")
            zero = math.degrees(model.qpos0[model.jnt_qposadr[joint]])
            if zero != 0.0:
                raise ModelError(f"{self.where}: joint {label} counts its angle from {zero:g}°", "ref 0")
            hinges.append(Hinge(label, turn @ model.jnt_axis[joint]))
        centres = model.jnt_pos[own.start : own.stop] * MILLIMETRES
        if any(np.linalg.norm(c - centres[0]) > 1e-6 for c in centres):
            raise ModelError(
                f"{self.where}: the hinges of {name} do not meet in a point", "axes through one centre for each body"
            )
        centre = centres[0] if len(centres) else np.zeros(3)
        parent = self.bodies[model.body_parentid[body]]
        return Link(name, parent, hinges[0].name if hinges else "", tuple(hinges), turn, place + turn @ centre, centre)

    def stretches(self) -> Iterator[_Stretch]:
        """Pieces between the sites of every spatial tendon."""
        model, kinds = self.model, mujoco.mjtWrap
        for tendon in range(model.ntendon):
            name = self.tendons[tendon]
            share, before, on = 1.0, -1, tuple[Cylinder | Obstacle, ...]()
            first = int(model.tendon_adr[tendon])
            for at in range(first, first + int(model.tendon_num[tendon])):
                kind, index, value = kinds(model.wrap_type[at]), int(model.wrap_objid[at]), float(model.wrap_prm[at])
                if kind == kinds.mjWRAP_PULLEY:
                    share, before, on = 1.0 / value, -1, ()
                elif kind == kinds.mjWRAP_SITE:
                    if before >= 0:
                        piece = Piece(name, (self.points[before], self.points[index]), on)
                        yield _Stretch(name, (self.sites[before], self.sites[index]), piece, share)
                    before, on = index, ()
                elif kind in (kinds.mjWRAP_CYLINDER, kinds.mjWRAP_SPHERE):
                    on = (self._shape(index, int(value)),)

    def _shape(self, geom: int, side: int) -> Cylinder | Obstacle:
        model = self.model
        if mujoco.mjtGeom(model.geom_type[geom]) != mujoco.mjtGeom.mjGEOM_CYLINDER:
            return Obstacle(f"{self._name(mujoco.mjtObj.mjOBJ_GEOM, geom, 'geom')}, a sphere")
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        body = int(model.geom_bodyid[geom])
        place, axis = model.geom_pos[geom] * MILLIMETRES, _turn(model.geom_quat[geom])[:, 2]
        towards: Floats | None = None
        if side >= 0:
            apart = data.site_xpos[side] - data.geom_xpos[geom]
            towards = data.xmat[body].reshape(3, 3).T @ apart * MILLIMETRES
        return Cylinder(self.bodies[body], place, axis, float(model.geom_size[geom][0]) * MILLIMETRES, towards)

    def moment_arms(self, rotations: Sequence[str], tendons: Sequence[str], postures: Floats) -> Floats:
        """Of tendons in postures (n, rotations) [rad]: (n, rotations, tendons) [mm]."""
        model, data = self.model, mujoco.MjData(self.model)
        joints = [self.joints.index(name) for name in rotations]
        angles, speeds = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
        chosen = [self.tendons.index(name) for name in tendons]
        out = np.zeros((*postures.shape, len(tendons)))
        rate = np.zeros((model.ntendon, model.nv))
        rows = np.repeat(np.arange(model.ntendon), model.ten_J_rownnz)
        for posture, arms in zip(postures, out, strict=True):
            data.qpos[angles] = posture
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_tendon(model, data)
            rate[rows, model.ten_J_colind] = data.ten_J
            arms[:] = -rate[np.ix_(chosen, speeds)].T * MILLIMETRES
        return out


def _turn(quaternion: Floats) -> Floats:
    """Takes a body's or geom's components to its parent's."""
    w, x, y, z = quaternion
    matrix: Floats = Rotation.from_quat([x, y, z, w]).as_matrix()
    return matrix


def compiled(root: ET.Element, where: str) -> Any:
    """MuJoCo's model of what moves tendons: bodies, joints, sites, shapes and tendons, without their looks.

    Raises:
        ModelError: MuJoCo cannot read it.
    """
    kept = ET.Element("mujoco", root.attrib)
    kept.extend(part for part in root if part.tag in ("compiler", "default", "worldbody", "tendon"))
    for parent in kept.iter():
        for part in list(parent):
            drawn = part.get("type") in ("mesh", "hfield", "sdf") or "mesh" in part.attrib
            if part.tag in _LOOKS or (part.tag == "geom" and drawn):
                parent.remove(part)
            part.attrib.pop("material", None)
    # Bones whose mass was in what was left out: ours are statics.
    ET.SubElement(kept, "compiler", boundmass="1e-6", boundinertia="1e-9", fusestatic="false", discardvisual="false")
    heard = mujoco.get_mju_user_warning()
    # Its warnings, of numbers that are refused below, would go into a file in the user's folder.
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        model = mujoco.MjModel.from_xml_string(ET.tostring(kept, encoding="unicode"))
    except ValueError as error:
        said = re.sub(r",? line -?\d+", "", " ".join(str(error).split())).rstrip(", ")
        raise ModelError(f"{where}: MuJoCo refuses it ({said})", WANTED) from error
    finally:
        mujoco.set_mju_user_warning(heard)
    for values in (model.body_pos, model.body_quat, model.jnt_pos, model.site_pos, model.geom_pos, model.geom_size):
        if not np.isfinite(values).all():
            raise ModelError(f"{where} holds a number that is not finite", "finite numbers")
    return model
