"""Worker processes: what they answer, and how they end."""

from __future__ import annotations

import logging
import os
import queue
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from server.service.jobs.orders import Order, Outcome
from server.service.jobs.supervisor import Supervisor
from tests.server.service.work import HERE

LONG_S = 60.0


class Notes:
    """Notes what it is told of an order."""

    def __init__(self, payload: Any = None, parts: Mapping[str, Any] | None = None) -> None:
        self.payload, self.parts = payload, parts or {}
        self.told: queue.SimpleQueue[tuple[str, Any]] = queue.SimpleQueue()

    def started(self) -> tuple[Any, Mapping[str, Any]]:
        return self.payload, self.parts

    def progressed(self, fraction: float, stage: str) -> None:
        self.told.put(("progress", (fraction, stage)))

    def part(self, key: str, result: Any) -> None:
        self.told.put(("part", (key, result)))

    def ended(self, outcome: Outcome) -> None:
        self.told.put(("ended", outcome))

    def next(self, what: str) -> Any:
        while True:
            kind, told = self.told.get(timeout=LONG_S)
            if kind == what:
                return told

    def end(self) -> Outcome:
        outcome: Outcome = self.next("ended")
        return outcome


@pytest.fixture
def pool() -> Iterator[Supervisor]:
    supervisor = Supervisor(1)
    yield supervisor
    supervisor.close()


def order(pool: Supervisor, function: str, payload: Any = None, timeout_s: float | None = LONG_S) -> Notes:
    notes = Notes(payload)
    pool.submit(Order(function, f"{HERE}.{function}", notes, timeout_s))
    return notes


def process_of(notes: Notes) -> int:
    return int(notes.next("progress")[1].split()[-1])


def test_result_and_progress_come_back_and_one_process_serves_all(pool: Supervisor) -> None:
    first, second = (order(pool, "double", {"value": k}) for k in (1, 2))
    assert first.next("progress") == (0.5, "doubling")
    ends = [first.end(), second.end()]
    assert [(e.ending, e.result["value"]) for e in ends] == [("done", 2), ("done", 4)]
    assert {e.result["process"] for e in ends} == set(pool.processes()) != {os.getpid()}


def test_bad_input_is_told_in_parts_and_a_fault_with_its_trace_in_the_log(
    pool: Supervisor, caplog: pytest.LogCaptureFixture
) -> None:
    refused = order(pool, "refuse").end()
    assert (refused.ending, refused.found, refused.expected) == ("refused", "a finger of wood", "one of bone")
    assert not caplog.records
    failed = order(pool, "fail").end()
    assert (failed.ending, failed.found) == ("failed", "KeyError: 'middle phalanx'")
    assert "in fail" in caplog.text
    assert order(pool, "unsendable").end().found.startswith("TypeError: cannot pickle")
    assert order(pool, "absent").end().found.startswith("AttributeError")
    assert order(pool, "double", {"value": 3}).end().result["value"] == 6


@pytest.mark.skipif(sys.platform == "win32", reason="no kill -9 on Windows")
def test_a_killed_worker_fails_its_job_and_is_replaced(pool: Supervisor) -> None:
    held, waiting = order(pool, "hold"), order(pool, "double", {"value": 1})
    killed = process_of(held)
    os.kill(killed, signal.SIGKILL)
    outcome = held.end()
    assert (outcome.ending, outcome.found) == ("died", "the worker died (signal SIGKILL)")
    assert "memory" in outcome.remedy
    assert waiting.end().result["process"] != killed
    # One that dies with nothing to do costs nothing.
    idle = pool.processes()[0]
    os.kill(idle, signal.SIGKILL)
    assert order(pool, "double", {"value": 1}).end().result["process"] != idle


def test_a_worker_that_leaves_is_told_with_its_exit_code(pool: Supervisor) -> None:
    assert order(pool, "leave").end().found == "the worker died (exit code 3)"


@pytest.mark.skipif(sys.platform == "win32", reason="no such signals on Windows")
def test_ctrl_c_and_the_end_of_the_service_are_left_to_the_parent(pool: Supervisor) -> None:
    assert order(pool, "interrupted").end().result == "went on"


def test_time_runs_out_for_a_job_and_not_for_the_next(pool: Supervisor) -> None:
    outcome = order(pool, "hold", timeout_s=0.2).end()
    assert (outcome.ending, outcome.found) == ("timed_out", "timed out after 0.2 s")
    assert order(pool, "double", {"value": 1}).end().ending == "done"


def test_running_and_waiting_jobs_can_be_cancelled_and_finished_ones_not(pool: Supervisor) -> None:
    held, waiting = order(pool, "hold"), order(pool, "double", {"value": 1})
    process_of(held)
    assert pool.state().waiting == pool.state().busy == 1
    assert pool.cancel("double")
    assert pool.cancel("hold")
    assert [held.end().ending, waiting.end().ending] == ["cancelled", "cancelled"]
    assert not pool.cancel("hold")
    assert order(pool, "double", {"value": 1}).end().ending == "done"


def test_closing_stops_what_runs_and_what_waits() -> None:
    pool = Supervisor(1)
    held, waiting = order(pool, "hold"), order(pool, "double", {"value": 1})
    process_of(held)
    pool.close()
    assert [held.end().ending, waiting.end().ending] == ["stopped", "stopped"]
    assert pool.processes() == []
    with pytest.raises(RuntimeError, match="closed"):
        order(pool, "double")


def test_a_worker_that_cannot_be_warmed_works_all_the_same(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.ERROR)
    pool = Supervisor(1, f"{HERE}.broken_warm_up")
    pool.warm()
    assert order(pool, "double", {"value": 1}).end().ending == "done"
    assert "no fuel" in caplog.text
    pool.close()


_PARENT = """
import sys, threading
from server.service.jobs.orders import Order
from server.service.jobs.supervisor import Supervisor
from tests.server.service.jobs.test_workers import Notes
from tests.server.service.work import HERE

if __name__ == "__main__":
    pool = Supervisor(2)
    pool.submit(Order("a", f"{HERE}.hold", Notes()))
    pool.submit(Order("b", f"{HERE}.with_helpers", Notes(sys.argv[1])))
    threading.Event().wait()
"""


def test_no_process_outlives_a_service_that_is_killed(tmp_path: Path) -> None:
    script, started = tmp_path / "parent.py", tmp_path / "helpers"
    script.write_text(_PARENT)
    environment = os.environ | {"PYTHONPATH": str(Path.cwd())}
    command = [sys.executable, str(script), str(started)]
    parent = subprocess.Popen(command, stdout=subprocess.PIPE, env=environment)  # noqa: S603 - our own script
    while not started.exists() or len(started.read_text().split()) < 2:
        assert parent.poll() is None
    parent.kill()
    # Its workers and their helpers hold the other end of this pipe as long as they live.
    parent.communicate(timeout=LONG_S)
