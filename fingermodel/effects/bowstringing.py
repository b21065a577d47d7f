"""The flexor tendons lift off the bone under the load that their pulleys carry."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
from jax import Array

from fingermodel.effects.places import at, flexion_of, flexors, shifted
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, one_sided
from fingermodel.rows import spread
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class Bowstringing(Effect):
    """At every bent joint the flexors move palmar under the pulley's load, less and less as the pulley tightens."""

    name = "bowstringing"
    stage = "geometry"
    title = "the flexors bowstring"
    formula = "y(flexors at a joint) -= d / (1 + s d), d = k 2 (T + c T_other) sin(|q|/2)"
    source = "pulley load of a bent cable, 2T sin(theta/2); range assumed: 0-0.8 mm/N"
    tell = "forces curve with the load level; flexed postures"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Lift per newton of load [mm/N]; how soon the pulley tightens [1/mm]; the other flexor's share of its load."""
        if not flexors(topology):
            return ()
        return (
            one_sided("bowstringing.lift", "mm/N", 0.8),
            one_sided("bowstringing.tightening", "1/mm", 0.4),
            one_sided("bowstringing.shared", "1", 0.5, 1.0),
        )

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """In proportion to the load, tightening, or a tightening pulley that both flexors share."""
        names = tuple(p.name for p in self.parameters(topology, layout))
        return {self.name: (names[:1], names[:2], names)} if names else {}

    def geometry(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Lift the flexors' points."""
        topology = state.topology
        pulled = [
            (segment, topology.muscles.index(slip), flexion)
            for slip in flexors(topology)
            for joint in topology.joints
            for segment in at(topology, slip, joint.name)
            if (flexion := flexion_of(topology, joint.name)) is not None
        ]
        if not pulled:
            return state
        segments, muscles, flexions = zip(*pulled, strict=True)
        own = spread(muscles, len(topology.muscles))
        others = spread([topology.muscles.index(m) for m in flexors(topology)], len(topology.muscles)).sum(axis=0) - own
        tension = own @ state.tension + p[2] * (others @ state.tension)
        # The tendon bends either way; the small number rounds off the corner at 0 deg.
        half = jnp.sin(0.5 * (spread(flexions, len(topology.rotations)) @ state.posture))
        lift = p[0] * 2.0 * tension * (jnp.sqrt(half * half + 1e-4) - 1e-2)
        return shifted(state, segments, dorsal=-lift / (1.0 + p[1] * lift))
