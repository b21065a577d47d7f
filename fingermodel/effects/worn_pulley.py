"""One tendon's pulley loses more than the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

from jax import Array

from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, one_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class WornPulley(Effect):
    """Each tendon's pulley may lose a share of its tension of its own; one pulley is one candidate."""

    name = "worn_pulley"
    stage = "tension"
    title = "one tendon's pulley loses more"
    formula = "T_i *= 1 - loss_i"
    source = "range assumed: 0-35 %, of a worn or misaligned pulley"
    tell = "that tendon alone, in every posture and at both clamps"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """One loss for each tendon [%]."""
        return tuple(one_sided(f"worn_pulley.{m}", "%", 35.0) for m in topology.muscles)

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """Each pulley alone."""
        names = [f"worn_pulley.{m}" for m in topology.muscles]
        return {name: ((name,),) for name in names}

    def tension(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Take each pulley's loss."""
        return state._replace(tension=state.tension * (1.0 - 0.01 * p))
