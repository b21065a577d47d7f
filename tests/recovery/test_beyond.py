"""What rigs are known to do beyond the catalogue: straightened forms against the ready-made effects, and sessions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from fingermodel.diagnosis.beyond import Form, forms, known_beyond
from fingermodel.diagnosis.candidates import NOTHING_MISSING, candidates_of
from fingermodel.diagnosis.evidence import KNOWN_THINGS, Known
from fingermodel.diagnosis.fitted import Fitted
from fingermodel.diagnosis.fitter import Fitter

from fingermodel.diagnosis.answer import answer
from fingermodel.effects.user import shipped_effects
from fingermodel.problems import Problem, map_problem
from server.commands.additions import add_bench
from server.commands.diagnosis import run_diagnosis
from server.workflow import Bench, open_bench
from tests.simulator import draw_session


def problem_of(bench: Bench) -> Problem:
    return map_problem(bench.model, bench.observations)


def base_of(bench: Bench) -> Fitted:
    problem = problem_of(bench)
    return Fitter(problem).fit(NOTHING_MISSING, [problem.centre], 60, finely=True)


def known_in(bench: Bench) -> tuple[Known, ...]:
    return known_beyond(base_of(bench), candidates_of(bench.model))


def forms_of(bench: Bench, name: str) -> list[Form]:
    problem = problem_of(bench)
    return [f for f in forms(problem, problem.centre) if f.name == name]


def test_every_known_thing_is_a_ready_made_effect() -> None:
    bench = open_bench("DEV-08", catalogue=True)
    problem = problem_of(bench)
    names = {f.name for f in forms(problem, problem.centre)}
    assert names <= set(shipped_effects())
    assert len(shipped_effects()) == KNOWN_THINGS
    for name in names:
        assert sum(f.share for f in forms_of(bench, name)) <= 1.0 + 1e-9


@pytest.mark.parametrize(
    ("name", "form", "parameters"),
    [
        ("force_shunt", 0, {"tip": 10.0}),
        ("force_shunt", 2, {"bone": 10.0}),
        ("edc_subluxation", 0, {"slide": 5.0}),
        ("hysteresis", 0, {"h": 5.0}),
    ],
)
def test_a_straightened_form_is_the_slope_of_the_ready_made_effect(
    name: str, form: int, parameters: dict[str, float]
) -> None:
    bench = open_bench("DEV-02", catalogue=True, effects=[name])
    # Every second case as if weight had been taken off, so that something can lag.
    turned = np.arange(len(bench.observations.ids)) % 2 == 1
    inputs = bench.observations.inputs._replace(unloading=jnp.asarray(turned))
    bench = replace(bench, observations=replace(bench.observations, inputs=inputs))
    table = bench.model.parameters
    moved = table.centre.copy()
    for parameter, width in parameters.items():
        moved[table.index[f"{name}.{parameter}"]] = 1e-3 * width
    now = np.asarray(bench.model.predict(inputs, table.centre).reading)
    change = (np.asarray(bench.model.predict(inputs, moved).reading) - now) / 1e-3
    found = forms_of(bench, name)[form].columns[:, :, 0]
    assert np.abs(change).max() > 0.01
    if name == "hysteresis":
        # The straightened form also has the torque of abduction lag, for fingers that have one.
        found, change = found[:, [0, 1, 5]], change[:, [0, 1, 5]]
    np.testing.assert_allclose(found, change, atol=2e-3 * np.abs(change).max())


@pytest.mark.parametrize(
    ("seed", "outside"),
    [
        (1018, "force_shunt"),
        (1012, "edc_subluxation"),
        pytest.param(1003, "seating", marks=pytest.mark.full),
        pytest.param(1011, "tissue_relaxation", marks=pytest.mark.full),
    ],
)
def test_a_known_thing_is_recognised_in_other_physics(tmp_path: Path, seed: int, outside: str) -> None:
    draw_session(tmp_path, seed, outside=outside, protocol="three_levels" if seed % 4 == 3 else "dev")
    found = known_in(open_bench(tmp_path, catalogue=True))
    assert found
    assert found[0].name == outside


def test_it_is_not_seen_where_nothing_is_missing() -> None:
    bench = open_bench("DEV-01", catalogue=True)
    nothing = base_of(bench)
    # Half the prior is on nothing: a gain that cannot overturn it names nothing.
    found = known_beyond(nothing, candidates_of(bench.model))
    assert all(k.log_evidence - nothing.log_evidence < 3.0 for k in found)


def test_it_is_not_offered_where_the_model_has_it(tmp_path: Path) -> None:
    draw_session(tmp_path, 1018, outside="force_shunt")
    bench = open_bench(tmp_path, catalogue=True)
    nothing = base_of(bench)
    names = {k.name for k in known_beyond(nothing, candidates_of(bench.model), had=["force_shunt"])}
    assert "force_shunt" not in names


def test_it_is_told_and_can_be_added(tmp_path: Path) -> None:
    draw_session(tmp_path, 1012, outside="edc_subluxation")
    bench = open_bench(tmp_path, catalogue=True)
    found = run_diagnosis(bench)
    body = answer(found)
    assert (body["verdict"], body["effects"]) == ("none_of_catalogue", [])
    assert body["ready_made"][0]["effect"] == "edc_subluxation"
    assert body["ready_made"][0]["probability"] > 0.9
    assert "edc_subluxation" in body["sentence"]
    held = open_bench(tmp_path, catalogue=True, effects=["edc_subluxation"])
    before, addition, after = add_bench(held, ["edc_subluxation"], ())
    assert addition.log_evidence_gain > 100.0
    unseen = [c.select(role="validation").errors("space").rmse_N for c in (before, after)]
    assert None not in unseen
    assert unseen[1] < 0.6 * unseen[0]  # type: ignore[operator]
