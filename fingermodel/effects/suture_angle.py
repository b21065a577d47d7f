"""The tendons leave the metacarpal at an angle to its long axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
from jax import Array

from fingermodel.fingers import Topology
from fingermodel.kinematics import turn_about
from fingermodel.parameters import Parameter, two_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class SutureAngle(Effect):
    """All sutures pull at an angle to the metacarpal, which its clamp alone feels."""

    name = "suture_angle"
    stage = "reading"
    constitutive = False
    title = "the tendons leave the metacarpal at an angle"
    formula = "v = R_z(a) R_y(b) x at the bone"
    source = "geometry; range assumed: 12 deg in two planes"
    tell = "bone force only"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Angles of the sutures in the sagittal plane (about z) and the frontal one (about y) [deg]."""
        if not any(location == "bone" for location, _ in layout.mountings):
            return ()
        return (two_sided("suture_angle.sagittal", "deg", 12.0), two_sided("suture_angle.frontal", "deg", 12.0))

    def reading(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Turn what the sutures pull on the bone's clamp."""
        assert state.wrench is not None  # noqa: S101 - the stage before has filled it
        if p.shape[0] == 0:
            return state
        angle = jnp.deg2rad(p)
        cosine, sine = jnp.cos(angle), jnp.sin(angle)
        pull = state.tension @ jnp.asarray(state.values.suture)
        turned = turn_about(2, cosine[0], sine[0]) @ (turn_about(1, cosine[1], sine[1]) @ pull)
        change = jnp.where(case.at_bone & ~case.is_check, turned - pull, 0.0)
        return state._replace(wrench=state.wrench + jnp.concatenate([change, jnp.zeros(3)]))
