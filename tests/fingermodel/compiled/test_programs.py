"""Stored programs: the same answer from what was traced now, from what was kept, and from a file that is damaged."""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Barrier
from typing import Any, Literal, NamedTuple, final

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from filelock import FileLock
from jax import Array

from fingermodel.budget import Budget
from fingermodel.comparison.observations import Observations
from fingermodel.compiled import programs
from fingermodel.compiled.compilation import prepare_jax
from fingermodel.compiled.programs import stored
from fingermodel.effects.user import load_effect
from fingermodel.fingers import Topology
from fingermodel.fingers.files import read_finger
from fingermodel.fitting.identification import reading_slopes, solve
from fingermodel.fitting.problems import DIFFERENTIATED, residual_at
from fingermodel.model import Model, predict_case
from fingermodel.parameters import Parameter, two_sided
from fingermodel.session import Session
from fingermodel.stages import Effect, Layout, LoadCaseInput, State
from tests.own_effect import python_file
from tests.simulator import draw_session
from tests.stated import stated_problem


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


def test_what_a_killed_process_left_empty_is_removed(cache: Path) -> None:
    """JAX would complain of it at every start."""
    for name, content in (("jit_one-1f-cache", b""), ("jit_two-2e-cache", b"x"), ("notes", b"")):
        (cache.parent / name).write_bytes(content)
    prepare_jax()
    assert {file.name for file in cache.parent.iterdir()} == {"jit_two-2e-cache", "notes"}


def test_a_place_that_cannot_be_written_is_no_error(cache: Path) -> None:
    for folder in (cache, cache.with_name("locks")):
        folder.write_text("a file where the folder should be", encoding="utf-8")
    assert float(program([])(Shape(2), np.arange(3.0)).total) == 5.0


def test_of_those_that_start_at_once_one_makes_a_program(cache: Path) -> None:
    traced: list[int] = []
    together = Barrier(2)

    class Slow(list[int]):
        def append(self, power: int) -> None:
            traced.append(power)
            time.sleep(0.3)

    def start() -> float:
        run = program(Slow())
        together.wait()
        return float(run(Shape(2), np.arange(3.0)).total)

    with ThreadPoolExecutor(2) as both:
        answers = [both.submit(start) for _ in range(2)]
        assert [answer.result() for answer in answers] == [5.0, 5.0]
    assert traced == [2]


