"""The clamped joints give under torque, so the posture depends on the load."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
from jax import Array

from fingermodel.effects.places import flexion_joints, flexions
from fingermodel.extensor import segment_tensions
from fingermodel.fingers import Topology
from fingermodel.kinematics import joint_poses
from fingermodel.parameters import Parameter, one_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State
from fingermodel.statics import joint_torques
from fingermodel.tendons import joint_pulls


@final
@dataclass(frozen=True)
class ClampCompliance(Effect):
    """Each joint turns in proportion to the torque that the tendons put on it, or by less of a large one."""

    name = "clamp_compliance"
    stage = "geometry"
    title = "the clamp gives under load"
    formula = "q_j += c_j tau_j; or c_j tau_j / (1 + s |tau_j|), of a clamp that stiffens"
    source = "a spring; ranges assumed: 0-3e-3 rad/(N mm) per joint, half as compliant at 100 N mm"
    tell = "forces are not proportional to the load"
    shown_by = "measure the joint angles with the weight on"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Compliance of each flexion joint [rad/N mm], and how it falls with torque, the same for all [1/N mm]."""
        names = [f"clamp_compliance.{j.name}" for j in flexion_joints(topology)]
        gives = tuple(one_sided(name, "rad/N mm", 3e-3) for name in names)
        return (*gives, one_sided("clamp_compliance.stiffening", "1/N mm", 0.01)) if gives else ()

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """A spring, or one that stiffens."""
        names = tuple(p.name for p in self.parameters(topology, layout))
        return {self.name: (names[:-1], names)} if names else {}

    def geometry(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Turn the joints under the torques of the measured posture."""
        topology = state.topology
        if not p.shape[0]:
            return state
        poses = joint_poses(topology, state.values, state.posture)
        pulls = joint_pulls(topology, state.values, poses)
        torque = joint_torques(poses, pulls, segment_tensions(topology, state.values, state.tension, poses))
        give = (p[:-1] @ flexions(topology)) * torque / (1.0 + p[-1] * jnp.abs(torque))
        return state._replace(posture=state.posture + give)
