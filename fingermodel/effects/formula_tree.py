"""The right-hand side of a formula as a tree: what may stand in it, what it measures, what it is worth.

The tree is Python's own syntax tree, but nothing of it is ever run as Python: it is walked, and array operations are
called in its place.
"""

from __future__ import annotations

import ast
import difflib
import math
from collections.abc import Callable, Iterable, Mapping
from functools import reduce
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from daq.errors import ModelError
from fingermodel.effects.formula_units import NUMBER, Dimension

# A formula is checked in the precision in which the model computes.
jax.config.update("jax_enable_x64", True)

NODE_LIMIT, DEPTH_LIMIT, EXPONENT_LIMIT, NUMBER_LIMIT = 150, 25, 8.0, 1e12


def _pos(x: Any) -> Array:
    return jnp.maximum(x, 0.0)


def _least(*x: Any) -> Any:
    return reduce(jnp.minimum, x)


def _most(*x: Any) -> Any:
    return reduce(jnp.maximum, x)


# Of numbers without unit; the rest keep their argument's unit, or its root.
PURE: dict[str, Callable[..., Any]] = {
    "sin": jnp.sin,
    "cos": jnp.cos,
    "tan": jnp.tan,
    "exp": jnp.exp,
    "log": jnp.log,
    "tanh": jnp.tanh,
}
FUNCTIONS: dict[str, Callable[..., Any]] = {
    **PURE,
    "sqrt": jnp.sqrt,
    "abs": jnp.abs,
    "pos": _pos,
    "min": _least,
    "max": _most,
}
_CONSTRUCTS = {
    ast.Attribute: "an attribute (a dot)",
    ast.Compare: "a comparison",
    ast.BoolOp: "and/or",
    ast.IfExp: "if/else",
    ast.Lambda: "lambda",
    ast.Subscript: "brackets",
    ast.NamedExpr: "an assignment",
    ast.Call: "a call that is not function(x)",
    ast.BinOp: "another operator than + - * / **",
    ast.UnaryOp: "another sign than + or -",
}


def near(word: str, known: Iterable[str]) -> str:
    """`Did you mean …?`, or nothing."""
    spelt = {name.lower(): name for name in known}
    close = difflib.get_close_matches(word.lower(), list(spelt), n=1)
    return f"Did you mean {spelt[close[0]]}?" if close else ""


def require_plain(tree: ast.expr) -> tuple[str, ...]:
    """Refuse what is not on the short list.

    Returns:
        The names in the tree.

    Raises:
        ModelError: about the formula, whose own text is not in it.
    """
    names: dict[str, None] = {}
    left: list[tuple[ast.AST, int]] = [(tree, 0)]
    count = 0
    while left:
        node, depth = left.pop()
        count += 1
        if depth > DEPTH_LIMIT or count > NODE_LIMIT:
            raise ModelError("is too long or too deep", f"{NODE_LIMIT} terms, {DEPTH_LIMIT} deep", "Split it")
        if isinstance(node, ast.Name):
            names[node.id] = None
        left += [(part, depth + 1) for part in reversed(_parts(node))]
    return tuple(names)


def _parts(node: ast.AST) -> list[ast.expr]:
    """Return what a node is made of, if it may stand in a formula."""
    match node:
        case ast.Name():
            return []
        case ast.Constant(value=value):
            _number(value)
            return []
        case ast.UnaryOp(op=ast.USub() | ast.UAdd(), operand=operand):
            return [operand]
        case ast.BinOp(op=ast.Pow(), left=left, right=right):
            _exponent(right)
            return [left]
        case ast.BinOp(op=ast.Add() | ast.Sub() | ast.Mult() | ast.Div(), left=left, right=right):
            return [left, right]
        case ast.Call(func=ast.Name(id=function), args=arguments, keywords=[]):
            if function not in FUNCTIONS:
                raise ModelError(f"calls {function!r}", f"one of {', '.join(FUNCTIONS)}", near(function, FUNCTIONS))
            several = function in ("min", "max")
            if len(arguments) < 2 if several else len(arguments) != 1:
                raise ModelError(f"gives {function} {len(arguments)} argument(s)", "two or more" if several else "one")
            return arguments
    raise ModelError(
        f"holds {_CONSTRUCTS.get(type(node), type(node).__name__)}",
        f"numbers, names, + - * / ** and {', '.join(FUNCTIONS)}",
        "For a condition write pos(x), or 0.5 * (1 + tanh(x / width))" if isinstance(node, ast.Compare) else "",
    )


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ModelError(f"holds {value!r}", "numbers, and names without quotes")
    if not abs(value) <= NUMBER_LIMIT:
        raise ModelError("holds a number that is too large", f"at most {NUMBER_LIMIT:g}")
    return float(value)


