"""An effect of the user from formulas in a YAML file, format `fingertwin-effect/1`.

```yaml
format: fingertwin-effect/1
name: pip_stiffness
title: the extensor stiffens the PIP joint
source: own specimens
formula: torque[PIP] += k * t_EDC * sin(q_PIP)
parameters:
  k: {unit: mm, range: [-5, 5]}
```

The null value of a parameter is 0 unless `null` says otherwise; a range that starts there is one-sided.
"""

from __future__ import annotations

import keyword
import math
import re
from typing import Any, Literal

from pydantic import Field

from daq.documents import Document, validated
from daq.errors import ModelError
from fingermodel.effects.formula_checks import FormulaParameter, require_neutral
from fingermodel.effects.formula_effect import FormulaEffect
from fingermodel.effects.formula_language import CASE, WRENCH, Formula, parse, prefix_of, require_dimensions
from fingermodel.effects.formula_stages import OF_STAGE
from fingermodel.effects.formula_tree import FUNCTIONS
from fingermodel.effects.formula_units import Unit, read_unit

FORMAT = "fingertwin-effect/1"
WANTED = f"a {FORMAT} file"
REMEDY = "See docs/how-to/add-an-effect.md"
MOST_FORMULAS, MOST_PARAMETERS = 16, 12
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,39}")


class _Parameter(Document):
    unit: str | int
    range: tuple[float, float]
    null: float = 0.0
    bounds: tuple[float, float] | None = None
    what: str = ""


class EffectFile(Document):
    """The schema of an effect's file."""

    format: Literal["fingertwin-effect/1"]
    name: str
    title: str = Field(min_length=1, max_length=200)
    source: str = Field(min_length=1, max_length=400)
    formula: str | None = None
    formulas: list[str] | None = None
    parameters: dict[str, _Parameter] = Field(min_length=1, max_length=MOST_PARAMETERS)
    tell: str = Field(default="", max_length=400)
    shown_by: str = Field(default="", max_length=400)
    alternatives: list[list[str]] = Field(default_factory=list, max_length=8)
    rests_on_clamp_assumption: bool = False
    outside: bool = False


def formula_effect(raw: Any, where: str, *, tried: bool = False) -> FormulaEffect:
    """Build an effect from the contents of its file.

    Args:
        raw: contents.
        where: what names the file in errors.
        tried: whether its formulas are known to be neutral at their null, and to have values and slopes elsewhere.

    Raises:
        ModelError: the first fault, in one line.
    """
    document = validated(EffectFile, _with_null(raw), where, WANTED, ModelError, REMEDY)
    if not is_name(document.name):
        raise ModelError(f"{where}: name is {document.name!r}", "a word of letters, digits and _", "Rename the effect")
    for key in ("title", "source"):
        if not getattr(document, key).strip():
            raise ModelError(f"{where}: {key} is empty", "a few plain words")
    formulas = _formulas(document, where)
    units: dict[str, Unit] = {}
    # By name, so that a document whose keys were sorted gives the same effect.
    declared = tuple(_parameter(n, p, units, where) for n, p in sorted(document.parameters.items()))
    for formula in formulas:
        require_dimensions(formula, units, where)
    _require_used(document, formulas, where)
    if not tried:
        require_neutral(formulas, declared, where)
    return OF_STAGE[formulas[0].target.stage](
        name=document.name,
        title=document.title,
        source=document.source,
        formulas=tuple(f.text for f in formulas),
        declared=declared,
        tell=document.tell,
        shown_by=" ".join(document.shown_by.split()),
        alternatives=tuple(tuple(names) for names in document.alternatives),
        rests_on_clamp_assumption=document.rests_on_clamp_assumption,
        outside=document.outside,
    )


def formula_document(effect: FormulaEffect) -> dict[str, Any]:
    """Return the effect as the contents of its file."""
    parameters = {}
    for p in effect.declared:
        entry: dict[str, Any] = {"unit": p.unit, "range": [p.low, p.high], "null": p.null, "bounds": [p.lower, p.upper]}
        parameters[p.name] = entry | ({"what": p.what} if p.what else {})
    document: dict[str, Any] = {
        "format": FORMAT,
        "name": effect.name,
        "title": effect.title,
        "source": effect.source,
        "formulas": list(effect.formulas),
        "parameters": parameters,
    }
    if effect.tell:
        document["tell"] = effect.tell
    if effect.shown_by:
        document["shown_by"] = effect.shown_by
    if effect.alternatives:
        document["alternatives"] = [list(names) for names in effect.alternatives]
    if effect.rests_on_clamp_assumption:
        document["rests_on_clamp_assumption"] = True
    return document


