"""Options that may be repeated and name what they set, such as `--bone PP=40.1`: each name once."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Sequence
from typing import TypeVar

from daq.errors import InputError

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")


def once(pairs: Iterable[tuple[K, V]], option: str) -> dict[K, V]:
    """Return values by name; only one could count of two for a name.

    Raises:
        InputError: a name that comes twice.
    """
    out: dict[K, V] = {}
    for name, value in pairs:
        if name in out:
            raise InputError(f"{option} {name} is given twice", "one value for each name")
        out[name] = value
    return out


def pair(entry: str, option: str, expected: str) -> tuple[str, str]:
    """Return the two sides of an entry `NAME=VALUE`.

    Raises:
        InputError: it is of another form; `expected` says which one is meant.
    """
    name, _, value = (part.strip() for part in entry.partition("="))
    if not name or not value:
        raise InputError(f"{option} {entry:.60}", expected)
    return name, value


def numbers(entries: Sequence[str], option: str, expected: str, unit: str = "") -> dict[str, float]:
    """Return numbers by name, from entries such as `PP=40.1`; a unit may stand behind a number.

    Raises:
        InputError: an entry of another form, or a name that comes twice.
    """

    def number(entry: str) -> tuple[str, float]:
        name, text = pair(entry, option, expected)
        try:
            value = float(text.removesuffix(unit))
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise InputError(f"{option} {entry:.60}", expected)
        return name, value

    return once(map(number, entries), option)
