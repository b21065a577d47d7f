"""Units by their names: how many newtons, newton millimetres, seconds, volts or millimetres a lab's word means.

Pint knows units; labs and instruments glue and hyphenate their names (`Nmm`, `N-m`, `in-lb`, `NewtonMeters`), and say a
mass where they mean its weight (`kg`, `lb`). A unit is never guessed: a word that is not known is none.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any, Literal

Kind = Literal["time", "force", "torque", "voltage", "length"]

_TARGETS: dict[Kind, str] = {"time": "s", "force": "N", "torque": "N*mm", "voltage": "V", "length": "mm"}
# Names that help somebody who has to choose.
COMMON: dict[Kind, tuple[str, ...]] = {
    "time": ("s", "ms", "us", "min"),
    "force": ("N", "mN", "kN", "lbf", "kgf", "gf", "ozf"),
    "torque": ("Nmm", "Nm", "Ncm", "mNm", "lbf-in", "lbf-ft", "ozf-in", "kgf-cm"),
    "voltage": ("V", "mV"),
    "length": ("mm", "cm", "m", "in", "ft"),
}
# Of nearly every file; for these alone Pint is not loaded.
_PLAIN: dict[tuple[Kind, str], float] = {
    ("time", "s"): 1.0, ("time", "ms"): 1e-3, ("force", "N"): 1.0, ("torque", "Nmm"): 1.0, ("torque", "Nm"): 1e3,
    ("voltage", "V"): 1.0,
}  # fmt: skip
_GLUED_FORCE = r"[mcdkM\u00b5\u03bc]?N|lbf|lbs?|ozf?|kgf?|gf?|kp|dyn"
_GLUED_LENGTH = r"mm|cm|m|inch|in|ft"
_GLUED = re.compile(rf"^(?:(?P<f>{_GLUED_FORCE})(?P<l>{_GLUED_LENGTH})|(?P<l2>inch|in|ft)(?P<f2>lbf|lbs?|ozf?))$")
_NAMES = {"kp": "kilopond", "ozf": "force_ounce", "gf": "force_gram", "inch": "inch", "in": "inch"}
# Letters of Russian and Ukrainian units, such as Н·мм.
_CYRILLIC = str.maketrans("НмскгВ", "NmskgV")
_WORDS = re.compile(r"[A-Z]?[a-z\u00b5\u03bc]+|[A-Z]+(?![a-z])|[\u00b5\u03bc][A-Za-z]+")
_PARTS = re.compile(r"[\s_.*\u00b7\u22c5\u00d7-]+")


@lru_cache(maxsize=512)
def factor_of(unit: str, kind: Kind) -> float | None:
    """Return a unit's factor to s, N, N mm, V or mm; None where it is not known or of another kind.

    Args:
        unit: in a lab's words, such as `N-m`, `InchPounds` or `kgf`.
        kind: of the quantity.
    """
    text = unit.strip().strip("[]()").strip().translate(_CYRILLIC)
    plain = _PLAIN.get((kind, _PARTS.sub("", text)))
    if plain is not None:
        return plain
    names = _names(text)
    if not names:
        return None
    import pint

    ureg = _registry()
    try:
        quantity = ureg.Quantity(1.0)
        for name in names:
            quantity = quantity * ureg.Quantity(1.0, name)
        if kind in ("force", "torque") and "[time]" not in quantity.dimensionality:
            # A mass stands for its weight.
            quantity = quantity * ureg.Quantity(9.80665, "m/s**2")
        # Its own rounding off: a pound-force is 4.4482216152605 N exactly.
        return float(f"{quantity.to(_TARGETS[kind]).magnitude:.15g}")
    except (pint.errors.PintError, ValueError, TypeError):
        return None


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=False)


def is_unit(text: str) -> bool:
    """Return whether a word is a unit of any of these kinds."""
    return any(factor_of(text, kind) is not None for kind in _TARGETS)


def _names(text: str) -> list[str]:
    """Return a unit's factors as Pint calls them; none where it is no product of names."""
    if "/" in text or not text or len(text) > 40:
        return []
    glued = _GLUED.match(text)
    if glued:
        parts = [glued["f"] or glued["f2"], glued["l"] or glued["l2"]]
    else:
        parts = [part for word in _PARTS.split(text) if word for part in _known(word)]
    out: list[str] = []
    for part in parts:
        if part.lower() == "force" and out:
            out[-1] = f"{out[-1].removesuffix('s')}_force"
        else:
            out.append(_NAMES.get(part, part))
    # Pint reads whole expressions: only names may get there.
    return out if all(name.replace("_", "").isalpha() and _is_known(name) for name in out) else []


def _is_known(name: str) -> bool:
    try:
        return name in _registry()
    except ValueError:  # of `nan` and `inf`, which are numbers
        return False


def _known(word: str) -> list[str]:
    """Return a word as it is, glued, in lower case, or as the words that capitals begin."""
    if word in _NAMES or not word.isalpha() or (_is_known(word) and not _GLUED.match(word)):
        return [word]
    glued = _GLUED.match(word)
    if glued:
        return [glued["f"] or glued["f2"], glued["l"] or glued["l2"]]
    words = _WORDS.findall(word)
    return [w.lower() for w in words] if "".join(words) == word and len(word) > 3 else [word]
