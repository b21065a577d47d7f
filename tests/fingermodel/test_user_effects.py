"""Effects of the user: what a formula may say, that it does what it says, and that every fault is one clear line."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
import yaml
from hypothesis import assume, given
from hypothesis import strategies as st

from daq.errors import ModelError
from fingermodel.effects.catalogue import CATALOGUE
from fingermodel.effects.contract_cases import states_before
from fingermodel.effects.formula import FORMAT
from fingermodel.effects.formula_effect import FormulaEffect
from fingermodel.effects.formula_language import parse
from fingermodel.effects.formula_units import read_unit
from fingermodel.effects.user import effect_document, effect_from_dict, load_effect, shipped_effects
from fingermodel.finger_files import read_finger
from fingermodel.fingers import Topology
from fingermodel.model import ANY_LAYOUT, Model, jax_values, predict_case, reading_jacobian
from fingermodel.stages import Layout, LoadCaseInput, State
from tests.fingermodel.fingers import random_case
from tests.own_effect import CODE, python_file

K = {"unit": "mm", "range": [-5, 5]}
SHARE = {"unit": "1", "range": [0, 1]}


def document(formula: str | list[str] = "torque[PIP] += k * t_EDC * sin(q_PIP)", **changes: Any) -> dict[str, Any]:
    """An effect's file with some keys changed; None removes one."""
    lines = {"formula": formula} if isinstance(formula, str) else {"formulas": formula}
    whole = {"format": FORMAT, "name": "mine", "title": "a stiff joint", "source": "ours", **lines}
    whole |= {"parameters": {"k": K}} | changes
    return {key: value for key, value in whole.items() if value is not None}


def made(formula: str | list[str], **changes: Any) -> FormulaEffect:
    effect = effect_from_dict(document(formula, **changes), "mine.yaml")
    assert isinstance(effect, FormulaEffect)
    return effect


def with_unit(unit: str, formula: str, low: float = -1.0) -> FormulaEffect:
    return made(formula, parameters={"k": {"unit": unit, "range": [low, 1]}})


@pytest.fixture(scope="module")
def topology() -> Topology:
    return read_finger("an1979_middle").topology


def one_line(found: pytest.ExceptionInfo[ModelError]) -> str:
    text = str(found.value)
    assert "\n" not in text
    assert len(text) < 700
    return text


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
            "expected N mm, the unit of torque[PIP]. Correct the formula, or the unit of k (mm)",
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


# --- what it does -----------------------------------------------------------------------------------------------------


def acted(effect: FormulaEffect, p: list[float], topology: Topology, number: int) -> tuple[State, State, LoadCaseInput]:
    """State before and after an effect, in one of the made-up load cases."""
    case, before = states_before(effect.stage, topology, ANY_LAYOUT)[number]
    after: State = getattr(effect, effect.stage)(jnp.asarray(p), case, before)
    return before, after, case


def test_each_target_changes_its_own_place_alone(topology: Topology) -> None:
    at = {name: i for i, name in enumerate(topology.muscles)}
    before, after, _ = acted(with_unit("1/N", "tension[FDP] *= 1 + k * t_FDS"), [0.1], topology, 4)
    expected = np.array(before.tension)
    expected[at["FDP"]] *= 1 + 0.1 * expected[at["FDS"]]
    np.testing.assert_allclose(after.tension, expected)

    before, after, _ = acted(with_unit("deg", "posture[PIP] += k"), [3.0], topology, 4)
    np.testing.assert_allclose(
        np.rad2deg(np.asarray(after.posture - before.posture)),
        [3.0 * (r == "PIP") for r in topology.rotations],
        atol=1e-12,
    )

    before, after, _ = acted(with_unit("mm", "point[PIP.FDP].y += k"), [2.0], topology, 4)
    for end in ("proximal_point", "distal_point"):
        moved = np.asarray(getattr(after.values, end)) - np.asarray(getattr(before.values, end))
        rows = [[0.0, 2.0 * (s.name == "PIP.FDP"), 0.0] for s in topology.segments]
        np.testing.assert_allclose(moved, rows, atol=1e-12)

    before, after, _ = acted(with_unit("N", "segment_tension[PIP.FDP] += k"), [1.0], topology, 4)
    assert before.segment_tension is not None
    assert after.segment_tension is not None
    gained = np.asarray(after.segment_tension - before.segment_tension)
    np.testing.assert_allclose(gained, [float(s.name == "PIP.FDP") for s in topology.segments], atol=1e-12)

    before, after, _ = acted(made("torque[PIP] += k * t_EDC * sin(q_PIP)"), [2.0], topology, 4)
    assert before.torque is not None
    assert after.torque is not None
    pip = topology.rotations.index("PIP")
    added = 2.0 * before.tension[at["EDC"]] * np.sin(before.posture[pip])
    np.testing.assert_allclose(np.asarray(after.torque - before.torque)[pip], added)


