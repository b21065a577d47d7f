"""The lateral bands drop towards the palm as the PIP joint flexes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
from jax import Array

from fingermodel.effects.places import at, flexion_of, shifted
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, one_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class LateralBandSlip(Effect):
    """The bands' points at the PIP joint move palmar with PIP flexion."""

    name = "lateral_band_slip"
    stage = "geometry"
    title = "the lateral bands drop palmar"
    formula = "y(bands at PIP) -= s q_PIP / 90 deg, in flexion"
    source = "bands without their retinacular restraint; range assumed: 0-9 mm at 90 deg"
    tell = "PIP torque of RI, UI, LU and EDC across PIP angles"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Drop at 90 deg of PIP flexion [mm]."""
        if topology.hood is None or flexion_of(topology, "PIP") is None:
            return ()
        return (one_sided("lateral_band_slip.drop", "mm", 9.0),)

    def geometry(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Move the bands' points."""
        topology = state.topology
        pip = flexion_of(topology, "PIP")
        if topology.hood is None or pip is None:
            return state
        bands = at(topology, topology.hood.radial_band, "PIP") + at(topology, topology.hood.ulnar_band, "PIP")
        drop = p[0] * jnp.maximum(state.posture[pip], 0.0) / (0.5 * jnp.pi)
        return shifted(state, bands, dorsal=-drop)
