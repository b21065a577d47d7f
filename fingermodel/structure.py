"""What a program is compiled for: a finger's topology and effects, whatever settings and mountings a session has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from fingermodel.compiled.programs import is_ours
from fingermodel.fingers import Topology
from fingermodel.parameters import Parameter, ParameterTable
from fingermodel.stages import Effect, Layout, LoadCaseInput

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Span = tuple[int, int]
Answer = TypeVar("Answer", bound=tuple[object, ...])

# For predictions without a session: one setting, the cell at either end.
ANY_LAYOUT = Layout((("posture", 0),), (("tip", 0), ("bone", 0)))


@dataclass(frozen=True)
class Structure:
    """What the compiler keys on: topology, effects and where their parameters stand.

    Attributes:
        topology: of the finger.
        effects: in the order in which they act.
        slices: of each effect, in a vector that all load cases share; the anatomy is before the first.
        own: of each effect, in a vector that every load case has of its own; by default no effect has any there.
    """

    topology: Topology
    effects: tuple[Effect, ...]
    slices: tuple[Span, ...]
    own: tuple[Span, ...] = ()

    @cached_property
    def _hash(self) -> int:
        return hash((self.topology, self.effects, self.slices, self.own))

    def __hash__(self) -> int:
        """Computed once: every call of a compiled program asks for it."""
        return self._hash

    def parts(self, theta: Array, own: Array | None = None) -> tuple[Array, ...]:
        """Split parameters (…, parameters) into the anatomy's part and each effect's.

        Args:
            theta: that all load cases share.
            own: of one load case.
        """
        first = self.slices[0][0] if self.slices else theta.shape[-1]
        shared = [theta[..., a:b] for a, b in self.slices]
        if own is None:
            return (theta[..., :first], *shared)
        both = zip(shared, self.own, strict=True)
        each = [jnp.concatenate([s, own[..., a:b]], axis=-1) if b > a else s for s, (a, b) in both]
        return (theta[..., :first], *each)

    def has_parameters(self, index: int) -> bool:
        """Whether an effect has any here."""
        return any(b > a for a, b in (self.slices[index], *self.own[index : index + 1]))

    def case_of(self, index: int, case: LoadCaseInput) -> LoadCaseInput:
        """A load case as an effect sees it: its own parameters are those of the only setting and mounting."""
        a, b = self.own[index] if self.own else (0, 0)
        return case._replace(setting=jnp.zeros((), int), mounting=jnp.zeros((), int)) if b > a else case


class Compact:
    """A model's parameters as compiled programs take them: one setting and one mounting to a load case.

    A session of other settings or mountings is no other program. Effects that have parameters `of_each` of them are
    given those of the load case. Others may have some for tip or bone, and have both. An effect of a user's that is not
    `of_each` has what it has in the session: its code may count on that.

    Args:
        topology: of the finger.
        effects: in the order in which they act.
        layout: of the session.
        table: of the session's parameters.
        anatomy: how many of them are the anatomy's.
    """

    def __init__(
        self, topology: Topology, effects: Sequence[Effect], layout: Layout, table: ParameterTable, anatomy: int
    ) -> None:
        self._count = len(table)
        slices, own, count = list[Span](), list[Span](), [anatomy, 0]
        shared: list[tuple[int, float]] = [(i, p.initial) for i, p in enumerate(table.parameters[:anatomy])]
        self._blocks: list[tuple[str, Ints]] = []
        # Whether each of the parts' parameters in a row is a load case's own.
        is_own = [False] * anatomy
        for effect in effects:
            declared = self._declared(effect, topology, layout)
            block = _block(effect, topology, layout)
            common = declared if block is None else declared[: len(declared) - block.shape[1]]
            if block is not None:
                first = table.index[effect.parameters(topology, layout)[0].name]
                self._blocks.append((effect.of_each, first + block))
            shared += [(table.index.get(p.name, -1), p.initial) for p in common]
            sizes = len(common), 0 if block is None else block.shape[1]
            for at, spans, size in zip((0, 1), (slices, own), sizes, strict=True):
                spans.append((count[at], count[at] + size))
                count[at] += size
                is_own += [at == 1] * size
        self.structure = Structure(topology, tuple(effects), tuple(slices), tuple(own))
        self._at = np.array([at for at, _ in shared], dtype=np.intp)
        self._initial = np.array([initial for _, initial in shared])
        self._has = np.flatnonzero(self._at >= 0)
        self._columns = np.flatnonzero(~np.array(is_own))[self._has], np.flatnonzero(is_own)

    @staticmethod
    def _declared(effect: Effect, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """The effect's parameters for one setting and mounting, for both locations, or in the session."""
        if effect.of_each:
            return effect.parameters(topology, _layout_of("", 1))
        return effect.parameters(topology, ANY_LAYOUT if is_ours(effect) else layout)

    def shared(self, theta: Floats) -> Floats:
        """Parameters that all load cases share, from those of the session (parameters,)."""
        out = self._initial.copy()
        out[self._has] = theta[self._at[self._has]]
        return out

    def own_of(self, cases: LoadCaseInput) -> Ints:
        """(cases, own) where the parameters of each load case's setting and mounting stand in the session's."""
        index = {"setting": np.asarray(cases.setting), "mounting": np.asarray(cases.mounting)}
        none = np.zeros((len(index["setting"]), 0), dtype=np.intp)
        return np.concatenate([none, *(block[index[of_each]] for of_each, block in self._blocks)], axis=1)

    def spread(self, slopes: Floats, own: Ints) -> Floats:
        """Slopes (n, parameters) by the session's parameters from those (n, k) by the parts' parameters in a row.

        Args:
            slopes: of a program.
            own: (n, own) of `own_of`, of each slope's load case.
        """
        out, (shared, of_case) = np.zeros((len(slopes), self._count)), self._columns
        out[:, self._at[self._has]] = slopes[:, shared]
        out[np.arange(len(slopes))[:, None], own] = slopes[:, of_case]
        return out