def _exponent(node: ast.expr) -> float:
    """Return the exponent of a power: a number, written out."""
    sign = 1.0
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        sign, node = -1.0, node.operand
    if not isinstance(node, ast.Constant):
        raise ModelError("has a power whose exponent is not a number", "such as x ** 2", "Write exp(a * log(x))")
    power = sign * _number(node.value)
    if abs(power) > EXPONENT_LIMIT:
        raise ModelError(f"has the exponent {power:g}", f"one from -{EXPONENT_LIMIT:g} to {EXPONENT_LIMIT:g}")
    return power


def value(node: ast.AST, names: Mapping[str, Array]) -> Any:
    """Evaluate a tree that `require_plain` has let in.

    Raises:
        ArithmeticError, ValueError: from numbers alone, such as 1/0.
    """
    match node:
        case ast.Constant(value=number):
            return _number(number)
        case ast.Name(id=name):
            return names[name]
        case ast.UnaryOp(op=op, operand=operand):
            inner = value(operand, names)
            return -inner if isinstance(op, ast.USub) else inner
        case ast.BinOp(op=ast.Pow(), left=left, right=right):
            base, power = value(left, names), _exponent(right)
            if isinstance(base, float):
                return math.pow(base, power)
            return base ** (int(power) if power == math.floor(power) else power)
        case ast.BinOp(op=op, left=left, right=right):
            a, b = value(left, names), value(right, names)
            match op:
                case ast.Add():
                    return a + b
                case ast.Sub():
                    return a - b
                case ast.Mult():
                    return a * b
                case _:
                    return a / b
        case ast.Call(func=ast.Name(id=function), args=arguments):
            return FUNCTIONS[function](*(value(argument, names) for argument in arguments))
    raise AssertionError(f"{type(node).__name__} was let in")


def dimension(node: ast.AST, measures: Mapping[str, Dimension]) -> Dimension | None:
    """Return what a tree measures; None for a bare 0, which goes with anything.

    Raises:
        ModelError: terms that do not go together; the formula's own text is not in it.
    """

    def of(part: ast.AST) -> Dimension | None:
        return dimension(part, measures)

    match node:
        case ast.Constant(value=number):
            return NUMBER if number else None
        case ast.Name(id=name):
            return measures[name]
        case ast.UnaryOp(operand=operand):
            return of(operand)
        case ast.BinOp(op=ast.Add() | ast.Sub(), left=left, right=right):
            return _common([left, right], [of(left), of(right)])
        case ast.BinOp(op=ast.Pow(), left=left, right=right):
            return (of(left) or NUMBER) ** _exponent(right)
        case ast.BinOp(op=op, left=left, right=right):
            a, b = of(left) or NUMBER, of(right) or NUMBER
            return a * b if isinstance(op, ast.Mult) else a / b
        case ast.Call(func=ast.Name(id=function), args=arguments):
            inner = _common(arguments, [of(argument) for argument in arguments])
            if function in PURE and inner not in (None, NUMBER):
                raise ModelError(
                    f"takes {function} of {ast.unparse(arguments[0])}, which is in {inner}",
                    str(NUMBER),
                    "Divide it by a parameter of that unit",
                )
            return NUMBER if function in PURE else (inner or NUMBER) ** 0.5 if function == "sqrt" else inner
    raise AssertionError(f"{type(node).__name__} was let in")


def _common(parts: list[ast.expr], found: list[Dimension | None]) -> Dimension | None:
    """Return what all terms measure."""
    known = [(part, d) for part, d in zip(parts, found, strict=True) if d is not None]
    for part, d in known[1:]:
        if d != known[0][1]:
            raise ModelError(
                f"puts {ast.unparse(known[0][0])} in {known[0][1]} beside {ast.unparse(part)} in {d}",
                "terms of one unit",
                "Correct the formula; an effect file can give a parameter another unit",
            )
    return known[0][1] if known else None
