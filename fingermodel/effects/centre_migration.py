"""A joint's centre moves along the bone as the joint flexes (rolling)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
from jax import Array

from fingermodel.effects.places import flexion_joints, flexions
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, one_sided, two_sided
from fingermodel.rows import spread
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class CentreMigration(Effect):
    """Each joint's centre moves along its proximal bone in proportion to flexion, or round that bone's head."""

    name = "centre_migration"
    stage = "geometry"
    title = "a joint rolls, so its centre migrates"
    formula = "x(centre of j) += s_j q_j; or round the head: s_j sin q_j along the bone, s_j (1 - cos q_j) palmar"
    source = "rolling of the joint surfaces; range assumed: 5 mm per rad"
    tell = "all tendons that cross the joint, flexors and extensors"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Travel of each flexion joint's centre [mm/rad], and the roundness of its way: 0 straight, 1 as a head."""
        travel = tuple(two_sided(f"centre_migration.{j.name}", "mm/rad", 5.0) for j in flexion_joints(topology))
        return (*travel, one_sided("centre_migration.roundness", "1", 1.0, 1.5)) if travel else ()

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """Along the bone, or round its head."""
        names = tuple(p.name for p in self.parameters(topology, layout))
        return {self.name: (names[:-1], names)} if names else {}

    def geometry(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Move the centres."""
        topology = state.topology
        if not p.shape[-1]:
            return state
        travel, roundness, angle = p[:-1], p[-1], flexions(topology) @ state.posture
        rows = spread([topology.joints.index(j) for j in flexion_joints(topology)], len(topology.joints))
        proximal = travel * (angle + roundness * (jnp.sin(angle) - angle))
        palmar = travel * roundness * (1.0 - jnp.cos(angle))
        moved = jnp.stack([proximal, -palmar, jnp.zeros_like(palmar)], axis=-1)
        return state._replace(values=state.values._replace(centre=state.values.centre + rows.T @ moved))
