"""A finger as other software describes it: bodies, hinges and paths; and the finger/1 document made of it.

A file's bodies may have frames of any orientation. Here every bone's axes are those of the first bone at zero angles,
and its origin is the joint at its base, as ours are. Bodies that do not move against each other are one bone, and
hinges that share a centre, with nothing attached between them, are one joint.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from daq.errors import ModelError
from fingermodel.exchange.described import Cylinder, Described, Floats, Hinge, Imported, Obstacle, Piece
from fingermodel.exchange.wrap_rules import SAME_MM, NoRuleError, rule_of
from fingermodel.fingers.files import finger_from_dict

# From the first joint to the load point [mm]: from a child's little finger to a gorilla's, with room.
SHORTEST_MM, LONGEST_MM = 10.0, 500.0
# An axis is flexion if it lies nearer than this to across the finger, as a cosine.
_ACROSS = 0.7
_UNSOURCED = {"source": "file", "certainty": "assumed"}
# What a clamp is taken to carry, by the number of angles that it holds.
_REACTIONS = {
    1: ["Fy"],
    2: ["Fx", "Fy"],
    3: ["Fx", "Fy", "Tz"],
    4: ["Fx", "Fy", "Fz", "Tz"],
    5: ["Fx", "Fy", "Fz", "Ty", "Tz"],
    6: ["Fx", "Fy", "Fz", "Tx", "Ty", "Tz"],
}


@dataclass
class _Bone:
    """A bone under construction: its joint towards the hand, and where the file's bodies lie in it."""

    name: str
    joint: str = ""
    hinges: list[Hinge] = field(default_factory=list)
    centre: Floats = field(default_factory=lambda: np.zeros(3))
    used: bool = False


@dataclass(frozen=True)
class _Placed:
    """Takes a body's points to its bone: `turn @ point + shift` [mm]."""

    bone: _Bone
    turn: Floats
    shift: Floats

    def at(self, point: Floats) -> Floats:
        place: Floats = self.turn @ point + self.shift
        return place


def finger_document_of(described: Described, where: str, source: str) -> Imported:
    """Make a finger file of what another file says.

    Args:
        described: by `read_mjcf` or `read_osim`.
        where: the file's name, for messages.
        source: what the numbers come from, as the new file cites it.

    Raises:
        ModelError: it is no chain, has no load point, or its lengths make no finger.
    """
    bones, placed = _chain(described, where)
    joints = bones[1:]
    if not joints:
        raise ModelError(f"{where}: nothing turns about a hinge", "a chain of bones joined by hinges")
    pieces = [p for p in described.pieces if placed[p.ends[0].body].bone is not placed[p.ends[1].body].bone]
    if not pieces:
        raise ModelError(f"{where}: no tendon runs from one bone to another", "tendons with path points")
    load_point = described.load_point
    if load_point is None:
        raise ModelError(
            f"{where} does not say where the clamp holds the finger",
            "a site (MJCF) or marker (OpenSim) named load_point on the last bone",
            "Give it: --load-point 'X Y Z' in mm in that body's own axes",
        )
    if placed[load_point.body].bone is not bones[-1]:
        raise ModelError(
            f"{where}: load_point lies on {load_point.body}", f"a point of {bones[-1].name}, the last bone"
        )
    for kind, given in (("bones", [b.name for b in bones]), ("angles", [h.name for b in joints for h in b.hinges])):
        if twice := {name for name in given if given.count(name) > 1}:
            raise ModelError(f"{where}: two {kind} are called {sorted(twice)[0]!r}", "a name for each", "Rename one")
    tip = placed[load_point.body].at(load_point.place)
    _check_lengths(joints, tip, pieces, placed, where)
    notes = list(described.notes)
    frame: Floats = np.eye(3)
    if not described.about:
        frame = _anatomical(joints, tip, where)
        notes.append(
            "axes were laid so that x points to the hand and z along the last joint's axis, and positive angles are "
            "taken to bend towards the palm"
        )
    document = _document(described, bones, frame, tip, where, source)
    order = {id(bone): i for i, bone in enumerate(bones)}
    for piece in pieces:
        segment, lost = _segment(piece, placed, order, bones, frame, document)
        name = f"{segment['joint']}.{segment['slip']}"
        if any(name == f"{s['joint']}.{s['slip']}" for s in document["segments"]):
            raise ModelError(
                f"{where}: {segment['slip']} crosses {segment['joint']} twice", "once, as in a finger/1 file"
            )
        notes += [f"{name}: {what}" for what in lost]
        document["segments"].append({**segment, **_UNSOURCED})
    if not described.about:
        document["muscles"] = list(dict.fromkeys(s["slip"] for s in document["segments"]))
    cylinders = sum(isinstance(shape, Cylinder) for piece in pieces for shape in piece.on)
    counts = {
        "bodies": len(described.links),
        "hinges": sum(len(b.hinges) for b in joints),
        "stretches of tendon between bones": len(pieces),
        "wraps on cylinders": cylinders,
    }
    read = f"{', '.join(f'{what} {count}' for what, count in counts.items())}, and the load point"
    return Imported(document, finger_from_dict(document, where), tuple(notes), read, bool(described.about))


