"""Capstan loss along the flexor sheath, from the tendon's real path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
import numpy as np
from jax import Array

from fingermodel.effects.paths import turned_so_far
from fingermodel.effects.places import flexors
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, one_sided
from fingermodel.rows import spread
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class SheathFriction(Effect):
    """The flexors lose tension by their sheath's friction wherever their path bends; the bone feels all of it."""

    name = "sheath_friction"
    stage = "sharing"
    title = "the flexor sheath rubs"
    formula = "T_seg *= exp(-mu * beta), beta the total change of direction of the real path up to that joint"
    source = "capstan law; mu after Uchiyama: 0.016 canine, 0.03-0.11 rabbit; range assumed: 0-0.2"
    tell = "flexors only; grows distally and with flexion; bone force keeps the full tension"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """One coefficient of friction; how far the sheath bends the tendon at each joint besides the points [deg]."""
        if not flexors(topology):
            return ()
        return (one_sided("sheath_friction.mu", "1", 0.2), one_sided("sheath_friction.curvature", "deg", 10.0))

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """Along the path through the tendon points, or along a sheath with bends of its own."""
        names = tuple(p.name for p in self.parameters(topology, layout))
        return {self.name: (names[:1], names)} if names else {}

    def sharing(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Reduce the flexors' tensions along their path."""
        if not flexors(state.topology):
            return state
        assert state.segment_tension is not None  # noqa: S101 - the stage before has filled it
        bend = jnp.zeros(len(state.topology.segments))
        for slip in flexors(state.topology):
            segments, turned = turned_so_far(state, slip)
            besides = jnp.deg2rad(p[1]) * np.arange(1.0, len(segments) + 1.0)
            bend = bend + (turned + besides) @ spread(segments, len(bend))
        return state._replace(segment_tension=state.segment_tension * jnp.exp(-p[0] * bend))
