"""Waiting for a job: told how far it is, patient with a service that is away, and never longer than asked for."""

from __future__ import annotations

import threading
from typing import Any

import httpx
import pytest

from fingertwin.client import JobFailedError, ServiceError
from fingertwin.client.exchange import Exchange
from fingertwin.client.jobs import Job, job_of, plain
from tests.client.services import URL, said, scripted

JOB: dict[str, Any] = {
    "id": "j1", "kind": "population", "session": None, "state": "queued", "progress": 0.0, "stage": "",
    "result": None, "problem": None,
}  # fmt: skip
RUNNING = JOB | {"state": "running", "progress": 0.4, "stage": "fitting"}
DONE = JOB | {"state": "done", "progress": 1.0, "result": {"answer": 42}}
PROBLEM = {"status": 422, "title": "…", "detail": "…", "found": "no load case", "expected": "one", "remedy": "Measure"}


def job(*answers: httpx.Response | Exception) -> tuple[Job[Any], list[httpx.Request], list[float]]:
    transport, asked = scripted(*answers)
    slept: list[float] = []
    exchange = Exchange(URL, None, 1.0, 0, transport, slept.append)
    return Job(exchange, JOB, plain), asked, slept


def test_a_result_comes_with_every_change_on_the_way() -> None:
    waited, asked, _ = job(said(JOB), said(RUNNING), said(RUNNING), said(DONE))
    told: list[tuple[float, str]] = []
    assert waited.result(lambda share, what: told.append((share, what))) == {"answer": 42}
    assert told == [(0.0, "queued"), (0.4, "fitting"), (1.0, "done")]
    assert [request.url.path for request in asked] == ["/api/v1/jobs/j1"] * 4
    assert waited.done


def test_a_service_that_restarts_is_waited_for() -> None:
    waited, asked, slept = job(httpx.ConnectError("refused"), said({"title": "stopping"}, 503), said(DONE))
    assert waited.result() == {"answer": 42}
    assert len(asked) == 3
    assert len(slept) == 2


def test_a_job_that_is_gone_is_not_waited_for() -> None:
    waited, asked, _ = job(said({"title": "Not Found", "detail": "there is no job j1."}, 404))
    with pytest.raises(ServiceError, match="there is no job j1"):
        waited.result()
    assert len(asked) == 1


def test_a_failed_job_says_why() -> None:
    waited, *_ = job(said(JOB | {"state": "failed", "problem": PROBLEM}))
    with pytest.raises(JobFailedError) as caught:
        waited.result()
    assert str(caught.value) == "population j1 failed: no load case; expected one. Measure."
    assert (caught.value.status, caught.value.state, caught.value.job) == (422, "failed", "j1")


def test_a_cancelled_job_says_so() -> None:
    waited, *_ = job(said(JOB | {"state": "cancelled"}))
    waited.cancel()
    with pytest.raises(JobFailedError, match="population j1 was cancelled"):
        waited.result()


def test_waiting_ends_in_time_and_the_job_goes_on() -> None:
    waited, asked, _ = job(said(RUNNING))
    with pytest.raises(TimeoutError, match=r"population j1 is running \(40%\) after 0 s"):
        waited.result(timeout_s=0.0)
    assert [request.method for request in asked] == ["GET"]
    assert not waited.done


def test_pauses_grow_and_stay_below_a_second() -> None:
    waited, _, slept = job(*[said(RUNNING)] * 30, said(DONE))
    waited.result()
    assert slept == sorted(slept)
    assert slept[0] <= 0.1
    assert slept[-1] == 1.0


def test_a_job_of_an_unknown_kind_gives_its_plain_result() -> None:
    transport, _ = scripted(said(DONE | {"kind": "of a newer service"}))
    found = job_of(Exchange(URL, transport=transport, sleep=lambda _: None), JOB | {"kind": "of a newer service"})
    assert found.result() == {"answer": 42}


def test_waiting_can_be_interrupted_from_the_progress() -> None:
    waited, asked, _ = job(said(RUNNING))
    stop = threading.Event()

    def once(share: float, what: str) -> None:
        stop.set()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        waited.result(once)
    assert stop.is_set()
    assert len(asked) == 1