def _chain(described: Described, where: str) -> tuple[list[_Bone], dict[str, _Placed]]:
    # The engines keep their own name of what does not move to themselves.
    base = _Bone("base" if all(link.body != "base" for link in described.links) else f"{described.base}_base")
    bones = [base]
    placed = {described.base: _Placed(base, np.eye(3), np.zeros(3))}
    attached = {end.body for piece in described.pieces for end in piece.ends}
    if described.load_point is not None:
        attached.add(described.load_point.body)
    for body in attached - {described.base, *(link.body for link in described.links)}:
        raise ModelError(f"{where}: a point lies on {body!r}, which is no body of the model", "a body of the chain")
    for link in described.links:
        parent = placed[link.parent]
        turn = parent.turn @ link.turn
        if not link.hinges:
            shift = parent.at(link.in_parent) - turn @ link.in_body
            placed[link.body] = _Placed(parent.bone, turn, shift)
            if parent.bone is base and len(bones) == 1:
                base.name = link.body
            continue
        if parent.bone is not bones[-1]:
            raise ModelError(
                f"{where} is no chain: {link.body} and {bones[-1].name} both move on {parent.bone.name}",
                "one finger, each bone on the one before",
                "Cut the model down to it",
            )
        bone = _Bone(link.body, link.joint, [Hinge(h.name, parent.turn @ h.axis) for h in link.hinges])
        bone.centre = parent.at(link.in_parent)
        bones.append(bone)
        placed[link.body] = _Placed(bone, turn, -turn @ link.in_body)
    for body in attached:
        placed[body].bone.used = True
    base.used = True
    return _merged(bones, placed), placed


def _merged(bones: list[_Bone], placed: dict[str, _Placed]) -> list[_Bone]:
    """Make one joint of two with a common centre, where no tendon is held between them."""
    out = [bones[0]]
    for bone in bones[1:]:
        before = out[-1]
        if len(out) > 1 and not before.used and np.linalg.norm(bone.centre) < SAME_MM:
            bone.hinges = [*before.hinges, *bone.hinges]
            bone.centre, bone.joint = before.centre, before.joint
            out[-1] = bone
        else:
            out.append(bone)
    # The hand's bone has its origin at the first joint.
    first = out[1].centre if len(out) > 1 else np.zeros(3)
    for body, place in placed.items():
        if place.bone is out[0]:
            placed[body] = _Placed(place.bone, place.turn, place.shift - first)
    if len(out) > 1:
        out[1].centre = np.zeros(3)
    return out


def _check_lengths(
    joints: Sequence[_Bone], tip: Floats, pieces: Sequence[Piece], placed: Mapping[str, _Placed], where: str
) -> None:
    length = float(sum(np.linalg.norm(v) for v in (*(j.centre for j in joints[1:]), tip)))
    expected = f"{SHORTEST_MM / 1000:g} to {LONGEST_MM / 1000:g} m, lengths in metres"
    if not SHORTEST_MM <= length <= LONGEST_MM:
        raise ModelError(
            f"{where}: from the first joint to the load point it is {length / 1000:.4g} m", expected, "Scale the model"
        )
    for piece in pieces:
        for end in piece.ends:
            far = float(np.linalg.norm(placed[end.body].at(end.place)))
            if far > LONGEST_MM:
                raise ModelError(f"{where}: {piece.slip} has a point {far / 1000:.4g} m from its joint", expected)


