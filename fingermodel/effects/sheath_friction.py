"""Capstan loss along the flexor sheath, from the tendon's real path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
from jax import Array

from fingermodel.effects.paths import turned_so_far
from fingermodel.effects.places import flexors, spread
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, one_sided
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
        """One coefficient of friction."""
        if not flexors(topology):
            return ()
        return (one_sided("sheath_friction.mu", "1", 0.2),)

    def sharing(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Reduce the flexors' tensions along their path."""
        if not flexors(state.topology):
            return state
        assert state.segment_tension is not None  # noqa: S101 - the stage before has filled it
        bend = jnp.zeros(len(state.topology.segments))
        for slip in flexors(state.topology):
            turned = turned_so_far(state, slip)
            bend = bend + jnp.stack(list(turned.values())) @ spread(list(turned), len(bend))
        return state._replace(segment_tension=state.segment_tension * jnp.exp(-p[0] * bend))