def test_a_changed_fraction_shares_anew_and_leaves_what_was_done_before(topology: Topology) -> None:
    effect = with_unit("1", "fraction[EDC_ES] += k", 0.0)
    case, before = states_before("sharing", topology, ANY_LAYOUT)[4]
    assert before.segment_tension is not None
    worn = before._replace(segment_tension=before.segment_tension * 0.5)
    plain, other = (effect.sharing(jnp.asarray([0.2]), case, s) for s in (before, worn))
    assert plain.segment_tension is not None
    assert other.segment_tension is not None
    gained = np.asarray(plain.segment_tension - before.segment_tension)
    edc = 0.2 * float(before.tension[topology.muscles.index("EDC")])
    share = {"PIP.ES": edc, "PIP.RB": -0.5 * edc, "PIP.UB": -0.5 * edc, "DIP.TE": -edc}
    np.testing.assert_allclose(gained, [share.get(s.name, 0.0) for s in topology.segments], atol=1e-12)
    np.testing.assert_allclose(np.asarray(other.segment_tension - before.segment_tension * 0.5), gained, atol=1e-12)
    assert float(plain.values.fraction[topology.fractions.index("EDC_ES")]) == pytest.approx(
        float(before.values.fraction[topology.fractions.index("EDC_ES")]) + 0.2
    )


def test_a_place_of_the_cell_is_kept_to(topology: Topology) -> None:
    effect = with_unit("N", "force.bone[y] += k * (1 - is_check)")
    seen = set()
    for number in range(8):
        before, after, case = acted(effect, [1.0], topology, number)
        assert before.wrench is not None
        assert after.wrench is not None
        expected = 1.0 if bool(case.at_bone) and not bool(case.is_check) else 0.0
        np.testing.assert_allclose(np.asarray(after.wrench - before.wrench), [0, expected, 0, 0, 0, 0], atol=1e-12)
        seen.add(expected)
    assert seen == {0.0, 1.0}


def test_formulas_read_the_state_before_all_of_them(topology: Topology) -> None:
    both = ["tension[FDP] += k * t_FDS", "tension[FDS] += k * t_FDP"]
    before, after, _ = acted(made(both, parameters={"k": SHARE}), [1.0], topology, 4)
    at = topology.muscles.index
    total = float(before.tension[at("FDP")] + before.tension[at("FDS")])
    assert float(after.tension[at("FDP")]) == pytest.approx(total)
    assert float(after.tension[at("FDS")]) == pytest.approx(total)


def test_ranges_become_priors(topology: Topology) -> None:
    parameters = {
        "a": {"unit": "%", "range": [0, 20]},
        "b": {"unit": "1", "range": [-4, 4]},
        "c": {"unit": "deg", "range": [10, 50], "null": 30, "bounds": [0, 90], "what": "onset"},
    }
    effect = made("torque[PIP] *= 1 + a + b * tanh(q_PIP - c)", parameters=parameters)
    a, b, c = effect.parameters(topology, ANY_LAYOUT)
    assert (a.name, a.unit, a.sd, a.lower, a.upper, a.one_sided) == ("mine.a", "%", 10.0, 0.0, 40.0, True)
    assert (b.sd, b.lower, b.upper, b.plausible, b.one_sided) == (2.0, -8.0, 8.0, (-4.0, 4.0), False)
    assert (c.initial, c.sd, c.lower, c.upper) == (30.0, 10.0, 0.0, 90.0)


