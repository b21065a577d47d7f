"""What may be otherwise in the skeleton and beside it: the catalogue from the posture to the pulleys."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.second_simulator.finger import (
    ALONG,
    BONES,
    JOINTS,
    Floats,
    angle_between,
    logistic,
    softplus,
    unit,
)
from tests.second_simulator.situation import Acting, Situation, form
from tests.second_simulator.tendon_effects import FLEXORS


@form("goniometer_bias", "posture")
def constant_bias(s: Situation, a: Acting) -> None:
    """The same in every posture."""
    s.flexion = s.flexion + a.size


@form("goniometer_bias", "posture")
def arms_do_not_lie(s: Situation, a: Acting) -> None:
    """Less in flexion, b (0.85 + 0.2 cos θ)."""
    s.flexion = s.flexion + a.size * (0.85 + 0.2 * np.cos(s.flexion))


@form("goniometer_bias", "posture")
def shared_arm(s: Situation, a: Acting) -> None:
    """Less 15 % of the neighbours' biases, which share an arm."""
    neighbours = np.append(a.size[1:], 0.0) + np.append(0.0, a.size[:-1])
    s.flexion = s.flexion + (a.size - 0.15 * neighbours)


def _lengthen(s: Situation, scale: Floats) -> None:
    for bone, by in zip(BONES, scale, strict=True):
        s.finger.shaft[bone] *= float(by)


@form("segment_length", "geometry")
def shaft_only(s: Situation, a: Acting) -> None:
    """The shaft alone, while the tendon points stay beside their joints."""
    _lengthen(s, 1.0 + a.size)


@form("segment_length", "geometry")
def whole_bone(s: Situation, a: Acting) -> None:
    """The bone with its tendon points, along x."""
    scale = 1.0 + a.size
    _lengthen(s, scale)
    for (_, joint), strand in s.finger.strands.items():
        beyond = JOINTS.index(joint)
        if beyond > 0:
            strand.proximal[0] *= scale[beyond - 1]
        strand.distal[0] *= scale[beyond]


@form("axis_tilt", "geometry")
def leans_dorsally(s: Situation, a: Acting) -> None:
    """About the bone's long axis, and a quarter as much proximally."""
    for joint, angle in zip(JOINTS, a.size, strict=True):
        s.finger.axis[joint] = unit(np.array([0.25 * np.tan(angle), np.tan(angle), 1.0]))


@form("axis_tilt", "geometry")
def leans_proximally(s: Situation, a: Acting) -> None:
    """About the dorsal axis, and a quarter as much dorsally."""
    for joint, angle in zip(JOINTS, a.size, strict=True):
        s.finger.axis[joint] = unit(np.array([np.tan(angle), 0.25 * np.tan(angle), 1.0]))


def _glides(s: Situation, way: Floats) -> None:
    """The bone beyond moves with the centre; proximal points stay on the bone before."""
    s.finger.glide = way
    for (_, joint), strand in s.finger.strands.items():
        strand.proximal[0] -= way[JOINTS.index(joint)]


@form("centre_migration", "geometry")
def gliding(s: Situation, a: Acting) -> None:
    """Centre and distal bone move by c sin θ."""
    _glides(s, a.size * np.sin(s.flexion))


@form("centre_migration", "geometry")
def gliding_saturates(s: Situation, a: Acting) -> None:
    """Centre and distal bone move by c 0.9 tanh(θ/0.9)."""
    _glides(s, a.size * 0.9 * np.tanh(s.flexion / 0.9))


@form("centre_migration", "geometry")
def instantaneous_centre(s: Situation, a: Acting) -> None:
    """Only the instantaneous centre moves by c sin θ, the bones do not."""
    s.finger.centre_shift = a.size * np.sin(s.flexion)


def _bands_drop(s: Situation, by: float) -> None:
    """The radial band more than the ulnar one, and its distal point three quarters as far."""
    for band, uneven in (("RB", 1.12), ("UB", 0.88)):
        strand = s.finger.strands[band, "PIP"]
        strand.proximal[1] -= by * uneven
        strand.distal[1] -= 0.75 * by * uneven


