"""A constant share of each joint's torque is lost to the soft tissue."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from jax import Array

from fingermodel.effects.places import flexion_joints, flexions
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, one_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class JointFriction(Effect):
    """A share of each joint's flexion torque does not reach the clamp."""

    name = "joint_friction"
    stage = "torque"
    title = "soft tissue takes a share of a joint's torque"
    formula = "tau_j *= 1 - f_j"
    source = "soft tissue beside a yielding clamp; true cartilage friction is 1-3 % with hysteresis; EFFECTS: 0-30 %"
    tell = "torque, not tension: the balance of tip and bone holds"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Share lost at each flexion joint [%]."""
        return tuple(one_sided(f"joint_friction.{j.name}", "%", 30.0) for j in flexion_joints(topology))

    def torque(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Take the shares."""
        assert state.torque is not None  # noqa: S101 - the stage before has filled it
        return state._replace(torque=state.torque * (1.0 - 0.01 * p @ flexions(state.topology)))
