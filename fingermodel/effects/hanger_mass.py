"""The hanger was not weighed, so every loaded tendon carries a little more."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

from jax import Array

from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, one_sided, two_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class HangerMass(Effect):
    """Every loaded tendon carries the unweighed hanger's mass besides; the hangers are alike, or not quite."""

    name = "hanger_mass"
    stage = "tension"
    title = "the hanger was not weighed"
    formula = "T_i += c g m0 wherever a mass hangs; or (1 + e_i) m0"
    source = "weight of an unweighed hanger; ranges assumed: 5-100 g, 20 % by tendon"
    tell = "an intercept of force against mass, the same for all tendons; largest where loads are small (lumbrical)"
    shown_by = "weigh the hangers"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """One mass [g]; and by how much more of it each tendon's hanger has."""
        own = tuple(two_sided(f"hanger_mass.{m}", "1", 0.2) for m in topology.muscles)
        return (one_sided("hanger_mass.m0", "g", 100.0), *own)

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """All hangers alike, or each with a mass of its own."""
        names = tuple(p.name for p in self.parameters(topology, layout))
        return {self.name: (names[:1], names)}

    def tension(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Add the hanger's weight."""
        hung = state.tension > 0.0
        return state._replace(tension=state.tension + p[0] * (1.0 + p[1:]) * case.weight * hung)
