"""A finger scaled to another specimen: from bone lengths and moment arms to a finger file that stands alone."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from daq.errors import InputError, ModelError
from daq.sessions import read_session
from fingermodel.comparison.observations import posture_rad
from fingermodel.compiled.compilation import prepare_jax
from fingermodel.fingers.files import finger_document, finger_from_dict, read_finger, write_finger
from fingermodel.scaling import flexion_arms, match_moment_arms, mean_moment_arms, phalanx_lengths, renamed, scale_by

if TYPE_CHECKING:
    from fingermodel.fingers import Finger

Floats = NDArray[np.float64]
# Beyond these a length is in other units, or another bone's.
LEAST, MOST = 0.3, 3.0
LARGEST_ARM_MM = 40.0
PRIOR_FACTOR = 3.0
NEUTRAL = "neutral"
POSTURES = "synek2019_HMEAN"
_UNITS = (("m", 1e3), ("cm", 10.0), ("inches", 25.4), ("\N{MICRO SIGN}m", 1e-3))


@dataclass(frozen=True)
class BoneScale:
    """One bone before and after; lengths [mm] are None where its own length does not enter the model.

    `how` is `given`, or what the factor was taken from.
    """

    bone: str
    before_mm: float | None
    after_mm: float | None
    factor: float
    how: str


@dataclass(frozen=True)
class ArmScale:
    """Flexion moment arm of one tendon at one joint [mm], by posture, before and after.

    `asked_mm` is the mean over the postures that was asked for; `shift_mm` how far its points moved dorsally for it.
    """

    segment: str
    before_mm: dict[str, float]
    after_mm: dict[str, float]
    mean_before_mm: float
    mean_after_mm: float
    asked_mm: float | None
    shift_mm: float


@dataclass(frozen=True)
class Scaled:
    """A scaled finger, and what was done to it.

    Attributes:
        base: it was scaled from.
        finger: scaled.
        bones: every bone.
        arms: every segment.
        postures_of: session whose postures the means are over.
        assumptions: a sentence each.
    """

    base: Finger
    finger: Finger
    bones: tuple[BoneScale, ...]
    arms: tuple[ArmScale, ...]
    postures_of: str
    assumptions: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "from": self.base.id,
            "finger": self.finger.id,
            "prior_width": self.finger.prior_width,
            "bones": [dict(b.__dict__) for b in self.bones],
            "moment_arms": [dict(a.__dict__) for a in self.arms],
            "postures_of": self.postures_of,
            "assumptions": list(self.assumptions),
        }


def scale_finger(
    base: str,
    lengths_mm: Mapping[str, float],
    arms_mm: Mapping[str, float],
    reference_mm: Mapping[str, float],
    identity: str,
    postures_of: str = POSTURES,
) -> Scaled:
    """Scale a finger to a specimen's bone lengths, then move its tendons to measured moment arms.

    Args:
        base: name of a shipped finger, or a finger file.
        lengths_mm: of the specimen's phalanges; those it leaves out scale by the mean factor of the others.
        arms_mm: mean flexion moment arm by tendon and joint, such as `{"FDP@MCP": 10.2}`.
        reference_mm: of the same phalanges of `base`, where they were measured between other landmarks than its
            joint centres, or are not in its file.
        identity: of the new finger.
        postures_of: session over whose postures moment arms are averaged.

    Raises:
        InputError: a finger or session that cannot be read, an unknown bone or tendon, or a length beyond reason.
    """
    prepare_jax()
    finger = read_finger(base)
    if not lengths_mm:
        raise InputError(
            "no bone length", f"the length of at least one of {_moving(finger)}", "At the command line: --bone BONE=MM"
        )
    own = _own_lengths(finger, lengths_mm, reference_mm)
    factors = _factors(finger, lengths_mm, own)
    postures = postures_of_session(finger, postures_of)
    scaled = scale_by(finger, factors)
    wanted = _wanted(scaled, arms_mm, list(postures.values())[1:])
    final = match_moment_arms(scaled, wanted, list(postures.values())[1:])
    words = ", ".join(f"{bone} {length:g}" for bone, length in lengths_mm.items())
    title = f"{finger.title}, scaled to {words} mm"
    final = renamed(final, identity, title, prior_width=PRIOR_FACTOR * finger.prior_width)
    return Scaled(
        base=finger,
        finger=final,
        bones=_bones(finger, lengths_mm, own, factors),
        arms=_arms(finger, scaled, final, wanted, postures),
        postures_of=postures_of,
        assumptions=tuple(_assumptions(finger, lengths_mm, reference_mm, own, wanted)),
    )


def postures_of_session(finger: Finger, session: str) -> dict[str, Floats]:
    """The neutral posture, then a session's, by name: (rotations,) [rad].

    Raises:
        InputError: no such session, or angles that the finger has no joint for.
    """
    out = {NEUTRAL: np.zeros(len(finger.topology.rotations))}
    for name, angles in read_session(session).postures_deg.items():
        out[name] = posture_rad(finger.topology, angles.model_dump(), f"{session}: posture {name}")
    return out


def _moving(finger: Finger) -> str:
    return ", ".join(finger.topology.bones[1:])


def _own_lengths(
    finger: Finger, lengths_mm: Mapping[str, float], reference_mm: Mapping[str, float]
) -> dict[str, float]:
    """Lengths of the base finger's phalanges [mm], where known; every length that was given is checked against them."""
    moving, known = finger.topology.bones[1:], phalanx_lengths(finger)
    for option, given in (("bone", lengths_mm), ("reference", reference_mm)):
        for bone, length in given.items():
            if bone == finger.topology.bones[0]:
                raise InputError(
                    f"{option} {bone}",
                    f"one of {_moving(finger)}",
                    f"The length of {bone} does not enter the model; points on it scale with {moving[0]}",
                )
            if bone not in moving:
                raise InputError(f"{option} {bone}: {finger.id} has no such bone", f"one of {_moving(finger)}")
            if not length > 0.0:
                raise InputError(f"{option} {bone}={length:g}", "a length above 0 mm")
    for bone, length in reference_mm.items():
        _require_alike(finger, f"reference {bone}", length, known.get(bone, length))
    own = known | dict(reference_mm)
    for bone, length in lengths_mm.items():
        if bone not in own:
            raise InputError(
                f"bone {bone}, whose length {finger.id} does not state",
                f"the length of {finger.id}'s own beside it",
                f"Give it as a reference (--reference {bone}=MM)",
            )
        _require_alike(finger, f"bone {bone}", length, own[bone])
    return {bone: own[bone] for bone in moving if bone in own}