@form("lateral_band_slip", "geometry")
def sine_squared(s: Situation, a: Acting) -> None:
    """With sin² PIP."""
    _bands_drop(s, a.value * float(np.sin(min(max(s.flexion[1], 0.0), np.pi / 2))) ** 2)


@form("lateral_band_slip", "geometry")
def past_a_threshold(s: Situation, a: Acting) -> None:
    """With a logistic step at 40° PIP."""
    rest, full = logistic(-0.7 / 0.2), logistic((np.pi / 2 - 0.7) / 0.2)
    _bands_drop(s, a.value * (logistic((max(s.flexion[1], 0.0) - 0.7) / 0.2) - rest) / (full - rest))


@form("lateral_band_slip", "geometry")
def one_less_cosine(s: Situation, a: Acting) -> None:
    """With 1 - cos PIP."""
    _bands_drop(s, a.value * (1.0 - float(np.cos(max(s.flexion[1], 0.0)))))


def _intrinsics_lift(s: Situation, by: Callable[[str], float]) -> None:
    """By the muscle's name; the point on the phalanx follows by 0.6."""
    for m in ("RI", "UI", "LU"):
        strand = s.finger.strands[m, "MCP"]
        strand.proximal[1] -= by(m)
        strand.distal[1] -= 0.6 * by(m)


@form("intrinsic_bowstring", "geometry")
def lifts_smoothly(s: Situation, a: Acting) -> None:
    """With softplus(sin MCP - 0.1)."""
    _intrinsics_lift(s, lambda m: a.value * softplus(float(np.sin(s.flexion[0])) - 0.1, 0.1))


@form("intrinsic_bowstring", "geometry")
def lifts_under_load(s: Situation, a: Acting) -> None:
    """With sin MCP (0.65 + 0.35 T/(T + 1.5 N))."""
    bent = max(float(np.sin(s.flexion[0])), 0.0)
    _intrinsics_lift(s, lambda m: a.value * (bent * (0.65 + 0.35 * s.pull[m] / (s.pull[m] + 1.5))))


@form("intrinsic_bowstring", "geometry")
def lifts_late(s: Situation, a: Acting) -> None:
    """With 1.6 (1 - cos MCP)."""
    _intrinsics_lift(s, lambda m: a.value * 1.6 * (1.0 - float(np.cos(max(s.flexion[0], 0.0)))))


def _flexors_lift(
    s: Situation, bent: Callable[[str], float], lift: Callable[[float], float], distal: float = 1.0
) -> None:
    """By what the pulleys carry, twice the tension times the sine of half the angle that the joint is bent."""
    for slip, joints in FLEXORS.items():
        for joint in joints:
            by = lift(2.0 * s.tension[slip, joint] * float(np.sin(bent(joint) / 2.0)))
            s.finger.strands[slip, joint].proximal[1] -= by
            s.finger.strands[slip, joint].distal[1] -= distal * by


def _flexed(s: Situation) -> Callable[[str], float]:
    return lambda joint: max(float(s.flexion[JOINTS.index(joint)]), 0.0)


@form("bowstringing", "lift")
def pulley_saturates(s: Situation, a: Acting) -> None:
    """By 7 mm (1 - exp(-k P/7 mm))."""
    _flexors_lift(s, _flexed(s), lambda load: 7.0 * (1.0 - float(np.exp(-a.value * load / 7.0))))


@form("bowstringing", "lift")
def pulley_stiffens(s: Situation, a: Acting) -> None:
    """By k P (1 + P/1 N)^-0.12."""
    _flexors_lift(s, _flexed(s), lambda load: a.value * load * (1.0 + load) ** -0.12)


@form("bowstringing", "lift")
def between_the_bones(s: Situation, a: Acting) -> None:
    """By k P/(1 + 0.04 P) of 0.85 of the bones' angle plus 3°, the distal point 0.4 of it."""

    def bent(joint: str) -> float:
        bones = angle_between(s.bones.before[joint] @ ALONG, s.bones.after[joint] @ ALONG)
        return max(0.85 * bones * float(np.sign(s.flexion[JOINTS.index(joint)])) + 0.05, 0.0)

    _flexors_lift(s, bent, lambda load: a.value * load / (1.0 + 0.04 * load), distal=0.4)
