"""A finger for another specimen or species: scale a known one to measured bones and measured moment arms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from daq.errors import ModelError
from fingermodel.fingers import Finger
from fingermodel.model import posture_moment_arms

Floats = NDArray[np.float64]


def scale_to_bones(finger: Finger, lengths_mm: Mapping[str, float], reference_mm: Mapping[str, float]) -> Finger:
    """Scale every phalanx, its joint centre and the tendon points on it by its length.

    Points on the metacarpal scale with the proximal phalanx, since its own length does not enter the model.

    Args:
        finger: to start from.
        lengths_mm: wanted length of each phalanx.
        reference_mm: length of the same phalanges in `finger`.

    Raises:
        ModelError: a bone that is missing or has no positive length.
    """
    topology, values = finger.topology, finger.values
    ratio: dict[str, float] = {}
    for bone in topology.bones[1:]:
        if not lengths_mm.get(bone, 0.0) > 0.0 or not reference_mm.get(bone, 0.0) > 0.0:
            raise ModelError(f"no length for {bone}", f"lengths in mm of {', '.join(topology.bones[1:])}")
        ratio[bone] = lengths_mm[bone] / reference_mm[bone]
    ratio[topology.bones[0]] = ratio[topology.bones[1]]
    of_bone = np.array([ratio[bone] for bone in topology.bones])
    proximal = values.proximal_point * of_bone[[s.proximal_bone for s in topology.segments]][:, None]
    distal = values.distal_point * of_bone[[s.distal_bone for s in topology.segments]][:, None]
    centre = values.centre * of_bone[[j.parent for j in topology.joints]][:, None]
    load_point = values.load_point * of_bone[-1]
    return finger.replace_values(proximal_point=proximal, distal_point=distal, centre=centre, load_point=load_point)


def mean_moment_arms(finger: Finger, postures_rad: Sequence[Floats]) -> Floats:
    """Mean flexion moment arm of every segment about its own joint over postures [mm]: (segments,)."""
    topology = finger.topology
    rows = [topology.rotations.index(s.joint) for s in topology.segments]
    arms = [np.asarray(posture_moment_arms(topology, finger.values, q))[rows, range(len(rows))] for q in postures_rad]
    mean: Floats = np.mean(arms, axis=0)
    return mean


def match_moment_arms(finger: Finger, wanted_mm: Mapping[str, float], postures_rad: Sequence[Floats]) -> Finger:
    """Move tendon points dorsally or palmarly until the mean moment arms are as measured.

    Both points of a segment move by the same amount along y, the least that does it; x and z stay.

    Args:
        finger: to start from.
        wanted_mm: mean flexion moment arm by segment, such as `{"PIP.FDS": 6.6}`.
        postures_rad: (rotations,) each, over which the mean is taken.

    Raises:
        ModelError: a segment that does not exist, or an arm that no such shift reaches.
    """
    from scipy.optimize import root_scalar

    names = [s.name for s in finger.topology.segments]
    for name, arm in wanted_mm.items():
        if name not in names:
            raise ModelError(f"no segment {name}", f"one of {', '.join(names)}")
        index = names.index(name)

        def shifted(y: float, index: int = index, base: Finger = finger) -> Finger:
            proximal, distal = base.values.proximal_point.copy(), base.values.distal_point.copy()
            proximal[index, 1] += y
            distal[index, 1] += y
            return base.replace_values(proximal_point=proximal, distal_point=distal)

        def miss(y: float, index: int = index, arm: float = arm, of=shifted) -> float:  # type: ignore[no-untyped-def]
            return float(mean_moment_arms(of(y), postures_rad)[index]) - arm

        # From where the points are: the arm turns back far away, so a bracket would find no sign change.
        answer = root_scalar(miss, x0=0.0, x1=0.1, method="secant", xtol=1e-10)
        if not answer.converged or abs(answer.root) > 15.0:
            raise ModelError(f"no shift within 15 mm gives {name} a mean moment arm of {arm} mm")
        finger = shifted(float(answer.root))
    return finger


def renamed(finger: Finger, identity: str, title: str, *, prior_width: float) -> Finger:
    """Return the finger under another name, with another width of the priors on its points."""
    return replace(finger, id=identity, title=title, prior_width=prior_width)