def test_what_cannot_act_in_a_session_stays_fixed(topology: Topology) -> None:
    shunt = load_effect(Path("force_shunt"))
    at_tip = Layout(ANY_LAYOUT.settings, (("tip", 0),))
    expected = {f"force_shunt.{mount}": mount == "tip" for mount in ("tip", "bone")}
    expected |= {f"force_shunt.{mount}_{axis}": mount == "tip" for mount in ("tip", "bone") for axis in "xyz"}
    assert {p.name: p.sd > 0 for p in shunt.parameters(topology, at_tip)} == expected
    directed = tuple(f"force_shunt.tip_{axis}" for axis in "xyz")
    assert shunt.variants(topology, at_tip) == {"force_shunt": (("force_shunt.tip",), directed)}
    bone_only = made("force.bone[x] *= 1 - k", parameters={"k": SHARE})
    assert bone_only.parameters(topology, at_tip) == ()
    assert bone_only.variants(topology, at_tip) == {}


def test_joints_and_muscles_that_the_finger_lacks_are_named(topology: Topology) -> None:
    for line, said in (
        ("torque[pip] += k * t_EDC", "Did you mean PIP?"),
        ("torque[PIP] += k * t_EDD", "t_EDD names 'EDD'"),
        ("torque[PIP] += k * t_EDC * q_thumb", "one of MCP, abduction, PIP, DIP"),
        ("torque[PIP] += k * t_EDC * tanh(q_XIP)", "q_XIP names 'XIP'"),
    ):
        effect = made(line)
        with pytest.raises(ModelError) as found:
            effect.parameters(topology, ANY_LAYOUT)
        assert said in one_line(found)


# --- files ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"format": "fingertwin-effect/2"}, "format: must be 'fingertwin-effect/1'"),
        ({"name": "my effect"}, "name is 'my effect'"),
        ({"name": "lambda"}, "name is 'lambda'"),
        ({"name": "hood_shift"}, "the name of an effect of the catalogue"),
        ({"name": "zero"}, "the name of a group of parameters"),
        ({"title": ""}, "title"),
        ({"source": "  "}, "source is empty"),
        ({"source": None}, "source: Field required"),
        ({"formula": None}, "no formula"),
        ({"formulas": ["torque[PIP] += k * t_EDC"]}, "formula and formulas"),
        ({"formula": None, "formulas": []}, "0 formulas"),
        ({"formula": None, "formulas": ["torque[PIP] += k * t_EDC", "tension[FDP] *= 1 + k / k"]}, "Make two effects"),
        ({"parameters": {}}, "parameters"),
        ({"parameters": {"k": K, "m": K}}, "no formula names the parameter m"),
        ({"parameters": {"k": K | {"unit": "stone"}}}, "'stone' is not a unit"),
        ({"parameters": {"k": {"unit": "mm"}}}, "parameters.k.range: Field required"),
        ({"parameters": {"k": K | {"range": [5, -5]}}}, "range [5, -5] and null 0"),
        ({"parameters": {"k": K | {"range": [-5, 0]}}}, "Turn the sign in the formula"),
        ({"parameters": {"k": K | {"range": [1, 5]}}}, "Put the null value into the range"),
        ({"parameters": {"k": K | {"range": [0, float("inf")]}}}, "finite number"),
        ({"parameters": {"k": K | {"bounds": [-1, 9]}}}, "Widen the bounds"),
        ({"parameters": {"k": K | {"range": [0, 5], "bounds": [-1, 9]}}}, "Start the bounds at the null value"),
        ({"parameters": {"k": K | {"prior": 3}}}, "Extra inputs are not permitted"),
        ({"parameters": {"t_EDC": K}}, "Rename it"),
        ({"parameters": {"sin": K}}, "Rename it"),
        ({"parameters": {"k.x": K}}, "Rename it"),
        ({"parameters": {"if": K}}, "Rename it"),
        ({"alternatives": [["k"], ["m"]]}, "alternatives name 'm'"),
        ({"alternatives": [[]]}, "none empty"),
        ({"extra": 1}, "Extra inputs are not permitted"),
    ],
)
def test_a_file_that_cannot_be_used_says_why(changes: dict[str, Any], said: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(document(**changes), sort_keys=False), encoding="utf-8")
    with pytest.raises(ModelError) as found:
        load_effect(path)
    assert said in one_line(found)
    assert one_line(found).startswith("mine.yaml: ")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("format: [", "is not YAML"),
        ("- 1\n- 2", "a fingertwin-effect/1 file"),
        ("", "a fingertwin-effect/1 file"),
        ("!!python/object/apply:os.system ['true']", "is not YAML"),
        ("[" * 3000, "mine.yaml"),
        ("x" * 70000, "larger than 64 kB"),
    ],
)
def test_text_that_is_no_effect_is_refused(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ModelError) as found:
        load_effect(path)
    assert said in str(found.value)


