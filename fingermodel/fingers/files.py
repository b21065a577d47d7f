"""Finger parameter sets as files: `data/fingers/NAME.yaml`, format `finger/1`.

Points stand in the file as their source prints them, in its length unit and its own bone frames; the loader turns them
into millimetres about the joint centres. Every block of numbers names its source and certainty.
"""

from __future__ import annotations

import copy
import difflib
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import ArrayLike

from daq.documents import read_document, validated
from daq.errors import ModelError
from daq.files import replacing
from daq.locations import data_dir
from fingermodel.fingers import (
    COMPONENTS,
    Finger,
    FingerValues,
    FractionPrior,
    Hood,
    Joint,
    Segment,
    Topology,
)
from fingermodel.fingers.document import FingerFile
from fingermodel.fingers.naming import require_known, require_once
from fingermodel.fingers.sourced import Certainty
from fingermodel.hood.files import ElasticHoodBlock, elastic_hood, with_network
from fingermodel.hood.parts import ElasticHood
from fingermodel.isometric.block_checks import check_blocks

WANTED = "a finger/1 file"
# Points that are nearer to each other are the same one.
_LEAST_MM = 1e-6


def finger_names() -> list[str]:
    """Names of the shipped fingers."""
    return sorted(p.stem for p in (data_dir() / "fingers").glob("*.yaml"))


def read_finger(name_or_path: str | os.PathLike[str], folder: Path | None = None) -> Finger:
    """Read a finger by its name in `data/fingers`, or from a file.

    Args:
        name_or_path: shipped name, or a path; a relative path is tried against `folder` first.
        folder: of the session that names the finger.

    Raises:
        ModelError: no such finger, or a file that does not meet the format.
    """
    if not isinstance(name_or_path, str | os.PathLike):
        raise ModelError(f"finger {name_or_path!r:.60}", "a Finger, a file, or the name of a shipped finger")
    text = os.fspath(name_or_path)
    path = _find(text, folder)
    return finger_from_dict(with_network(read_document(path, WANTED, ModelError), path.parent), path.name)


def finger_from_dict(raw: Any, where: str) -> Finger:
    """Build a finger from the contents of a finger file; `where` names it in errors."""
    raw = with_network(raw, None)
    document = validated(FingerFile, raw, where, WANTED, ModelError, "See data/README.md")
    _check_names(document, where)
    finger = _build(document)
    _check_lengths(finger, where)
    return finger


def _find(text: str, folder: Path | None) -> Path:
    candidates = [Path(text)] if folder is None else [folder / text, Path(text)]
    for path in candidates:
        if path.is_file():
            return path
    shipped = data_dir() / "fingers" / f"{text}.yaml"
    if Path(text).name == text and shipped.is_file():
        return shipped
    near = difflib.get_close_matches(text, finger_names(), n=1)
    raise ModelError(
        f"no finger {text!r}",
        f"a file, or one of {', '.join(finger_names())}",
        f"Did you mean {near[0]}?" if near else "",
    )


def _need(ok: bool, where: str, found: str, expected: str) -> None:
    if not ok:
        raise ModelError(f"{where}: {found}", expected)


def _check_chain(document: FingerFile, where: str) -> None:
    """Check that the joints join each bone to the next, in this order, each about directions."""
    bones, joints = document.bones, document.joints
    require_once(where, "bone", bones)
    require_once(where, "joint", [j.name for j in joints])
    require_once(where, "rotation", [r.name for j in joints for r in j.rotations])
    found = f"{len(joints)} joints for {len(bones)} bones"
    _need(len(joints) == len(bones) - 1, where, found, "one between each bone and the next, from proximal to distal")
    for joint, parent, child in zip(joints, bones, bones[1:], strict=False):
        found = f"joint {joint.name} joins {joint.parent} and {joint.child}"
        expected = f"{parent} and {child} at its place: bones and joints are listed from proximal to distal"
        _need((joint.parent, joint.child) == (parent, child), where, found, expected)
        _need(bool(joint.rotations), where, f"joint {joint.name} has no rotation", "at least one")
        for rotation in joint.rotations:
            _need(any(rotation.axis), where, f"rotation {rotation.name} has an axis of no length", "a direction")


