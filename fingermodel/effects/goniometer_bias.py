"""Each joint angle is read wrong by a constant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
from jax import Array

from fingermodel.effects.places import flexion_joints, flexions
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, two_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class GoniometerBias(Effect):
    """Each joint's angle differs from the one read by the same amount in every posture."""

    name = "goniometer_bias"
    stage = "geometry"
    title = "the goniometer reads a joint wrong"
    formula = "q_j += b_j"
    source = "goniometer SEM 2-5 deg; range assumed: 12 deg per joint"
    tell = "directions of all tendons, in all postures"
    shown_by = "measure the joint angles again, with another instrument"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Error of each flexion joint's angle [deg]."""
        return tuple(two_sided(f"goniometer_bias.{j.name}", "deg", 12.0) for j in flexion_joints(topology))

    def geometry(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Correct the posture."""
        return state._replace(posture=state.posture + jnp.deg2rad(p) @ flexions(state.topology))
