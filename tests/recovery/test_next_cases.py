"""Load cases that test a finding, and predictions of them that are frozen before they are measured."""

from __future__ import annotations

import copy
from pathlib import Path

import pytest

from daq.errors import ModelError
from fingermodel.diagnosis.diagnose import Diagnosis
from fingermodel.diagnosis.next_cases.frozen import freeze, read_frozen, score, write_frozen
from fingermodel.diagnosis.next_cases.next_cases import PlannedReading, feasible, name_of, plan_next
from fingermodel.session import Session
from server.application.diagnosing import run_diagnosis
from tests.simulator import draw_session

HOOK, FLEXED = "hook", "major_flexion"


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> tuple[Session, Diagnosis, Path]:
    folder = tmp_path_factory.mktemp("hanger")
    draw_session(folder, 11, {"hanger_mass": 30.0}, nuisance_scale=0.7)
    bench = Session.open(folder)
    return bench, run_diagnosis(bench), folder


def test_the_next_case_tests_the_finding(planned: tuple[Session, Diagnosis, Path]) -> None:
    _, found, _ = planned
    plan = plan_next(found)
    assert found.verdict.effects == ("hanger_mass",)
    assert plan.cases
    assert plan.explanations == {"hanger_mass": 0.5, "nothing missing": 0.5}
    assert "nat; if both are equally probable before, probability of the true one" in plan.text
    assert plan.cases[0].information_nat >= plan.cases[-1].information_nat > 0.0
    assert any("weigh the hangers" in text for text in plan.instruments)
    # What was read already has taught what it can.
    o = found.session.observations
    read = list(zip(o.postures, o.locations, o.masses_g, strict=True))
    assert all((c.posture, c.location, dict(c.masses_g)) not in read for c in feasible(found))


def test_a_frozen_prediction_confirms_or_refutes(planned: tuple[Session, Diagnosis, Path], tmp_path: Path) -> None:
    bench, found, _ = planned
    measured = [PlannedReading(p, "tip", {"FDS": 950.0}) for p in (HOOK, "minor_flexion", FLEXED)]
    document = freeze(plan_next(found, measured), "earlier", "specimen", "model", None, bench.observations.ids)
    path = tmp_path / "frozen.json"
    write_frozen(document, path)
    with pytest.raises(ModelError, match="never overwritten"):
        write_frozen(document, path)
    # The rig that has the hanger bears the finding out, the same rig without it does not.
    earlier = score(read_frozen(path), name_of(found.best), "earlier", bench.observations)
    assert earlier.confirmed is None
    told = score(read_frozen(path), name_of(found.best), "later", bench.observations)
    assert len(told.cases) == len(document["cases"])
    assert told.confirmed is not False
    clean = tmp_path / "clean"
    clean.mkdir()
    draw_session(clean, 11, None, nuisance_scale=0.7)
    other = score(read_frozen(path), name_of(found.best), "later", Session.open(clean).observations)
    assert other.confirmed is not True
    # What was frozen adds to a model without effects: under one that holds them the same name says something else.
    assert score(document, name_of(found.best), "later", bench.observations, ("hanger_mass.m0",)).confirmed is None
    # An explanation that contains the finding says nearly the same, and is no rival.
    more = f"{name_of(found.best)} + worn_pulley.FDP"
    with_more = copy.deepcopy(document)
    with_more["explanations"][more] = 0.01
    for case in with_more["cases"]:
        case["predictions"][more] = case["predictions"][name_of(found.best)]
    again = score(with_more, name_of(found.best), "later", bench.observations)
    assert (again.confirmed, again.text) == (told.confirmed, told.text)
    path.write_text(path.read_text(encoding="utf-8").replace('"tip"', '"bone"'), encoding="utf-8")
    with pytest.raises(ModelError, match="changed after"):
        read_frozen(path)
