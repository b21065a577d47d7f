"""The tendons leave the metacarpal at an angle to its long axis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
import numpy as np
from jax import Array

from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, one_sided, two_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class SutureAngle(Effect):
    """All sutures pull at an angle to the metacarpal, as its clamp alone feels.

    They run side by side, or together to one eyelet, or each a little more or less steeply than the others.
    """

    name = "suture_angle"
    stage = "reading"
    title = "the tendons leave the metacarpal at an angle"
    formula = (
        "v = R_z(a) R_y(b) (x - c r) at the bone, r (y, z) where a tendon crosses the first joint; or (1 + e_i) a, b"
    )
    source = (
        "geometry; ranges assumed: 12 deg in two planes, an eyelet 100 mm behind the joint or further, 30 % by tendon"
    )
    tell = "bone force only"
    shown_by = "photograph the sutures against the metacarpal"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Angles in the sagittal plane (about z) and the frontal one (about y) [deg]; how soon they meet [1/m].

        And by how much more of both angles each tendon has.
        """
        if not any(location == "bone" for location, _ in layout.mountings):
            return ()
        return (
            two_sided("suture_angle.sagittal", "deg", 12.0),
            two_sided("suture_angle.frontal", "deg", 12.0),
            one_sided("suture_angle.convergence", "1/m", 10.0),
            *(two_sided(f"suture_angle.{m}", "1", 0.3) for m in topology.muscles),
        )

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """Side by side, towards one eyelet, or each at an angle of its own."""
        names = tuple(p.name for p in self.parameters(topology, layout))
        return {self.name: (names[:2], names[:3], (*names[:2], *names[3:]))} if names else {}

    def reading(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Turn what the sutures pull on the bone's clamp."""
        assert state.wrench is not None  # noqa: S101 - the stage before has filled it
        if p.shape[0] == 0:
            return state
        suture = jnp.asarray(state.values.suture)
        line = suture - 1e-3 * p[2] * _across(state)
        # As changes of direction, which are nothing to the last bit where they run side by side and straight.
        shrunk = jnp.sqrt(jnp.sum(suture * suture, axis=1) / jnp.sum(line * line, axis=1))
        pull = state.tension[:, None] * suture
        x, y, z = (pull + state.tension[:, None] * (shrunk[:, None] * line - suture)).T
        sagittal, frontal = jnp.deg2rad(p[:2])[:, None] * (1.0 + p[3:])
        x, z = x * jnp.cos(frontal) + z * jnp.sin(frontal), z * jnp.cos(frontal) - x * jnp.sin(frontal)
        x, y = x * jnp.cos(sagittal) - y * jnp.sin(sagittal), x * jnp.sin(sagittal) + y * jnp.cos(sagittal)
        turned = jnp.sum(jnp.stack([x, y, z], axis=1) - pull, axis=0)
        change = jnp.where(case.at_bone & ~case.is_check, turned, 0.0)
        return state._replace(wrench=state.wrench + jnp.concatenate([change, jnp.zeros(3)]))


def _across(state: State) -> Array:
    """(muscles, 3) where each tendon lies across the first bone at the first joint [mm]; zero where it does not."""
    topology = state.topology
    first = topology.joints[0].name
    chosen = np.array([[s.slip == m and s.joint == first for s in topology.segments] for m in topology.muscles])
    return chosen.astype(float) @ state.values.proximal_point * np.array([0.0, 1.0, 1.0])
