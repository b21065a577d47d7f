"""A load case on its way from the weights to the cell, and the register of what may act on it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from tests.second_simulator.finger import ALONG, MUSCLES, Bones, Finger, Floats, Line, Segment

# In the order in which they act; from `geometry` to `give` once more for each round of a clamp that gives.
Stage = Literal[
    "mass",
    "tension",
    "posture",
    "geometry",
    "sharing",
    "lift",
    "path",
    "torque",
    "give",
    "clamp",
    "held",
    "cell",
    "zero",
]


@dataclass(frozen=True)
class Case:
    """One load case of a protocol; times in s since the start of the record.

    Attributes:
        id: unique in its session.
        role: identification or validation.
        posture: its name.
        location: tip or bone.
        masses_g: hung on each tendon.
        unloaded_s: window of the tare; loaded_s: of the reading; unloaded_after_s: of a second tare.
        setting: number by which the posture was set, where the protocol counts.
        mounting: number by which the cell was mounted, where the protocol counts.
        repeat_of: an earlier case that this one repeats.
        direction: loading or unloading, where the protocol tells.
        block: number of the tare that it shares with others.
    """

    id: str
    role: str
    posture: str
    location: str
    masses_g: Mapping[str, float]
    unloaded_s: tuple[float, float]
    loaded_s: tuple[float, float]
    unloaded_after_s: tuple[float, float] | None = None
    setting: int | None = None
    mounting: int | None = None
    repeat_of: str | None = None
    direction: str | None = None
    block: int = 0

    @property
    def set_s(self) -> float:
        """When the posture was in place, without load."""
        return self.unloaded_s[0] - 0.4

    @property
    def hung_s(self) -> float:
        """When the weights were hung."""
        return self.loaded_s[0] - 1.6

    @property
    def middle_s(self) -> float:
        """Of the loaded window."""
        return 0.5 * (self.loaded_s[0] + self.loaded_s[1])


@dataclass(frozen=True)
class Acting:
    """An effect that acts, in one of its forms.

    Attributes:
        form: name of the function.
        size: in the effect's unit and shape, one number or one by joint, bone or axis.
        at: where it acts: a tendon, a mount, a posture.
        own: by tendon, posture or case, what else the specimen or rig has of its own.
        further: other numbers of its own.
    """

    form: str
    size: Floats
    at: tuple[str, ...] = ()
    own: Mapping[str, float] = field(default_factory=dict)
    further: Floats = field(default_factory=lambda: np.zeros(1))

    @property
    def value(self) -> float:
        """The size where it is one number."""
        return float(self.size.flat[0])


@dataclass
class Situation:
    """One case while it is computed; effects change it.

    Attributes:
        case: what was set.
        end_s: length of the record.
        caught: whether a weight that touches something does so at this moment.
        masses_g: that really hang.
        pull: tension with which each tendon leaves the metacarpal.
        flexion: (3,) of MCP, PIP, DIP under load.
        abduction: as stated.
        finger: the specimen, this situation's own copy.
        suture: direction in which each tendon leaves the metacarpal.
        tension: by strand.
        torque: (4,) about MCP, abduction, PIP and DIP.
        give: (3,) by which the posture yields.
        turn: (3, 3) from the mount's axes to the clamped bone's, by which the cell is wrong.
        force: on the cell; moment: about its origin.
        bones: where they are, from stage `sharing` on.
        lines: of the strands, from stage `path` on.
    """

    case: Case
    end_s: float
    caught: bool
    masses_g: dict[str, float]
    finger: Finger
    flexion: Floats
    abduction: float
    pull: dict[str, float] = field(default_factory=lambda: dict.fromkeys(MUSCLES, 0.0))
    suture: dict[str, Floats] = field(default_factory=lambda: dict.fromkeys(MUSCLES, ALONG))
    tension: dict[Segment, float] = field(default_factory=dict)
    torque: Floats = field(default_factory=lambda: np.zeros(4))
    give: Floats = field(default_factory=lambda: np.zeros(3))
    turn: Floats = field(default_factory=lambda: np.eye(3))
    force: Floats = field(default_factory=lambda: np.zeros(3))
    moment: Floats = field(default_factory=lambda: np.zeros(3))
    bones: Bones = field(init=False)
    lines: dict[Segment, Line] = field(init=False)

    @property
    def unloading(self) -> bool:
        """Whether weights had been taken off before the reading."""
        return self.case.direction == "unloading"


Acts: TypeAlias = Callable[[Situation, Acting], None]
# Time as a share of the record, to the share of the whole drift.
Drifts: TypeAlias = Callable[[Floats], Floats]

# Names of the forms by effect, in the order in which they are drawn from.
FORMS: dict[str, list[str]] = {}
DRIFTS: dict[str, Drifts] = {}
_ACTS: dict[Stage, dict[tuple[str, str], Acts]] = {}


def form(effect: str, stage: Stage) -> Callable[[Acts], Acts]:
    """Enter the function that follows as one form of the effect; within a stage they act as they were entered."""

    def entered(act: Acts) -> Acts:
        name = getattr(act, "__name__", "")
        FORMS.setdefault(effect, []).append(name)
        _ACTS.setdefault(stage, {})[effect, name] = act
        return act

    return entered


def drift(effect: str) -> Callable[[Drifts], Drifts]:
    """Enter the function that follows as one form of an effect that only the clock shows."""

    def entered(wanders: Drifts) -> Drifts:
        name = getattr(wanders, "__name__", "")
        FORMS.setdefault(effect, []).append(name)
        DRIFTS[name] = wanders
        return wanders

    return entered


def act(stage: Stage, s: Situation, acting: Mapping[str, Acting]) -> None:
    """Let everything act that belongs to this stage."""
    for (effect, name), acts in _ACTS.get(stage, {}).items():
        if effect in acting and acting[effect].form == name:
            acts(s, acting[effect])
