"""Population runs: what is drawn, and that neither place, order nor an interruption changes what comes out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from daq.errors import InputError
from fingermodel.diagnosis.posterior.hyper import Hyperparameters
from fingermodel.diagnosis.session_model.session import session_of
from fingermodel.diagnosis.settings import TENSION
from fingermodel.session import Session
from server.service.jobs import population
from server.service.jobs.bench_input import BenchInput
from server.service.jobs.executors import DaskExecutor, ExecutorSettings, ProcessExecutor
from server.service.jobs.inputs import PopulationInput
from server.service.jobs.population import drawn, run
from server.service.jobs.population_summary import summarise
from server.service.jobs.worker import Said, Tell
from tests.server.service.few_effects import few_effects
from tests.server.service.shipped import bench_input

NAMES = ("synek2019_H01", "synek2019_H02")
SETS = ((), ("zero_offset.tip",))


@pytest.fixture(autouse=True, scope="module")
def _two_effects() -> Iterator[None]:
    with few_effects():
        yield


class Kept:
    """What a run tells."""

    def __init__(self, parts: Mapping[str, Any] | None = None, most: int = 10**9) -> None:
        self.parts: dict[str, Any] = dict(parts or {})
        self.made: list[str] = []
        self.progress: list[float] = []
        self.tell = Tell(self._hear, dict(self.parts))
        self._most = most

    def _hear(self, said: Said) -> None:
        if said[0] == "progress":
            self.progress.append(said[1])
        elif len(self.made) == self._most:
            raise KeyboardInterrupt
        else:
            self.made.append(said[1])
            self.parts[said[1]] = said[2]


def asked(**changes: Any) -> PopulationInput:
    return replace(PopulationInput(tuple(bench_input(n) for n in NAMES), SETS, bootstrap=2, seed=7), **changes)


@pytest.fixture(scope="module")
def plain() -> tuple[dict[str, Any], Kept]:
    """A run in this process, never interrupted."""
    kept = Kept()
    return run(asked(), kept.tell), kept


def test_a_run_fits_every_replicate_once_and_tells_its_share(plain: tuple[dict[str, Any], Kept]) -> None:
    result, kept = plain
    assert sorted(kept.made) == sorted(f"{n}/{e}/{k}" for n in NAMES for e in (0, 1) for k in range(3))
    assert kept.progress == sorted(kept.progress)
    assert (result["fits"], result["bootstrap"], result["seed"]) == (12, 2, 7)
    each = result["sets"][0]["sessions"][NAMES[0]]
    errors = each["rmse_N"]["identification/tip"]["sagittal"]
    values = [kept.parts[f"{NAMES[0]}/0/{k}"]["rmse_N"]["identification/tip"]["sagittal"] for k in range(3)]
    assert errors["estimate"] == values[0]
    assert errors["mean"] == pytest.approx(np.mean(values[1:]))
    assert min(values[1:]) <= errors["low"] <= errors["high"] <= max(values[1:])
    assert errors["sd"] > 0.0
    both = [result["sets"][0]["sessions"][n]["rmse_N"]["validation/bone"]["space"]["estimate"] for n in NAMES]
    over = result["sets"][0]["specimens"]["rmse_N"]["validation/bone"]["space"]
    assert (over["specimens"], over["mean"], over["sd"]) == (
        2,
        pytest.approx(np.mean(both)),
        pytest.approx(np.std(both, ddof=1)),
    )


@pytest.mark.parametrize("place", ["processes", pytest.param("dask", marks=pytest.mark.full)])
def test_the_place_changes_nothing(
    plain: tuple[dict[str, Any], Kept], place: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def opened(_: ExecutorSettings) -> ProcessExecutor | DaskExecutor:
        return ProcessExecutor(2) if place == "processes" else DaskExecutor(workers=2, processes=False)

    monkeypatch.setattr(ExecutorSettings, "open", opened)
    assert run(asked(), Kept().tell) == plain[0]


def test_an_interrupted_run_goes_on_where_it_was(plain: tuple[dict[str, Any], Kept]) -> None:
    first = Kept(most=3)
    with pytest.raises(KeyboardInterrupt):
        run(asked(), first.tell)
    second = Kept(first.parts)
    assert run(asked(), second.tell) == plain[0]
    assert sorted(first.made + second.made) == sorted(plain[1].made)


def test_estimates_under_other_grids_of_hyperparameters_are_made_anew(plain: tuple[dict[str, Any], Kept]) -> None:
    parts = dict(plain[1].parts)
    key = f"{NAMES[0]}/0/0"
    parts[key] = parts[key] | {"recipe": parts[key]["recipe"] | {"grids": "of an earlier version"}}
    again = Kept(parts)
    assert run(asked(), again.tell) == plain[0]
    assert again.made == [key]


def test_parts_of_a_session_that_has_changed_since_are_not_used(plain: tuple[dict[str, Any], Kept]) -> None:
    given = asked()
    other = BenchInput({**given.benches[1].session, "gravity_m_s2": 9.80665})
    again = Kept(plain[1].parts)
    result = run(replace(given, benches=(given.benches[0], other)), again.tell)
    assert {key.split("/")[0] for key in again.made} == {NAMES[1]}
    sessions = [r["sets"][0]["sessions"] for r in (plain[0], result)]
    assert sessions[0][NAMES[0]] == sessions[1][NAMES[0]]
    assert sessions[0][NAMES[1]] != sessions[1][NAMES[1]]


@pytest.mark.parametrize("name", [pytest.param("synek2019_H01", marks=pytest.mark.full), "DEV-01"])
def test_draws_have_the_covariance_of_the_readings_shared_tares_included(name: str) -> None:
    bench = Session.open(name, catalogue=False)
    kept = Kept()
    run(asked(benches=(bench_input(name),), effects=((),), bootstrap=0), kept.tell)
    estimate = kept.parts[f"{name}/0/0"]
    # A hyperparameter is kept as its place on its axis.
    node = [int(np.searchsorted(TENSION.values, 0.02)), *estimate["recipe"]["node"][1:]]
    scattered = {**estimate, "recipe": estimate["recipe"] | {"node": node}}
    session = session_of(bench.model, bench.observations).seen_from(np.array(estimate["recipe"]["about"]))
    problem, values = session.problem, Hyperparameters.of(session).values(tuple(node))
    assert values.errors.scatter == 0.02
    whitener = session.whitened_smooth(values.errors, frozenset()).noise
    measured = bench.observations.wrench.reshape(-1)
    every = np.array([drawn(bench, scattered, 1, name, k).wrench.reshape(-1) - measured for k in range(300)])
    rest = np.setdiff1d(np.arange(len(measured)), problem.rows)
    assert not np.nan_to_num(every[:, rest]).any(), "validation cases stay as they were measured"
    white = (whitener @ every[:, problem.rows].T).T
    correlation = white.T @ white / len(white)
    # Entries of a sample covariance of independent unit normals, of 300: sd 0.058 off the diagonal.
    assert np.abs(correlation - np.eye(len(correlation))).max() < 0.4
    assert np.sqrt(np.mean((correlation - np.eye(len(correlation))) ** 2)) == pytest.approx(300**-0.5, rel=0.1)
    again, other = (drawn(bench, scattered, seed, name, 5).wrench.reshape(-1) - measured for seed in (1, 2))
    assert np.array_equal(again, every[5], equal_nan=True)
    assert not np.array_equal(other, again, equal_nan=True)


def test_a_replicate_without_noise_is_the_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(population, "drawn", lambda bench, *_: bench.observations)
    kept = Kept()
    run(asked(benches=(bench_input(NAMES[0]),), bootstrap=1), kept.tell)
    estimate, replicate = (kept.parts[f"{NAMES[0]}/0/{k}"] for k in (0, 1))
    assert replicate["objective"] == pytest.approx(estimate["objective"], abs=1e-3)
    assert replicate["values"].keys() == estimate["values"].keys()


def test_effects_are_added_and_see_the_same_draws(plain: tuple[dict[str, Any], Kept]) -> None:
    result, kept = plain
    without, with_effect = (s["sessions"][NAMES[0]] for s in result["sets"])
    assert without["parameters"] == {}
    assert {"zero_offset.tip.x", "zero_offset.tip.y"} <= with_effect["parameters"].keys()
    # Zeros of forces are in newtons, and those of the tip's moments in newton millimetres.
    assert {found["unit"] for found in with_effect["parameters"].values()} <= {"N", "N mm"}
    assert with_effect["parameters"]["zero_offset.tip.x"]["unit"] == "N"
    for found in with_effect["parameters"].values():
        assert found["low"] < found["mean"] < found["high"]
        assert 0.0 < found["sd"] < 2.0 * (found["high"] - found["low"])
    # Priors' centre is where the effect is not: with it the same draws are fitted no worse.
    for k in range(3):
        objectives = [kept.parts[f"{NAMES[0]}/{number}/{k}"]["objective"] for number in (0, 1)]
        assert objectives[1] <= objectives[0] + 1e-3


def test_sessions_of_a_specimen_count_as_one() -> None:
    def part(specimen: str, value: float) -> dict[str, Any]:
        return {
            "specimen": specimen,
            "judged_in": "space",
            "outcome": "converged",
            "added": ["e"],
            "log_evidence_gain": 1.0,
            "units": {"e": "g"},
            "values": {"e": value},
            "rmse_N": {},
        }

    parts = {"a/0/0": part("A", 1.0), "b/0/0": part("A", 3.0), "c/0/0": part("C", 6.0)}
    parts |= {"a/0/10": part("A", 1.0), "a/0/9": part("A", 2.0) | {"outcome": "too_many_evaluations"}}
    out = summarise([["e"]], ["a", "b", "c"], parts, 0.9)["sets"][0]
    over = out["specimens"]["parameters"]["e"]
    assert (over["specimens"], over["mean"]) == (2, 4.0)
    each = out["sessions"]["a"]
    assert (each["replicates"], each["not_converged"]) == (2, 1)
    assert (each["parameters"]["e"]["mean"], each["parameters"]["e"]["sd"]) == (1.0, None)


@pytest.mark.parametrize(
    "wrong",
    [
        {"benches": ()},
        {"benches": (BenchInput({"id": "a"}), BenchInput({"id": "a"}))},
        {"effects": ()},
        {"effects": (("a", "b"), ("b", "a"))},
        {"bootstrap": -1},
        {"level": 1.0},
        {"bootstrap": 10_000, "effects": tuple((str(k),) for k in range(60))},
    ],
)
def test_what_makes_no_sense_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        asked(**wrong)