def test_a_program_is_kept_once_it_is_compiled_and_waits_for_no_other_for_ever(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(programs, "WAIT_S", 0.1)
    program([])(Shape(2), np.arange(3.0))
    (file,) = cache.iterdir()
    file.unlink()
    with FileLock(cache.with_name("locks") / file.name):
        assert float(program([])(Shape(2), np.arange(3.0)).total) == 5.0
    assert file.exists()


def test_it_can_be_differentiated(cache: Path) -> None:
    slope = jax.grad(lambda x: program([])(Shape(2), x).total)(jnp.arange(3.0))
    np.testing.assert_array_equal(slope, [0.0, 2.0, 4.0])


def test_an_effect_from_a_file_is_traced_in_every_process(cache: Path, tmp_path: Path) -> None:
    bench = Session.open("synek2019_H01", catalogue=False)
    model = Model(
        read_finger("an1979_middle"), bench.model.layout, bench.model.budget, (load_effect(python_file(tmp_path)),)
    )
    solve(stated_problem(model, bench.observations), model.parameters.initial, evaluations=1)
    assert not cache.exists()


def test_an_effect_that_does_not_act_is_skipped_without_a_trace() -> None:
    bench = Session.open("synek2019_H01")
    problem = stated_problem(bench.model, bench.observations)
    start = problem.centre + 0.3 * problem.scale * np.where(problem.free, 1.0, 0.0)
    skipped, whole = solve(problem, start, evaluations=1), problem.whitener @ reading_slopes(problem, start)
    # What is compiled together is rounded together: nothing but the last digit.
    np.testing.assert_allclose(skipped.residual, residual_at(problem, start), rtol=1e-12, atol=1e-12)
    effects = ~problem.free & bench.model.parameters.of_kind("effect")
    np.testing.assert_allclose(skipped.jacobian[:, problem.free], whole[:, problem.free], rtol=1e-9, atol=1e-9)
    assert not skipped.jacobian[:, effects].any()
    assert np.abs(whole[:, effects]).sum() > 0.0


def test_preparing_load_cases_and_readings_compiles_nothing() -> None:
    """A small program for each new shape takes some 10 ms; a session had fifty of them."""
    bench = Session.open("DEV-01")
    inputs, problem = bench.observations.inputs, stated_problem(bench.model, bench.observations)
    events: list[str] = []

    def listener(event: str, duration_secs: float, **_: str | int) -> None:
        events.append(f"{event} took {duration_secs} s")

    jax.monitoring.register_event_duration_secs_listener(listener)
    try:
        # Shapes that nothing else in these tests has.
        odd = LoadCaseInput.batch(**{k: np.repeat(np.asarray(v), 3, axis=0) for k, v in inputs._asdict().items()})
        part = odd.rows(np.arange(61))
        thinner = replace(problem, rows=problem.rows[:77], whitener=np.eye(77), _fitted=[])
        pieces = thinner.fitted_readings.differentiated.cases
    finally:
        jax.monitoring.unregister_event_duration_listener(listener)
    assert not events
    assert part.tension.shape == (61, len(bench.model.finger.topology.muscles))
    assert part.setting.dtype == inputs.setting.dtype
    np.testing.assert_array_equal(np.asarray(part.posture)[:3], np.asarray(inputs.posture)[[0, 0, 0]])
    assert {case.tension.shape[0] for case in pieces.cases} == {DIFFERENTIATED}


def test_a_session_of_other_cases_settings_and_mountings_is_no_other_program(tmp_path: Path) -> None:
    further = [("pinch", "tip", {"FDP": 500.0}), ("claw", "bone", {"EDC": 500.0})]
    for name, more in (("before", []), ("after", further)):
        draw_session(tmp_path / name, 1, protocol="three_levels", further=more)
    before, after = (Session.open(str(tmp_path / name)) for name in ("before", "after"))
    tip_alone = before.model.layout
    tip_alone = replace(tip_alone, mountings=tuple(m for m in tip_alone.mountings if m[0] == "tip"))
    models = [before.model, after.model, Model(before.model.finger, tip_alone, Budget(), before.model.effects)]
    assert len({len(model.parameters) for model in models}) == 3
    assert len({len(model.layout.settings) for model in models[:2]}) == 2
    assert len({model.compact.structure for model in models}) == 1
    # What is kept on disk is found by the structure's text.
    assert len({repr(model.compact.structure) for model in models}) == 1
    shapes = set()
    for bench in (before, after):
        fitted = stated_problem(bench.model, bench.observations).fitted_readings
        for pieces in (fitted.every_case, fitted.differentiated.cases):
            shapes |= {
                str(jax.tree.map(np.shape, (case, own))) for case, own in zip(pieces.cases, pieces.own, strict=True)
            }
    assert len(shapes) == 2


def test_each_case_has_the_parameters_of_its_setting_and_mounting(tmp_path: Path) -> None:
    draw_session(tmp_path, 1, protocol="three_levels")
    bench = Session.open(str(tmp_path))
    model, observations = bench.model, bench.observations
    # The last ten cases after the cell had been moved.
    moved = np.arange(len(observations.ids)) >= len(observations.ids) - 10
    layout = replace(model.layout, mountings=(*model.layout.mountings, *((m, 1) for m, _ in model.layout.mountings)))
    mounting = np.asarray(observations.inputs.mounting) + len(model.layout.mountings) * moved
    inputs = observations.inputs._replace(mounting=jnp.asarray(mounting))
    _agrees_case_by_case(replace(model, layout=layout), replace(observations, inputs=inputs, layout=layout))


@final
@dataclass(frozen=True)
class Looser(Effect):
    """An effect of a user's, which has a parameter for each setting or mounting and does not say so."""

    each: Literal["setting", "mounting"]
    name = "looser"
    stage = "tension"

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        here, name = (
            (layout.settings, layout.setting_name)
            if self.each == "setting"
            else (layout.mountings, layout.mounting_name)
        )
        return tuple(two_sided(f"looser.{name(k)}", "1", 0.2) for k in range(len(here)))

    def tension(self, p: Array, case: LoadCaseInput, state: State) -> State:
        return state._replace(tension=state.tension * (1.0 + p[getattr(case, self.each)]))


def test_an_effect_with_parameters_of_its_own_for_each_setting_keeps_them_all(tmp_path: Path) -> None:
    draw_session(tmp_path, 1, protocol="three_levels")
    bench = Session.open(str(tmp_path))
    finger, layout = bench.model.finger, bench.model.layout
    assert len(layout.settings) > 1
    _agrees_case_by_case(Model(finger, layout, Budget(), (Looser("setting"),)), bench.observations)


def test_an_effect_with_parameters_of_its_own_for_each_mounting_is_given_those_of_the_session() -> None:
    bench = Session.open("synek2019_H01", catalogue=False)
    inputs, settings = bench.observations.inputs, bench.model.layout.settings
    bone = inputs.rows(np.flatnonzero(np.asarray(inputs.at_bone)))._replace(mounting=jnp.zeros(8, int))
    assert len(bone.at_bone) == 8
    model = Model(bench.model.finger, Layout(settings, (("bone", 0),)), Budget(), (Looser("mounting"),))
    theta = np.where([name == "looser.bone" for name in model.parameters.names], 0.1, model.initial)
    plain, looser = (np.asarray(model.predict(bone, vector).reading) for vector in (model.initial, theta))
    np.testing.assert_allclose(looser[:, :3], 1.1 * plain[:, :3], rtol=1e-9)


def _agrees_case_by_case(model: Model, observations: Observations) -> None:
    """Predictions and slopes are those of the model's own structure, one case at a time."""
    inputs, problem = observations.inputs, stated_problem(model, observations)
    rng = np.random.default_rng(1)
    off = problem.centre + 0.2 * problem.scale * rng.uniform(0.5, 1.5, len(problem.centre))
    theta = np.clip(off, problem.lower, problem.upper)
    chosen = [0, 40, len(inputs.setting) - 1]
    cases = [LoadCaseInput(*(field[i] for field in inputs)) for i in chosen]
    alone = [predict_case(model.structure, model.values, jnp.asarray(theta), case).reading for case in cases]
    reading = np.asarray(model.predict(inputs, theta).reading)
    assert reading.shape == (len(observations.ids), 6)
    np.testing.assert_allclose(reading[chosen], alone, rtol=1e-9, atol=1e-9)
    # More cases than a program predicts at once.
    thrice = inputs.rows(np.tile(np.arange(len(reading)), 3))
    np.testing.assert_array_equal(np.asarray(model.predict(thrice, theta).reading), np.tile(reading, (3, 1)))
    # What the solver picks out of them.
    start = np.where(problem.free, theta, problem.centre)
    free = solve(problem, start, evaluations=1).jacobian[:, problem.free]
    np.testing.assert_allclose(
        free, (problem.whitener @ reading_slopes(problem, start))[:, problem.free], rtol=1e-7, atol=1e-7
    )
    slopes = np.asarray(model.jacobian(inputs, theta)).reshape(-1, len(theta))[problem.rows]
    np.testing.assert_allclose(
        -(problem.whitener @ reading_slopes(problem, theta)),
        problem.whitener @ slopes * problem.scale,
        rtol=1e-7,
        atol=1e-7,
    )
