"""The extensor hood slides as the fingers flex, so its slips share tension otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import jax.numpy as jnp
import numpy as np
from jax import Array

from fingermodel.effects.places import flexion_of
from fingermodel.extensor import segment_tensions
from fingermodel.fingers import Hood, Topology
from fingermodel.parameters import Parameter, two_sided
from fingermodel.stages import Effect, Layout, LoadCaseInput, State

HALF_FLEXED = np.pi / 4.0


@final
@dataclass(frozen=True)
class HoodShift(Effect):
    """Flexion draws the hood distally, and its slips share tension otherwise.

    As a rule more of the extensor goes to the central slip and of the intrinsics to the bands; or more of all, or less.
    The shift is counted from the half-flexed finger (PIP 45 deg, MCP 0 deg), to which the model's fractions belong, and
    a fraction stays between 0 and 1 however far the hood slides.
    """

    name = "hood_shift"
    stage = "sharing"
    title = "the hood slides with flexion"
    formula = "f_ES += a + b for extensors, a - b for intrinsics; a, b = k_PIP (q_PIP - 45 deg) + k_MCP q_MCP"
    source = "form after the hood of Zancolli 1979, its shift assumed linear; range assumed: 0-1 per rad"
    tell = "RI, UI, LU and EDC across PIP angles"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Change of the fractions per rad of PIP and of MCP flexion, first in opposite directions, then in the same.

        None where the hood has no such fractions.
        """
        if not isinstance(topology.hood, Hood) or flexion_of(topology, "PIP") is None:
            return ()
        names = ("hood_shift.PIP", "hood_shift.MCP", "hood_shift.alike.PIP", "hood_shift.alike.MCP")
        return tuple(two_sided(name, "1/rad", 1.0) for name in names)

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """By the PIP joint alone or by both joints, extensor against intrinsics; by both, all of them alike."""
        names = tuple(p.name for p in self.parameters(topology, layout))
        return {self.name: (names[:1], names[:2], names[2:])} if names else {}

    def sharing(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Share the tensions anew."""
        topology = state.topology
        pip, mcp = flexion_of(topology, "PIP"), flexion_of(topology, "MCP")
        if not isinstance(topology.hood, Hood) or pip is None or mcp is None:
            return state
        sign = np.array([_direction(topology.hood, name) for name in topology.fractions])
        fraction = jnp.asarray(state.values.fraction)
        opposite, alike = p.reshape(2, 2) @ jnp.stack([state.posture[pip] - HALF_FLEXED, state.posture[mcp]])
        moved = jnp.where(sign != 0.0, jnp.clip(fraction + sign * opposite + alike, 0.0, 1.0), fraction)
        values = state.values._replace(fraction=moved)
        return state._replace(values=values, segment_tension=segment_tensions(topology, values, state.tension))


def _direction(hood: Hood, fraction: str) -> float:
    """Which way a fraction goes as the hood slides distally."""
    muscle, _, kind = fraction.partition("_")
    if kind != "ES":
        return 0.0
    return 1.0 if muscle in hood.extensors else -1.0
