"""One tendon's pulley loses more than the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
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
    source = "ranges assumed: 0-35 %, of a worn or misaligned pulley; none to twice that of a light load"
    tell = "that tendon alone, in every posture and at both clamps"
    shown_by = "pull a known weight through that pulley"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """One loss for each tendon [%]; and for each, by how much more of it a light load has."""
        losses = tuple(one_sided(f"worn_pulley.{m}", "%", 35.0) for m in topology.muscles)
        return (*losses, *(two_sided(f"worn_pulley.{m}.light", "1", 1.0, 1.0) for m in topology.muscles))

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """Each pulley alone, with the same share of every load or another of a light one."""
        names = [f"worn_pulley.{m}" for m in topology.muscles]
        return {name: ((name,), (name, f"{name}.light")) for name in names}

    def tension(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Take each pulley's loss."""
        losses, light = p.reshape(2, -1)
        loss = jnp.minimum(0.01 * losses * of_the_load(light, state.tension), 1.0)
        return state._replace(tension=state.tension * (1.0 - loss))
