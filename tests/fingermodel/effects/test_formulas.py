"""The language of formulas: what is in it, units that go together, and that an effect is neutral, finite and smooth."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress

import jax.numpy as jnp
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from daq.errors import ModelError
from fingermodel.effects.formula_language import parse
from fingermodel.effects.formula_units import read_unit
from tests.fingermodel.effect_documents import made, one_line, with_unit

# --- the language -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "attack",
    [
        "__import__('os').system('true')",
        "k.__class__",
        "().__class__.__bases__[0].__subclasses__()",
        "(lambda: k)()",
        "eval('k')",
        "open('x')",
        "getattr(k, 'x')",
        "[k for k in (1, 2)]",
        "{k}",
        "k if k else 0",
        "k and t_EDC",
        "not k",
        "k > 0",
        "k := 1",
        "(k := 1)",
        "f'{k}'",
        "'k'",
        "b'k'",
        "True",
        "None",
        "...",
        "1j",
        "k[0]",
        "*k",
        "sin(*k)",
        "sin(x=k)",
        "sin",
        "sin()",
        "max(k)",
        "k % 2",
        "k // 2",
        "k @ k",
        "k << 2",
        "~k",
        "await k",
        "yield k",
        "k; k",
        "k = 1",
        "k, k",
        "9 ** 9 ** 9",
        "k ** 99",
        "k ** k",
        "k ** -9",
        "2 ** 8.5",
        "9" * 350,
        "1e999 * k",
        "k" + " + k" * 200,
        "-" * 300 + "k",
        "(" * 150 + "k" + ")" * 149,
        "sin(" * 60 + "k" + ")" * 60,
        "ｋ * t_EDC",
        "k * t_EDC * \N{GREEK SMALL LETTER MU}",
        "k\x00",
        "k #",
        "",
        " ",
    ],
)
def test_what_is_not_in_the_language_is_refused(attack: str) -> None:
    with pytest.raises(ModelError) as found:
        made("torque[PIP] += " + attack)
    text = one_line(found)
    assert text.startswith("mine.yaml: ")
    assert "expected" in text


@given(text=st.text(max_size=60) | st.text(alphabet="kt_EDCqPI0123456789.+-*/()[]= sincoexpl,'", max_size=60))
def test_no_text_does_worse_than_be_refused(text: str) -> None:
    for line in (text, f"torque[PIP] += {text}"):
        with suppress(ModelError):
            parse(line, "x")


FUNCTIONS: dict[str, Callable[[float], float]] = {
    "sin": math.sin,
    "cos": math.cos,
    "tanh": math.tanh,
    "abs": abs,
    "pos": lambda x: max(x, 0.0),
}


@st.composite
def expressions(draw: st.DrawFn, depth: int = 4) -> tuple[str, float]:
    """An expression of k = 0.7 and q_PIP = -1.3, and its value."""
    kind = draw(st.sampled_from(["number", "name", "sum", "product", "call", "power", "minus", "least"]))
    if depth == 0 or kind in ("number", "name"):
        number = st.integers(0, 99).map(lambda n: (str(n / 8), n / 8))
        return draw(number if kind == "number" else st.sampled_from([("k", 0.7), ("q_PIP", -1.3)]))
    a, x = draw(expressions(depth=depth - 1))
    if kind in ("sum", "product", "least"):
        b, y = draw(expressions(depth=depth - 1))
        text, value = {
            "sum": (f"({a} + {b})", x + y),
            "product": (f"({a}) * ({b})", x * y),
            "least": (f"min({a}, {b})", min(x, y)),
        }[kind]
        return text, value
    if kind == "call":
        name = draw(st.sampled_from(sorted(FUNCTIONS)))
        return f"{name}({a})", FUNCTIONS[name](x)
    return (f"({a}) ** 2", x**2) if kind == "power" else (f"-({a})", -x)


@given(expression=expressions())
def test_a_formula_is_worth_what_it_says(expression: tuple[str, float]) -> None:
    text, value = expression
    assume(len(text) < 300 and abs(value) < 1e9)
    formula = parse(f"torque[PIP] += {text}", "x")
    found = formula.value({"k": jnp.asarray(0.7), "q_PIP": jnp.asarray(-1.3)})
    assert float(found) == pytest.approx(value, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("torque[PIP] = k", "To subtract x write += -x"),
        ("torque[PIP] -= k * t_EDC", "To subtract x write += -x"),
        ("torque[PIP] **= k", "cannot be read"),
        ("torque += k", "cannot be read"),
        ("torgue[PIP] += k", "Did you mean torque?"),
        ("torque.tip[PIP] += k", "changes torque.tip[PIP]; expected torque[PIP]"),
        ("force.finger[x] += k", "expected force, force.tip or force.bone"),
        ("force[w] += k", "expected force[x], force[y] or force[z]"),
        ("point[PIP.FDP] += k", "expected point[JOINT.SLIP].x, .y or .z"),
        ("point[PIP.FDP].w += k", "expected point[JOINT.SLIP].x, .y or .z"),
        ("torque[PIP].x += k", "expected torque[PIP]"),
        ("torque[PIP] += k * sine(q_PIP)", "Did you mean sin?"),
        ("torque[PIP] += k * t_EDC * elapsd", "Did you mean elapsed?"),
        ("torque[PIP] += k * F_x", "F_x at the reading stage only"),
        ("force[x] *= 1 + k * tau_PIP", "tau_PIP at the torque stage only"),
        ("torque[PIP] += k * sin", "names sin without an argument; expected sin(x)"),
        ("torque[PIP] += k * (q_PIP > 0)", "For a condition write pos(x)"),
    ],
)
def test_a_line_that_cannot_be_used_says_why(line: str, said: str) -> None:
    with pytest.raises(ModelError) as found:
        made(line)
    assert said in one_line(found)


# --- units ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("unit", "formula"),
    [
        ("mm", "torque[PIP] += k * t_EDC"),
        ("N mm", "torque[PIP] += k * sin(q_PIP)"),
        ("N mm/rad", "torque[PIP] += k * q_PIP"),
        ("N mm/deg", "torque[PIP] += k * q_PIP"),
        ("1/N mm", "torque[PIP] *= 1 + k * abs(tau_DIP)"),
        ("%", "torque[PIP] += k * tau_DIP"),
        ("1/N", "tension[FDP] *= 1 + k * t_FDS"),
        ("g", "tension[FDP] += k * weight"),
        ("mm/N", "point[PIP.FDP].y += k * t_FDP"),
        ("rad/N mm", "torque[PIP] *= exp(k * tau_PIP)"),
        ("deg", "posture[PIP] += k * elapsed"),
        ("1", "fraction[EDC_ES] += k * sin(q_PIP) ** 2"),
        ("N", "segment_tension[PIP.FDP] += max(0, k)"),
        ("1/mm", "force.tip[x] += k * M_z"),
        ("mm", "moment[z] += k * min(F_x, F_y, F_z)"),
    ],
)
def test_units_that_go_together(unit: str, formula: str) -> None:
    assert with_unit(unit, formula, 0.0).formula == formula


@pytest.mark.parametrize(
    ("unit", "formula", "said"),
    [
        ("N", "torque[PIP] += k * t_EDC", "right-hand side in N^2; expected N mm, the unit of torque[PIP]"),
        (
            "mm",
            "torque[PIP] += k",
            "expected N mm, the unit of torque[PIP]. Correct the formula; k is in mm, and an effect file",
        ),
        ("mm", "torque[PIP] *= 1 + k", "puts 1 in 1 (a number, angle or share) beside k in mm"),
        ("mm", "torque[PIP] *= k", "expected 1 (a number, angle or share), a factor"),
        ("mm", "posture[PIP] += k", "expected 1 (a number, angle or share), the unit of posture[PIP]"),
        ("mm", "torque[PIP] += k * t_EDC * sin(t_EDC)", "takes sin of t_EDC, which is in N"),
        ("mm", "torque[PIP] += k * t_EDC + q_PIP", "in N mm beside q_PIP"),
        ("mm", "torque[PIP] += k * max(t_EDC, q_PIP)", "puts t_EDC in N beside q_PIP"),
        ("s", "torque[PIP] *= exp(-k * elapsed)", "takes exp of -k * elapsed, which is in s"),
        ("g", "tension[FDP] += k", "expected N, the unit of tension[FDP]"),
    ],
)
def test_units_that_do_not(unit: str, formula: str, said: str) -> None:
    with pytest.raises(ModelError) as found:
        with_unit(unit, formula)
    assert said in one_line(found)


@pytest.mark.parametrize(
    ("text", "dimension", "scale"),
    [
        ("N mm", "N mm", 1.0),
        ("N*mm", "N mm", 1.0),
        ("rad/N mm", "1/N mm", 1.0),
        ("rad/(N mm)", "1/N mm", 1.0),
        ("1/rad", "1 (a number, angle or share)", 1.0),
        ("deg", "1 (a number, angle or share)", math.pi / 180),
        ("mm^2/N", "mm^2/N", 1.0),
        ("mm²", "mm^2", 1.0),
        ("%", "1 (a number, angle or share)", 0.01),
        ("mN m", "N mm", 1.0),
        ("1/min", "1/s", 1 / 60),
        ("kg", "g", 1000.0),
    ],
)
def test_units_are_read(text: str, dimension: str, scale: float) -> None:
    unit = read_unit(text, "k")
    assert str(unit.dimension) == dimension
    assert unit.scale == pytest.approx(scale)


@pytest.mark.parametrize("text", ["", "/", "N/mm/s", "furlong", "N+mm", "2", "N^0", "mm^-1", "N" * 99, "1/"])
def test_what_is_no_unit_is_refused(text: str) -> None:
    with pytest.raises(ModelError, match="is not a unit"):
        read_unit(text, "k")


# --- neutral, finite, smooth ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("formula", "said"),
    [
        ("posture[PIP] += k + 1e-9", "adds 1e-09 at the null values, where k = 0; expected exactly 0"),
        ("posture[PIP] += k + q_PIP - q_PIP + 1e-30", "at the null values"),
        ("posture[PIP] += cos(k)", "adds 1 at the null values"),
        ("torque[PIP] *= k", "multiplies by 0 at the null values"),
        ("torque[PIP] *= 0.1 + 0.2 + 0.7 + 1e-9 + k", "expected exactly 1"),
        ("posture[PIP] += k / q_PIP", "no finite value at the null values, where q_PIP = 0 and k = 0"),
        ("posture[PIP] += k * log(q_PIP)", "no finite value at the null values"),
        ("posture[PIP] += log(1 + 0.9 * k)", "no finite value at some values within the bounds"),
        ("posture[PIP] += k / 0", "no finite value"),
        ("posture[PIP] += k * (1 / 0)", "has no value (float division by zero)"),
        ("posture[PIP] += k * (0 - 2) ** 0.5", "has no value"),
        ("posture[PIP] += sqrt(abs(k))", "no finite derivative at the null values"),
        ("posture[PIP] += k * sqrt(abs(q_PIP))", "no finite derivative"),
        ("posture[PIP] += exp(1e3 * k * k) - 1", "within the bounds"),
    ],
)
def test_a_formula_that_is_not_neutral_finite_and_smooth_is_refused(formula: str, said: str) -> None:
    with pytest.raises(ModelError) as found:
        with_unit("1", formula)
    assert said in one_line(found)


def test_a_null_value_other_than_zero_and_a_rounded_corner_are_taken() -> None:
    tau = {"unit": "1", "range": [0.5, 1.5], "null": 1.0, "bounds": [0.2, 2.0]}
    effect = made("posture[PIP] += log(k) * (sqrt(abs(q_PIP) + 0.01) - 0.1)", parameters={"k": tau})
    assert effect.declared[0].null == 1.0
    with pytest.raises(ModelError, match=r"within the bounds|no finite value"):
        made("posture[PIP] += log(k)", parameters={"k": tau | {"bounds": [0.0, 2.0]}})