def test_a_file_that_is_not_there_names_those_that_are(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"no effect file hysteresys; expected .* Did you mean hysteresis\?"):
        load_effect(Path("hysteresys"))
    (tmp_path / "notes.txt").write_text("x")
    with pytest.raises(ModelError, match=r"notes\.txt is no effect file"):
        load_effect(tmp_path / "notes.txt")


@pytest.mark.parametrize("name", shipped_effects())
def test_an_effect_comes_back_from_its_document(name: str) -> None:
    effect = load_effect(Path(name))
    kept = effect_document(effect)
    for copied in (json.loads(json.dumps(kept)), yaml.safe_load(yaml.safe_dump(kept))):
        again = effect_from_dict(copied, "revision")
        assert again == effect
        assert hash(again) == hash(effect)


def test_null_is_a_key_in_yaml_too(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(
        f"format: {FORMAT}\nname: mine\ntitle: t\nsource: s\nformula: 'posture[PIP] += k - 0.5'\n"
        "parameters:\n  k: {unit: 1, range: [0, 1], null: 0.5}\n"
    )
    effect = load_effect(path)
    assert isinstance(effect, FormulaEffect)
    assert effect.declared[0].null == 0.5


# --- Python files -----------------------------------------------------------------------------------------------------


def test_a_python_file_and_a_formula_say_the_same(tmp_path: Path) -> None:
    finger, rng = read_finger("an1979_middle"), np.random.default_rng(3)
    posture, tension = random_case(finger, rng)
    case = states_before("torque", finger.topology, ANY_LAYOUT)[4][0]
    case = case._replace(posture=jnp.asarray(posture), tension=jnp.asarray(tension))
    by_python, by_formula = load_effect(python_file(tmp_path)), made("torque[PIP] += k * t_EDC * sin(q_PIP)")
    found = []
    for effects in ((by_python,), (by_formula,), ()):
        model = Model(finger, effects=effects)
        theta = model.initial
        theta[[n == "mine.k" for n in model.parameters.names]] = 2.0
        values = jax_values(finger.values)
        found.append(np.asarray(predict_case(model.structure, values, jnp.asarray(theta), case).reading))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-12)
    assert np.abs(found[0] - found[2]).max() > 0.01


@pytest.mark.parametrize("name", shipped_effects())
def test_the_compiler_takes_it(name: str) -> None:
    finger = read_finger("an1979_middle")
    case = states_before("torque", finger.topology, ANY_LAYOUT)[4][0]
    cases = LoadCaseInput(*(jnp.asarray(x)[None] for x in case))
    first, second = (Model(finger, effects=(load_effect(Path(name)),)) for _ in range(2))
    assert first.structure == second.structure
    assert hash(first.structure) == hash(second.structure)
    values, theta = jax_values(finger.values), jnp.asarray(first.initial)
    assert reading_jacobian.eval_shape(first.structure, values, theta, cases).shape == (1, 6, len(theta))


def test_the_same_file_gives_the_same_instance_until_it_changes(tmp_path: Path) -> None:
    path = python_file(tmp_path)
    first = load_effect(path)
    assert load_effect(path) is first
    # As long as before, and within the same second: no byte code may stand in for it.
    other = load_effect(python_file(tmp_path, ('"mm", 5.0', '"mm", 6.0')))
    assert other is not first
    assert other.parameters(read_finger("an1979_middle").topology, ANY_LAYOUT)[0].plausible == (-6.0, 6.0)
    assert [p.name for p in tmp_path.iterdir()] == ["mine.py"]