def _block(effect: Effect, topology: Topology, layout: Layout) -> Ints | None:
    """(settings or mountings, own) where an effect's parameters of each of them stand among its own; the last ones."""
    if not effect.of_each:
        return None
    places = len(layout.settings if effect.of_each == "setting" else layout.mountings)
    one, two = (len(effect.parameters(topology, _layout_of(effect.of_each, count))) for count in (1, 2))
    size = two - one
    return one - size + size * np.arange(places)[:, None] + np.arange(size)


def _layout_of(of_each: str, count: int) -> Layout:
    """One setting and one mounting, or so many of one kind."""
    settings, mountings = (count if of_each == kind else 1 for kind in ("setting", "mounting"))
    return Layout(tuple(("posture", k) for k in range(settings)), tuple(("tip", k) for k in range(mountings)))


def in_pieces(count: int, size: int) -> list[Ints]:
    """Rows of so many, one or more, in pieces of one size; the last is filled up with the last row."""
    filled = np.minimum(np.arange(count + -count % size), count - 1)
    return np.split(filled, len(filled) // size)


def joined(answers: Sequence[Answer], count: int) -> Answer:
    """Named tuples of arrays that pieces were answered with as one, without what fills the last one up."""
    whole: Answer = jax.tree.map(lambda *parts: np.concatenate([np.asarray(p) for p in parts])[:count], *answers)
    return whole


@dataclass(frozen=True, eq=False)
class Pieces:
    """Load cases in pieces of the one size for which a program is compiled.

    Attributes:
        cases: of each piece; the last is filled up with its last case.
        own: (size, own) of each piece, as of `Compact.own_of`.
        count: of load cases, without what fills them up.
    """

    cases: tuple[LoadCaseInput, ...]
    own: tuple[Ints, ...]
    count: int

    @classmethod
    def of(cls, compact: Compact, cases: LoadCaseInput, size: int) -> Pieces:
        """Cut load cases, one or more, into pieces."""
        count = len(cases.setting)
        # Left where they are: a program takes in as little in no time, to transfer it takes longer than to predict it.
        columns: list[Any] = [np.asarray(column) for column in cases]
        pieces = [LoadCaseInput(*(c[rows] for c in columns)) for rows in in_pieces(count, size)]
        return cls(tuple(pieces), tuple(compact.own_of(piece) for piece in pieces), count)
