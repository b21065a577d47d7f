"""A finger for another specimen or species: scale a known one to measured bones and measured moment arms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from daq.errors import ModelError
from fingermodel.fingers import Finger, Topology
from fingermodel.model import posture_moment_arms

Floats = NDArray[np.float64]

# The last phalanx over the distance of mid pulp from its joint: 0.804786 and 0.487393 O2O3 (Synek et al. 2019).
TIP_OVER_PULP = 0.804786 / 0.487393


def phalanx_lengths(finger: Finger) -> dict[str, float]:
    """Length of every phalanx [mm]: between joint centres, of the last one to its tip.

    A finger's file says where the clamp holds the last phalanx, not how long it is. Mid pulp is taken, in the
    proportions of Synek et al. 2019; where that makes the last phalanx longer than the one before, it is left out.
    """
    out = finger.phalanx_lengths_mm()
    last = TIP_OVER_PULP * float(np.linalg.norm(finger.values.load_point))
    before = list(out.values())[-1:]
    return out | ({finger.topology.bones[-1]: last} if not before or last <= before[0] else {})


def scale_to_bones(finger: Finger, lengths_mm: Mapping[str, float], reference_mm: Mapping[str, float]) -> Finger:
    """Scale every phalanx, its joint centre and the tendon points on it by its length.

    Args:
        finger: to start from.
        lengths_mm: wanted length of each phalanx.
        reference_mm: length of the same phalanges in `finger`.

    Raises:
        ModelError: a bone that is missing or has no positive length.
    """
    ratio: dict[str, float] = {}
    for bone in finger.topology.bones[1:]:
        if not lengths_mm.get(bone, 0.0) > 0.0 or not reference_mm.get(bone, 0.0) > 0.0:
            raise ModelError(f"no length for {bone}", f"lengths in mm of {', '.join(finger.topology.bones[1:])}")
        ratio[bone] = lengths_mm[bone] / reference_mm[bone]
    return scale_by(finger, ratio)


def scale_by(finger: Finger, ratio: Mapping[str, float]) -> Finger:
    """Scale every bone with what lies on it by a factor of its own, the same in all directions.

    Points on the first bone, the metacarpal, scale with the second, since its own length does not enter the model.

    Args:
        finger: to start from.
        ratio: by bone, of every bone but the first.
    """
    topology, values = finger.topology, finger.values
    of_bone = np.array([ratio[bone] for bone in (topology.bones[1], *topology.bones[1:])])
    proximal = values.proximal_point * of_bone[[s.proximal_bone for s in topology.segments]][:, None]
    distal = values.distal_point * of_bone[[s.distal_bone for s in topology.segments]][:, None]
    centre = values.centre * of_bone[[j.parent for j in topology.joints]][:, None]
    load_point = values.load_point * of_bone[-1]
    return finger.replace_values(proximal_point=proximal, distal_point=distal, centre=centre, load_point=load_point)


def flexion_arms(finger: Finger, posture_rad: Floats) -> Floats:
    """Flexion moment arm of every segment about its own joint in a posture (rotations,) [mm]: (segments,)."""
    rows = _flexion_rows(finger.topology)
    arms = np.asarray(posture_moment_arms(finger.topology, finger.values, posture_rad))
    out: Floats = arms[rows, range(len(rows))]
    return out


def mean_moment_arms(finger: Finger, postures_rad: Sequence[Floats]) -> Floats:
    """Mean flexion moment arm of every segment about its own joint over postures [mm]: (segments,)."""
    mean: Floats = np.mean([flexion_arms(finger, q) for q in postures_rad], axis=0)
    return mean


def _flexion_rows(topology: Topology) -> list[int]:
    """For every segment, the rotation that is its joint's flexion."""
    first = np.cumsum([0, *(len(j.rotations) for j in topology.joints)])
    rows = {}
    for at, joint in zip(first, topology.joints, strict=False):
        # A joint without a flexion of its own wraps nothing; its first rotation is what a tendon over it turns.
        rows[joint.name] = int(at) + max(joint.flexion, 0)
    return [rows[s.joint] for s in topology.segments]


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
