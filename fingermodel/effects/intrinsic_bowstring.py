"""Dissected intrinsic tendons lift towards the palm at the flexed MCP joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
from jax import Array

from fingermodel.effects.places import flexion_of, intrinsics, shifted
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, one_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class IntrinsicBowstring(Effect):
    """RI, UI and LU move palmar at the flexed MCP joint."""

    name = "intrinsic_bowstring"
    stage = "geometry"
    title = "the intrinsics lift palmar at the MCP joint"
    formula = "y(RI, UI, LU at MCP) -= h sin(q_MCP), in flexion"
    source = "interosseous hood cut in dissection; range assumed: 0-10 mm"
    tell = "RI, UI and LU at high MCP flexion"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Lift at 90 deg of MCP flexion [mm]."""
        if not intrinsics(topology) or flexion_of(topology, "MCP") is None:
            return ()
        return (one_sided("intrinsic_bowstring.lift", "mm", 10.0),)

    def geometry(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Move the intrinsics' points."""
        mcp = flexion_of(state.topology, "MCP")
        if not intrinsics(state.topology) or mcp is None:
            return state
        lift = p[0] * jnp.sin(jnp.maximum(state.posture[mcp], 0.0))
        return shifted(state, intrinsics(state.topology), dorsal=-lift)