def _check_hood(document: FingerFile, where: str) -> list[str]:
    """Check the muscles that enter the hood and the slips that leave it; return the slips."""
    hood = document.hood
    if hood is None:
        return []
    expected = set(_hood(document, where).fractions)
    _need(set(hood.fractions) == expected, where, f"hood.fractions has {sorted(hood.fractions)}", f"{sorted(expected)}")
    entering = list(hood.pulls) if isinstance(hood, ElasticHoodBlock) else [*hood.radial, *hood.ulnar, *hood.extensors]
    require_once(where, "muscle that enters the hood", entering)
    require_once(where, "muscle that enters the hood in part", hood.partial)
    for muscle in entering:
        _need(muscle in document.muscles, where, f"{muscle!r} enters the hood", f"one of {', '.join(document.muscles)}")
    slips = [hood.central_slip, hood.radial_band, hood.ulnar_band, hood.terminal_slip]
    require_once(where, "muscle or slip of the hood", [*document.muscles, *slips])
    return slips


def _check_names(document: FingerFile, where: str) -> None:
    def need(ok: bool, found: str, expected: str) -> None:
        _need(ok, where, found, expected)

    _check_chain(document, where)
    require_once(where, "muscle", document.muscles)
    require_once(where, "segment", [f"{s.joint}.{s.slip}" for s in document.segments])
    joints = {j.name: j for j in document.joints}
    for segment in document.segments:
        require_known(where, f"segment {segment.slip} crosses", segment.joint, joints)
        joint, place = joints[segment.joint], document.bones.index
        start, end = segment.proximal_bone or joint.parent, segment.distal_bone or joint.child
        for bone in (start, end):
            require_known(where, f"segment {segment.joint}.{segment.slip} ends on", bone, document.bones)
        crosses = place(start) <= place(joint.parent) and place(joint.child) <= place(end)
        need(crosses, f"segment {segment.joint}.{segment.slip} leads from {start} to {end}", f"across {segment.joint}")
    hood_slips = _check_hood(document, where)
    for segment in document.segments:
        known = segment.slip in document.muscles or segment.slip in hood_slips
        need(known, f"segment {segment.joint}.{segment.slip} is pulled by nothing", "a muscle or a slip of the hood")
        late = segment.rests_at_deg and (segment.wrap == "straight" or isinstance(document.hood, ElasticHoodBlock))
        found = f"segment {segment.joint}.{segment.slip} has rests_at_deg"
        need(not late, found, "it with a wrap only, and not beside an elastic hood")
    count = sum(len(j.rotations) for j in document.joints)
    need(
        len(set(document.reactions)) == len(document.reactions) == count,
        f"{len(document.reactions)} reactions for {count} rotations",
        "as many different reactions of the tip clamp as there are rotations",
    )
    moving = document.bones[1:]
    inertia = document.inertia or []
    bodies = [body.bone for body in inertia]
    for bone in bodies:
        known = bone in moving and bodies.count(bone) == 1
        need(known, f"inertia of {bone!r}, {bodies.count(bone)} times", f"one of {', '.join(moving)}, once each")
    blocks = [document.length_unit, document.load_point, *document.joints, *document.segments, *inertia]
    blocks += list(document.hood.fractions.values()) if document.hood else []
    blocks += check_blocks(document, where)
    for block in blocks:
        need(block.source in document.sources, f"source {block.source!r} is not listed", f"{sorted(document.sources)}")


def _check_lengths(finger: Finger, where: str) -> None:
    """Check that every segment has a length, and so a direction, in the neutral posture."""
    values = finger.values
    # All bones are parallel there, and each begins at the joint before it.
    origin = np.concatenate([np.zeros((1, 3)), np.cumsum(values.centre, axis=0)])
    for i, segment in enumerate(finger.topology.segments):
        start = origin[segment.proximal_bone] + values.proximal_point[i]
        end = origin[segment.distal_bone] + values.distal_point[i]
        long = float(np.linalg.norm(end - start)) > _LEAST_MM
        _need(long, where, f"segment {segment.name} has no length", "different points on its two bones")


def _hood(document: FingerFile, where: str) -> Hood | ElasticHood:
    hood = document.hood
    assert hood is not None  # noqa: S101 - asked for only where there is one
    if isinstance(hood, ElasticHoodBlock):
        return elastic_hood(hood, document.bones, where)
    return Hood(
        radial=tuple(hood.radial),
        ulnar=tuple(hood.ulnar),
        extensors=tuple(hood.extensors),
        partial=tuple(hood.partial),
        central_slip=hood.central_slip,
        radial_band=hood.radial_band,
        ulnar_band=hood.ulnar_band,
        terminal_slip=hood.terminal_slip,
    )


