"""Adhesion passes part of one flexor's tension to the other, distal to the MCP joint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

from jax import Array

from fingermodel.effects.places import at, beyond, flexors
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, one_sided
from fingermodel.rows import spread
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class FdpFdsCoupling(Effect):
    """Beyond the MCP joint, a share of FDP's tension pulls on FDS instead, and the other way round."""

    name = "fdp_fds_coupling"
    stage = "sharing"
    title = "adhesion couples FDP and FDS"
    formula = "T_FDS += kappa T_FDP - kappa_r T_FDS, T_FDP the reverse, distal to the MCP; or kappa T / (1 + c kappa T)"
    source = "adhesion after dissection; range assumed: 0-0.3"
    tell = "FDP loads look partly like FDS loads"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Share of FDP that passes to FDS, of FDS that passes to FDP; how soon the adhesion yields [1/N]."""
        if not {"FDP", "FDS"} <= set(flexors(topology)):
            return ()
        return (
            one_sided("fdp_fds_coupling.kappa", "1", 0.3, 0.9),
            one_sided("fdp_fds_coupling.reverse", "1", 0.3, 0.9),
            one_sided("fdp_fds_coupling.yielding", "1/N", 0.2, 1.0),
        )

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """FDP to FDS alone, both ways, or an adhesion that yields."""
        names = tuple(p.name for p in self.parameters(topology, layout))
        return {self.name: (names[:1], names[:2], (names[0], names[2]))} if names else {}

    def sharing(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Pass tension between the flexors' distal segments."""
        topology = state.topology
        if not {"FDP", "FDS"} <= set(flexors(topology)):
            return state
        assert state.segment_tension is not None  # noqa: S101 - the stage before has filled it
        tension = state.segment_tension
        first = topology.joints[0].name
        deep, shallow = beyond(topology, "FDP", first), beyond(topology, "FDS", first)
        # What passes is taken from the tensions that reach the first joint.
        fdp, fds = tension[at(topology, "FDP", first)[0]], tension[at(topology, "FDS", first)[0]]
        passed = p[0] * fdp / (1.0 + p[2] * p[0] * fdp) - p[1] * fds
        gains = spread(shallow, len(topology.segments)).sum(axis=0) - spread(deep, len(topology.segments)).sum(axis=0)
        return state._replace(segment_tension=tension + passed * gains)
