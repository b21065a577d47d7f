"""The cell's zero wanders with time after the tare."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
from jax import Array

from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, two_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class TareDrift(Effect):
    """The zero drifts, steadily or ever slower; what remains in a case is the drift since its own tare."""

    name = "tare_drift"
    stage = "reading"
    after_mounting = True
    title = "the cell's zero drifts after the tare"
    formula = "F += d (g(t) - g(t_tare)), g(t) = t + t (1 - t) (b + c (1 - 2 t)), t from 0 to 1 over the session"
    source = "thermal drift of a strain-gauge cell; range assumed: 1 N over the session, each axis"
    tell = "follows the clock, not the load"
    shown_by = "tare again before each case"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Drift over the session's length, each axis [N]; how much of it comes early; how much there and back."""
        drift = tuple(two_sided(f"tare_drift.{a}", "N", 1.0) for a in "xyz")
        return (*drift, two_sided("tare_drift.early", "1", 1.0), two_sided("tare_drift.swell", "1", 2.0))

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """Steady, slowing down (a cell that warms up), or with the room's swings besides."""
        names = tuple(p.name for p in self.parameters(topology, layout))
        return {self.name: (names[:3], names[:4], names)}

    def reading(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Add the drift since the tare."""
        assert state.wrench is not None  # noqa: S101 - the stage before has filled it
        # g(t) - g(t_tare), factored by the time between the two.
        t, tare, since = case.elapsed, case.elapsed - case.since_tare, case.since_tare
        early = 1.0 - t - tare
        swell = 1.0 - 3.0 * (t + tare) + 2.0 * (t * t + t * tare + tare * tare)
        between = since * (1.0 + p[3] * early + p[4] * swell)
        return state._replace(wrench=state.wrench + jnp.concatenate([p[:3] * between, jnp.zeros(3)]))
