"""The lumbrical arises from the FDP tendon: its tension unloads FDP distally."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
import numpy as np
from jax import Array

from fingermodel.effects.places import flexors
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, one_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class LumbricalOnFdp(Effect):
    """The lumbrical's tension is taken off FDP distal to its origin, never below slack."""

    name = "lumbrical_on_fdp"
    stage = "sharing"
    title = "the lumbrical pulls on FDP"
    formula = "T_FDP = max(T_FDP - lambda T_LU, 0) at all finger joints"
    source = "anatomy: the lumbrical arises from the FDP tendon; range 0-1"
    tell = "only where LU and FDP are loaded together"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Share of the lumbrical's tension that unloads FDP."""
        if "FDP" not in flexors(topology) or "LU" not in topology.muscles:
            return ()
        return (one_sided("lumbrical_on_fdp.lambda", "1", 1.0),)

    def sharing(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Unload FDP's segments."""
        topology = state.topology
        if "FDP" not in flexors(topology) or "LU" not in topology.muscles:
            return state
        assert state.segment_tension is not None  # noqa: S101 - the stage before has filled it
        tension = state.segment_tension
        deep = np.array([s.slip == "FDP" for s in topology.segments])
        lumbrical = state.tension[topology.muscles.index("LU")]
        # A slack tendon stays slack, and has no slope either.
        left = jnp.where(tension > 0.0, jnp.maximum(tension - p[0] * lumbrical, 0.0), tension)
        return state._replace(segment_tension=jnp.where(deep, left, tension))
