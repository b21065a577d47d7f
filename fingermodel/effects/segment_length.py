"""Bones are longer or shorter than the model's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
import numpy as np
from jax import Array

from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, two_sided
from fingermodel.rows import spread
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class SegmentLength(Effect):
    """Each phalanx is scaled along its axis; what is measured from its head moves with it."""

    name = "segment_length"
    stage = "geometry"
    title = "a bone is longer or shorter"
    formula = "length_b *= 1 + s_b"
    source = "geometry; range assumed: 15 % per bone"
    tell = "all tendons, through the lever arms of the tip force"
    shown_by = "measure the bones in an X-ray"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Relative change of each phalanx' length [%]."""
        return tuple(two_sided(f"segment_length.{b}", "%", 15.0) for b in topology.bones[1:])

    def geometry(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Move the next joint, or the load point, and the tendon points at the bone's head."""
        topology, values = state.topology, state.values
        centre, load_point = jnp.asarray(values.centre), jnp.asarray(values.load_point)
        points = jnp.asarray(values.proximal_point)
        for k in range(len(topology.bones) - 1):
            bone = k + 1
            beyond = [i for i, joint in enumerate(topology.joints) if joint.parent == bone]
            if not beyond:
                load_point = load_point * jnp.array([1.0 + 0.01 * p[k], 1.0, 1.0])
                continue
            longer = 0.01 * p[k] * centre[beyond[0]]
            at_head = np.array([float(s.proximal_bone == bone) for s in topology.segments])
            centre = centre + jnp.outer(spread(beyond[:1], len(topology.joints))[0], longer)
            points = points + jnp.outer(at_head, longer)
        changed = values._replace(centre=centre, load_point=load_point, proximal_point=points)
        return state._replace(values=changed)
