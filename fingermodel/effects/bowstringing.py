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
    """At every bent joint the flexors move palmar under the pulley's load, less and less as the pulley tightens.

    In extension they may press on the palmar plate instead, and pulley or insertion may hold them beyond a joint.
    """

    name = "bowstringing"
    stage = "geometry"
    title = "the flexors bowstring"
    formula = "y(flexors at a joint) -= d / (1 + s d), d = k 2 (T + c T_other) sin(|q|/2), (1 - p) d in extension"
    source = "pulley load of a bent cable, 2T sin(theta/2); range assumed: 0-0.8 mm/N"
    tell = "forces curve with the load level; flexed postures"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Lift per newton of load [mm/N]; how soon the pulley tightens [1/mm]; and three shares.

        The shares: of the other flexor's load that the pulley carries; of the lift that is missing in extension, where
        the tendon presses on the joint; and of the lift that is missing at the points beyond a joint.
        """
        if not flexors(topology):
            return ()
        return (
            one_sided("bowstringing.lift", "mm/N", 0.8),
            one_sided("bowstringing.tightening", "1/mm", 0.4),
            one_sided("bowstringing.shared", "1", 0.5, 1.0),
            one_sided("bowstringing.pressed", "1", 1.0, 1.0),
            one_sided("bowstringing.tethered", "1", 1.0, 1.0),
        )

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """In proportion to the load, or tightening; in flexion only; by a pulley that both share; held beyond."""
        names = tuple(p.name for p in self.parameters(topology, layout))
        if not names:
            return {}
        lift, tightening, shared, pressed, tethered = names
        return {
            self.name: (
                (lift,),
                (lift, tightening),
                (lift, tightening, pressed),
                (lift, tightening, shared, pressed),
                (lift, tightening, pressed, tethered),
            )
        }

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
        # The tendon bends either way; the small number rounds off the corner within 0.01 deg of 0.
        half = jnp.sin(0.5 * (spread(flexions, len(topology.rotations)) @ state.posture))
        either = jnp.sqrt(half * half + 1e-8) - 1e-4
        lift = p[0] * 2.0 * tension * ((1.0 - p[3]) * either + p[3] * 0.5 * (half + either))
        lift = lift / (1.0 + p[1] * lift)
        return shifted(state, segments, dorsal=-lift, distal=1.0 - p[4])
