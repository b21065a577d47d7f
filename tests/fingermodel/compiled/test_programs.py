"""Stored programs: the same answer from what was traced now, from what was kept, and from a file that is damaged."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fingermodel.compiled.programs import stored
from fingermodel.effects.user import load_effect
from fingermodel.fingers.files import read_finger
from fingermodel.fitting.identification import solve, whole_slopes
from fingermodel.fitting.problems import map_problem, residual_at
from fingermodel.model import Model, predict_case
from fingermodel.session import Session
from fingermodel.stages import LoadCaseInput
from tests.own_effect import python_file
from tests.simulator import draw_session


class Answer(NamedTuple):
    total: Any
    each: Any


@dataclass(frozen=True)
class Shape:
    power: int


@pytest.fixture
def cache(tmp_path: Path) -> Iterator[Path]:
    before = jax.config.values["jax_compilation_cache_dir"]
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield tmp_path / "traced"
    jax.config.update("jax_compilation_cache_dir", before)


def program(traced: list[int]) -> Any:
    """Make a program that says when it is traced."""

    def sum_of_powers(shape: Shape, x: Any) -> Answer:
        traced.append(shape.power)
        return Answer(jnp.sum(x**shape.power), x**shape.power)

    return stored(Answer)(sum_of_powers)


def test_what_was_kept_answers_as_what_was_traced(cache: Path) -> None:
    x = np.arange(4.0)
    first: list[int] = []
    second: list[int] = []
    traced = program(first)(Shape(3), x)
    kept = program(second)(Shape(3), x)
    assert first
    assert not second
    assert isinstance(kept, Answer)
    np.testing.assert_array_equal(kept.each, traced.each)
    assert float(kept.total) == 36.0
    assert len(list(cache.iterdir())) == 1


def test_another_structure_or_shape_is_another_program(cache: Path) -> None:
    traced: list[int] = []
    run = program(traced)
    assert float(run(Shape(2), np.arange(3.0)).total) == 5.0
    assert float(run(Shape(1), np.arange(3.0)).total) == 3.0
    assert float(run(Shape(1), np.arange(5.0)).total) == 10.0
    assert len(list(cache.iterdir())) == 3


@pytest.mark.parametrize("damage", [b"", b"not a program", None])
def test_a_damaged_file_is_traced_anew(cache: Path, damage: bytes | None) -> None:
    program([])(Shape(2), np.arange(3.0))
    (file,) = cache.iterdir()
    file.write_bytes(file.read_bytes()[:40] if damage is None else damage)
    again: list[int] = []
    assert float(program(again)(Shape(2), np.arange(3.0)).total) == 5.0
    assert again
    after: list[int] = []
    assert float(program(after)(Shape(2), np.arange(3.0)).total) == 5.0
    assert not after


def test_a_place_that_cannot_be_written_is_no_error(cache: Path) -> None:
    cache.write_text("a file where the folder should be", encoding="utf-8")
    assert float(program([])(Shape(2), np.arange(3.0)).total) == 5.0


def test_it_can_be_differentiated(cache: Path) -> None:
    slope = jax.grad(lambda x: program([])(Shape(2), x).total)(jnp.arange(3.0))
    np.testing.assert_array_equal(slope, [0.0, 2.0, 4.0])


def test_an_effect_from_a_file_is_traced_in_every_process(cache: Path, tmp_path: Path) -> None:
    bench = Session.open("synek2019_H01", catalogue=False)
    model = Model(
        read_finger("an1979_middle"), bench.model.layout, bench.model.budget, (load_effect(python_file(tmp_path)),)
    )
    solve(map_problem(model, bench.observations), model.parameters.initial, evaluations=1)
    assert not cache.exists()


def test_an_effect_that_does_not_act_is_skipped_without_a_trace() -> None:
    bench = Session.open("synek2019_H01")
    problem = map_problem(bench.model, bench.observations)
    start = problem.centre + 0.3 * problem.scale * np.where(problem.free, 1.0, 0.0)
    skipped, whole = solve(problem, start, evaluations=1), whole_slopes(problem, start)
    # What is compiled together is rounded together: nothing but the last digit.
    np.testing.assert_allclose(skipped.residual, residual_at(problem, start), rtol=1e-12, atol=1e-12)
    effects = ~problem.free & bench.model.parameters.of_kind("effect")
    np.testing.assert_allclose(skipped.jacobian[:, problem.free], whole[:, problem.free], rtol=1e-9, atol=1e-9)
    assert not skipped.jacobian[:, effects].any()
    assert np.abs(whole[:, effects]).sum() > 0.0


def test_preparing_load_cases_and_readings_compiles_nothing() -> None:
    """A small program for each new shape takes some 10 ms; a session had fifty of them."""
    bench = Session.open("DEV-01")
    inputs = bench.observations.inputs
    events: list[str] = []

    def listener(event: str, duration_secs: float, **_: str | int) -> None:
        events.append(f"{event} took {duration_secs} s")

    jax.monitoring.register_event_duration_secs_listener(listener)
    try:
        # Shapes that nothing else in these tests has.
        odd = LoadCaseInput.batch(**{k: np.repeat(np.asarray(v), 3, axis=0) for k, v in inputs._asdict().items()})
        part = odd.rows(np.arange(61))
        problem = map_problem(bench.model, bench.observations)
        thinner = replace(problem, rows=problem.rows[:77], whitener=problem.whitener[:77, :77], _fitted=[])
        rows = thinner.fitted_readings.at
    finally:
        jax.monitoring.unregister_event_duration_listener(listener)
    assert not events
    assert part.tension.shape == (61, len(bench.model.finger.topology.muscles))
    assert part.setting.dtype == inputs.setting.dtype
    np.testing.assert_array_equal(np.asarray(part.posture)[:3], np.asarray(inputs.posture)[[0, 0, 0]])
    # Rounded up.
    assert rows.shape == (128,)


def test_a_session_that_grows_by_a_few_cases_finds_its_programs_compiled(tmp_path: Path) -> None:
    further = [("pinch", "tip", {"FDP": 500.0}), ("claw", "bone", {"EDC": 500.0})]
    for name, more in (("before", []), ("after", further)):
        draw_session(tmp_path / name, 1, protocol="three_levels", further=more)
    before, after = (Session.open(str(tmp_path / name)) for name in ("before", "after"))
    grown = len(after.observations.ids) - len(before.observations.ids)
    settings = len(after.observations.layout.settings) - len(before.observations.layout.settings)
    assert (grown, settings) == (2, 2)
    assert len(after.model.parameters) > len(before.model.parameters)
    given = []
    for bench in (before, after):
        fitted = map_problem(bench.model, bench.observations).fitted_readings
        given.append((fitted.every_case, fitted.inputs, fitted.components, fitted.at, bench.model.placed(bench.theta)))
    assert before.model.compiled == after.model.compiled
    assert jax.tree.map(np.shape, given[0]) == jax.tree.map(np.shape, given[1])
    # From the first cases on, as the service compares them while they are measured; a single prediction stays one.
    part = before.observations.inputs.rows
    assert [len(part(np.arange(n)).filled().setting) for n in (1, 2, 5, 16, 17)] == [1, 16, 16, 16, 32]


def test_room_for_more_settings_and_cases_changes_no_answer(tmp_path: Path) -> None:
    draw_session(tmp_path, 1, protocol="three_levels")
    bench = Session.open(str(tmp_path))
    model, inputs = bench.model, bench.observations.inputs
    assert len(model.placed(model.initial)) > len(model.parameters)
    assert inputs.filled().setting.shape[0] > inputs.setting.shape[0]
    problem = map_problem(model, bench.observations)
    theta = np.clip(problem.centre + 0.2 * problem.scale, problem.lower, problem.upper)
    # Of the model's own structure, case by case.
    cases = [LoadCaseInput(*(field[i] for field in inputs)) for i in (0, 40, len(inputs.setting) - 1)]
    alone = [predict_case(model.structure, model.values, jnp.asarray(theta), case).reading for case in cases]
    reading = np.asarray(model.predict(inputs, theta).reading)
    assert reading.shape == (len(bench.observations.ids), 6)
    np.testing.assert_allclose(reading[[0, 40, -1]], alone, rtol=1e-9, atol=1e-9)
    # What the solver picks out of them.
    start = np.where(problem.free, theta, problem.centre)
    free = solve(problem, start, evaluations=1).jacobian[:, problem.free]
    np.testing.assert_allclose(free, whole_slopes(problem, start)[:, problem.free], rtol=1e-7, atol=1e-7)
    slopes = np.asarray(model.jacobian(inputs, theta)).reshape(-1, len(theta))[problem.rows]
    np.testing.assert_allclose(
        whole_slopes(problem, theta), -problem.whitener @ slopes * problem.scale, rtol=1e-7, atol=1e-7
    )
