"""Record of a job: each change of state is kept together with its message and result, or not at all."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from sqlalchemy import insert, select, update
from sqlalchemy.exc import OperationalError

from daq.errors import InputError
from server.service.answers import plain
from server.service.jobs.kinds import CANCELLED, DONE, FAILED, QUEUED, RUNNING, Job, TaskKind
from server.service.jobs.orders import Outcome
from server.service.storage.database import now_utc
from server.service.storage.messages import Message, Messages, Telling
from server.service.storage.schema import job_parts, jobs
from server.service.web.problems import ProblemError

_log = logging.getLogger(__name__)

# A database that cannot be written to is tried again after so long [s]; a full disk may be mended by then.
_PAUSES_S = (0.5, 2.0, 5.0, 15.0, 30.0, 60.0)


class Keeper:
    """Keeps what becomes of jobs.

    Args:
        messages: are told of it, and give the transactions.
    """

    def __init__(self, messages: Messages) -> None:
        self.closing = threading.Event()
        self._messages = messages
        self._live: dict[str, tuple[float, str]] = {}
        self._ended = threading.Condition()

    def live(self, job: Job) -> Job:
        """Return a job with the progress that was told last."""
        known = self._live.get(job.id)
        return job if known is None or job.state != RUNNING else replace(job, progress=known[0], stage=known[1])

    def wait(self, read: Callable[[], Job], timeout_s: float | None) -> Job:
        """Wait until a job that is read anew at each turn is finished."""
        with self._ended:
            self._ended.wait_for(lambda: read().finished, timeout_s)
        return read()

    def tell_progress(self, job: Job, fraction: float, stage: str) -> None:
        """Tell it to whoever listens now."""
        self._live[job.id] = (fraction, stage)
        self._messages.publish(Message("job", job.session, self.live(job).as_message(), created_utc=now_utc()))

    def forget_progress(self, job: Job) -> None:
        """Forget the progress of a job that has ended."""
        self._live.pop(job.id, None)
        with self._ended:
            self._ended.notify_all()

    def write(self, change: Callable[[Telling], None]) -> None:
        """Carry out a change in a transaction of its own, again if the database cannot be reached."""
        for pause_s in (*_PAUSES_S, None):
            try:
                with self._messages.writing() as telling:
                    change(telling)
                return
            except OperationalError as error:
                if pause_s is None or self.closing.is_set():
                    raise
                _log.warning("the database cannot be written to; trying again in %g s: %s", pause_s, error.orig)
                self.closing.wait(pause_s)


class JobWatcher:
    """Keeps what a worker tells of one job."""

    def __init__(self, keeper: Keeper, job: Job, task: TaskKind) -> None:
        self._keeper, self._job, self._task = keeper, job, task

    def started(self) -> tuple[Any, Mapping[str, Any]]:
        """Mark a job as running."""
        parts: dict[str, Any] = {}

        def begin(telling: Telling) -> None:
            self._change(telling, QUEUED, state=RUNNING, started_utc=now_utc(), stage="starting")
            mine = select(job_parts.c.part, job_parts.c.result).where(job_parts.c.job == self._job.id)
            parts.update((row.part, row.result) for row in telling.connection.execute(mine))

        self._keeper.write(begin)
        try:
            return self._task.build(self._job.request), parts
        except ProblemError as error:
            raise _as_input(error) from error

    def progressed(self, fraction: float, stage: str) -> None:
        """Tell the share that is done, and the stage."""
        self._keeper.tell_progress(self._job, min(max(fraction, 0.0), 1.0), stage[:200])

    def part(self, key: str, result: Any) -> None:
        """Keep a part; of two with one key the later one counts."""
        values = {"result": plain(result)}

        def keep(telling: Telling) -> None:
            mine = (job_parts.c.job == self._job.id) & (job_parts.c.part == key)
            if telling.connection.execute(update(job_parts).where(mine).values(values)).rowcount == 0:
                telling.connection.execute(insert(job_parts).values(values | {"job": self._job.id, "part": key}))

        self._keeper.write(keep)

    def ended(self, outcome: Outcome) -> None:
        """Keep how the job ended."""
        try:
            if outcome.ending == "done":
                outcome = self._keep_result(outcome)
            if outcome.ending != "done":
                self._keeper.write(lambda telling: self._keep_end(telling, outcome))
        finally:
            self._keeper.forget_progress(self._job)

    def _keep_result(self, outcome: Outcome) -> Outcome:
        def keep(telling: Telling) -> None:
            kept = plain(self._task.keep(telling, self._job, outcome.result))
            end = {"progress": 1.0, "stage": "", "result": kept, "finished_utc": now_utc()}
            if not self._change(telling, RUNNING, state=DONE, **end):
                raise _NotRunningError

        try:
            self._keeper.write(keep)
        except OperationalError:
            raise
        except _NotRunningError:
            _log.warning("job %s ended after it had been given up: nothing of it is kept", self._job.id)
        except ProblemError as error:
            return Outcome.of_error(_as_input(error))
        except Exception as error:
            failure = Outcome.of_error(error)
            if failure.trace:
                _log.exception("job %s: its result could not be kept", self._job.id)
            return failure
        return outcome

    def _keep_end(self, telling: Telling, outcome: Outcome) -> None:
        if outcome.ending == "stopped":
            self._change(telling, RUNNING, state=QUEUED, started_utc=None, progress=0.0, stage="")
            return
        end = {"finished_utc": now_utc(), "stage": "", "progress": self._keeper.live(self._job).progress}
        if outcome.ending == "cancelled":
            self._change(telling, QUEUED, RUNNING, state=CANCELLED, **end)
        else:
            self._change(telling, QUEUED, RUNNING, state=FAILED, problem=problem_of(outcome), **end)

    def _change(self, telling: Telling, *states: str, **values: Any) -> bool:
        """Change a job that is in one of some states, and tell it; return whether it was in one of them."""
        mine = (jobs.c.id == self._job.id) & jobs.c.state.in_(states)
        columns = [c for c in jobs.c if c.name != "result"]
        row = telling.connection.execute(update(jobs).where(mine).values(values).returning(*columns)).first()
        if row is not None:
            self._job = Job.of_row(row)
            telling.tell("job", self._job.session, self._job.as_message())
        return row is not None


class _NotRunningError(Exception):
    """The job is in another state by now: what belongs to its result is not kept either."""


def _as_input(error: ProblemError) -> InputError:
    return InputError(error.found, error.expected, error.remedy)


def problem_of(outcome: Outcome) -> dict[str, Any]:
    """Return the problem of a job that failed: 422 where what was given cannot be used, else 500."""
    status = 422 if outcome.ending == "refused" else 500
    return ProblemError(status, outcome.found, outcome.expected, outcome.remedy).body
