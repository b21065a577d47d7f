"""The public API: its examples run, its names are there, and importing it is light."""

from __future__ import annotations

import ast
import doctest
import importlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import daq
import fingermodel
import fingertwin
import server
from fingermodel import (
    Fit,
    InputError,
    Session,
    add,
    compare,
    predict,
    read_finger,
    read_revision,
    refit,
    save,
)
from fingermodel.diagnosis.session_model.session import session_of
from tests.contracts.test_layers import loaded_by

ROOT = Path(__file__).parents[2]
PACKAGES = (daq, fingermodel, server, fingertwin)


def with_examples() -> list[str]:
    """Modules of the packages whose docstrings hold examples."""
    files = [f for p in PACKAGES for f in sorted((ROOT / p.__name__).rglob("*.py")) if ">>> " in f.read_text("utf-8")]
    return [".".join(f.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__") for f in files]


@pytest.mark.parametrize("name", with_examples())
def test_examples_of_docstrings_give_what_they_say(name: str) -> None:
    found = doctest.testmod(importlib.import_module(name))
    assert found.attempted > 0
    assert found.failed == 0


def test_what_a_notebook_shows_of_a_value_is_a_line() -> None:
    session = Session.open("synek2019_H01")
    fit = refit(session, starts=1)
    shown = [repr(v) for v in (session, session.model, session.model.finger, compare(session), fit)]
    assert all(len(line) < 120 and "\n" not in line for line in shown)
    assert shown[0] == "<Session synek2019_H01: 40 load cases, model synek2019_initial>"
    assert shown[4].startswith("<Fit (map), converged")


def test_linear_algebra_has_one_thread_while_something_is_computed_and_what_it_had_afterwards() -> None:
    def used() -> set[int]:
        return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}

    during: list[set[int]] = []
    with threadpool_limits(limits=2, user_api="blas"):
        before = used()
        refit(Session.open("synek2019_H01"), starts=1, progress=lambda _: during.append(used()))
        assert used() == before
    assert during
    assert all(threads == {1} for threads in during)


def test_the_guide_for_notebooks_gives_what_it_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    guide = ROOT / "docs/how-to/use-it-in-a-notebook.md"
    found = doctest.testfile(str(guide), module_relative=False, optionflags=doctest.ELLIPSIS, encoding="utf-8")
    assert found.attempted > 20
    assert found.failed == 0


def test_importing_the_model_is_light() -> None:
    assert loaded_by("fingermodel").isdisjoint({"jax", "numpy", "scipy", "pydantic", "yaml", "pyarrow"})


def test_a_type_checker_and_python_find_the_same_public_names() -> None:
    tree = ast.parse(Path(fingermodel.__file__).read_text("utf-8"))
    typed = {
        alias.name
        for block in tree.body
        if isinstance(block, ast.If)
        for imported in block.body
        if isinstance(imported, ast.ImportFrom)
        for alias in imported.names
    }
    assert typed == set(fingermodel.__all__)
    assert set(fingermodel.__all__) <= set(dir(fingermodel))
    for name in fingermodel.__all__:
        found = getattr(fingermodel, name)
        assert callable(found) or name == "CATALOGUE"


def test_a_name_that_is_not_public_is_refused() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nothing_of_the_kind'"):
        _ = fingermodel.nothing_of_the_kind


@pytest.mark.parametrize("package", PACKAGES)
def test_every_package_says_that_it_is_typed(package: object) -> None:
    assert (Path(str(getattr(package, "__file__", ""))).parent / "py.typed").is_file()


@pytest.fixture(scope="module")
def session() -> Session:
    return Session.open("synek2019_HMEAN")


def test_a_fit_goes_into_a_file_and_comes_back(session: Session, tmp_path: Path) -> None:
    fit = refit(session)
    revision = save(session, fit, tmp_path / "mean.json")
    again = Session.open("synek2019_HMEAN", tmp_path / "mean.json")
    assert again.refitted
    assert not session.refitted
    assert revision.id == again.loaded.name == read_revision(tmp_path / "mean.json").id
    expected = compare(session.at(fit)).rmse_N("validation/tip")
    assert compare(again).rmse_N("validation/tip") == pytest.approx(expected, rel=1e-9)
    with pytest.raises(InputError, match="exists"):
        save(session, fit, tmp_path / "mean.json")


def test_a_fit_is_the_same_with_the_catalogue_at_its_null_where_scatter_reads_alike(session: Session) -> None:
    bare = Session.open("synek2019_HMEAN", catalogue=False)
    one, other = refit(session), refit(bare)
    assert one.errors == other.errors
    # Scatter is that of the finger as a search fits it, which ends within hundredths of a unit of chi-square.
    assert one.objective == pytest.approx(other.objective, abs=0.05)


def test_an_addition_is_part_of_the_model_afterwards(session: Session, tmp_path: Path) -> None:
    addition = add(session, "tip_location")
    better = session.at(addition)
    assert set(better.loaded.added) == {p.name for p in addition.fit.parameters if p.kind == "effect"}
    again = add(better, without=["tip_location"])
    assert not session.at(again).loaded.added
    assert save(better, again, tmp_path / "without.json").document["removed"] == ["tip_location"]
    with pytest.raises(InputError, match="no hanger_mass to take out"):
        add(better, without=["hanger_mass"])
    revision = save(session, addition, tmp_path / "tip.json")
    assert revision.document["added"] == list(addition.names)
    assert revision.document["evidence"] == {"log_evidence_gain": addition.log_evidence_gain}


@pytest.fixture(scope="module")
def specimen() -> Session:
    return Session.open("synek2019_H01")


@pytest.fixture(scope="module")
def own_fit(specimen: Session) -> Fit:
    return refit(specimen, starts=1)


def test_a_fit_goes_to_another_session_by_the_names_of_its_parameters(
    session: Session, specimen: Session, own_fit: Fit
) -> None:
    """Anatomy and effects belong to the specimen; errors of rig and posture stay where they were made."""
    cases = tuple(reversed(specimen.measured.cases))
    backwards = Session.of(replace(specimen.measured, cases=cases))
    assert backwards.model.parameters.names != specimen.model.parameters.names
    expected = compare(specimen.at(own_fit)).rmse_N("identification/tip")
    assert compare(backwards.at(own_fit)).rmse_N("identification/tip") == pytest.approx(expected, rel=1e-9)

    other = session.at(own_fit)
    index, budget = other.model.parameters.index, other.model.parameters.of_kind("budget")
    assert not other.theta[budget].any()
    anatomy = {p.name: p.value for p in own_fit.parameters if p.kind == "anatomy"}
    assert {name: other.theta[index[name]] for name in anatomy} == anatomy
    assert "fitted to session synek2019_H01" in other.loaded.notes[0]
    assert not specimen.at(own_fit).loaded.notes


def test_a_fit_that_says_nothing_of_a_session_is_refused(session: Session, own_fit: Fit, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a fit of finger synek2019_initial for session DEV-02 with finger an1979"):
        Session.open("DEV-02", catalogue=False).at(own_fit)
    with pytest.raises(InputError, match=r"synek2019_H01 to be saved as one of synek2019_HMEAN; .*Give session synek2"):
        save(session, own_fit, tmp_path / "alien.json")
    assert not list(tmp_path.iterdir())
    added = refit(session.holding(["tip_location.x"]), starts=1)
    with pytest.raises(InputError, match=r"a fit with tip_location\.x, which the model of session synek2019_HMEAN"):
        Session.open("synek2019_HMEAN", catalogue=False).at(added)


def test_a_name_that_the_model_lacks_is_refused_wherever_a_session_takes_names(session: Session) -> None:
    asked: list[tuple[Callable[[], object], str]] = [
        (lambda: session.without("hanger_mass"), r"effects is 'hanger_mass'; .*Give \['hanger_mass'\]"),
        (lambda: session.without(["hanger_mas"]), "no effect or parameter 'hanger_mas'; .*Did you mean hanger_mass?"),
        (lambda: session.holding("hanger_mass.m0"), r"parameters is 'hanger_mass\.m0'; .*Give \['hanger_mass\.m0'\]"),
        (lambda: session.holding(["hanger_mass"]), "no parameter 'hanger_mass'"),
        (lambda: session.at_values({"hanger_mass.mO": 30.0}), r"no parameter 'hanger_mass\.mO'; .*Did you mean hanger"),
    ]
    for ask, words in asked:
        with pytest.raises(InputError, match=words):
            ask()
    heavier = session.at_values({"hanger_mass.m0": 30.0, "worn_pulley.FDP": 20.0})
    for names in (["hanger_mass", "worn_pulley"], ["hanger_mass.m0", "worn_pulley.FDP"]):
        np.testing.assert_array_equal(heavier.without(names).theta, session.theta)


def test_a_slip_in_a_call_is_one_line(session: Session, own_fit: Fit) -> None:
    call: Any = fingermodel  # whose types would refuse most of these
    finger, posture, load = "an1979_middle", {"PIP": 65.0, "DIP": 50.0}, {"FDP": 950.0}
    asked: list[tuple[Callable[[], object], str]] = [
        (lambda: call.compare("DEV-02"), r"session 'DEV-02'; expected an open session\. Open it: Session\.open"),
        (lambda: call.refit("DEV-02"), "session 'DEV-02'; expected an open session"),
        (lambda: call.refit(session, starts=0), "starts 0; expected a whole number, 1 or more"),
        (lambda: call.add(session, "hanger_mass", starts=1.5), r"starts 1\.5; expected a whole number"),
        (lambda: call.add(session, ["hanger_mass"]), r"effect \['hanger_mass'\]; expected names of effects, one after"),
        (
            lambda: own_fit.parameter("zero.bone.xx"),
            r"no fitted parameter 'zero\.bone\.xx'; .*Did you mean zero\.bone\.x?",
        ),
        (lambda: call.Session.of(session.measured, 3), "finger 3; expected a Finger, a file, or the name"),
        (lambda: call.Session.of(session.measured, effects=[3]), "effect 3; expected an Effect, or the file of one"),
        (lambda: call.load_effect("pip.yaml"), r"no effect file pip\.yaml"),
        (lambda: call.predict(None, posture, load), "finger None; expected a Finger, a file, or the name"),
        (lambda: call.predict(finger, [65.0, 50.0], load), r"columns \[65\.0, 50\.0\]; expected numbers by name"),
        (lambda: call.predict(finger, posture, 950.0), r"columns 950\.0; expected numbers by name"),
        (lambda: call.predict(finger, {1: 65.0}, load), "joint 1; expected one of MCP"),
        (
            lambda: call.predict(finger, posture, load, tension_factor="0.8"),
            r"tension_factor '0\.8'; expected a number",
        ),
    ]
    for ask, words in asked:
        with pytest.raises(InputError, match=words):
            ask()
    assert repr(compare(session).select(posture="nosuch")) == "<Comparison of 0 load cases>"


def test_loads_may_be_columns_of_any_kind_that_has_names() -> None:
    class Frame(dict[str, list[float]]):
        """As a DataFrame: neither true nor false."""

        def __bool__(self) -> bool:
            raise ValueError("ambiguous")

    posture, load = {"PIP": 65.0, "DIP": 50.0}, {"FDP": [950.0, 500.0]}
    expected = predict("an1979_middle", posture, load).tip_force_N
    np.testing.assert_array_equal(predict("an1979_middle", posture, Frame(load)).tip_force_N, expected)


def test_what_holds_arrays_is_compared_by_identity(session: Session, tmp_path: Path) -> None:
    again = Session.open("synek2019_HMEAN")
    fit = refit(session, starts=1)
    save(session, fit, tmp_path / "a.json")
    revisions = [read_revision(tmp_path / "a.json") for _ in range(2)]
    for one, other in (
        (read_finger("an1979_middle"), read_finger("an1979_middle")), (session.model, again.model), revisions,
        (compare(session), compare(session)), (session.observations, again.observations),
    ):  # fmt: skip
        assert one == one  # noqa: PLR0124
        assert one != other
    assert hash(session.model.finger)


def test_columns_of_a_comparison_are_its_cases(session: Session) -> None:
    comparison = compare(session)
    table = comparison.table()
    assert table["id"] == [c.id for c in comparison.cases]
    assert {len(column) for column in table.values()} == {len(comparison.cases)}
    np.testing.assert_allclose(
        np.array(table["measured_x_N"]) - np.array(table["predicted_x_N"]), table["residual_x_N"], atol=1e-12
    )
    with pytest.raises(InputError, match="no load case of validation/toe"):
        comparison.rmse_N("validation/toe")


@pytest.mark.parametrize(
    ("plane", "hint"),
    [("Sagittal", " Did you mean sagittal?"), ("frontal", ""), ("", ""), ("spaec", " Did you mean space?")],
)
def test_a_plane_that_there_is_not_is_refused(session: Session, plane: str, hint: str) -> None:
    comparison = compare(session)
    asked: list[Callable[[], object]] = [
        lambda: refit(session, plane=plane),  # type: ignore[arg-type]
        lambda: comparison.rmse_N("validation/tip", plane=plane),  # type: ignore[arg-type]
        lambda: comparison.errors(plane),
        lambda: comparison.cases[0].z_in(plane),  # type: ignore[arg-type]
        lambda: session_of(session.model, session.observations, plane),  # type: ignore[arg-type]
    ]
    for ask in asked:
        with pytest.raises(InputError) as caught:
            ask()
        assert str(caught.value) == f"plane {plane!r}; expected sagittal or space.{hint}"


def test_one_name_is_no_list_of_effects(session: Session) -> None:
    for effects in ("hanger_mass", Path("own.yaml")):
        with pytest.raises(InputError, match=f"effects is '{effects}'; expected a list of effects or of their files"):
            Session.of(session.measured, effects=effects)  # type: ignore[arg-type]
    with pytest.raises(
        InputError, match=r"without is 'hanger_mass'; expected a list of effects\. Give \['hanger_mass'\]"
    ):
        add(session, without="hanger_mass")
    with pytest.raises(InputError, match="hanger_mass is an effect of the catalogue"):
        Session.of(session.measured, effects=["hanger_mass"])


def test_forces_of_a_finger_are_those_of_its_name_and_double_with_the_load() -> None:
    finger = read_finger("an1979_middle")
    posture: dict[str, float | list[float]] = {"MCP": 20.0, "PIP": [65.0, 30.0], "DIP": 40.0}
    by_name, by_value = predict("an1979_middle", posture, {"FDP": 500.0}), predict(finger, posture, {"FDP": 500.0})
    np.testing.assert_array_equal(by_name.tip_force_N, by_value.tip_force_N)
    twice = predict(finger, posture, {"FDP": 1000.0})
    np.testing.assert_allclose(twice.bone_force_N, 2.0 * by_value.bone_force_N, rtol=1e-12)
    pulled = predict(finger, posture, tensions_N={"FDP": 500.0 * 9.81e-3})
    np.testing.assert_allclose(pulled.tip_force_N, by_value.tip_force_N, rtol=1e-12)
    assert len(pulled) == 2


def test_a_session_predicts_with_its_fitted_model(session: Session, tmp_path: Path) -> None:
    fit = refit(session)
    posture, load = {"PIP": 45.0, "DIP": 10.0}, {"FDP": 500.0}
    fitted = predict(session.at(fit), posture, load).tip_force_N
    revision = save(session, fit, tmp_path / "mean.json")
    same = predict(revision, posture, load, tension_factor=session.measured.tension_factor)
    np.testing.assert_allclose(fitted, same.tip_force_N, rtol=1e-6)
    assert not np.allclose(fitted, predict(session, posture, load).tip_force_N, rtol=1e-3)
    worn, whole = session.at_values({"worn_pulley.FDP": 10.0}), predict(session, posture, load)
    np.testing.assert_allclose(predict(worn, posture, load).tip_force_N, 0.9 * whole.tip_force_N, rtol=1e-9)


def test_weights_of_a_session_pull_as_they_did_in_it(session: Session) -> None:
    """With the session's friction factor and gravity; a finger alone knows of no friction."""
    assert session.measured.tension_factor == 0.835
    load = ({"PIP": 65.0, "DIP": 50.0}, {"FDP": 950.0})
    own, stated = predict(session, *load), predict(session, *load, tension_factor=0.835, gravity_m_s2=9.81)
    np.testing.assert_array_equal(own.tip_force_N, stated.tip_force_N)
    pulled = predict(session, load[0], tensions_N={"FDP": 0.835 * 9.81e-3 * 950.0})
    np.testing.assert_allclose(own.tip_force_N, pulled.tip_force_N, rtol=1e-12)
    whole = predict(session, *load, tension_factor=1.0).tip_force_N
    np.testing.assert_allclose(own.tip_force_N, 0.835 * whole, rtol=1e-12)
    np.testing.assert_allclose(predict(session.model.finger, *load).tip_force_N, whole, rtol=1e-12)
    elsewhere = replace(session.measured, session=session.measured.session.model_copy(update={"gravity_m_s2": 9.9}))
    light = predict(replace(session, measured=elsewhere), *load)
    np.testing.assert_allclose(light.tip_force_N, own.tip_force_N * 9.9 / 9.81, rtol=1e-12)


def test_a_refit_refuses_what_it_cannot_do(session: Session) -> None:
    with pytest.raises(InputError, match="expected map or slsqp"):
        refit(session, "newton")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="plane 'space' with method 'slsqp'"):
        refit(session, "slsqp", plane="space")


def test_a_model_that_is_not_there_is_said_in_a_line(tmp_path: Path) -> None:
    for asked in (lambda: read_revision(tmp_path / "no.json"), lambda: predict(tmp_path / "no.json", {}, {"FDP": 1.0})):
        with pytest.raises(InputError, match="no model file"):
            asked()


def test_a_prediction_refuses_what_it_cannot_use() -> None:
    posture = {"PIP": 65.0, "DIP": 50.0}
    with pytest.raises(InputError, match="no load; expected one of masses_g and tensions_N"):
        predict("an1979_middle", posture)
    with pytest.raises(InputError, match="below zero"):
        predict("an1979_middle", posture, {"FDP": -1.0})
    with pytest.raises(InputError, match="joint 'KNEE'"):
        predict("an1979_middle", {"KNEE": 1.0}, {"FDP": 1.0})
    with pytest.raises(InputError, match="FDP: 'heavy'"):
        predict("an1979_middle", posture, {"FDP": "heavy"})
    with pytest.raises(InputError, match=r"mass or tension of 1e\+07; expected at most 1e\+06"):
        predict("an1979_middle", posture, {"FDP": 1e7})
    with pytest.raises(InputError, match="angle of 400 degrees; expected -180 to 180"):
        predict("an1979_middle", posture | {"MCP": 400.0}, {"FDP": 1.0})


@pytest.mark.parametrize("factor", [-1.0, 0.0, 8.35, float("nan"), float("inf")])
def test_a_factor_that_no_friction_gives_is_refused(factor: float) -> None:
    with pytest.raises(InputError, match=f"tension_factor {factor:g}; expected the friction correction c, above 0 and"):
        predict("an1979_middle", {"PIP": 65.0, "DIP": 50.0}, {"FDP": 950.0}, tension_factor=factor)


@pytest.mark.parametrize("gravity", [-9.81, 0.0, 981.0, float("nan")])
def test_a_gravity_of_no_place_is_refused(gravity: float) -> None:
    with pytest.raises(InputError, match="5 to 20 m/s2"):
        predict("an1979_middle", {"PIP": 65.0, "DIP": 50.0}, {"FDP": 950.0}, gravity_m_s2=gravity)
