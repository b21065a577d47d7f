"""Files of effects, with formulas or in Python: what is read, what comes back, and what is refused in one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import yaml

from daq.errors import ModelError
from fingermodel.compiled.programs import UNOPTIMISED
from fingermodel.effects.catalogue import CATALOGUE
from fingermodel.effects.contract_cases import states_before
from fingermodel.effects.formula import FORMAT
from fingermodel.effects.formula_effect import FormulaEffect
from fingermodel.effects.user import effect_document, effect_from_dict, load_effect, shipped_effects
from fingermodel.fingers.files import read_finger
from fingermodel.model import Model, jax_values, predict_case, reading_jacobian
from fingermodel.stages import LoadCaseInput
from fingermodel.structure import ANY_LAYOUT
from tests.fingermodel.effect_documents import K, document, made, one_line
from tests.fingermodel.fingers import random_case
from tests.own_effect import CODE, python_file

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
        ({"shown_by": 3}, "shown_by"),
        ({"shown_by": ["pull"]}, "shown_by"),
        ({"shown_by": "pull " * 100}, "shown_by: String should have at most 400 characters"),
        ({"alternatives": [["k"], ["m"]]}, "alternatives name 'm'"),
        ({"alternatives": [[]]}, "none empty"),
        ({"extra": 1}, "Extra inputs are not permitted"),
        (
            {"parameters": None, "parametrs": {"k": K}},
            "parametrs is not a known key; expected a fingertwin-effect/1 file. Did you mean parameters?",
        ),
        ({"shownby": "x"}, "Did you mean shown_by"),
        (
            {"parameters": {"k": {"unit": "mm", "rnage": [0, 1]}}},
            "parameters.k.rnage is not a known key; expected a fingertwin-effect/1 file. Did you mean range?",
        ),
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
        ("a: 1\na: 2\n", "mine.yaml in line 2, column 1: key 'a' is there twice; expected each key once. Remove"),
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


def test_a_file_declares_the_measurement_that_shows_its_effect(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    text = yaml.safe_dump(document(), sort_keys=False)
    path.write_text(f"{text}shown_by: >\n  pull a known weight\n  through the sheath\n", encoding="utf-8")
    for effect in (load_effect(path), effect_from_dict(effect_document(load_effect(path)), "revision")):
        assert effect.remedy("mine") == "pull a known weight through the sheath"
    without = made("torque[PIP] += k * t_EDC * sin(q_PIP)")
    assert without.remedy("mine") == ""
    assert "shown_by" not in effect_document(without)
    # Words change nothing that is computed: programs and revisions of the one serve the other.
    assert without == load_effect(path)


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
    predict, found = jax.jit(predict_case, static_argnums=0, compiler_options=UNOPTIMISED), []
    for effects in ((by_python,), (by_formula,), ()):
        model = Model(finger, effects=effects)
        theta = model.initial
        theta[[n == "mine.k" for n in model.parameters.names]] = 2.0
        values = jax_values(finger.values)
        found.append(np.asarray(predict(model.structure, values, jnp.asarray(theta), case).reading))
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