def _build(document: FingerFile) -> Finger:
    unit = document.length_unit.value_mm
    bone = {name: i for i, name in enumerate(document.bones)}
    joints = tuple(
        Joint(
            name=j.name,
            parent=bone[j.parent],
            child=bone[j.child],
            rotations=tuple(r.name for r in j.rotations),
            flexion=next((i for i, r in enumerate(j.rotations) if r.flexion), -1),
        )
        for j in document.joints
    )
    by_name = {j.name: j for j in document.joints}
    segments = tuple(
        Segment(
            slip=s.slip,
            joint=s.joint,
            proximal_bone=bone[s.proximal_bone or by_name[s.joint].parent],
            distal_bone=bone[s.distal_bone or by_name[s.joint].child],
            wrap=s.wrap,
            rests_at=math.radians(s.rests_at_deg or 0.0),
        )
        for s in document.segments
    )
    hood = _hood(document, document.id) if document.hood else None
    topology = Topology(
        bones=tuple(document.bones),
        joints=joints,
        segments=segments,
        muscles=tuple(document.muscles),
        hood=hood,
        reactions=tuple(COMPONENTS.index(c) for c in document.reactions),
    )
    printed = np.array([s.distal for s in document.segments])
    origin = np.array([[by_name[s.joint].distal_origin, 0.0, 0.0] for s in document.segments])
    heads = np.array([by_name[s.joint].centre for s in document.segments])
    axes = np.array([r.axis for j in document.joints for r in j.rotations], dtype=float)
    fractions = [document.hood.fractions[name] for name in topology.fractions] if document.hood else []
    values = FingerValues(
        centre=unit * np.array([j.centre for j in document.joints], dtype=float),
        axis=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        proximal_point=unit * (np.array([s.proximal for s in document.segments]) + heads),
        distal_point=unit * (printed - origin),
        fraction=np.array([f.value for f in fractions], dtype=float),
        load_point=np.array(document.load_point.offset_mm, dtype=float),
        suture=np.tile([1.0, 0.0, 0.0], (len(document.muscles), 1)),
    )
    return Finger(
        id=document.id,
        title=document.title,
        topology=topology,
        values=values,
        length_unit_mm=unit,
        prior_width=document.prior_width,
        fraction_priors=tuple(FractionPrior(f.sd, f.centre) for f in fractions),
        judged_in=document.judged_in,
        document=document.model_dump(mode="json", exclude_none=True),
    )


def finger_document(finger: Finger, source: str, cite: str, certainty: Certainty) -> dict[str, Any]:
    """Return the finger as the contents of a finger file, the numbers that differ from its file marked as ours.

    Args:
        finger: with the numbers to write.
        source: short name under which the changed numbers are listed, such as `fit`.
        cite: what that source is.
        certainty: of the changed numbers.
    """
    document: dict[str, Any] = copy.deepcopy(finger.document)
    known = _build(FingerFile.model_validate(document))
    unit, values, topology = finger.length_unit_mm, finger.values, finger.topology
    changed = {"source": source, "certainty": certainty, "note": ""}
    document |= {"id": finger.id, "title": finger.title, "prior_width": finger.prior_width}
    document["sources"] = document["sources"] | {source: cite}

    def differs(ours: ArrayLike, theirs: ArrayLike) -> bool:
        return not np.allclose(ours, theirs, rtol=0.0, atol=1e-12)

    joints = {j.name: i for i, j in enumerate(topology.joints)}
    for i, joint in enumerate(document["joints"]):
        if differs(values.centre[i], known.values.centre[i]):
            joint.update(changed, centre=(values.centre[i] / unit).tolist())
    for i, segment in enumerate(document["segments"]):
        joint = document["joints"][joints[segment["joint"]]]
        head = values.centre[joints[segment["joint"]]]
        moved = differs(values.proximal_point[i], known.values.proximal_point[i]) or differs(
            values.distal_point[i], known.values.distal_point[i]
        )
        if moved or differs(head, known.values.centre[joints[segment["joint"]]]):
            origin = np.array([joint["distal_origin"], 0.0, 0.0])
            segment.update(
                changed,
                proximal=((values.proximal_point[i] - head) / unit).tolist(),
                distal=(values.distal_point[i] / unit + origin).tolist(),
            )
    for i, name in enumerate(topology.fractions):
        if differs(values.fraction[i], known.values.fraction[i]):
            document["hood"]["fractions"][name] |= changed | {"value": float(values.fraction[i])}
    if differs(values.load_point, known.values.load_point):
        document["load_point"] |= changed | {"offset_mm": values.load_point.tolist()}
    return document


def write_finger(document: dict[str, Any], path: Path, heading: str = "") -> None:
    """Write a finger document as YAML, under a temporary name that is then renamed."""
    with replacing(path) as temporary:
        temporary.write_text(finger_text(document, heading), encoding="utf-8")


def finger_text(document: dict[str, Any], heading: str = "") -> str:
    """A finger document as YAML, below a heading of comments."""
    text = "".join(f"# {line}\n" for line in heading.splitlines())
    return text + yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=110, default_flow_style=None)
