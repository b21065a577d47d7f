"""The clamp holds the tip proximal or distal of the modelled point."""

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
class TipLocation(Effect):
    """The point at which the clamp holds the tip lies elsewhere along the distal phalanx."""

    name = "tip_location"
    stage = "geometry"
    title = "the clamp holds the tip elsewhere"
    formula = "x(load point) += d"
    source = "Synek et al. 2019: mid pulp, 7.5 mm beyond O1; range assumed: 6 mm"
    tell = "tip torque Tz, faintly Fz; invisible in Fx and Fy"
    shown_by = "measure where the clamp holds the pulp"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Distance along the distal phalanx [mm], proximal positive."""
        return (two_sided("tip_location.x", "mm", 6.0),)

    def geometry(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Move the load point."""
        load_point = state.values.load_point + p[0] * jnp.array([1.0, 0.0, 0.0])
        return state._replace(values=state.values._replace(load_point=load_point))