def is_name(text: object) -> bool:
    """Whether a text can name an effect or a parameter."""
    return isinstance(text, str) and _NAME.fullmatch(text) is not None and not keyword.iskeyword(text)


def _with_null(raw: Any) -> Any:
    """Spell the key `null`, which YAML takes for nothing, as a word."""
    if not isinstance(raw, dict) or not isinstance(raw.get("parameters"), dict):
        return raw
    entries = {
        name: {("null" if key is None else key): x for key, x in entry.items()} if isinstance(entry, dict) else entry
        for name, entry in raw["parameters"].items()
    }
    return raw | {"parameters": entries}


def _formulas(document: EffectFile, where: str) -> tuple[Formula, ...]:
    if (document.formula is None) == (document.formulas is None):
        found = "no formula" if document.formula is None else "formula and formulas"
        raise ModelError(f"{where}: {found}", "either formula: or a list formulas:", REMEDY)
    texts = [document.formula] if document.formula is not None else document.formulas or []
    if not 1 <= len(texts) <= MOST_FORMULAS:
        raise ModelError(f"{where}: {len(texts)} formulas", f"1 to {MOST_FORMULAS}")
    formulas = tuple(parse(text, where) for text in texts)
    first = formulas[0].target
    for formula in formulas[1:]:
        if formula.target.stage != first.stage:
            raise ModelError(
                f"{where}: {first} acts at the {first.stage} stage and {formula.target} at the "
                f"{formula.target.stage} stage",
                "formulas of one stage",
                "Make two effects of it",
            )
    return formulas


def _parameter(name: str, entry: _Parameter, units: dict[str, Unit], where: str) -> FormulaParameter:
    """Read one parameter, and enter its unit."""
    place = f"{where}: parameter {name}"
    taken = name in FUNCTIONS or name in CASE or name in WRENCH or bool(prefix_of(name))
    if not is_name(name) or taken:
        raise ModelError(
            f"{where}: parameter {name!r}",
            "a word of letters, digits and _ that is no function, no name of the language, and starts with none of "
            "t_, q_ and tau_",
            "Rename it",
        )
    units[name] = unit = read_unit(str(entry.unit), place)
    (low, high), null = entry.range, entry.null
    if not low <= null < high:
        found = f"{place}: range [{low:g}, {high:g}] and null {null:g}"
        turned = "Turn the sign in the formula" if null == high else "Put the null value into the range"
        raise ModelError(found, "a range that holds the null value, and more above it", turned)
    lower, upper = entry.bounds or (null - 2.0 * (null - low), null + 2.0 * (high - null))
    if not (lower <= low and high <= upper) or (low == null and lower < null):
        raise ModelError(
            f"{place}: bounds [{lower:g}, {upper:g}] about the range [{low:g}, {high:g}]",
            "bounds that enclose the range, and start with it where it starts at the null value",
            "Widen the bounds" if low != null else "Start the bounds at the null value",
        )
    text = " ".join(str(entry.unit).split())
    if not all(math.isfinite(x * unit.scale) for x in (lower, upper)):
        raise ModelError(f"{place}: bounds [{lower:g}, {upper:g}] {text}", "bounds of a reasonable size")
    return FormulaParameter(name, text, unit.scale, null, low, high, lower, upper, entry.what)


def _require_used(document: EffectFile, formulas: tuple[Formula, ...], where: str) -> None:
    """Refuse parameters that no formula names, and alternatives of parameters that there are not."""
    used = {name for formula in formulas for name in formula.names}
    for name in document.parameters:
        if name not in used:
            raise ModelError(f"{where}: no formula names the parameter {name}", "every parameter in use", "Remove it")
    for names in document.alternatives:
        for name in names:
            if name not in document.parameters:
                known = ", ".join(document.parameters)
                raise ModelError(f"{where}: alternatives name {name!r}", f"sets of {known}")
        if not names or len(set(names)) != len(names):
            raise ModelError(f"{where}: alternatives hold {names}", "sets of different parameters, none empty")
