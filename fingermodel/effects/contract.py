"""What every effect must keep, whoever wrote it, and how to find out: for any finger, without its numbers."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from daq.errors import InputError
from fingermodel.compiled.programs import UNOPTIMISED
from fingermodel.effects.contract_cases import states_before
from fingermodel.effects.formula import is_name
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter
from fingermodel.stages import STAGES, Effect, Layout, LoadCaseInput, State

Floats = NDArray[np.float64]
# Groups of parameters that the anatomy and the budget have taken.
RESERVED = (
    "point",
    "fraction",
    "cell",
    "cell_gain",
    "mount_offset",
    "mounting_rotation",
    "posture_angle",
    "tension_factor",
    "zero",
)


def contract_faults(effect: Effect, topology: Topology, layout: Layout) -> list[str]:
    """Return what an effect breaks of the contract, one line each; nothing where it keeps it.

    Declarations are read, and the effect's one method is run at random load cases of a made-up finger of this topology:
    at the null values it must change nothing, to the last bit; it must have finite values and slopes, there and off
    it; it must trace as array code; and each of its free parameters must change something.

    Args:
        effect: to look at.
        topology: of the finger that it is for.
        layout: of the session.

    Raises:
        ModelError: from an effect that says itself why it cannot act on this finger.
    """
    faults = class_faults(effect)
    if faults:
        return faults
    try:
        declared = effect.parameters(topology, layout)
        faults = [*_parameter_faults(effect, declared), *_variant_faults(effect, declared, topology, layout)]
        return faults or list(_behaviour_faults(effect, declared, topology, layout))
    except InputError:
        raise
    except Exception as fault:  # whatever a user's code may raise
        return [f"effect {effect.name} fails at the {effect.stage} stage ({_said(fault)})"]


def class_faults(effect: Effect) -> list[str]:
    """Return what can be seen without a finger: name, title, source, stage, and which method is overridden."""
    out = []
    kind = type(effect)
    if not is_name(effect.name):
        out.append(f"{kind.__name__}.name is {effect.name!r}; expected a word of letters, digits and _")
    elif effect.name in RESERVED:
        out.append(
            f"effect {effect.name} has the name of a group of parameters; expected none of {', '.join(RESERVED)}"
        )
    for key in ("title", "source"):
        text = getattr(effect, key)
        if not isinstance(text, str) or not text.strip():
            out.append(f"effect {effect.name}: {key} is empty; expected a few plain words")
    acts = [stage for stage in STAGES if getattr(kind, stage) is not getattr(Effect, stage)]
    if effect.stage not in STAGES:
        out.append(f"effect {effect.name}: stage is {effect.stage!r}; expected one of {', '.join(STAGES)}")
    elif acts != [effect.stage]:
        has = ", ".join(acts) or "none"
        out.append(f"effect {effect.name} overrides {has}; expected the method of its stage alone: {effect.stage}")
    if not _hashable(effect):
        out.append(f"effect {effect.name} cannot be hashed; expected a frozen dataclass without arrays or lists")
    return out


def _hashable(effect: Hashable) -> bool:
    try:
        hash(effect)
    except TypeError:
        return False
    return True


def _said(fault: BaseException) -> str:
    first = next(iter(str(fault).strip().splitlines()), "")
    return f"{type(fault).__name__}: {first}" if first else type(fault).__name__


def _parameter_faults(effect: Effect, declared: tuple[Parameter, ...]) -> list[str]:
    out = []
    names = [p.name for p in declared]
    if len(set(names)) != len(names):
        out.append(f"effect {effect.name} declares a parameter twice; expected different names")
    for p in declared:
        if not p.name.startswith(f"{effect.name}.") or p.name == f"{effect.name}.":
            out.append(f"parameter {p.name}; expected a name such as {effect.name}.place")
        if not p.unit.strip():
            out.append(f"parameter {p.name} has no unit; expected mm, deg, N, 1, …")
        if p.kind != "effect":
            out.append(f"parameter {p.name} is of kind {p.kind}; expected effect")
        if not 0.0 <= p.sd < math.inf:
            out.append(f"parameter {p.name} has the prior sd {p.sd}; expected a finite one")
        low, high = p.plausible or (math.nan, math.nan)
        if not -math.inf < p.lower <= low <= p.initial <= high <= p.upper < math.inf or not low < high:
            out.append(
                f"parameter {p.name} has the plausible range {p.plausible} and bounds [{p.lower}, {p.upper}] about "
                f"{p.initial}; expected a range about the null value within finite bounds"
            )
    if declared and not any(p.sd > 0.0 for p in declared):
        out.append(
            f"effect {effect.name} declares only fixed parameters; expected a prior sd above 0, or no parameters"
        )
    return out


def _variant_faults(effect: Effect, declared: tuple[Parameter, ...], topology: Topology, layout: Layout) -> list[str]:
    free, out = {p.name for p in declared if p.sd > 0.0}, []
    found = effect.variants(topology, layout) if declared else {}
    for name, alternatives in found.items():
        out += [
            f"candidate {name} frees {', '.join(chosen) or 'nothing'}; expected declared parameters"
            for chosen in alternatives
            if not chosen or not set(chosen) <= free
        ]
    missed = free - {n for alternatives in found.values() for chosen in alternatives for n in chosen}
    if missed:
        out.append(f"no candidate of {effect.name} frees {', '.join(sorted(missed))}; expected every parameter in one")
    return out


def _behaviour_faults(
    effect: Effect, declared: tuple[Parameter, ...], topology: Topology, layout: Layout
) -> Iterator[str]:
    """Yield what goes wrong at the sampled load cases, the first of each kind."""
    if not declared:
        return
    rng = np.random.default_rng(3)
    sampled = states_before(effect.stage, topology, layout)
    null = np.array([p.initial for p in declared])
    off = [np.array([_off_null(p, rng) for p in declared]) for _ in sampled]
    program = _Program(effect, null, *sampled[0])
    for where, values in (("its null values", [null] * len(sampled)), ("values within its range", off)):
        if not all(program.is_finite(p, case, s, rng) for p, (case, s) in zip(values, sampled, strict=True)):
            yield f"effect {effect.name} has a value or slope that is not finite at {where}; expected finite ones"
    for case, state in sampled:
        if not _same(_leaves(state), program.acted(null, case, state)):
            yield f"effect {effect.name} changes something at its null values; expected nothing, to the last bit"
            break
    for i, parameter in enumerate(declared):
        if parameter.sd > 0.0 and not any(
            program.moves(i, parameter, p, case, s) for p, (case, s) in zip(off, sampled, strict=True)
        ):
            yield f"parameter {parameter.name} changes nothing at any load case tried; expected it to act"
    yield from _flat(effect, declared, topology, layout, program)


def flat_faults(effect: Effect, topology: Topology, layout: Layout) -> list[str]:
    """Return alternatives of an effect that change nothing to first order at their null values, one line each.

    Such a form costs its hypothesis nothing where it does not act, so no evidence could speak against it. An example is
    k (exp(a q) - 1) with both k and a at 0.

    Args:
        effect: to look at.
        topology: of the finger that it is for.
        layout: of the session.
    """
    declared = effect.parameters(topology, layout)
    if not declared:
        return []
    program = _Program(
        effect, np.array([p.initial for p in declared]), *states_before(effect.stage, topology, layout)[0]
    )
    return _flat(effect, declared, topology, layout, program)


def _flat(
    effect: Effect, declared: tuple[Parameter, ...], topology: Topology, layout: Layout, program: _Program
) -> list[str]:
    null, sampled = np.array([p.initial for p in declared]), states_before(effect.stage, topology, layout)
    index = {p.name: i for i, p in enumerate(declared)}

    def acts(name: str) -> bool:
        return any(program.has_slope(index[name], null, case, state) for case, state in sampled)

    return [
        f"effect {effect.name}: at the null values of {', '.join(chosen)} nothing changes to first order; expected one "
        "that acts there at once, such as k in k * (exp(a * q) - 1) with the null of a at 2 and not at 0"
        for alternatives in effect.variants(topology, layout).values()
        for chosen in alternatives
        if not any(acts(name) for name in chosen)
    ]


def _off_null(parameter: Parameter, rng: np.random.Generator) -> float:
    low, high = parameter.plausible or (parameter.lower, parameter.upper)
    return float(rng.uniform(low, high)) if parameter.sd > 0.0 else parameter.initial


def _acted(effect: Effect, p: Array, case: LoadCaseInput, state: State) -> State:
    out: State = getattr(effect, effect.stage)(p, case, state)
    return out


def _leaves(state: State) -> list[Array]:
    """Every number of a state."""
    leaves = jax.tree_util.tree_leaves(state._replace(topology=None))  # type: ignore[arg-type]
    return [jnp.asarray(leaf, float) for leaf in leaves]


def _same(a: list[Array], b: list[Array]) -> bool:
    return len(a) == len(b) and all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


class _Program:
    """An effect compiled for the numbers of load cases, values and slopes; run a few times, so not optimised.

    Args:
        effect: of the program.
        p: (parameters,) any values.
        case: any, and
        state: before the effect; all others have numbers in the same places.
    """

    def __init__(self, effect: Effect, p: Floats, case: LoadCaseInput, state: State) -> None:
        leaves, self._tree = jax.tree_util.tree_flatten(state._replace(topology=None))  # type: ignore[arg-type]
        self._moving = [i for i, leaf in enumerate(leaves) if isinstance(leaf, jax.Array)]

        def act(case: LoadCaseInput, p: Array, numbers: list[Array]) -> list[Array]:
            filled: list[Any] = list(leaves)
            for i, number in zip(self._moving, numbers, strict=True):
                filled[i] = number
            whole = jax.tree_util.tree_unflatten(self._tree, filled)._replace(topology=state.topology)
            return _leaves(_acted(effect, p, case, whole))

        def slope(case: LoadCaseInput, start: tuple[Any, ...], way: tuple[Any, ...]) -> list[Array]:
            value, change = jax.jvp(lambda *x: act(case, *x), start, way)
            return [*value, *change]

        start = (jnp.asarray(p), self._numbers(state))
        self._value = jax.jit(act).lower(case, *start).compile(UNOPTIMISED)
        self._slope = jax.jit(slope).lower(case, start, start).compile(UNOPTIMISED)

    def _numbers(self, state: State) -> list[Array]:
        leaves = jax.tree_util.tree_leaves(state._replace(topology=None))  # type: ignore[arg-type]
        return [leaves[i] for i in self._moving]

    def acted(self, p: Floats, case: LoadCaseInput, state: State) -> list[Array]:
        """Every number of the state after the effect."""
        out: list[Array] = self._value(case, jnp.asarray(p), self._numbers(state))
        return out

    def is_finite(self, p: Floats, case: LoadCaseInput, state: State, rng: np.random.Generator) -> bool:
        """Whether value and slope are, along a random direction of all parameters and of the state's numbers."""
        start = (jnp.asarray(p), self._numbers(state))
        way = jax.tree_util.tree_map(lambda x: rng.normal(size=x.shape), start)
        return all(bool(np.isfinite(np.asarray(x)).all()) for x in self._slope(case, start, way))

    def has_slope(self, index: int, p: Floats, case: LoadCaseInput, state: State) -> bool:
        """Whether one parameter changes anything to first order."""
        numbers = self._numbers(state)
        way = (np.eye(len(p))[index], [np.zeros(n.shape) for n in numbers])
        changed = self._slope(case, (jnp.asarray(p), numbers), way)
        return any(np.asarray(x).any() for x in changed[len(changed) // 2 :])

    def moves(self, index: int, parameter: Parameter, p: Floats, case: LoadCaseInput, state: State) -> bool:
        """Whether one parameter changes anything between the ends of its range."""
        ends = []
        for end in parameter.plausible or (parameter.lower, parameter.upper):
            moved = p.copy()
            moved[index] = end
            ends.append(self.acted(moved, case, state))
        return not _same(*ends)
