"""Jobs that are kept: their states, their results, and what becomes of them when the service stops."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import func, insert, select, update

from daq.errors import InputError
from server.service.jobs.kinds import Job, TaskKind
from server.service.jobs.service import JobService
from server.service.jobs.supervisor import Supervisor
from server.service.storage.database import Database, now_utc
from server.service.storage.messages import Message, Messages, Telling
from server.service.storage.schema import job_parts, jobs, metadata, own_effects
from server.service.web.problems import ProblemError
from tests.server.service.work import HERE

LONG_S = 60.0


def require_value(request: dict[str, Any]) -> dict[str, Any]:
    if "value" not in request:
        raise InputError("no value", "one", "Give a value")
    return request


def keep_with_row(telling: Telling, job: Job, result: Any) -> dict[str, Any]:
    row = {"name": job.id, "created_utc": now_utc(), "document": {"value": result["value"]}}
    telling.connection.execute(insert(own_effects).values(row))
    if result["value"] == 26:
        raise InputError("a result of 26", "another")
    return {"value": result["value"], "unknown": float("nan")}


def kinds() -> list[TaskKind]:
    plain = [TaskKind(name, lambda r: r, f"{HERE}.{name}") for name in ("hold", "in_parts", "fail", "leave", "refuse")]
    return [*plain, TaskKind("double", require_value, f"{HERE}.double", keep_with_row)]


class Running:
    """A job service on a database file, with what it tells."""

    def __init__(self, folder: Path, workers: int = 1) -> None:
        self.database = Database(f"sqlite:///{folder / 'jobs.db'}")
        metadata.create_all(self.database.engine)
        self.messages = Messages(self.database)
        self.told: list[Message] = []
        self.messages.listen(self._hear)
        self._heard = threading.Condition()
        self.jobs = JobService(self.database, self.messages, Supervisor(workers), kinds(), LONG_S)

    def _hear(self, message: Message) -> None:
        with self._heard:
            self.told.append(message)
            self._heard.notify_all()

    def until(self, true: Callable[[Message], bool]) -> Message:
        """Wait for a message."""
        with self._heard:
            assert self._heard.wait_for(lambda: any(map(true, self.told)), LONG_S)
            return next(m for m in self.told if true(m))

    def holding(self, job: Job) -> None:
        """Wait until a job has begun to hold."""
        self.until(lambda m: m.body["id"] == job.id and m.body["stage"].startswith("holding"))

    def done(self, job: Job) -> Job:
        return self.jobs.wait(job.id, LONG_S)

    def close(self) -> None:
        self.jobs.close()
        self.database.close()


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    service = Running(tmp_path)
    yield service
    service.close()


def test_a_job_tells_its_states_and_keeps_its_result_with_what_comes_of_it(running: Running) -> None:
    job = running.jobs.submit("double", "S1", {"value": 21})
    assert (job.state, job.progress, job.request) == ("queued", 0.0, {"value": 21})
    done = running.done(job)
    assert (done.state, done.progress, done.result) == ("done", 1.0, {"value": 42, "unknown": None})
    assert done.created_utc <= (done.started_utc or "") <= (done.finished_utc or "")
    kept = [m.body["state"] for m in running.messages.after(0)]
    assert kept == ["queued", "running", "done"]
    live = [(m.body["progress"], m.body["stage"]) for m in running.told if m.id is None]
    assert live == [(0.5, "doubling")]
    assert "result" not in running.told[-1].body
    with running.database.reading() as connection:
        assert connection.execute(select(own_effects.c.document)).scalars().all() == [{"value": 42}]


def test_a_result_that_cannot_be_kept_leaves_nothing_behind(running: Running) -> None:
    failed = running.done(running.jobs.submit("double", None, {"value": 13}))
    assert failed.state == "failed"
    assert failed.result is None
    assert (failed.problem or {})["found"] == "a result of 26"
    with running.database.reading() as connection:
        assert connection.execute(select(func.count()).select_from(own_effects)).scalar() == 0


@pytest.mark.parametrize(
    ("kind", "status", "found"),
    [
        ("refuse", 422, "a finger of wood"),
        ("double", 422, "no value"),
        ("fail", 500, "KeyError: 'middle phalanx'"),
        ("leave", 500, "the worker died (exit code 3)"),
    ],
)
def test_a_failure_says_why(running: Running, kind: str, status: int, found: str) -> None:
    failed = running.done(running.jobs.submit(kind, None, {}))
    problem = failed.problem or {}
    assert (failed.state, problem["status"], problem["found"]) == ("failed", status, found)
    assert running.done(running.jobs.submit("double", None, {"value": 1})).state == "done"


def test_nothing_is_kept_of_a_job_that_was_given_up_as_it_ended(running: Running) -> None:
    def given_up(telling: Telling, job: Job, result: Any) -> dict[str, Any]:
        kept = keep_with_row(telling, job, result)
        telling.connection.execute(update(jobs).where(jobs.c.id == job.id).values(state="cancelled"))
        return kept

    task = replace(running.jobs._tasks["double"], keep=given_up)
    running.jobs._tasks["double"] = task
    job = running.jobs.submit("double", None, {"value": 4})
    running.until(lambda m: m.body["id"] == job.id and m.body["stage"] == "doubling")
    other = running.done(running.jobs.submit("in_parts", None, {"parts": 1, "fail_after": None}))
    assert other.finished
    with running.database.reading() as connection:
        assert connection.execute(select(own_effects.c.name)).all() == []
        states = connection.execute(select(jobs.c.state, jobs.c.result).where(jobs.c.id == job.id)).one()
    # The change that gave it up was in the same transaction here, so it is gone with the rest.
    assert tuple(states) == ("running", None)


def test_unknown_kinds_and_endless_timeouts_are_refused(running: Running) -> None:
    with pytest.raises(InputError, match="one of hold, in_parts"):
        running.jobs.submit("triple", None, {})
    with pytest.raises(InputError, match="above zero"):
        running.jobs.submit("double", None, {}, float("inf"))
    assert running.done(running.jobs.submit("hold", None, {}, 0.1)).problem is not None


def test_jobs_go_in_order_and_equal_ones_that_wait_are_one(running: Running) -> None:
    held = running.jobs.submit("hold", "S1", {})
    running.holding(held)
    first = running.jobs.submit("double", "S1", {"value": 1})
    second = running.jobs.submit("double", "S2", {"value": 1})
    assert running.jobs.submit("double", "S1", {"value": 1}) == first
    assert running.jobs.submit("double", "S1", {"value": 1, "more": 2}).id not in (first.id, second.id)
    # One that runs is not one that waits: what it was built from may have changed since.
    again = running.jobs.submit("hold", "S1", {})
    assert again.id != held.id
    assert running.jobs.get(held.id).progress == 0.25
    assert running.jobs.cancel(again.id).state == running.jobs.cancel(held.id).state == "cancelled"
    third = running.jobs.submit("double", "S1", {"value": 3})
    running.done(third)
    done = [m.body["id"] for m in running.told if m.body["state"] == "done"]
    assert (done[0], done[1], done[-1]) == (first.id, second.id, third.id)
    with pytest.raises(ProblemError, match=f"job {first.id} is done"):
        running.jobs.cancel(first.id)


def test_jobs_of_this_run_are_not_taken_up_a_second_time(running: Running) -> None:
    held, waiting = (running.jobs.submit(kind, None, {"value": 1}) for kind in ("hold", "double"))
    running.holding(held)
    running.jobs.start()
    assert running.jobs.workers().waiting == 1
    running.jobs.cancel(held.id)
    assert running.done(waiting).state == "done"


def test_lists_are_newest_first_without_results_and_go_on_after_a_job(running: Running) -> None:
    made = [running.jobs.submit("double", f"S{k % 2}", {"value": k}) for k in range(4)]
    running.done(made[-1])
    newest = [j.id for j in reversed(made)]
    assert [j.id for j in running.jobs.list(limit=2)] == newest[:2]
    assert [j.id for j in running.jobs.list(after=newest[1])] == newest[2:]
    assert [j.id for j in running.jobs.list(session="S1", state="done")] == newest[::2]
    assert all(j.result is None for j in running.jobs.list())
    assert running.jobs.list(session="S\0") == running.jobs.list(state="failed") == []
    with pytest.raises(ProblemError, match="there is no job"):
        running.jobs.get("0\0")


def test_a_stop_queues_running_jobs_again_and_holds_nothing_against_them(tmp_path: Path) -> None:
    first = Running(tmp_path)
    held, waiting = (first.jobs.submit("in_parts", None, parts_of(tmp_path, k)) for k in (2, 1))
    first.holding(held)
    first.close()
    with pytest.raises(ProblemError, match="stopping"):
        first.jobs.submit("double", None, {"value": 1})
    (tmp_path / "go on").touch()
    second = Running(tmp_path)
    assert [(j.state, j.progress, j.attempts) for j in second.jobs.list()] == [("queued", 0.0, 0)] * 2
    second.jobs.start()
    # Parts that were finished before the stop are not made again.
    assert second.done(held).result == {"total": 14, "made": [2, 3]}
    assert second.done(waiting).result == {"total": 14, "made": [0, 1, 2, 3]}
    second.close()


def parts_of(folder: Path, until: int) -> dict[str, Any]:
    return {"parts": 4, "until": until, "file": str(folder / "go on")}


_SERVICE = """
import sys, threading
from pathlib import Path
from tests.server.service.jobs.test_jobs import Running, parts_of

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    service = Running(folder)
    service.holding(service.jobs.submit("in_parts", "S1", parts_of(folder, 3)))
    print("holding", flush=True)
    threading.Event().wait()
