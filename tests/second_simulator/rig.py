"""A rig with a specimen in it: the small errors that every rig has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from tests.second_simulator.finger import MUSCLES, TO_CENTRAL_SLIP, Finger, Floats, read_numbers, turning_by
from tests.second_simulator.protocols import Protocol
from tests.second_simulator.situation import Acting

# Of a posture or a mount, with the number of its setting or mounting.
Numbered: TypeAlias = tuple[str, int | None]

_POINT_MM = {"MCP": 1.8, "PIP": 0.6, "DIP": 0.6}
_ZERO_N = {"tip": 0.015, "bone": 0.02}


@dataclass(frozen=True)
class Mounting:
    """How the cell sits in its clamp.

    Attributes:
        turn: (3, 3) from the mount's axes to the cell's.
        zero: (3,) force that the tare missed [N].
        offset: (3,) of the cell's origin from where it is said to be [mm].
    """

    turn: Floats
    zero: Floats
    offset: Floats


@dataclass(frozen=True)
class Rig:
    """Everything that stays as it is during a session.

    Attributes:
        plan: the protocol that it goes through.
        finger: the specimen's own numbers.
        passes: by tendon, what its pulley passes against the session's factor.
        angle_error: (3,) by posture and setting, true less stated [rad].
        mounting: by location and number.
        gain: (6,) by location.
        creep: (3,) of the zero over the session [N].
        acting: effects by name.
    """

    plan: Protocol
    finger: Finger
    passes: Mapping[str, float]
    angle_error: Mapping[Numbered, Floats]
    mounting: Mapping[Numbered, Mounting]
    gain: Mapping[str, Floats]
    creep: Floats
    acting: Mapping[str, Acting]

    def with_only(self, acting: Mapping[str, Acting]) -> Rig:
        """The same rig in which these act instead."""
        return replace(self, acting=acting)


def draw_rig(plan: Protocol, rng: np.random.Generator, budget: float) -> Rig:
    """Draw a specimen and its small errors, `budget` times what a careful laboratory has."""
    finger = read_numbers().copy()
    for (_, joint), strand in finger.strands.items():
        width = budget * _POINT_MM[joint] * np.array([1.0, 1.0, 0.5])
        strand.proximal = strand.proximal + width * rng.standard_normal(3)
        strand.distal = strand.distal + width * rng.standard_normal(3)
    for name in TO_CENTRAL_SLIP:
        stated = finger.fraction[name]
        finger.fraction[name] = float(np.clip(stated + 0.15 * budget * rng.standard_normal(), 0.02, 0.98))
    finger.fraction["RI_EM"] = _within(rng, finger.fraction["RI_EM"], 0.25 * min(budget, 1.0))
    passes = {m: 1.0 + 0.012 * budget * rng.standard_normal() for m in MUSCLES}
    creep = rng.normal(0.0, 0.008, 3) * budget
    angle_error, mounting, gain = _draw_settings(plan, rng, budget)
    return Rig(plan, finger, passes, angle_error, mounting, gain, creep, {})


def _within(rng: np.random.Generator, centre: float, sd: float) -> float:
    """A normal value of a share that is never quite nothing."""
    while True:
        value = float(centre + sd * rng.standard_normal())
        if 0.05 <= value <= 1.0:
            return value


def _draw_settings(
    plan: Protocol, rng: np.random.Generator, budget: float
) -> tuple[dict[Numbered, Floats], dict[Numbered, Mounting], dict[str, Floats]]:
    """Errors of the postures and mountings, in the order in which the cases come to them."""
    degree = np.radians(1.0)
    angles: dict[Numbered, Floats] = {}
    mounting: dict[Numbered, Mounting] = {}
    gain: dict[str, Floats] = {}
    for case in plan.cases:
        stated, where = (case.posture, case.setting), (case.location, case.mounting)
        if (case.posture, None) not in angles:
            angles[case.posture, None] = degree * budget * rng.standard_normal(3)
        if stated not in angles:
            # The goniometer errs alike each time a posture is set; a little is new.
            angles[stated] = 0.95 * angles[case.posture, None] + 0.3 * degree * budget * rng.standard_normal(3)
        if where not in mounting:
            if case.location not in gain:
                gain[case.location] = 1.0 + 0.004 * budget * rng.standard_normal(6)
            mounting[where] = Mounting(
                turn=turning_by(np.radians(0.6) * budget * rng.standard_normal(3)),
                zero=budget * _ZERO_N[case.location] * rng.standard_normal(3),
                offset=2.0 * budget * rng.standard_normal(3),
            )
    return angles, mounting, gain
