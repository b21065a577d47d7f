"""The rig's pulleys pass a common share other than the session's friction factor says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
from jax import Array

from fingermodel.effects.pulleys import of_the_load
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, two_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class RigFriction(Effect):
    """All pulleys pass another share than the friction factor; on unloading, friction holds the weight instead.

    The share may be another for a light load than for a heavy one, as bearings have it.
    """

    name = "rig_friction"
    stage = "tension"
    title = "the pulleys' friction differs from the session's factor"
    formula = "T *= 1 + d on loading, 1 - d on unloading; d = delta, or delta (1 + l / (1 + T / 2 N))"
    source = "Synek et al. 2019, Eq 1: c = 0.79 to 0.91 between specimens; assumed: none to twice that of a light load"
    tell = "all forces scale nearly alike; the balance of tip and bone against the tensions"
    shown_by = "pull a known weight through the pulleys, or read the bone's clamp"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """One relative deviation of the friction factor [%], and by how much more of it a light load has."""
        return two_sided("rig_friction.delta", "%", 20.0), two_sided("rig_friction.light", "1", 1.0, 1.0)

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """The same share of every load, or another of a light one."""
        return {self.name: (("rig_friction.delta",), ("rig_friction.delta", "rig_friction.light"))}

    def tension(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Scale all tensions."""
        sign = jnp.where(case.unloading, -1.0, 1.0)
        share = 0.01 * p[0] * sign * of_the_load(p[1], state.tension)
        return state._replace(tension=state.tension * (1.0 + share))