"""


def test_a_service_that_is_killed_takes_its_jobs_up_again(tmp_path: Path) -> None:
    script = tmp_path / "service.py"
    script.write_text(_SERVICE)
    environment = os.environ | {"PYTHONPATH": str(Path.cwd())}
    command = [sys.executable, str(script), str(tmp_path)]
    service = subprocess.Popen(command, stdout=subprocess.PIPE, env=environment)  # noqa: S603 - our own script
    assert service.stdout is not None
    assert service.stdout.readline() == b"holding\n"
    service.kill()
    service.communicate(timeout=LONG_S)
    (tmp_path / "go on").touch()
    again = Running(tmp_path)
    again.jobs.start()
    job = again.done(again.jobs.list()[0])
    assert (job.state, job.attempts, job.result) == ("done", 1, {"total": 14, "made": [3]})
    with again.database.reading() as connection:
        assert connection.execute(select(func.count()).select_from(job_parts)).scalar() == 4
    again.close()


def test_a_job_that_stopped_the_service_three_times_is_not_tried_again(tmp_path: Path) -> None:
    first = Running(tmp_path)
    held = first.jobs.submit("hold", None, {})
    unknown = first.jobs.submit("fail", None, {})
    first.holding(held)
    first.close()
    with first.database.writing() as connection:
        connection.execute(update(jobs).where(jobs.c.id == held.id).values(state="running", attempts=2))
        connection.execute(update(jobs).where(jobs.c.id == unknown.id).values(kind="of a later version"))
    second = Running(tmp_path)
    second.jobs.start()
    found = [(second.done(j).problem or {})["found"] for j in (held, unknown)]
    assert found == [
        "the service stopped three times while it ran",
        "this version of the service has no jobs of kind of a later version",
    ]
    second.close()
