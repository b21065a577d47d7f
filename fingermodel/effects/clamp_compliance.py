"""The clamped joints give under torque, so the posture depends on the load."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

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
    """Each joint turns in proportion to the torque that the tendons put on it."""

    name = "clamp_compliance"
    stage = "geometry"
    title = "the clamp gives under load"
    formula = "q_j += c_j tau_j"
    source = "linear spring; range assumed: 0-3e-3 rad/(N mm) per joint"
    tell = "forces are not proportional to the load"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Compliance of each flexion joint [rad/N mm]."""
        return tuple(one_sided(f"clamp_compliance.{j.name}", "rad/N mm", 3e-3) for j in flexion_joints(topology))

    def geometry(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Turn the joints under the torques of the measured posture."""
        topology = state.topology
        poses = joint_poses(topology, state.values, state.posture)
        pulls = joint_pulls(topology, state.values, poses)
        torque = joint_torques(poses, pulls, segment_tensions(topology, state.values, state.tension, poses))
        return state._replace(posture=state.posture + (p @ flexions(topology)) * torque)
