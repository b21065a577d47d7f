"""A share of each joint's torque is lost to the soft tissue, and perhaps a little that does not grow with the load."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
import numpy as np
from jax import Array

from fingermodel.effects.places import flexion_joints, flexions
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, one_sided
from fingermodel.rows import spread
from fingermodel.stages import Effect, Layout, LoadCaseInput, State

# Torque [N mm] from which the preload rubs in full; a joint that carries nothing loses nothing.
PRELOADED = 5.0


@final
@dataclass(frozen=True)
class JointFriction(Effect):
    """A share of each joint's torque does not reach the clamp: of its flexion, and perhaps of its other rotations.

    Tissue that is pressed on already rubs before any load does: a preload, the same for all joints, is one alternative.
    """

    name = "joint_friction"
    stage = "torque"
    title = "soft tissue takes a share of a joint's torque"
    formula = "tau_j -= f_j tau_j; or f_j (tau_j + c tanh(tau_j / c0)), c a preload"
    source = (
        "soft tissue beside a yielding clamp; true cartilage friction is 1-3 % with hysteresis; range assumed: 0-30 %"
    )
    tell = "torque, not tension: the balance of tip and bone holds"
    shown_by = "read the bone's clamp as well"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Share lost at each flexion joint [%], then at each other rotation, and the tissue's preload [N mm]."""
        names = [j.name for j in flexion_joints(topology)] + _others(topology)
        shares = tuple(one_sided(f"joint_friction.{name}", "%", 30.0) for name in names)
        return (*shares, one_sided("joint_friction.preload", "N mm", 10.0)) if shares else ()

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """In flexion alone, with a preload, or in every rotation."""
        names = tuple(p.name for p in self.parameters(topology, layout))
        if not names:
            return {}
        flexing = names[: len(flexion_joints(topology))]
        return {self.name: tuple(dict.fromkeys((flexing, (*flexing, names[-1]), names[:-1], names)))}

    def torque(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Take the shares."""
        assert state.torque is not None  # noqa: S101 - the stage before has filled it
        topology = state.topology
        rows = [topology.rotations.index(name) for name in _others(topology)]
        places = np.concatenate([flexions(topology), spread(rows, len(topology.rotations))])
        rubbing = state.torque + p[-1] * jnp.tanh(state.torque / PRELOADED)
        return state._replace(torque=state.torque - 0.01 * (p[:-1] @ places) * rubbing)


def _others(topology: Topology) -> list[str]:
    """Rotations that are no joint's flexion."""
    flexing = {j.rotations[j.flexion] for j in flexion_joints(topology)}
    return [name for name in topology.rotations if name not in flexing]
