"""The tendons leave the metacarpal at an angle to its long axis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
import numpy as np
from jax import Array

from fingermodel.fingers import Topology
from fingermodel.kinematics import turn_about
from fingermodel.parameters import Parameter, one_sided, two_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class SutureAngle(Effect):
    """All sutures pull at an angle to the metacarpal, as its clamp alone feels; they may run together to one eyelet."""

    name = "suture_angle"
    stage = "reading"
    constitutive = False
    title = "the tendons leave the metacarpal at an angle"
    formula = "v = R_z(a) R_y(b) (x - c r) at the bone, r (y, z) where a tendon crosses the first joint"
    source = "geometry; ranges assumed: 12 deg in two planes, an eyelet 100 mm behind the joint or further"
    tell = "bone force only"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Angles in the sagittal plane (about z) and the frontal one (about y) [deg]; how soon they meet [1/m]."""
        if not any(location == "bone" for location, _ in layout.mountings):
            return ()
        return (
            two_sided("suture_angle.sagittal", "deg", 12.0),
            two_sided("suture_angle.frontal", "deg", 12.0),
            one_sided("suture_angle.convergence", "1/m", 10.0),
        )

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """Side by side, or towards one eyelet."""
        names = tuple(p.name for p in self.parameters(topology, layout))
        return {self.name: (names[:2], names)} if names else {}

    def reading(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Turn what the sutures pull on the bone's clamp."""
        assert state.wrench is not None  # noqa: S101 - the stage before has filled it
        if p.shape[0] == 0:
            return state
        angle = jnp.deg2rad(p[:2])
        cosine, sine = jnp.cos(angle), jnp.sin(angle)
        suture = jnp.asarray(state.values.suture)
        pull = state.tension @ suture
        line = suture - 1e-3 * p[2] * _across(state)
        # As a change of direction, which is nothing to the last bit where they run side by side.
        shrunk = jnp.sqrt(jnp.sum(suture * suture, axis=1) / jnp.sum(line * line, axis=1))
        meeting = state.tension @ (shrunk[:, None] * line - suture)
        turned = turn_about(2, cosine[0], sine[0]) @ (turn_about(1, cosine[1], sine[1]) @ (pull + meeting))
        change = jnp.where(case.at_bone & ~case.is_check, turned - pull, 0.0)
        return state._replace(wrench=state.wrench + jnp.concatenate([change, jnp.zeros(3)]))


def _across(state: State) -> Array:
    """(muscles, 3) where each tendon lies across the first bone at the first joint [mm]; zero where it does not."""
    topology = state.topology
    first = topology.joints[0].name
    chosen = np.array([[s.slip == m and s.joint == first for s in topology.segments] for m in topology.muscles])
    return chosen.astype(float) @ state.values.proximal_point * np.array([0.0, 1.0, 1.0])
