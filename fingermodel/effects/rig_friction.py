"""The rig's pulleys pass a common share other than the session's friction factor says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
from jax import Array

from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, two_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class RigFriction(Effect):
    """All pulleys pass another share than the friction factor; on unloading, friction holds the weight instead."""

    name = "rig_friction"
    stage = "tension"
    title = "the pulleys' friction differs from the session's factor"
    formula = "T *= 1 + delta on loading, 1 - delta on unloading"
    source = "Synek et al. 2019, Eq 1: c = 0.79 to 0.91 between specimens"
    tell = "all forces scale alike; the balance of tip and bone against the tensions"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """One relative deviation of the friction factor [%]."""
        return (two_sided("rig_friction.delta", "%", 20.0),)

    def tension(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Scale all tensions."""
        sign = jnp.where(case.unloading, -1.0, 1.0)
        return state._replace(tension=state.tension * (1.0 + 0.01 * p[0] * sign))
