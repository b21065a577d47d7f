"""A component of the cell leaks into another, and gains differ."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
from jax import Array

from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, two_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class CellCrosstalk(Effect):
    """The cell's forces are mixed by a matrix near the identity."""

    name = "cell_crosstalk"
    stage = "reading"
    after_mounting = True
    title = "the cell's components leak into one another"
    formula = "F = (1 + E) F"
    source = "calibration matrix of a damaged or mismatched cell; range assumed: 10 %"
    tell = "a small component beside a large one; with gain alone, one class with rig_friction"
    shown_by = "hang a known weight on the cell in three directions"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Nine entries of the matrix [%]: `cell_crosstalk.Fx.Fy` is the share of Fy that appears in Fx."""
        axes = ("Fx", "Fy", "Fz")
        return tuple(two_sided(f"cell_crosstalk.{a}.{b}", "%", 10.0) for a in axes for b in axes)

    def reading(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Mix the forces."""
        assert state.wrench is not None  # noqa: S101 - the stage before has filled it
        leak = (0.01 * p.reshape(3, 3)) @ state.wrench[:3]
        return state._replace(wrench=state.wrench + jnp.concatenate([leak, jnp.zeros(3)]))
