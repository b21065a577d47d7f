"""The language of an effect's formulas: `torque[PIP] += k * t_EDC * sin(q_PIP)`.

The left-hand side says what changes, and so at which stage; the right-hand side is a tree (`formula_tree`).
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Literal

from jax import Array

from daq.errors import ModelError
from fingermodel.effects import formula_tree
from fingermodel.effects.formula_tree import FUNCTIONS, near, require_plain
from fingermodel.effects.formula_units import FORCE, LENGTH, MASS, MOMENT, NUMBER, Dimension, Unit
from fingermodel.fingers import Topology
from fingermodel.stages import Stage

LENGTH_LIMIT = 400

# What may stand on the left, at which stage, and what it measures.
TARGETS: dict[str, tuple[Stage, Dimension]] = {
    "tension": ("tension", FORCE),
    "posture": ("geometry", NUMBER),
    "point": ("geometry", LENGTH),
    "segment_tension": ("sharing", FORCE),
    "fraction": ("sharing", NUMBER),
    "torque": ("torque", MOMENT),
    "force": ("reading", FORCE),
    "moment": ("reading", MOMENT),
}
# What a formula may name besides its parameters: of the case, of a muscle or rotation, and at one stage only.
CASE: dict[str, Dimension] = {
    "elapsed": NUMBER,
    "since_tare": NUMBER,
    "unloading": NUMBER,
    "at_bone": NUMBER,
    "is_check": NUMBER,
    "weight": FORCE / MASS,
    "pi": NUMBER,
}
PLACED: dict[str, Dimension] = {"t_": FORCE, "q_": NUMBER, "tau_": MOMENT}
WRENCH: dict[str, Dimension] = {f"{f}_{a}": d for f, d in (("F", FORCE), ("M", MOMENT)) for a in "xyz"}
AXES = ("x", "y", "z")

_LINE = re.compile(
    r"(?P<what>[a-z_]+)(?:\.(?P<place>\w+))? ?\[ ?(?P<name>[\w.]+) ?\](?:\.(?P<axis>\w+))?"
    r" ?(?P<operator>\+=|\*=)(?P<right>[^=].*)"
)
_SHAPE = "`target += expression` or `target *= expression`, such as torque[PIP] += k * t_EDC * sin(q_PIP)"


@dataclass(frozen=True)
class Target:
    """What a formula changes: `place` is tip or bone, `axis` x, y or z, where the target has them."""

    what: str
    name: str
    place: str = ""
    axis: str = ""

    def __str__(self) -> str:
        """As it is written."""
        place, axis = f".{self.place}" * bool(self.place), f".{self.axis}" * bool(self.axis)
        return f"{self.what}{place}[{self.name}]{axis}"

    @property
    def stage(self) -> Stage:
        """At which it is changed."""
        return TARGETS[self.what][0]

    @property
    def dimension(self) -> Dimension:
        """What it measures."""
        return TARGETS[self.what][1]


@dataclass(frozen=True)
class Formula:
    """One parsed line."""

    text: str
    target: Target
    operator: Literal["+=", "*="]
    tree: ast.expr = field(repr=False, compare=False)
    names: tuple[str, ...] = field(repr=False, compare=False)

    def value(self, names: Mapping[str, Array]) -> Any:
        """Evaluate the right-hand side from the names' values, in N, mm, g, s and rad."""
        return formula_tree.value(self.tree, names)

    def places(self, topology: Topology) -> Iterable[tuple[str, str, tuple[str, ...]]]:
        """Yield what the formula asks of a finger: (as written, name, the finger's names of that kind)."""
        kinds = {
            "tension": topology.muscles,
            "posture": topology.rotations,
            "torque": topology.rotations,
            "point": tuple(s.name for s in topology.segments),
            "segment_tension": tuple(s.name for s in topology.segments),
            "fraction": topology.fractions,
        }
        if self.target.what in kinds:
            yield str(self.target), self.target.name, kinds[self.target.what]
        for name in self.names:
            prefix = prefix_of(name)
            if prefix:
                kind = topology.muscles if prefix == "t_" else topology.rotations
                yield name, name.removeprefix(prefix), kind


def prefix_of(name: str) -> str:
    """`t_`, `q_` or `tau_` of a name that belongs to a muscle or rotation; else nothing."""
    return next((p for p in PLACED if name.startswith(p) and name != p), "")


def one_line(text: str) -> str:
    """Return a formula as it is shown: on one line, each run of blanks as one."""
    return " ".join(text.split())


