"""A constant force at one mount that the tare missed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
from jax import Array

from fingermodel.effects.places import locations
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, two_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class ZeroOffset(Effect):
    """The cell reads a constant force at one location beside the load."""

    name = "zero_offset"
    stage = "reading"
    after_mounting = True
    constitutive = False
    title = "the tare missed a constant force"
    formula = "F += f0 at one mount"
    source = "range assumed: 0.8 N an axis, of a tare taken under load"
    tell = "does not scale with the load"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Three components at each location of the cell [N]."""
        return tuple(two_sided(f"zero_offset.{place}.{a}", "N", 0.8) for place in locations(layout) for a in "xyz")

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """Each location alone."""
        return {
            f"zero_offset.{place}": (tuple(f"zero_offset.{place}.{a}" for a in "xyz"),) for place in locations(layout)
        }

    def reading(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Add the constant."""
        assert state.wrench is not None  # noqa: S101 - the stage before has filled it
        offsets = p.reshape(-1, 3)
        offset = offsets[0] if offsets.shape[0] == 1 else jnp.where(case.at_bone, offsets[1], offsets[0])
        return state._replace(wrench=state.wrench + jnp.concatenate([offset, jnp.zeros(3)]))
