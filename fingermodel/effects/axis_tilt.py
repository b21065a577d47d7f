"""The flexion axes are not parallel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
from jax import Array

from fingermodel.effects.places import flexion_joints, flexion_of
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, two_sided
from fingermodel.rows import picked, spread
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class AxisTilt(Effect):
    """Each flexion axis is turned out of the radioulnar direction."""

    name = "axis_tilt"
    stage = "geometry"
    title = "the flexion axes are not parallel"
    formula = "axis_j = R_y(a_j) R_x(b_j) axis_j"
    source = "geometry; range assumed: 15 deg per joint"
    tell = "out-of-plane forces"
    rests_on_clamp_assumption = True

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Two angles of each flexion axis [deg]: in the frontal plane (about y) and along the bone (about x)."""
        joints = flexion_joints(topology)
        return tuple(two_sided(f"axis_tilt.{j.name}.{a}", "deg", 15.0) for a in "yx" for j in joints)

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """In one plane, in the other, or in both."""
        names = tuple(p.name for p in self.parameters(topology, layout))
        half = len(names) // 2
        return {self.name: (names[:half], names[half:], names)}

    def geometry(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Turn the axes."""
        topology, tilted = state.topology, jnp.asarray(state.values.axis)
        joints = flexion_joints(topology)
        # Flexion joints have a rotation each; all are turned at once, which compiles as one.
        rows = [row for joint in joints if (row := flexion_of(topology, joint.name)) is not None]
        angle = jnp.deg2rad(p)
        cosine, sine = jnp.cos(angle), jnp.sin(angle)
        axes, count = picked(tilted, rows), len(joints)
        x, y, z = axes.T
        y, z = cosine[count:] * y - sine[count:] * z, sine[count:] * y + cosine[count:] * z
        x, z = cosine[:count] * x + sine[:count] * z, cosine[:count] * z - sine[:count] * x
        change = jnp.stack([x, y, z], axis=1) - axes
        tilted = tilted + spread(rows, len(topology.rotations)).T @ change
        return state._replace(values=state.values._replace(axis=tilted))
