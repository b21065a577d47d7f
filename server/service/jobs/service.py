"""Jobs that are kept: queued, carried out by worker processes, and taken up again after a restart."""

from __future__ import annotations

import math
import threading
import uuid
from collections.abc import Iterable, Sequence
from typing import Any

from sqlalchemy import ColumnElement, func, insert, select, update

from daq.errors import InputError
from server.service.answers import plain
from server.service.jobs.keeping import JobWatcher, Keeper, problem_of
from server.service.jobs.kinds import FAILED, QUEUED, RUNNING, STATES, Job, TaskKind
from server.service.jobs.orders import Order, Outcome
from server.service.jobs.supervisor import Supervisor, Workers
from server.service.storage.database import Database, now_utc
from server.service.storage.messages import Messages, Telling
from server.service.storage.schema import jobs
from server.service.web.problems import ProblemError, not_found, shortened

# A job that was running when the service stopped unasked so often is at fault itself, most likely.
_MOST_ATTEMPTS = 3
_CANCEL_S = 10.0


class JobService:
    """Takes jobs in, and says how they stand.

    Args:
        database: where they are kept.
        messages: are told of every change.
        supervisor: carries them out; it is this service's alone, and is closed with it.
        tasks: kinds of jobs.
        default_timeout_s: of a job that states none.
    """

    def __init__(
        self,
        database: Database,
        messages: Messages,
        supervisor: Supervisor,
        tasks: Iterable[TaskKind],
        default_timeout_s: float,
    ) -> None:
        self._database, self._messages, self._supervisor = database, messages, supervisor
        self._tasks = {task.kind: task for task in tasks}
        self._default_timeout_s = default_timeout_s
        self._keeper = Keeper(messages)
        # Jobs are queued in the order of their numbers.
        self._queueing = threading.Lock()
        # Of this run, until those of the run before are taken up.
        self._new: set[str] | None = set()

    def start(self) -> None:
        """Queue again what was queued or running when the service stopped last; to be called once."""
        with self._queueing:
            if self._keeper.closing.is_set():
                return
            with self._messages.writing() as telling:
                left = jobs.c.state.in_((QUEUED, RUNNING)) & jobs.c.id.not_in(self._new or ())
                rows = telling.connection.execute(select(jobs).where(left).order_by(jobs.c.number)).all()
                again = [job for row in rows if (job := self._taken_up(telling, Job.of_row(row))) is not None]
            self._new = None
            for job in again:
                self._order(job)

    def submit(self, kind: str, session: str | None, request: dict[str, Any], timeout_s: float | None = None) -> Job:
        """Queue a job; one of the same request that still waits is returned instead of a second one.

        Args:
            kind: of the tasks.
            session: that it is about.
            request: plain data.
            timeout_s: after which it is given up.

        Raises:
            InputError: no such kind, or a timeout that is none.
            ProblemError: 503 the service is stopping.
        """
        if kind not in self._tasks:
            raise InputError(f"job of kind {shortened(kind)!r}", f"one of {', '.join(self._tasks)}")
        limit_s = self._default_timeout_s if timeout_s is None else timeout_s
        if not (math.isfinite(limit_s) and limit_s > 0.0):
            raise InputError(f"a timeout of {limit_s:g} s", "a time above zero")
        asked = plain(request)
        with self._queueing:
            if self._keeper.closing.is_set():
                raise ProblemError(503, "the service is stopping", "", "Ask again when it is back")
            with self._messages.writing() as telling:
                connection = telling.connection
                same = (jobs.c.state == QUEUED) & (jobs.c.kind == kind) & jobs.c.session.is_not_distinct_from(session)
                for row in connection.execute(select(jobs).where(same).order_by(jobs.c.number)):
                    if row.request == asked:
                        return Job.of_row(row)
                last = connection.execute(select(func.max(jobs.c.number))).scalar()
                job = Job(
                    uuid.uuid4().hex, kind, session, asked, QUEUED, 0.0, "", 0, limit_s, now_utc(), None, None
                )  # fmt: skip
                connection.execute(insert(jobs).values(vars(job) | {"number": (last or 0) + 1}))
                telling.record("job asked for", session, {"job": job.id, "kind": kind, "request": asked})
                telling.tell("job", session, job.as_message())
            self._order(job)
        return job

    def get(self, name: str) -> Job:
        """Return a job as it stands, its result included.

        Raises:
            ProblemError: 404 there is none.
        """
        row = None
        if _askable(name):
            with self._database.reading() as connection:
                row = connection.execute(select(jobs).where(jobs.c.id == name)).first()
        if row is None:
            raise not_found("job", name, "/api/v1/jobs")
        return self._keeper.live(Job.of_row(row))

    def list(
        self,
        session: str | None = None,
        state: str | None = None,
        limit: int = 100,
        after: str | None = None,
        kinds: Sequence[str] = (),
    ) -> Sequence[Job]:
        """Return jobs without their results, newest first.

        Args:
            session: that they are about.
            state: one of STATES.
            limit: at most so many.
            after: id of a job; those that are older follow.
            kinds: of the tasks; all where it is empty.

        Raises:
            ProblemError: 404 there is no job of that id.
            InputError: no such state.
        """
        if state is not None and state not in STATES:
            raise InputError(f"state {shortened(state)!r}", f"one of {', '.join(STATES)}")
        if session is not None and not _askable(session):
            return []
        query = select(*(c for c in jobs.c if c.name != "result")).order_by(jobs.c.number.desc()).limit(limit)
        chosen: list[ColumnElement[bool]] = []
        if session is not None:
            chosen.append(jobs.c.session == session)
        if state is not None:
            chosen.append(jobs.c.state == state)
        if kinds:
            chosen.append(jobs.c.kind.in_(kinds))
        if after is not None:
            last = self.get(after).id
            chosen.append(jobs.c.number < select(jobs.c.number).where(jobs.c.id == last).scalar_subquery())
        return [self._keeper.live(Job.of_row(row)) for row in self._database.rows(query.where(*chosen))]

    def cancel(self, name: str) -> Job:
        """Cancel a job that is queued or running, and return what has become of it.

        Raises:
            ProblemError: 404 there is none, 409 it is finished.
        """
        job = self.get(name)
        if not job.finished and self._supervisor.cancel(name):
            with self._messages.writing() as telling:
                telling.record("job cancelled", job.session, {"job": name})
            return self.wait(name, _CANCEL_S)
        job = self.get(name)
        raise ProblemError(
            409,
            f"job {name} is {job.state}",
            "one that is queued or running",
            "Nothing is left to cancel; begin a new job where it is needed",
        )

    def wait(self, name: str, timeout_s: float | None = None) -> Job:
        """Wait until a job is finished; after a time return it as it stands."""
        return self._keeper.wait(lambda: self.get(name), timeout_s)

    def warm(self) -> None:
        """Start the workers now, so that the first job finds its models compiled."""
        self._supervisor.warm()

    def workers(self) -> Workers:
        """Count worker processes."""
        return self._supervisor.state()

    def close(self) -> None:
        """Stop: running jobs are queued again, for the next start, and all workers end."""
        with self._queueing:
            self._keeper.closing.set()
        self._supervisor.close()

    def _order(self, job: Job) -> None:
        if self._new is not None:
            self._new.add(job.id)
        task = self._tasks[job.kind]
        self._supervisor.submit(Order(job.id, task.run, JobWatcher(self._keeper, job, task), job.timeout_s))

    def _taken_up(self, telling: Telling, job: Job) -> Job | None:
        """Make an open job of an earlier run wait again; None where it must not."""
        attempts = job.attempts + (job.state == RUNNING)
        change: dict[str, Any] = {"attempts": attempts, "progress": 0.0, "stage": ""}
        fault = None
        if job.kind not in self._tasks:
            fault = Outcome("refused", found=f"this version of the service has no jobs of kind {job.kind}")
        elif attempts >= _MOST_ATTEMPTS:
            fault = Outcome("died", found="the service stopped three times while it ran")
        if fault is not None:
            change |= {"state": FAILED, "problem": problem_of(fault), "finished_utc": now_utc()}
        elif job.state == RUNNING:
            change |= {"state": QUEUED, "started_utc": None}
        elif job.attempts == attempts:
            return job
        row = telling.connection.execute(
            update(jobs).where(jobs.c.id == job.id).values(change).returning(*jobs.c)
        ).one()
        changed = Job.of_row(row)
        telling.tell("job", job.session, changed.as_message())
        return None if fault is not None else changed


def _askable(text: str) -> bool:
    """Return whether a client's text can be held against what is kept at all: PostgreSQL knows no zero byte."""
    return "\0" not in text
