"""The lateral bands drop towards the palm as the PIP joint flexes."""

from __future__ import annotations

from collections.abc import Mapping
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
    """The bands' points at the PIP joint move palmar with PIP flexion, from its beginning or late."""

    name = "lateral_band_slip"
    stage = "geometry"
    title = "the lateral bands drop palmar"
    formula = (
        "y(bands at PIP) -= s q_PIP / 90 deg, in flexion; or late: s ((1 - l) q_PIP / 90 deg + l (1 - cos(q_PIP)))"
    )
    source = "bands without their retinacular restraint; ranges assumed: 0-9 mm at 90 deg, late by any share"
    tell = "PIP torque of RI, UI, LU and EDC across PIP angles"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Drop at 90 deg of PIP flexion [mm], and how late it comes: 1 where what still holds is slack at first."""
        if topology.hood is None or flexion_of(topology, "PIP") is None:
            return ()
        return one_sided("lateral_band_slip.drop", "mm", 9.0), one_sided("lateral_band_slip.late", "1", 1.0, 1.0)

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """From the beginning, or late."""
        names = tuple(p.name for p in self.parameters(topology, layout))
        return {self.name: (names[:1], names)} if names else {}

    def geometry(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Move the bands' points."""
        topology = state.topology
        pip = flexion_of(topology, "PIP")
        if topology.hood is None or pip is None:
            return state
        bands = at(topology, topology.hood.radial_band, "PIP") + at(topology, topology.hood.ulnar_band, "PIP")
        flexion = jnp.maximum(state.posture[pip], 0.0)
        drop = p[0] * ((1.0 - p[1]) * flexion / (0.5 * jnp.pi) + p[1] * (1.0 - jnp.cos(flexion)))
        return shifted(state, bands, dorsal=-drop)
