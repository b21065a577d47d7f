"""The hanger was not weighed, so every loaded tendon carries a little more."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from jax import Array

from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, one_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class HangerMass(Effect):
    """Every loaded tendon carries the unweighed hanger's mass besides."""

    name = "hanger_mass"
    stage = "tension"
    constitutive = False
    title = "the hanger was not weighed"
    formula = "T_i += c g m0 wherever a mass hangs"
    source = "weight of an unweighed hanger; range assumed: 5-100 g"
    tell = "an intercept of force against mass, the same for all tendons; largest where loads are small (lumbrical)"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """One mass [g]."""
        return (one_sided("hanger_mass.m0", "g", 100.0),)

    def tension(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Add the hanger's weight."""
        hung = state.tension > 0.0
        return state._replace(tension=state.tension + p[0] * case.weight * hung)
