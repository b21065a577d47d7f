"""What workers compute is what the command line answers."""

from __future__ import annotations

import json
import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.errors import InputError
from daq.plain_json import clean
from daq.sessions import FINGER_DOCUMENT as RECORDED_FINGER
from fingermodel.comparing import compare
from fingermodel.fingers.files import read_finger
from fingermodel.session import Session
from server.application.additions import add_bench
from server.application.diagnosing import diagnosis_answer, run_diagnosis
from server.application.provenance import provenance
from server.application.refitting import fit_body, refit_compared
from server.service.jobs import inputs, tasks
from server.service.jobs.bench_input import FINGER_DOCUMENT, BenchInput
from server.service.jobs.kinds import TaskKind
from server.service.jobs.service import JobService
from server.service.jobs.supervisor import Supervisor
from server.service.jobs.worker import Tell
from tests.server.service.few_effects import HERE, few_effects
from tests.server.service.jobs.test_jobs import Running
from tests.server.service.shipped import bench_input

NAME = "synek2019_H01"
TIMES = ("seconds",)
COMPILING_S = 300.0


def untimed(body: dict[str, Any]) -> dict[str, Any]:
    return {k: v for k, v in clean(body).items() if k not in TIMES}


def silent() -> Tell:
    return Tell(lambda said: None)


@pytest.mark.parametrize("name", [NAME, "DEV-01"])
def test_a_bench_is_the_same_from_its_folder_and_in_a_worker(name: str) -> None:
    given, here = pickle.loads(pickle.dumps(bench_input(name))), Session.open(name, catalogue=False)  # noqa: S301 - our own
    there = given.open()
    assert there.measured.session.model_dump() == here.measured.session.model_dump()
    assert np.array_equal(there.observations.wrench, here.observations.wrench, equal_nan=True)
    assert np.array_equal(there.observations.noise.blocks, here.observations.noise.blocks)
    assert np.array_equal(there.observations.shared_tares, here.observations.shared_tares)
    assert there.model.structure == here.model.structure
    assert np.array_equal(there.theta, here.theta)
    assert given.fingerprint == bench_input(name).fingerprint
    other = BenchInput(given.session, given.plateaus, model="synek2019_optimised")
    assert other.fingerprint != given.fingerprint
    assert other.open().model.finger.id == "synek2019_optimised"


def test_a_session_brings_its_finger_and_no_name_is_taken_for_a_path(tmp_path: Path) -> None:
    assert FINGER_DOCUMENT == RECORDED_FINGER
    given, finger = bench_input(NAME), read_finger("synek2019_optimised")
    own = BenchInput({**given.session, "finger": "of the bench", FINGER_DOCUMENT: finger.document})
    assert own.open().model.finger.id == finger.id
    path = tmp_path / "an1979_middle.yaml"
    path.write_text("format: finger/1\n")
    for session, model in ((given.session, str(path)), ({**given.session, "finger": str(path)}, None)):
        with pytest.raises(InputError, match=r"no finger .* expected one of"):
            BenchInput(session, model=model).open()
    with pytest.raises(InputError, match="the revision has format None"):
        BenchInput(given.session, model={}).open()


@pytest.fixture
def two_effects() -> Iterator[None]:
    with few_effects():
        yield


@pytest.fixture
def refitted(tmp_path: Path) -> tasks.Answer:
    """A real refit, as a job in a worker process."""
    running = Running(tmp_path)
    kind = TaskKind("refit", lambda r: inputs.RefitInput(bench_input(r["session"])), f"{HERE}.refit")
    service = JobService(running.database, running.messages, Supervisor(1), [kind], COMPILING_S)
    job = service.wait(service.submit("refit", NAME, {"session": NAME}).id, COMPILING_S)
    service.close()
    running.close()
    assert job.result is not None
    return job.result


@pytest.mark.usefixtures("two_effects")
def test_a_refit_in_a_worker_is_the_refit_of_the_command_line(refitted: tasks.Answer) -> None:
    bench = Session.open(NAME)
    before, fit, after = refit_compared(bench)
    body, revision = refitted["body"], refitted["revision"]
    expected = {"schema": "fingertwin/refit/1"} | provenance(bench) | fit_body(bench, fit, before, after)
    assert untimed(body) == untimed(expected | {"model": revision["id"]})
    digests = {"readings_sha256": "f" * 64, "measured_sha256": bench.measured.sha256}
    assert revision["session"] == {"id": NAME} | digests
    # It serves as the model of the next job.
    again = bench_input(NAME, model=json.loads(json.dumps(revision))).open(catalogue=True)
    assert again.loaded.name == revision["id"]
    assert compare(again).errors("space").rmse_N == pytest.approx(after.errors("space").rmse_N)


@pytest.mark.usefixtures("two_effects")
def test_additions_and_diagnoses_are_those_of_the_command_line() -> None:
    bench = Session.open(NAME)
    before, addition, after = add_bench(bench, ["hanger_mass"], [])
    given = bench_input(NAME)
    answer = tasks.add(inputs.AddInput(given, ("hanger_mass",)), silent())
    body, revision = answer["body"], answer["revision"]
    for key, value in untimed(fit_body(bench, addition.fit, before, after)).items():
        assert body[key] == value
    assert (body["added"], body["log_evidence_gain"]) == (["hanger_mass"], addition.log_evidence_gain)
    assert revision["added"] == ["hanger_mass"]
    assert body["history"] == revision["history"]
    held = bench_input(NAME, model=revision).open(catalogue=True)
    assert {p.split(".")[0] for p in held.loaded.added} == {"hanger_mass"}

    stages: list[str] = []
    found = tasks.diagnose(inputs.DiagnoseInput(given), Tell(lambda said: stages.append(said[2])))["body"]
    expected = diagnosis_answer(bench, run_diagnosis(bench))
    assert untimed(found) == untimed({"schema": "fingertwin/diagnose/1"} | expected)
    assert list(dict.fromkeys(stages)) == ["loading", "fitting every effect", "weighing load cases"]
    plan = tasks.next_cases(inputs.NextInput(given, freeze=bool(expected["next_cases"])), silent())
    assert plan["body"]["next_cases"] == clean(expected["next_cases"])
    if plan["frozen"] is not None:
        again = tasks.diagnose(inputs.DiagnoseInput(given, frozen=(plan["frozen"],)), silent())["body"]
        assert again["confirmation"]["text"] == "no frozen case has been measured yet"


def test_what_makes_no_sense_is_refused_before_anything_is_computed() -> None:
    given = BenchInput({"id": "S1"})
    for wrong in (
        lambda: inputs.RefitInput(given, method="guess"),
        lambda: inputs.RefitInput(given, plane="frontal"),
        lambda: inputs.RefitInput(given, method="slsqp", plane="space"),
        lambda: inputs.AddInput(given),
        given.open,
    ):
        with pytest.raises(InputError):
            wrong()
