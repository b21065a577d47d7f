"""A constant force at one mount that the tare missed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
from jax import Array

from fingermodel.effects.places import locations
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, two_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State


@final
@dataclass(frozen=True)
class ZeroOffset(Effect):
    """The cell reads a constant force at one location beside the load, and at the tip perhaps a constant moment.

    A zero that is the cell's own has no moment that follows from its force; what hangs on the cell has one.
    """

    name = "zero_offset"
    stage = "reading"
    after_mounting = True
    title = "the tare missed a constant force"
    formula = "F += f0 at one mount, Tz += m0 at the tip"
    source = "ranges assumed: 0.8 N an axis, of a tare taken under load; 8 N mm, of that at a lever of 10 mm"
    tell = "does not scale with the load"
    shown_by = "read the unloaded cell before and after, at that mount"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Three components at each location of the cell [N]; the tip's moment about z [N mm]."""
        places = locations(layout)
        forces = tuple(two_sided(f"zero_offset.{place}.{a}", "N", 0.8) for place in places for a in "xyz")
        return (*forces, two_sided("zero_offset.tip.Tz", "N mm", 8.0)) if "tip" in places else forces

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """Each location alone; at the tip without a moment or with one."""
        out = {}
        for place in locations(layout):
            force = tuple(f"zero_offset.{place}.{a}" for a in "xyz")
            alone = (force,)
            out[f"zero_offset.{place}"] = (*alone, (*force, "zero_offset.tip.Tz")) if place == "tip" else alone
        return out

    def remedy(self, candidate: str) -> str:
        """Say that the mount of a candidate is to be tared again."""
        place = candidate.removeprefix(self.name).strip(".").partition(".")[0]
        return f"tare the {place} mount again" if place else self.shown_by

    def reading(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Add the constant."""
        assert state.wrench is not None  # noqa: S101 - the stage before has filled it
        count = p.shape[0] // 3
        offsets, moments = p[: 3 * count].reshape(-1, 3), p[3 * count :]
        offset = offsets[0] if count == 1 else jnp.where(case.at_bone, offsets[1], offsets[0])
        moment = jnp.where(case.at_bone, 0.0, moments[0]) if moments.shape[0] else 0.0
        torque = jnp.zeros(3).at[2].set(moment)
        return state._replace(wrench=state.wrench + jnp.concatenate([offset, torque]))
