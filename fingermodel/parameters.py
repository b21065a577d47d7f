"""Parameters of a model: each declared once, all in one flat vector, chosen by which of them are free."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Kind = Literal["anatomy", "budget", "effect"]


@dataclass(frozen=True)
class Parameter:
    """One number that a fit may change.

    Attributes:
        name: `group.place`, such as `point.MCP.RI.proximal.y` or `mounting_rotation.bone#1.x`.
        unit: mm, deg, N, 1, …
        initial: value before fitting, about which the prior stands.
        sd: prior standard deviation; 0 keeps the parameter fixed, inf is a flat prior.
        lower: bound.
        upper: bound.
        kind: anatomy (belongs to the finger), budget (to this session's rig) or effect.
        centre: of the prior, where it is not the initial value.
        plausible: range of an effect's parameter within which a finding is believed; its bounds lie further out.
    """

    name: str
    unit: str
    initial: float
    sd: float
    lower: float = -np.inf
    upper: float = np.inf
    kind: Kind = "anatomy"
    centre: float | None = None
    plausible: tuple[float, float] | None = None

    @property
    def one_sided(self) -> bool:
        """Whether the prior is truncated at its null value."""
        return self.kind == "effect" and self.lower == self.initial

    def __post_init__(self) -> None:
        if not self.lower <= self.initial <= self.upper:
            raise ValueError(f"{self.name}: initial {self.initial} outside [{self.lower}, {self.upper}]")


def with_unit(number: str, unit: str) -> str:
    """A number as text with its unit; what has no dimension (unit 1) has none to be written."""
    return number if unit in ("1", "") else f"{number} {unit}"


def one_sided(name: str, unit: str, maximum: float, bound: float | None = None) -> Parameter:
    """Declare an effect's parameter that is 0 or more: half a normal distribution, half the maximum wide."""
    upper = 2.0 * maximum if bound is None else bound
    return Parameter(name, unit, 0.0, 0.5 * maximum, 0.0, upper, "effect", plausible=(0.0, maximum))


def two_sided(name: str, unit: str, reach: float, bound: float | None = None) -> Parameter:
    """Declare an effect's parameter of either sign: normal about 0, half the reach wide."""
    upper = 2.0 * reach if bound is None else bound
    return Parameter(name, unit, 0.0, 0.5 * reach, -upper, upper, "effect", plausible=(-reach, reach))


class ParameterTable:
    """An ordered set of parameters as arrays, with lookup by name."""

    def __init__(self, parameters: Sequence[Parameter]) -> None:
        self.parameters = tuple(parameters)
        self.names = tuple(p.name for p in parameters)
        self.index = {name: i for i, name in enumerate(self.names)}
        if len(self.index) != len(self.names):
            raise ValueError("two parameters share a name")
        self.initial = np.array([p.initial for p in parameters], dtype=float)
        self.centre = np.array([p.initial if p.centre is None else p.centre for p in parameters], dtype=float)
        self.sd = np.array([p.sd for p in parameters], dtype=float)
        self.lower = np.array([p.lower for p in parameters], dtype=float)
        self.upper = np.array([p.upper for p in parameters], dtype=float)
        self.one_sided = np.array([p.one_sided for p in parameters], dtype=bool)

    def __len__(self) -> int:
        return len(self.parameters)

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self.parameters)

    @property
    def free(self) -> NDArray[np.bool_]:
        """Which parameters a fit may change: those whose prior has any width."""
        free: NDArray[np.bool_] = self.sd > 0.0
        return free

    @property
    def fixed_elsewhere(self) -> list[str]:
        """Sentences on parameters that every fit holds at another value than the finger's file has."""
        fixed = [p for p in self.parameters if p.sd == 0.0 and p.centre not in (None, p.initial)]
        return [f"{p.name} is {p.initial:g} in the finger's file; every fit holds it at {p.centre:g}." for p in fixed]

    def of_kind(self, kind: Kind) -> NDArray[np.bool_]:
        """Which parameters are of a kind."""
        return np.array([p.kind == kind for p in self.parameters], dtype=bool)

    def select(self, *prefixes: str) -> NDArray[np.bool_]:
        """Which parameters' names start with any of the prefixes."""
        return np.array([name.startswith(prefixes) for name in self.names], dtype=bool)
