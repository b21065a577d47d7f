"""A joint's centre moves along the bone as the joint flexes (rolling)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
from jax import Array

from fingermodel.effects.places import flexion_joints, flexions, spread
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, two_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class CentreMigration(Effect):
    """Each joint's centre moves along its proximal bone in proportion to flexion."""

    name = "centre_migration"
    stage = "geometry"
    title = "a joint rolls, so its centre migrates"
    formula = "x(centre of j) += s_j q_j"
    source = "rolling of the joint surfaces; range assumed: 5 mm per rad"
    tell = "all tendons that cross the joint, flexors and extensors"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Travel of each flexion joint's centre [mm/rad]."""
        return tuple(two_sided(f"centre_migration.{j.name}", "mm/rad", 5.0) for j in flexion_joints(topology))

    def geometry(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Move the centres."""
        topology = state.topology
        travel = p * (flexions(topology) @ state.posture)
        rows = spread([topology.joints.index(j) for j in flexion_joints(topology)], len(topology.joints))
        along = jnp.outer(travel @ rows, jnp.array([1.0, 0.0, 0.0]))
        return state._replace(values=state.values._replace(centre=state.values.centre + along))
