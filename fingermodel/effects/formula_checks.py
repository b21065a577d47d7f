"""What a formula must keep: at the null values it changes nothing, exactly; everywhere it has a value and a slope."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from daq.errors import ModelError
from fingermodel.effects.formula_language import Formula, about, prefix_of
from fingermodel.parameters import Parameter

Floats = NDArray[np.float64]
SAMPLES = 96


@dataclass(frozen=True)
class FormulaParameter:
    """A parameter as the file declares it, in its own unit; `scale` times it is in N, mm, g, s and rad.

    Attributes:
        name: as formulas call it.
        unit: as it is written.
        scale: of one such unit.
        null: value at which it changes nothing.
        low: of its plausible range.
        high: of its plausible range.
        lower: bound.
        upper: bound.
        what: it is, in plain words.
    """

    name: str
    unit: str
    scale: float
    null: float
    low: float
    high: float
    lower: float
    upper: float
    what: str = ""

    def of(self, effect: str, acts: bool) -> Parameter:
        """Declare it for an effect; fixed in a session where it can change nothing."""
        width = 0.5 * (self.high - self.null) if self.low == self.null else 0.25 * (self.high - self.low)
        return Parameter(
            f"{effect}.{self.name}",
            self.unit,
            self.null,
            width if acts else 0.0,
            self.lower,
            self.upper,
            "effect",
            plausible=(self.low, self.high),
        )


def require_neutral(formulas: Sequence[Formula], parameters: Sequence[FormulaParameter], where: str) -> None:
    """Refuse formulas that change something at the null values, or that have no value or slope somewhere.

    Tried at random load cases, unloaded tendons and straight joints among them, at the null values and within the
    bounds. Slopes with respect to tensions, angles and forces count too: errors of the rig are felt through them.

    Raises:
        ModelError: the formula and the place where it fails.
    """
    null = {p.name: np.full(SAMPLES, p.null * p.scale) for p in parameters}
    rng = np.random.default_rng(1)
    inside = {p.name: _within(p, rng) * p.scale for p in parameters}
    for formula in formulas:
        others = {name: _typical(name, rng) for name in formula.names if name not in null}
        try:
            _require(formula, others | {n: v for n, v in null.items() if n in formula.names}, at_null=True)
            _require(formula, others | {n: v for n, v in inside.items() if n in formula.names}, at_null=False)
        except ModelError as fault:
            raise about(formula.text, where, fault) from None


def _within(parameter: FormulaParameter, rng: np.random.Generator) -> Floats:
    """Values across a parameter's bounds, the bounds themselves and the ends of the range among them."""
    ends = [parameter.lower, parameter.upper, parameter.low, parameter.high]
    return np.where(
        rng.random(SAMPLES) < 0.3,
        rng.choice(ends, SAMPLES),
        rng.uniform(parameter.lower, parameter.upper, SAMPLES),
    )


def _typical(name: str, rng: np.random.Generator) -> Floats:
    """Values of a name over load cases [N, mm, rad]; the first is 0, as are many others."""
    prefix = prefix_of(name)
    if name == "pi":
        return np.full(SAMPLES, np.pi)
    if prefix == "t_":
        out = rng.uniform(0.0, 15.0, SAMPLES)
    elif prefix == "q_":
        out = rng.uniform(-0.8, 1.7, SAMPLES)
    elif prefix == "tau_" or name.startswith("M_"):
        out = rng.normal(0.0, 80.0, SAMPLES)
    elif name.startswith("F_"):
        out = rng.normal(0.0, 5.0, SAMPLES)
    elif name == "weight":
        out = np.full(SAMPLES, 0.0083)
    elif name in ("unloading", "at_bone", "is_check"):
        out = np.ones(SAMPLES)
    else:
        out = rng.uniform(0.0, 1.0, SAMPLES)
    out[rng.random(SAMPLES) < 0.35] = 0.0
    out[0] = 0.0
    return out


def _require(formula: Formula, names: dict[str, Floats], at_null: bool) -> None:
    keys = tuple(names)

    def one(row: Array) -> Array:
        return jnp.asarray(formula.value(dict(zip(keys, row, strict=True))), float)

    rows = np.stack([names[k] for k in keys], axis=1) if keys else np.zeros((SAMPLES, 0))
    try:
        found, slope = jax.vmap(jax.value_and_grad(one))(jnp.asarray(rows))
    except (ArithmeticError, ValueError) as fault:
        raise ModelError(f"has no value ({fault})", "a finite number", "Divide by nothing that is 0") from fault
    value, slopes = np.asarray(found), np.asarray(slope)
    at = "the null values" if at_null else "some values within the bounds of its parameters"
    if not np.isfinite(value).all():
        bad = _place(rows, keys, ~np.isfinite(value))
        raise ModelError(f"has no finite value at {at}{bad}", "a finite number everywhere", "Narrow range or bounds")
    neutral = 0.0 if formula.operator == "+=" else 1.0
    if at_null and not (value == neutral).all():
        row = int(np.flatnonzero(value != neutral)[0])
        bad = _place(rows, keys, value != neutral)
        verb = "adds" if formula.operator == "+=" else "multiplies by"
        raise ModelError(
            f"{verb} {value[row]:.6g} at the null values{bad}",
            f"exactly {neutral:g}, for any load case",
            "Give `null:` where it is not 0, or rewrite the formula",
        )
    if not np.isfinite(slopes).all():
        bad = _place(rows, keys, ~np.isfinite(slopes).all(axis=1))
        raise ModelError(
            f"has no finite derivative at {at}{bad}",
            "a slope everywhere, with respect to all it names",
            "Round off the corner: sqrt(x + c) - sqrt(c), say, in place of sqrt(x)",
        )


def _place(rows: Floats, keys: Sequence[str], bad: NDArray[np.bool_]) -> str:
    """`, where q_PIP = 0 and k = 2`: the first row that fails."""
    row = rows[int(np.flatnonzero(bad)[0])]
    said = [f"{key} = {x:.4g}" for key, x in zip(keys, row, strict=True)]
    return f", where {' and '.join(said[:6])}" if said else ""