def _require_alike(finger: Finger, what: str, length: float, own: float) -> None:
    ratio = length / own
    if LEAST <= ratio <= MOST:
        return
    unit = next((u for u, factor in _UNITS if 0.5 <= ratio * factor <= 2.0), None)
    raise InputError(
        f"{what}={length:g} is {ratio:.2g} times the {own:.1f} mm of {finger.id}",
        f"a length in mm, {LEAST} to {MOST:g} times as long",
        f"Is it in {unit}? Lengths are in mm" if unit else "Check the bone, or start from a finger of like size",
    )


def _factors(finger: Finger, lengths_mm: Mapping[str, float], own: Mapping[str, float]) -> dict[str, float]:
    """Factor of every bone but the first; one that was not measured takes the geometric mean of the others."""
    given = {bone: length / own[bone] for bone, length in lengths_mm.items()}
    mean = math.exp(float(np.mean([math.log(f) for f in given.values()])))
    return {bone: given.get(bone, mean) for bone in finger.topology.bones[1:]}


def _wanted(scaled: Finger, arms_mm: Mapping[str, float], postures: Sequence[Floats]) -> dict[str, float]:
    """Moment arms by the model's name of the segment, each held against what scaling alone gives."""
    names = {f"{s.slip}@{s.joint}": s.name for s in scaled.topology.segments}
    mean = mean_moment_arms(scaled, postures)
    before = dict(zip(names, mean.tolist(), strict=True))
    out: dict[str, float] = {}
    for name, arm in arms_mm.items():
        if name not in names:
            raise InputError(f"moment arm {name}", f"TENDON@JOINT, one of {', '.join(names)}")
        plain = before[name]
        if arm == 0.0 or abs(arm) > LARGEST_ARM_MM:
            raise InputError(
                f"moment arm {name}={arm:g}", f"mm, flexion positive; scaling the bones alone gives {plain:.1f}"
            )
        # An arm near zero may change its sign; a large one that does has been written without it.
        if abs(plain) >= 2.0 and not LEAST <= arm / plain <= MOST:
            sign = f"Write {name}={-arm:g}" if arm < 0.0 < plain or plain < 0.0 < arm else "Arms are in mm"
            raise InputError(
                f"moment arm {name}={arm:g} where scaling the bones alone gives {plain:.1f} mm",
                f"the same sign (flexion positive), {LEAST} to {MOST:g} times as large",
                sign,
            )
        out[names[name]] = arm
    return out


def _bones(
    finger: Finger, lengths_mm: Mapping[str, float], own: Mapping[str, float], factors: Mapping[str, float]
) -> tuple[BoneScale, ...]:
    first, *moving = finger.topology.bones
    rows = [BoneScale(first, None, None, factors[moving[0]], f"as {moving[0]}")]
    for bone in moving:
        before, factor = own.get(bone), factors[bone]
        how = "given" if bone in lengths_mm else "mean of the given ones"
        rows.append(BoneScale(bone, before, None if before is None else before * factor, factor, how))
    return tuple(rows)


def _arms(
    base: Finger, scaled: Finger, final: Finger, wanted: Mapping[str, float], postures: Mapping[str, Floats]
) -> tuple[ArmScale, ...]:
    before = {name: flexion_arms(base, q) for name, q in postures.items()}
    after = {name: flexion_arms(final, q) for name, q in postures.items()}
    shift = final.values.proximal_point[:, 1] - scaled.values.proximal_point[:, 1]
    rows = []
    for i, segment in enumerate(final.topology.segments):
        was, now = ({name: float(arms[i]) for name, arms in table.items()} for table in (before, after))
        mean_was, mean_now = (float(np.mean([v for k, v in t.items() if k != NEUTRAL])) for t in (was, now))
        rows.append(ArmScale(segment.name, was, now, mean_was, mean_now, wanted.get(segment.name), float(shift[i])))
    return tuple(rows)


