"""Effects made of formulas: how a parsed formula acts at its stage.

All formulas of one effect read the state as it was before any of them; they act in their order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from daq.errors import ModelError
from fingermodel.effects.formula_checks import FormulaParameter
from fingermodel.effects.formula_language import AXES, Formula, Target, parse, prefix_of
from fingermodel.effects.formula_tree import near
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter
from fingermodel.stages import Effect, Layout, LoadCaseInput, State

Mask = Array | NDArray[np.float64]


# The catalogue's classes declare title and source once for all; here each instance has its own.
@dataclass(frozen=True, kw_only=True)
class FormulaEffect(Effect):
    """An effect whose form is text. Hashable, equal to another of the same text.

    Attributes:
        name: of the effect.
        title: what happens, in a few plain words.
        source: of the form and the ranges.
        formulas: what it changes, one target each, all of one stage.
        declared: its parameters, by name.
        tell: what gives it away in the data.
        shown_by: instruction for the measurement besides a load case that would show it; empty where none is known.
        alternatives: sets of parameters, any of which may make it up; all together where none are given.
        rests_on_clamp_assumption: whether only out-of-plane forces can support it.
        outside: whether it is known to happen in rigs but is no effect of the catalogue.
        formula: all formulas in one line.
    """

    name: str
    title: str  # type: ignore[misc]
    source: str  # type: ignore[misc]
    formulas: tuple[str, ...]
    declared: tuple[FormulaParameter, ...]
    tell: str = ""  # type: ignore[misc]
    shown_by: str = field(default="", compare=False)  # type: ignore[misc]
    alternatives: tuple[tuple[str, ...], ...] = ()
    rests_on_clamp_assumption: bool = False  # type: ignore[misc]
    outside: bool = field(default=False, compare=False)  # type: ignore[misc]
    formula: str = field(init=False, default="")  # type: ignore[misc]

    def __post_init__(self) -> None:
        object.__setattr__(self, "formula", "; ".join(self.formulas))

    @property
    def parsed(self) -> tuple[Formula, ...]:
        """The formulas, ready to act."""
        return tuple(parse(text, self.name) for text in self.formulas)

    def check(self, topology: Topology) -> None:
        """Refuse a finger that lacks something that a formula names.

        Raises:
            ModelError: what is lacking.
        """
        for formula in self.parsed:
            for written, name, known in formula.places(topology):
                if name not in known:
                    kind = f"one of {', '.join(known)}" if known else "a finger that has some"
                    raise ModelError(
                        f"effect {self.name}: {written} names {name!r}, which this finger does not have",
                        kind,
                        near(name, known),
                    )

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Declare the file's parameters; those that change nothing in this session stay fixed.

        Raises:
            ModelError: a finger that lacks what a formula names.
        """
        self.check(topology)
        acting = self._acting(layout)
        return tuple(p.of(self.name, p.name in acting) for p in self.declared) if acting else ()

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """Any of the file's alternatives."""
        acting = self._acting(layout)
        sets = self.alternatives or (tuple(p.name for p in self.declared),)
        kept = dict.fromkeys(tuple(f"{self.name}.{n}" for n in names if n in acting) for names in sets)
        found = tuple(names for names in kept if names)
        return {self.name: found} if found else {}

    def _acting(self, layout: Layout) -> set[str]:
        """Names of what can change something in a session with these mountings of the cell."""
        places = {"", *(location for location, _ in layout.mountings)}
        return {name for f in self.parsed if f.target.place in places for name in f.names} & {
            p.name for p in self.declared
        }

    def named(self, p: Array, case: LoadCaseInput, state: State) -> dict[str, Array]:
        """What the formulas name, in N, mm, g, s and rad."""
        topology = state.topology
        sources: dict[str, tuple[tuple[str, ...], Array | None]] = {
            "t_": (topology.muscles, state.tension),
            "q_": (topology.rotations, state.posture),
            "tau_": (topology.rotations, state.torque),
        }
        out: dict[str, Array] = {}
        for name in {n: None for f in self.parsed for n in f.names}:
            prefix = prefix_of(name)
            if prefix:
                known, array = sources[prefix]
                assert array is not None  # noqa: S101 - a name of another stage was refused
                out[name] = array[known.index(name.removeprefix(prefix))]
            elif name[:2] in ("F_", "M_") and name[2:] in AXES:
                assert state.wrench is not None  # noqa: S101 - a name of another stage was refused
                out[name] = state.wrench[AXES.index(name[2:]) + 3 * (name[0] == "M")]
            elif name == "pi":
                out[name] = jnp.asarray(math.pi)
            elif name in LoadCaseInput._fields:
                out[name] = jnp.asarray(getattr(case, name), float)
        return out | {d.name: p[i] * d.scale for i, d in enumerate(self.declared)}

    def acted(
        self, arrays: tuple[Array, ...], chosen: Callable[[Target], tuple[Mask | None, ...]], names: dict[str, Array]
    ) -> tuple[Array, ...]:
        """Let every formula act on arrays; `chosen` tells where, with ones among zeros, and None on no place."""
        out = list(arrays)
        for formula in self.parsed:
            value = formula.value(names)
            for i, mask in enumerate(chosen(formula.target)):
                if mask is not None and formula.operator == "+=":
                    out[i] = out[i] + mask * value
                elif mask is not None:
                    out[i] = out[i] * (1.0 + mask * (value - 1.0))
        return tuple(out)