@lru_cache(maxsize=512)
def parse(text: str, where: str) -> Formula:
    """Read one formula; `where` names the file in errors.

    Raises:
        ModelError: anything that is not in the language.
    """
    if len(text) > LENGTH_LIMIT:
        raise ModelError(f"{where}: a formula has {len(text)} characters", f"at most {LENGTH_LIMIT}", "Split it")
    line = one_line(text)
    if not line.isascii() or not line.isprintable():
        raise ModelError(f"{_place(line, where)} is not plain ASCII", "Latin letters, digits and + - * / ( )")
    found = _LINE.fullmatch(line)
    if found is None:
        raise ModelError(f"{_place(line, where)} cannot be read", _SHAPE, "To subtract x write += -x")
    try:
        target = _target(found["what"], found["place"] or "", found["name"], found["axis"] or "")
        tree = ast.parse(found["right"].strip(), mode="eval").body
        names = require_plain(tree)
    except ModelError as fault:
        raise about(line, where, fault) from None
    except (SyntaxError, ValueError, RecursionError, MemoryError) as fault:
        why = str(fault.msg) if isinstance(fault, SyntaxError) else "too deep"
        raise ModelError(f"{_place(line, where)} cannot be read ({why})", "an expression after the sign") from fault
    return Formula(line, target, "+=" if found["operator"] == "+=" else "*=", tree, names)


def _place(line: str, where: str) -> str:
    """Return where a formula stands: in a file, or nowhere else where it was given by itself."""
    itself = f"formula {line!r}"
    return itself if where == itself else f"{where}: {itself}"


def about(line: str, where: str, fault: ModelError) -> ModelError:
    """Return the same fault with the formula's text and file."""
    return ModelError(f"{_place(line, where)} {fault.found}", fault.expected, fault.remedy)


def _target(what: str, place: str, name: str, axis: str) -> Target:
    target = Target(what, name, place, axis)
    if what not in TARGETS:
        raise ModelError(f"changes {what!r}", f"one of {', '.join(TARGETS)}", near(what, TARGETS))
    of_cell = what in ("force", "moment")
    if of_cell and name not in AXES:
        raise ModelError(f"changes {target}", f"{what}[x], {what}[y] or {what}[z]")
    if place not in (("", "tip", "bone") if of_cell else ("",)):
        raise ModelError(f"changes {target}", f"{what}, {what}.tip or {what}.bone" if of_cell else f"{what}[{name}]")
    if axis not in (AXES if what == "point" else ("",)):
        raise ModelError(f"changes {target}", "point[JOINT.SLIP].x, .y or .z" if what == "point" else f"{what}[{name}]")
    return target


def require_dimensions(formula: Formula, units: Mapping[str, Unit], where: str) -> None:
    """Refuse names that the formula's stage does not have, and units that do not go together.

    Args:
        formula: parsed.
        units: of the effect's parameters.
        where: names the file in errors.

    Raises:
        ModelError: one line.
    """
    stage = formula.target.stage
    measures = {name: unit.dimension for name, unit in units.items()} | CASE
    measures |= WRENCH if stage == "reading" else {}
    for name in formula.names:
        prefix = prefix_of(name)
        if prefix and (prefix != "tau_" or stage == "torque"):
            measures[name] = PLACED[prefix]
    try:
        for name in formula.names:
            if name not in measures:
                raise _unknown(name, stage, measures)
        given = formula_tree.dimension(formula.tree, measures)
        wanted = formula.target.dimension if formula.operator == "+=" else NUMBER
        if given not in (None, wanted):
            owner = f"the unit of {formula.target}" if formula.operator == "+=" else "a factor"
            used = [f"{n} is in {d}" for n, d in measures.items() if n in formula.names and n in units]
            remedy = f"Correct the formula; {', '.join(used)}, and an effect file can give another unit" if used else ""
            raise ModelError(f"has a right-hand side in {given}", f"{wanted}, {owner}", remedy)
    except ModelError as fault:
        raise about(formula.text, where, fault) from None


def _unknown(name: str, stage: Stage, measures: Mapping[str, Dimension]) -> ModelError:
    if name in FUNCTIONS:
        return ModelError(f"names {name} without an argument", f"{name}(x)")
    if prefix_of(name) == "tau_" or name in WRENCH:
        own = "torque" if name not in WRENCH else "reading"
        return ModelError(f"names {name} at the {stage} stage", f"{name} at the {own} stage only")
    known = [*measures, "t_MUSCLE", "q_ROTATION"]
    return ModelError(f"names {name!r}, which is nothing", f"one of {', '.join(known)}", near(name, known))