def test_code_in_a_document_is_never_run(tmp_path: Path) -> None:
    path = python_file(tmp_path)
    effect = load_effect(path)
    kept = json.loads(json.dumps(effect_document(effect)))
    assert kept["text"] == CODE
    with pytest.raises(ModelError, match=r"not run from inside a file; expected the file itself, .* --effect"):
        effect_from_dict(kept, "revision")
    assert effect_from_dict(kept, "revision", [load_effect(Path("hysteresis")), effect]) is effect
    with pytest.raises(ModelError, match="another version of its file"):
        effect_from_dict(kept | {"sha256": "0" * 64}, "revision", [effect])


def test_an_effect_of_the_catalogue_has_no_document() -> None:
    with pytest.raises(ModelError, match="comes from no file"):
        effect_document(CATALOGUE[0])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("import jax.numpy", "import nowhere.numpy", "line 4: ModuleNotFoundError"),
        ("@dataclass(frozen=True)", "@dataclass(frozen=True", "SyntaxError"),
        ("@dataclass(frozen=True)", "raise SystemExit(3)\n@dataclass(frozen=True)", "line 10: SystemExit: 3"),
        ("class Mine(", "class _Mine(", "defines no effect"),
        ("class Mine(Effect):", "class Other(Effect):\n    pass\n\nclass Mine(Effect):", "defines Mine, Other"),
        ("    def parameters", "    size: float\n\n    def parameters", "Mine() fails (TypeError"),
        ("@dataclass(frozen=True)", "@dataclass", "cannot be hashed"),
        ('name = "mine"', 'name = "my effect"', "Mine.name is 'my effect'"),
        ('name = "mine"', 'name = "volar_plate"', "the name of an effect of the catalogue"),
        ('stage = "torque"', 'stage = "torsion"', "stage is 'torsion'"),
        ('stage = "torque"', 'stage = "reading"', "overrides torque; expected the method of its stage alone: reading"),
        (
            "    def torque",
            "    def tension(self, p, case, state):\n        return state\n\n    def torque",
            "tension, torque",
        ),
        ('title = "a stiff joint"', 'title = " "', "title is empty"),
        ('source = "ours"', 'source = ""', "source is empty"),
        ('"mine.k"', '"k"', "expected a name such as mine.place"),
        ('"mm", 5.0', '"", 5.0', "mine.k has no unit"),
        (
            'two_sided("mine.k", "mm", 5.0)',
            'Parameter("mine.k", "mm", 0.0, float("inf"), -9.0, 9.0, "effect", plausible=(-5.0, 5.0))',
            "the prior sd inf",
        ),
        ('two_sided("mine.k", "mm", 5.0)', 'Parameter("mine.k", "mm", 0.0, 1.0, -9.0, 9.0)', "of kind anatomy"),
        (
            'two_sided("mine.k", "mm", 5.0)',
            'Parameter("mine.k", "mm", 0.0, 1.0, -9.0, 9.0, "effect")',
            "has the plausible range None",
        ),
        ('(two_sided("mine.k", "mm", 5.0),)', '(two_sided("mine.k", "mm", 5.0),) * 2', "declares a parameter twice"),
        ("added = p[0]", "added = (p[0] + 1e-12)", "changes something at its null values"),
        ("jnp.sin(", "jnp.sqrt(p[0] * 0.0 + ", "value or slope that is not finite"),
        ("p[0] *", "jnp.sqrt(jnp.abs(p[0])) *", "slope that is not finite at its null values"),
        ("p[0] *", "0.0 * p[0] *", "mine.k changes nothing"),
        (
            "added = p[0]",
            "added = 0.0 if p[0] == 0.0 else p[0]",
            "fails at the torque stage (TracerBoolConversionError",
        ),
        ("p[0] *", "undefined *", "fails at the torque stage (NameError"),
        ("return state._replace(torque", "return state._replace(torques", "fails at the torque"),
    ],
)
def test_a_python_file_that_breaks_the_contract_says_where(old: str, new: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(ModelError) as found:
        load_effect(python_file(tmp_path, (old, new)))
    assert said in one_line(found)
    assert one_line(found).startswith("mine.py")
