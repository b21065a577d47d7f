"""A load case on its way from the weights to the cell, and effects: what acts on it at one stage."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tests.simulator.finger import Finger, Floats

# In the order in which they act. `give` comes last of the loop that finds the posture under load.
Stage = Literal["tension", "posture", "geometry", "hood", "sharing", "torque", "give", "reading"]
Size: TypeAlias = float | tuple[float, ...]


@dataclass(frozen=True)
class Case:
    """One load case of a protocol; times are in s since the start of the record.

    Attributes:
        id: unique in its session.
        role: identification or validation.
        posture: its name.
        location: tip or bone.
        masses_g: hung on each tendon [g].
        unloaded_s: window of the tare; loaded_s: of the loaded reading.
        block_start_s: when posture and cell were in place, without load.
        load_start_s: when the weights were hung.
        setting: how often the posture had been set before.
        mounting: how often the cell had been moved before.
    """

    id: str
    role: str
    posture: str
    location: str
    masses_g: Mapping[str, float]
    unloaded_s: tuple[float, float]
    loaded_s: tuple[float, float]
    block_start_s: float
    load_start_s: float
    setting: int = 0
    mounting: int = 0

    @property
    def block(self) -> tuple[str, str, int, int]:
        """Cases of one block share a posture as it was set, and the cell as it was mounted."""
        return self.posture, self.location, self.setting, self.mounting


@dataclass
class Situation:
    """One case while it is computed; effects change it.

    Attributes:
        case: what was set.
        finger: the specimen, this case's own copy: replace arrays, do not write into them.
        angles: (4,) of MCP, abduction, PIP, DIP [rad].
        pull: (6,) tension with which the tendons leave the metacarpal [N].
        hung: (6,) 1 where a weight hangs on the tendon, else 0.
        newton_per_gram: tension of a hung gram, by the session's friction factor.
        end_s: length of the record [s].
        torque_before: (4,) joint torques of the case before in this block, zero where it is the first [N mm].
        tension: (segments,) [N], from stage `sharing` on.
        torque: (4,) about the rotations [N mm], from stage `torque` on.
        give: (4,) by which the posture yields to the load [rad].
        wrench: (6,) reading [N, N mm], at stage `reading`.
    """

    case: Case
    finger: Finger
    angles: Floats
    pull: Floats
    hung: Floats
    newton_per_gram: float
    end_s: float
    torque_before: Floats
    tension: Floats
    torque: Floats
    give: Floats
    wrench: Floats

    @property
    def middle_s(self) -> float:
        """Middle of the loaded window."""
        return 0.5 * (self.case.loaded_s[0] + self.case.loaded_s[1])

    def move(self, points: NDArray[np.bool_], by: Floats, ends: str = "both") -> None:
        """Move the chosen segments' points by (3,) or (segments, 3) [mm], in their bones' axes."""
        shift = points[:, None] * by
        if ends in ("both", "proximal"):
            self.finger.proximal = self.finger.proximal + shift
        if ends in ("both", "distal"):
            self.finger.distal = self.finger.distal + shift


# Situation, size by place, and eight numbers in ±1 that are the specimen's own and that no size tells.
Acts: TypeAlias = Callable[[Situation, Floats, Floats], None]
# Times (n,), length of the record, size, the specimen's own numbers; gives forces (n, 3) that add to the reading.
Wanders: TypeAlias = Callable[[Floats, float, Floats, Floats], Floats]


@dataclass(frozen=True)
class Effect:
    """Something that may happen in a rig.

    Attributes:
        name: as the catalogue has it, or our own outside it.
        stage: at which it acts on a case.
        unit: of its size.
        low: of the plausible range, below zero where both signs happen; high: its other end.
        places: names of the components of its size; one empty name where it has but one.
        act: changes a situation.
        wander: adds to the readings by the clock, for what no single case shows.
    """

    name: str
    stage: Stage
    unit: str
    low: float
    high: float
    places: tuple[str, ...]
    act: Acts
    wander: Wanders | None = None


class Registry(dict[str, Effect]):
    """Effects by name, in the order in which they act within a stage."""

    def enter(
        self, stage: Stage, unit: str, low: float, high: float, places: tuple[str, ...] = ("",)
    ) -> Callable[[Acts], Acts]:
        """Enter the function that follows, under its own name."""

        def entered(act: Acts) -> Acts:
            name = getattr(act, "__name__", "")
            self[name] = Effect(name, stage, unit, low, high, places, act)
            return act

        return entered


CATALOGUE = Registry()
OUTSIDE = Registry()


def sizes_of(effects: Mapping[str, Size]) -> dict[str, Floats]:
    """Spread sizes over the places of each effect.

    Args:
        effects: by catalogue name with a value for every place, or by `name.place` with those of the places that have
            this name or begin with it (`goniometer_bias.PIP`, `zero_offset.bone`, `zero_offset.bone.x`).

    Returns:
        Sizes (places,) by catalogue name, zero where nothing was said.
    """
    out: dict[str, Floats] = {}
    for key, value in effects.items():
        name, _, place = key.partition(".")
        if name not in CATALOGUE:
            raise KeyError(f"{name} is not in the catalogue: {', '.join(CATALOGUE)}")
        places = CATALOGUE[name].places
        at = [i for i, p in enumerate(places) if not place or p == place or p.startswith(f"{place}.")]
        values = np.atleast_1d(np.asarray(value, dtype=float))
        if not at or len(values) != len(at):
            raise ValueError(f"{key}: {len(values)} values for {[places[i] for i in at] or list(places)}")
        out.setdefault(name, np.zeros(len(places)))[at] = values
    return out
