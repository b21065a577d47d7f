"""A constant share of each joint's torque is lost to the soft tissue."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
from jax import Array

from fingermodel.effects.places import flexion_joints, flexions, spread
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, one_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class JointFriction(Effect):
    """A share of each joint's torque does not reach the clamp: of its flexion, and perhaps of its other rotations."""

    name = "joint_friction"
    stage = "torque"
    title = "soft tissue takes a share of a joint's torque"
    formula = "tau_j *= 1 - f_j"
    source = (
        "soft tissue beside a yielding clamp; true cartilage friction is 1-3 % with hysteresis; range assumed: 0-30 %"
    )
    tell = "torque, not tension: the balance of tip and bone holds"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Share lost at each flexion joint [%], then at each other rotation."""
        names = [j.name for j in flexion_joints(topology)] + _others(topology)
        return tuple(one_sided(f"joint_friction.{name}", "%", 30.0) for name in names)

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """In flexion alone, or in every rotation."""
        names = tuple(p.name for p in self.parameters(topology, layout))
        flexing = names[: len(flexion_joints(topology))]
        return {self.name: (flexing, names) if len(names) > len(flexing) else (names,)} if names else {}

    def torque(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Take the shares."""
        assert state.torque is not None  # noqa: S101 - the stage before has filled it
        topology = state.topology
        rows = [topology.rotations.index(name) for name in _others(topology)]
        places = np.concatenate([flexions(topology), spread(rows, len(topology.rotations))])
        return state._replace(torque=state.torque * (1.0 - 0.01 * p @ places))


def _others(topology: Topology) -> list[str]:
    """Rotations that are no joint's flexion."""
    flexing = {j.rotations[j.flexion] for j in flexion_joints(topology)}
    return [name for name in topology.rotations if name not in flexing]
