"""The cell's axes are turned against the bone's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
from jax import Array

from fingermodel.fingers import Topology
from fingermodel.kinematics import turn_about
from fingermodel.parameters import Parameter, two_sided
from fingermodel.rows import chosen
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class CellRotation(Effect):
    """The cell is turned in its mounting by far more than its certificate allows: all mountings alike, or one."""

    name = "cell_rotation"
    stage = "reading"
    title = "the cell's axes are turned"
    formula = "W = R(a) W, forces and moments"
    source = "geometry; range assumed: 12 deg about three axes"
    tell = "a constant angle, magnitudes right; the moments turn too"
    shown_by = "hang a known weight on the cell in three directions"
    of_each = "mounting"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Rotation vector common to all mountings, then one for each mounting [deg]."""
        places = ["common", *(layout.mounting_name(i) for i in range(len(layout.mountings)))]
        return tuple(two_sided(f"cell_rotation.{place}.{a}", "deg", 12.0) for place in places for a in "xyz")

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """All mountings alike, one of them, or each by itself."""
        common, *each = (
            tuple(f"cell_rotation.{place}.{a}" for a in "xyz")
            for place in ["common", *(layout.mounting_name(i) for i in range(len(layout.mountings)))]
        )
        if len(each) < 2:
            return {self.name: (common,)}
        return {self.name: (common, *each, tuple(name for names in each for name in names))}

    def reading(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Turn the wrench, intrinsic x-y-z."""
        assert state.wrench is not None  # noqa: S101 - the stage before has filled it
        rotations = p.reshape(-1, 3)
        angle = jnp.deg2rad(rotations[0] + chosen(rotations[1:], case.mounting))
        cosine, sine = jnp.cos(angle), jnp.sin(angle)
        both = jnp.stack([state.wrench[:3], state.wrench[3:]], axis=1)
        for axis in (2, 1, 0):
            both = turn_about(axis, cosine[axis], sine[axis]) @ both
        return state._replace(wrench=both.T.reshape(6))