def _assumptions(
    finger: Finger,
    lengths_mm: Mapping[str, float],
    reference_mm: Mapping[str, float],
    own: Mapping[str, float],
    wanted: Mapping[str, float],
) -> list[str]:
    first, *moving = finger.topology.bones
    out = [
        f"Every bone scales alike in all directions: breadth and depth follow its length. Points on {first} scale "
        f"with {moving[0]}.",
        f"The hood's fractions, axes and wrapping are those of {finger.id}; priors on points are {PRIOR_FACTOR:g} "
        "times as wide as its own.",
    ]
    last = moving[-1]
    if last in lengths_mm and last not in reference_mm:
        out.append(
            f"{last} of {finger.id} is taken as {own[last]:.1f} mm, its load point being mid pulp; "
            f"--reference {last}=MM where it is known."
        )
    if missing := [bone for bone in moving if bone not in lengths_mm]:
        out.append(f"Not measured, so scaled by the mean factor of the others: {', '.join(missing)}.")
    if not wanted:
        out.append("No moment arm was given: they scale with the bones, which need not hold between species.")
    return out


def scaled_document(scaled: Scaled) -> dict[str, Any]:
    """Contents of the finger file; every number that was scaled names its source, certainty and factor."""
    base, factors = scaled.base, {b.bone: b for b in scaled.bones}
    known = base.document.get("sources", {})
    source = next(s for s in ("scaled", *(f"scaled{i}" for i in range(2, 99))) if s not in known)
    lengths = ", ".join(f"{b.bone} {b.after_mm:.6g}" for b in scaled.bones if b.how == "given")
    arms = ", ".join(f"{a.segment} {a.asked_mm:g}" for a in scaled.arms if a.asked_mm is not None)
    cite = f"{base.id} scaled by bone length to a specimen's: {lengths} mm"
    if arms:
        cite += f"; flexion moment arms, mean over the postures of {scaled.postures_of}: {arms} mm"
    document = finger_document(scaled.finger, source, cite, "low")

    first, second = scaled.bones[0].bone, scaled.bones[1].bone

    def mark(block: dict[str, Any], bones: Sequence[str], note: str) -> None:
        if block["source"] == source:
            measured = all(factors[second if b == first else b].how == "given" for b in bones)
            block |= {"certainty": "low" if measured else "assumed", "note": note}

    def times(bone: str) -> str:
        return f"x {factors[bone].factor:.4f} ({bone}, {factors[bone].how})"

    topology = scaled.finger.topology
    for joint in document["joints"]:
        mark(joint, [joint["parent"]], f"centre {times(joint['parent'])}")
    for block, segment, arm in zip(document["segments"], topology.segments, scaled.arms, strict=True):
        ends = [topology.bones[segment.proximal_bone], topology.bones[segment.distal_bone]]
        note = f"proximal {times(ends[0])}, distal {times(ends[1])}"
        if arm.asked_mm is not None:
            note += f"; both y {arm.shift_mm:+.4f} mm to a mean moment arm of {arm.asked_mm:g} mm"
        mark(block, ends, note)
    mark(document["load_point"], [topology.bones[-1]], f"offset {times(topology.bones[-1])}")
    for body in document.get("inertia") or []:
        factor = factors[body["bone"]].factor
        body |= {
            "mass_kg": body["mass_kg"] * factor**3,
            "centre_mm": [x * factor for x in body["centre_mm"]],
            "principal_kg_mm2": [x * factor**5 for x in body["principal_kg_mm2"]],
            "source": source,
            "certainty": "assumed",
            "note": f"centre {times(body['bone'])}, mass by its cube, moments by its fifth power: same form, density",
        }
    return document


def scaled_heading(scaled: Scaled) -> str:
    """What stands above the finger file."""
    return (
        f"Made by `fingertwin scale {scaled.base.id}`.\n"
        f"Points are in units of {scaled.base.id}'s length_unit: proximal from the joint centre, distal from the\n"
        "point that lies distal_origin distal of it."
    )


def write_scaled(scaled: Scaled, path: Path) -> None:
    """Write the finger file and read it again.

    Raises:
        ModelError: what was written does not read as the same finger.
        OSError: it cannot be written.
    """
    document = scaled_document(scaled)
    finger_from_dict(document, path.name)
    write_finger(document, path, scaled_heading(scaled))
    again = read_finger(path)
    for ours, theirs in zip(scaled.finger.values, again.values, strict=True):
        if not np.allclose(ours, theirs, rtol=0.0, atol=1e-9):
            raise ModelError(f"{path.name} does not read as it was written", "the same numbers", "Write it elsewhere")
