"""A rig with a finger that goes through a protocol, by the physics of either simulator.

It takes effects of the catalogue in its own forms, composed laws, and a scatter from case to case.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeAlias

import numpy as np

from tests.random_worlds.laws import Law
from tests.random_worlds.protocols import Plan, Rng
from tests.second_simulator.situation import Acting as SecondActing
from tests.simulator import CATALOGUE
from tests.simulator.finger import Floats
from tests.simulator.rig import Acting as FirstActing

Part: TypeAlias = FirstActing | SecondActing | Law
NAMES = tuple(CATALOGUE)


class Engine(Protocol):
    """What reads a protocol's cases."""

    plan: Plan

    def drawn(self, name: str, rng: Rng) -> Part:
        """Draw an effect of the catalogue at its largest."""

    def sized(self, part: Part, share: float) -> Part:
        """The same at a share of its size."""

    def read(self, parts: Sequence[Part], passes: Floats | None = None) -> Floats:
        """What the cell reads without noise, drift apart: (cases, 6) [N, N mm].

        Args:
            parts: what acts.
            passes: (cases, 6) by which the tensions of each case differ from case to case.
        """

    def wander(self, parts: Sequence[Part], t_s: Floats) -> Floats:
        """What the clock adds to the readings (n, 6)."""

    def said(self, part: Part) -> tuple[str, dict[str, float]]:
        """Name of what acts and its sizes."""


def loads(engine: Engine, parts: Sequence[Part], passes: Floats | None = None) -> Floats:
    """(cases, 6) as the windows have it, drift included, tare removed."""
    out = engine.read(parts, passes)
    for i, case in enumerate(engine.plan.cases):
        late, early = (engine.wander(parts, np.linspace(*w, 25)) for w in (case.loaded_s, case.unloaded_s))
        out[i] += late.mean(axis=0) - early.mean(axis=0)
    return out
