"""Whether the names in the isometric blocks of a finger file are known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from daq.errors import ModelError
from fingermodel.fingers.document import FingerFile
from fingermodel.fingers.naming import require_known, require_once
from fingermodel.fingers.sourced import Sourced


def check_blocks(document: FingerFile, where: str) -> list[Sourced]:
    """Check the names in these blocks of a finger file; return the blocks that name a source.

    Raises:
        ModelError: a name that is not known, or one given twice.
    """
    surfaces, passive = list(document.surfaces or []), list(document.passive or [])
    bones = {s.name: s.bone for s in surfaces}
    joints = {j.name: j for j in document.joints}
    require_once(where, "surface", [s.name for s in surfaces])
    for surface in surfaces:
        require_known(where, f"surface {surface.name} is on", surface.bone, document.bones)
        if not any(surface.axis):
            raise ModelError(f"{where}: surface {surface.name} has an axis of no length", "a direction")
    for segment in document.segments:
        if segment.over is None:
            continue
        name, joint = f"{segment.joint}.{segment.slip}", joints[segment.joint]
        require_known(where, f"segment {name} runs over", segment.over.surface, bones)
        if (segment.proximal_bone or joint.parent, segment.distal_bone or joint.child) != (joint.parent, joint.child):
            raise ModelError(f"{where}: segment {name} runs over a surface and several joints", "one joint")
        require_known(where, f"the surface of {name} is on", bones[segment.over.surface], [joint.parent, joint.child])
    rotations = [r.name for j in document.joints for r in j.rotations]
    for block in passive:
        require_known(where, "a passive torque acts on", block.rotation, rotations)
    require_once(where, "passive torque on", [b.rotation for b in passive])
    _check_heads(where, document.heads or {}, document.muscles)
    held = [document.held] if document.held else []
    for posture in held:
        for name in posture.posture_deg:
            require_known(where, "the posture held names", name, rotations)
    return [*surfaces, *passive, *held]


def _check_heads(where: str, heads: Mapping[str, Sequence[str]], muscles: Sequence[str]) -> None:
    for name, members in heads.items():
        if name in muscles or not members:
            raise ModelError(f"{where}: heads of {name!r}", "another name than a muscle's, with one head at least")
        for muscle in members:
            require_known(where, f"a head of {name} is", muscle, muscles)
    require_once(where, "head", [muscle for members in heads.values() for muscle in members])
