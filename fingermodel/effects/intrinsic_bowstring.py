"""Dissected intrinsic tendons lift towards the palm at the flexed MCP joint."""

from __future__ import annotations

from collections.abc import Mapping
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
    """RI, UI and LU move palmar at the flexed MCP joint, from the beginning of flexion or late."""

    name = "intrinsic_bowstring"
    stage = "geometry"
    title = "the intrinsics lift palmar at the MCP joint"
    formula = "y(RI, UI, LU at MCP) -= h sin(q_MCP), in flexion; or late: h ((1 - l) sin(q_MCP) + l (1 - cos(q_MCP)))"
    source = "interosseous hood cut in dissection; ranges assumed: 0-10 mm, late by any share"
    tell = "RI, UI and LU at high MCP flexion"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Lift at 90 deg of MCP flexion [mm], and how late it comes: 1 where what still holds is slack at first."""
        if not intrinsics(topology) or flexion_of(topology, "MCP") is None:
            return ()
        return (
            one_sided("intrinsic_bowstring.lift", "mm", 10.0),
            one_sided("intrinsic_bowstring.late", "1", 1.0, 1.0),
        )

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """From the beginning, or late."""
        names = tuple(p.name for p in self.parameters(topology, layout))
        return {self.name: (names[:1], names)} if names else {}

    def geometry(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Move the intrinsics' points."""
        mcp = flexion_of(state.topology, "MCP")
        if not intrinsics(state.topology) or mcp is None:
            return state
        flexion = jnp.maximum(state.posture[mcp], 0.0)
        lift = p[0] * ((1.0 - p[1]) * jnp.sin(flexion) + p[1] * (1.0 - jnp.cos(flexion)))
        return shifted(state, intrinsics(state.topology), dorsal=-lift)
