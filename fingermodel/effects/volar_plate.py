"""In hyperextension the palmar plate takes part of an extending torque at the MCP joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from jax import Array

from fingermodel.effects.places import flexion_of
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, one_sided
from fingermodel.rows import spread
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class VolarPlate(Effect):
    """The volar plate carries a share of an extending MCP torque while the joint is hyperextended."""

    name = "volar_plate"
    stage = "torque"
    title = "the volar plate takes part of the extension"
    formula = "tau_MCP *= 1 - s where q_MCP < 0 and tau_MCP < 0"
    source = "one-sided restraint in hyperextension; range: share 0-1"
    tell = "EDC in hyperextension only"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Share that the plate takes."""
        if flexion_of(topology, "MCP") is None:
            return ()
        return (one_sided("volar_plate.share", "1", 1.0, 1.2),)

    def torque(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Take the plate's share."""
        mcp = flexion_of(state.topology, "MCP")
        if mcp is None:
            return state
        assert state.torque is not None  # noqa: S101 - the stage before has filled it
        taut = (state.posture[mcp] < 0.0) & (state.torque[mcp] < 0.0)
        share = p[0] * taut * spread([mcp], len(state.topology.rotations))[0]
        return state._replace(torque=state.torque * (1.0 - share))
