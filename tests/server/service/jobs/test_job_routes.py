"""Jobs over REST."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient

from daq.errors import InputError
from server.service.routes import jobs as routes
from server.service.schemas.jobs import JobList, JobShown
from server.service.web.problems import ProblemError, answer_input_error, answer_problem
from tests.server.service.jobs.test_jobs import Running


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    service = Running(tmp_path)
    yield service
    service.close()


@pytest.fixture
def client(running: Running) -> TestClient:
    app = FastAPI()
    app.state.services = SimpleNamespace(jobs=running.jobs)
    app.add_exception_handler(ProblemError, answer_problem)
    app.add_exception_handler(InputError, answer_input_error)
    app.include_router(routes.router)
    return TestClient(app)


def test_jobs_are_read_listed_and_cancelled(running: Running, client: TestClient) -> None:
    held, waiting = (running.jobs.submit("hold", session, {}) for session in ("S1", "S2"))
    running.holding(held)
    answer = JobShown.model_validate(client.get(f"/jobs/{held.id}").json())
    assert (answer.state, answer.progress, answer.session) == ("running", 0.25, "S1")
    rows = JobList.model_validate(client.get("/jobs").json()).jobs
    assert [r.id for r in rows] == [waiting.id, held.id]
    page = client.get("/jobs", params={"limit": 1}).json()
    assert [r["id"] for r in client.get("/jobs", params={"after": page["next"]}).json()["jobs"]] == [held.id]
    assert client.get("/jobs", params={"session": "S2", "state": "running"}).json()["jobs"] == []
    for job in (waiting, held):
        assert client.post(f"/jobs/{job.id}/cancel").json()["state"] == "cancelled"
    refused = client.post(f"/jobs/{held.id}/cancel")
    assert refused.status_code == 409
    told = refused.json()
    assert (told["found"], told["expected"]) == (f"job {held.id} is cancelled", "one that is queued or running")
    assert told["remedy"]


def test_what_is_not_there_or_makes_no_sense_is_refused(client: TestClient) -> None:
    assert client.get("/jobs/none").status_code == client.post("/jobs/none/cancel").status_code == 404
    assert client.get("/jobs", params={"after": "none"}).status_code == 404
    assert client.get("/jobs/%00").status_code == 422
    for faulty in ({"state": "asleep"}, {"limit": 0}, {"limit": 10**6}, {"session": "x" * 300}):
        assert client.get("/jobs", params=faulty).status_code == 422