def _anatomical(joints: Sequence[_Bone], tip: Floats, where: str) -> Floats:
    """Axes of ours (columns) in the file's: x proximal, y dorsal, z along the last joint's last axis."""
    z = joints[-1].hinges[-1].axis / np.linalg.norm(joints[-1].hinges[-1].axis)
    along = -(sum((j.centre for j in joints[1:]), np.zeros(3)) + tip)
    x = along - z * (z @ along)
    if np.linalg.norm(x) < SHORTEST_MM / 2.0:
        raise ModelError(f"{where}: the last joint turns about the length of the finger", "an axis across it")
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _document(
    described: Described, bones: Sequence[_Bone], frame: Floats, tip: Floats, where: str, source: str
) -> dict[str, Any]:
    """Everything but the segments."""
    about = described.about
    unit = float(about.get("length_unit_mm", 1.0))
    count = sum(len(b.hinges) for b in bones)
    if count not in _REACTIONS:
        raise ModelError(f"{where} turns about {count} axes", f"at most {max(_REACTIONS)}, which a clamp can hold")
    document: dict[str, Any] = {
        "format": "finger/1",
        "id": about.get("id") or re.sub(r"\W+", "_", described.name).strip("_") or "imported",
        "title": about.get("title") or f"{described.name}, imported",
        "sources": {"file": source},
        "length_unit": {"value_mm": unit, **_UNSOURCED},
        "prior_width": about.get("prior_width", 1.0),
        "bones": [b.name for b in bones],
        "joints": [],
        "muscles": about.get("muscles", []),
        "segments": [],
    }
    names = {tuple(v): k for k, v in dict(about.get("joints", {})).items()}
    for parent, bone in pairwise(bones):
        axes = [frame.T @ h.axis / np.linalg.norm(h.axis) for h in bone.hinges]
        name = names.get(tuple(h.name for h in bone.hinges), bone.joint)
        if about:
            bends = dict(about.get("flexion", {})).get(name)
        else:
            across = [abs(float(axis[2])) for axis in axes]
            bends = bone.hinges[int(np.argmax(across))].name if max(across) > _ACROSS else None
        document["joints"].append(
            {
                "name": name,
                "parent": parent.name,
                "child": bone.name,
                "centre": _plain(frame.T @ bone.centre / unit),
                "distal_origin": 0.0,
                "rotations": [
                    {"name": h.name, "axis": _plain(axis)} | ({"flexion": True} if h.name == bends else {})
                    for h, axis in zip(bone.hinges, axes, strict=True)
                ],
                **_UNSOURCED,
            }
        )
    if about.get("hood"):
        fractions = {k: {**v, **_UNSOURCED} for k, v in dict(about["hood"].get("fractions", {})).items()}
        document["hood"] = {**about["hood"], "fractions": fractions}
    document["reactions"] = about.get("reactions") or _REACTIONS[count]
    document["load_point"] = {"offset_mm": _plain(frame.T @ tip), **_UNSOURCED}
    document["judged_in"] = about.get("judged_in", "space")
    return document


def _segment(
    piece: Piece,
    placed: Mapping[str, _Placed],
    order: Mapping[int, int],
    bones: Sequence[_Bone],
    frame: Floats,
    document: Mapping[str, Any],
) -> tuple[dict[str, Any], list[str]]:
    """A piece as a segment of the finger file, and what it lost."""
    ends = sorted(piece.ends, key=lambda end: order[id(placed[end.body].bone)])
    low, high = (order[id(placed[end.body].bone)] for end in ends)
    proximal, distal = (frame.T @ placed[end.body].at(end.place) for end in ends)
    joint = document["joints"][low]
    unit = document["length_unit"]["value_mm"]
    head = frame.T @ bones[low + 1].centre
    wrap, rests_at, lost = piece.wrap, piece.rests_at, []
    for shape in piece.on:
        try:
            if isinstance(shape, Obstacle):
                raise NoRuleError(f"{shape.what}, which a finger/1 file has no word for")
            place = placed[shape.body]
            # What turns with a joint's first rotations alone is no bone.
            if high > low + 1 or order.get(id(place.bone), low) not in (low, high):
                raise NoRuleError("a cylinder that is not the head of its joint")
            if wrap != "straight":
                raise NoRuleError("a second cylinder")
            centre = frame.T @ place.at(shape.place)
            turned = replace(
                shape,
                # Seen from the joint, whichever of its two bones carries the cylinder.
                place=centre - head if place.bone is bones[low] else centre,
                axis=frame.T @ place.turn @ shape.axis,
                side=None if shape.side is None else frame.T @ place.turn @ shape.side,
            )
            wrap, rests_at = rule_of(joint, proximal - head, distal, turned)
        except NoRuleError as reason:
            lost.append(f"wraps on {reason}")
    notes = [f"{what}: {'taken as straight' if wrap == 'straight' else 'left out'}" for what in lost]
    slip = piece.slip
    if document["muscles"] and slip.startswith(f"{joint['name']}."):
        slip = slip.removeprefix(f"{joint['name']}.")
    return {
        "slip": slip,
        "joint": joint["name"],
        "proximal": _plain((proximal - head) / unit),
        "distal": _plain(distal / unit),
        "wrap": wrap,
        **({"rests_at_deg": math.degrees(rests_at)} if rests_at else {}),
        "proximal_bone": bones[low].name,
        "distal_bone": bones[high].name,
    }, notes


def _plain(vector: Floats) -> list[float]:
    return [float(x) + 0.0 for x in vector]
