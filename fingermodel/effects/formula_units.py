"""Units of a formula's parameters and names: what they measure, and what one of them is in N, mm, g and s."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from fractions import Fraction

from daq.errors import ModelError

BASES = ("N", "mm", "g", "s")
LIMIT = 60


@dataclass(frozen=True)
class Dimension:
    """Powers of N, mm, g and s; all zero for a number, an angle or a share."""

    powers: tuple[Fraction, Fraction, Fraction, Fraction]

    def __mul__(self, other: Dimension) -> Dimension:
        """Of a product."""
        return _dimension(*(a + b for a, b in zip(self.powers, other.powers, strict=True)))

    def __truediv__(self, other: Dimension) -> Dimension:
        """Of a quotient."""
        return _dimension(*(a - b for a, b in zip(self.powers, other.powers, strict=True)))

    def __pow__(self, exponent: float) -> Dimension:
        """Of a power."""
        return _dimension(*(a * Fraction(exponent).limit_denominator(1000) for a in self.powers))

    def __str__(self) -> str:
        """As `N mm/s`, or `1 (a number, angle or share)`."""
        above = " ".join(_power(base, p) for base, p in zip(BASES, self.powers, strict=True) if p > 0)
        below = " ".join(_power(base, -p) for base, p in zip(BASES, self.powers, strict=True) if p < 0)
        if not above and not below:
            return "1 (a number, angle or share)"
        return f"{above or '1'}/{below}" if below else above


def _dimension(*powers: Fraction) -> Dimension:
    force, length, mass, time = powers
    return Dimension((force, length, mass, time))


def _power(base: str, exponent: Fraction) -> str:
    return base if exponent == 1 else f"{base}^{exponent}"


def _base(name: str) -> Dimension:
    return _dimension(*(Fraction(int(name == base)) for base in BASES))


NUMBER = _dimension(*(Fraction(0) for _ in BASES))
FORCE, LENGTH, MASS, TIME = (_base(name) for name in BASES)
MOMENT = FORCE * LENGTH

# Symbol → what it measures, and how much of N, mm, g, s or rad one of it is.
SYMBOLS: dict[str, tuple[Dimension, float]] = {
    "1": (NUMBER, 1.0),
    "%": (NUMBER, 0.01),
    "rad": (NUMBER, 1.0),
    "deg": (NUMBER, math.pi / 180.0),
    "N": (FORCE, 1.0),
    "mN": (FORCE, 1e-3),
    "mm": (LENGTH, 1.0),
    "um": (LENGTH, 1e-3),
    "cm": (LENGTH, 10.0),
    "m": (LENGTH, 1000.0),
    "g": (MASS, 1.0),
    "kg": (MASS, 1000.0),
    "s": (TIME, 1.0),
    "ms": (TIME, 1e-3),
    "min": (TIME, 60.0),
}
_FACTOR = re.compile(r"(?P<symbol>[A-Za-z]+|%|1)(?:\^?(?P<power>[1-9]))?")


@dataclass(frozen=True)
class Unit:
    """What a unit measures, and its size in N, mm, g, s and rad."""

    dimension: Dimension
    scale: float


def read_unit(text: str, where: str) -> Unit:
    """Read a unit such as `N mm`, `mm/N`, `rad/N mm` (per N mm), `1/rad`, `mm^2` or `%`.

    Everything after the one stroke divides, as in the units of the catalogue.

    Args:
        text: the unit.
        where: names the parameter in errors.

    Raises:
        ModelError: what is not such a unit.
    """
    parts = text.split("/")
    if len(text) > LIMIT or len(parts) > 2:
        raise _not_a_unit(text, where)
    unit = _product(parts[0], text, where)
    if len(parts) == 2:
        below = parts[1].strip()
        if below.startswith("(") and below.endswith(")"):
            below = below[1:-1]
        divisor = _product(below, text, where)
        unit = Unit(unit.dimension / divisor.dimension, unit.scale / divisor.scale)
    return unit


def _product(text: str, whole: str, where: str) -> Unit:
    factors = text.replace("²", "^2").replace("³", "^3").replace("·", " ").replace("*", " ").split()
    if not factors:
        raise _not_a_unit(whole, where)
    dimension, scale = NUMBER, 1.0
    for factor in factors:
        found = _FACTOR.fullmatch(factor)
        if found is None or found["symbol"] not in SYMBOLS:
            raise _not_a_unit(whole, where)
        measures, size = SYMBOLS[found["symbol"]]
        power = int(found["power"] or 1)
        dimension, scale = dimension * measures**power, scale * size**power
    return Unit(dimension, scale)


def _not_a_unit(text: str, where: str) -> ModelError:
    return ModelError(
        f"{where}: {text[:LIMIT]!r} is not a unit",
        "a product of " + ", ".join(SYMBOLS) + ", after a stroke those that divide it",
        "Write for example N mm, mm/N, rad/N mm, 1/rad or %",
    )
