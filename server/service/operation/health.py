"""Health of the service, its database, disk and workers."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from pydantic import BaseModel, Field
from sqlalchemy import func, select, text
from sqlalchemy.exc import SQLAlchemyError

from server.service.operation.migrate import expected
from server.service.operation.scrub import Scrub, named
from server.service.storage.database import Database, now_utc
from server.service.storage.purge import reusable_bytes
from server.service.storage.schema import jobs
from server.service.web.metrics import Metrics

if TYPE_CHECKING:
    from server.service.jobs.supervisor import Workers

API_VERSION = "v1"
# Below it the health is degraded: an hour or two of a bench at 7 kHz.
LITTLE_BYTES = 2 << 30


class DatabaseHealth(BaseModel):
    """State of the database."""

    dialect: Literal["sqlite", "postgresql"]
    revision: str = Field(description="Version of its schema.", examples=["0001"])
    ok: bool = Field(description="Whether it answers.")
    size_bytes: int | None = Field(description="Of the database; null where it does not say.")
    free_bytes: int | None = Field(description="Free on its disk; null where that is another machine's.")
    reusable_bytes: int | None = Field(description="Of the database's file, what holds nothing; null for PostgreSQL.")
    deleted_bytes: int | None = Field(description="Of deleted sessions when last checked; `fingertwin purge` frees it.")
    folder_bytes: int | None = Field(description="Everything in the data folder, former databases included.")
    checked_utc: str | None = Field(description="When everything was last held against its checksums; null before.")
    damaged: int = Field(description="Rows that are known not to be as they were written.")


class WorkersHealth(BaseModel):
    """State of the processes that refit and diagnose; each starts when it is first needed."""

    most: int = Field(description="How many there may be.")
    alive: int = Field(description="How many there are.")
    busy: int = Field(description="How many have a job.")
    waiting: int = Field(description="Jobs that wait.")


class HealthAnswer(BaseModel):
    """State of the service."""

    schema_: Literal["fingertwin/health/1"] = Field(default="fingertwin/health/1", serialization_alias="schema")
    status: Literal["ok", "degraded"]
    live: bool = Field(description="Whether it runs.")
    ready: bool = Field(description="Whether its models are warm and its database is up to date.")
    version: str = Field(description="Of fingertwin.", examples=["0.1.0"])
    api_version: str = Field(description="Of the addresses.", examples=["v1"])
    database: DatabaseHealth
    workers: WorkersHealth
    problems: list[str] = Field(description="What is wrong, in words.")
    started_utc: str = Field(examples=["2026-01-01T08:00:00.000+00:00"])
    uptime_s: float = Field(ge=0.0)


class Health:
    """Looks at a running service.

    Args:
        database: of the service.
        ready: whether it may be asked.
        workers: counts processes and jobs that wait.
        scrub: knows what is damaged.
        folder: of its data, whose disk is looked at; None where the database is elsewhere.
    """

    def __init__(
        self,
        database: Database,
        ready: Callable[[], bool],
        workers: Callable[[], Workers],
        scrub: Scrub,
        folder: Path | None = None,
    ) -> None:
        self._database, self._ready, self._workers, self._scrub = database, ready, workers, scrub
        self._folder = folder or (database.file.parent if database.file else None)
        self._started_utc, self._started_s = now_utc(), time.monotonic()
        self._version = version("fingertwin")

    @property
    def ready(self) -> bool:
        """True if it may be asked."""
        return self._ready()

    def answer(self) -> HealthAnswer:
        """Look; it may wait for the database."""
        ok = self._database.alive()
        free = self.free_bytes()
        workers = WorkersHealth(**vars(self._workers()))
        problems = [] if ok else ["the database does not answer"]
        if free is not None and free < LITTLE_BYTES:
            problems.append(f"the disk has {free >> 20} MB left")
        damaged = self._scrub.damaged
        if damaged:
            problems.append(named(damaged))
        return HealthAnswer(
            status="degraded" if problems else "ok",
            live=True,
            ready=self.ready,
            version=self._version,
            api_version=API_VERSION,
            database=DatabaseHealth(
                dialect="sqlite" if self._database.dialect == "sqlite" else "postgresql",
                revision=expected(),
                ok=ok,
                size_bytes=self.size_bytes() if ok else None,
                free_bytes=free,
                reusable_bytes=self.reusable_bytes() if ok else None,
                deleted_bytes=self._scrub.deleted_bytes,
                folder_bytes=self.folder_bytes(),
                checked_utc=self._scrub.checked_utc,
                damaged=len(damaged),
            ),
            workers=workers,
            problems=problems,
            started_utc=self._started_utc,
            uptime_s=round(time.monotonic() - self._started_s, 3),
        )

    def size_bytes(self) -> int | None:
        """Return the size of the database; None where it does not say."""
        file = self._database.file
        with suppress(OSError, SQLAlchemyError):
            if file is not None:
                return sum(f.stat().st_size for f in (file, file.with_name(f"{file.name}-wal")) if f.exists())
            return int(self._database.value(text("SELECT pg_database_size(current_database())")))
        return None

    def reusable_bytes(self) -> int | None:
        """Return bytes of the database's file that hold nothing; None where it does not say."""
        with suppress(SQLAlchemyError):
            return reusable_bytes(self._database)
        return None

    def folder_bytes(self) -> int | None:
        """Return the size of all files in the data folder; None where there is none."""
        with suppress(OSError):
            return None if self._folder is None else sum(f.stat().st_size for f in self._folder.iterdir())
        return None

    def free_bytes(self) -> int | None:
        """Return free space for the database; None where it is another machine's."""
        with suppress(OSError):
            return None if self._folder is None else shutil.disk_usage(self._folder).free
        return None

    def jobs_by_state(self) -> dict[str, float]:
        """Return the number of jobs in each state; empty where the database does not answer."""
        query = select(jobs.c.state, func.count()).group_by(jobs.c.state)
        with suppress(SQLAlchemyError):
            return {str(state): float(count) for state, count in self._database.rows(query)}
        return {}

    def report(self, metrics: Metrics) -> None:
        """Let the metrics ask for what is known here."""
        metrics.ask("fingertwin_jobs", "Jobs by state.", self.jobs_by_state, "state")
        metrics.ask("fingertwin_database_bytes", "Size of the database.", self.size_bytes)
        metrics.ask("fingertwin_disk_bytes", "What takes space, by what it is.", self._disk, "of")
        metrics.ask("fingertwin_free_bytes", "Free on its disk.", self.free_bytes)
        metrics.ask(
            "fingertwin_damaged_rows",
            "Stored rows that are not as they were written.",
            lambda: float(len(self._scrub.damaged)),
        )
        metrics.ask("fingertwin_ready", "Whether the service may be asked.", lambda: float(self.ready))
        metrics.ask("fingertwin_workers", "Worker processes and waiting jobs.", lambda: vars(self._workers()), "state")

    def _disk(self) -> dict[str, float]:
        known = {
            "database": self.size_bytes(),
            "reusable": self.reusable_bytes(),
            "deleted": self._scrub.deleted_bytes,
            "folder": self.folder_bytes(),
        }
        return {name: float(size) for name, size in known.items() if size is not None}
