"""One tendon's pulley loses more than the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

from jax import Array

from fingermodel.effects.pulleys import of_the_load
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, one_sided, two_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class WornPulley(Effect):
    """Each tendon's pulley may lose a share of its tension of its own; one pulley is one candidate.

    The share may be another for a light load than for a heavy one, as bearings have it.
    """

    name = "worn_pulley"
    stage = "tension"
    title = "one tendon's pulley loses more"
    formula = "T_i *= 1 - w_i; w_i = loss_i, or loss_i (1 + l / (1 + T_i / 2 N))"
    source = "range assumed: 0-35 %, of a worn or misaligned pulley"
    tell = "that tendon alone, in every posture and at both clamps"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """One loss for each tendon [%], and by how much more of it a light load has."""
        losses = tuple(one_sided(f"worn_pulley.{m}", "%", 35.0) for m in topology.muscles)
        return (*losses, two_sided("worn_pulley.light", "1", 1.0))

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """Each pulley alone, with the same share of every load or another of a light one."""
        names = [f"worn_pulley.{m}" for m in topology.muscles]
        return {name: ((name,), (name, "worn_pulley.light")) for name in names}

    def tension(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Take each pulley's loss."""
        loss = 0.01 * p[:-1] * of_the_load(p[-1], state.tension)
        return state._replace(tension=state.tension * (1.0 - loss))
