"""The way from one finger to another in steps, to see which of them changes the force transmission."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from daq.errors import ModelError
from fingermodel.model import clamp_forces_batch, jax_values
from fingermodel.scaling import match_moment_arms, scale_by

if TYPE_CHECKING:
    from fingermodel.fingers import Finger
    from fingermodel.studies.species_sides import Side

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Step:
    """A finger on the way from the one to the other, and its mean ratios over the main load's cases."""

    what: str
    tension_to_tip: float
    bone_to_tip: float


def steps_between(first: Side, second: Side, tendons: str) -> tuple[Step, ...]:
    """Mean ratios of the first finger, as it becomes the second: as a whole, posture, bone lengths, moment arms.

    Bones are lengthened between the tendon points at their ends, so that moment arms stay ("longer but not necessarily
    larger at the epiphyses", Synek et al. 2019); then the loaded tendons are moved to the second finger's mean arms.
    Anatomy alone: effects of a revision are left out.

    Returns:
        Nothing where the two have other bones, rotations or tendons; without the step of moment arms where moving the
        first finger's tendons dorsally or palmarly does not reach them.
    """
    a, b = first.finger.topology, second.finger.topology
    if (a.bones, a.rotations, a.muscles) != (b.bones, b.rotations, b.muscles):
        return ()
    if set(first.lengths_mm) != set(a.bones[1:]) or set(second.lengths_mm) != set(a.bones[1:]):
        return ()
    whole = sum(second.lengths_mm.values()) / sum(first.lengths_mm.values())
    longer = _lengthened(first.finger, second.lengths_mm, first.lengths_mm)
    loaded = {s.name for s in a.segments if s.slip in tendons.split("+")} & set(second.arms_mm)
    wanted = {name: second.arms_mm[name] for name in first.arms_mm if name in loaded}
    try:
        matched = match_moment_arms(longer, wanted, list(second.postures_rad.values()))
    except ModelError:  # no shift of its tendons reaches them
        matched = None
    return tuple(
        Step(what, *_ratios(finger, side, tendons))
        for what, finger, side in (
            (first.name, first.finger, first),
            (f"{first.name} x {whole:.2f} as a whole", scale_by(first.finger, dict.fromkeys(a.bones, whole)), first),
            (f"{first.name}, in the postures and loads of {second.name}", first.finger, second),
            ("+ its bone lengths, moment arms as they were", longer, second),
            ("+ its mean moment arms", matched, second),
            (second.name, second.finger, second),
        )
        if finger is not None
    )


def _lengthened(finger: Finger, wanted_mm: dict[str, float], own_mm: dict[str, float]) -> Finger:
    """The finger with other bone lengths, every tendon point as it lies about the joint that it belongs to."""
    topology, values = finger.topology, finger.values
    factor = np.array([1.0, *(wanted_mm[bone] / own_mm[bone] for bone in topology.bones[1:])])
    centre = values.centre * factor[[j.parent for j in topology.joints]][:, None]
    at = [next(i for i, j in enumerate(topology.joints) if j.name == s.joint) for s in topology.segments]
    proximal = values.proximal_point + (centre - values.centre)[at]
    return finger.replace_values(centre=centre, proximal_point=proximal, load_point=values.load_point * factor[-1])


def _ratios(finger: Finger, side: Side, tendons: str) -> tuple[float, float]:
    """Mean tension to tip force and bone to tip force, under a side's loads and postures."""
    loads = side.of_tendons(tendons)
    muscles = finger.topology.muscles
    tension = np.zeros((len(loads), len(muscles)))
    for i, load in enumerate(loads):
        total = sum(load.masses_g.values())
        for muscle, mass in load.masses_g.items():
            tension[i, muscles.index(muscle)] = load.tension_N * mass / total
    posture = np.array([side.postures_rad[load.posture] for load in loads])
    forces = clamp_forces_batch(finger.topology, jax_values(finger.values), posture, tension)
    tip = np.linalg.norm(np.asarray(forces.tip)[:, :3], axis=1)
    bone: Floats = np.linalg.norm(np.asarray(forces.bone), axis=1)
    return float(np.mean(tension.sum(axis=1) / tip)), float(np.mean(bone / tip))
