"""Kinds of jobs: the input of each, and the part of its result that is kept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import insert, select

from daq.errors import InputError
from daq.sessions.models import TensionEstimate
from fingermodel.effects.user import effect_document
from fingermodel.model_files import Revision
from server.service.answers import plain
from server.service.jobs.bench_input import BenchInput
from server.service.jobs.executors import ExecutorSettings
from server.service.jobs.inputs import (
    AddInput,
    DiagnoseInput,
    NextInput,
    PooledInput,
    PopulationInput,
    RefitInput,
    ReproduceInput,
)
from server.service.jobs.kinds import Job, TaskKind
from server.service.models.effects import OwnEffects
from server.service.models.revisions import Revisions
from server.service.models.session_models import SessionModels
from server.service.sessions.measuring import Measured, Measuring
from server.service.settings import Settings
from server.service.storage.database import Database, now_utc
from server.service.storage.messages import Telling
from server.service.storage.schema import frozen

_TASKS = "server.service.jobs.tasks"
Request = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Tasks:
    """Makes of a request what a worker is given: values, never a place to look them up; and keeps what comes of it."""

    settings: Settings
    database: Database
    measuring: Measuring
    models: SessionModels
    revisions: Revisions
    effects: OwnEffects

    def kinds(self) -> list[TaskKind]:
        """Return every kind of job that the service does."""
        return [
            TaskKind("refit", self.refit, f"{_TASKS}.refit", self.kept_revision),
            TaskKind("add", self.add, f"{_TASKS}.add", self.kept_revision),
            TaskKind("diagnose", self.diagnose, f"{_TASKS}.diagnose", lambda _, __, result: _body(result)),
            TaskKind("pooled", self.pooled, f"{_TASKS}.pooled", lambda _, __, result: _body(result)),
            TaskKind("next", self.next_cases, f"{_TASKS}.next_cases", _kept_frozen),
            TaskKind("population", self.population, "server.service.jobs.population.run"),
            TaskKind("reproduce", _study, f"{_TASKS}.reproduce", lambda _, __, result: plain(result["body"])),
        ]

    def kept_revision(self, telling: Telling, job: Job, result: Any) -> dict[str, Any]:
        """Keep the revision of a fit, and return what is kept as the job's result."""
        origin = result["provenance"]
        self.revisions.keep(telling, result["revision"], origin["specimen"], origin | {"job": job.id}, _why(job))
        return _body(result)

    def refit(self, request: Request) -> RefitInput:
        """Make the input of a refit."""
        return RefitInput(self.bench(request), request["method"], request["plane"])

    def add(self, request: Request) -> AddInput:
        """Make the input of an addition."""
        return AddInput(self.bench(request, request["add"]), tuple(request["add"]), tuple(request["without"]))

    def diagnose(self, request: Request) -> DiagnoseInput:
        """Make the input of a diagnosis, with this specimen's frozen predictions."""
        bench = self.bench(request, request["effects"])
        query = select(frozen.c.document).where(frozen.c.specimen == bench.provenance["specimen"])
        documents = tuple(row.document for row in self.database.rows(query.order_by(frozen.c.created_utc)))
        return DiagnoseInput(bench, request["thorough"], documents)

    def pooled(self, request: Request) -> PooledInput:
        """Make the input of a diagnosis of several sessions."""
        benches = [self.bench(dict(request) | {"session": s}, request["effects"]) for s in request["sessions"]]
        return PooledInput(tuple(benches), request["thorough"])

    def next_cases(self, request: Request) -> NextInput:
        """Make the input of a search for the next load cases."""
        return NextInput(self.bench(request, request["effects"]), request["freeze"])

    def population(self, request: Request) -> PopulationInput:
        """Make the input of a population run."""
        used = [name for names in request["effects"] for name in names]
        benches = [self.bench(dict(request) | {"session": s}, used) for s in request["sessions"]]
        place = ExecutorSettings(self.settings.executor, self.settings.worker_count, self.settings.dask_scheduler)
        return PopulationInput(
            tuple(benches),
            tuple(tuple(names) for names in request["effects"]),
            request["bootstrap"],
            request["seed"],
            executor=place,
        )

    def bench(self, request: Request, used: list[str] | tuple[str, ...] = ()) -> BenchInput:
        """Return a session as it stands, with its model and users' effects.

        Raises:
            InputError: the session cannot be used.
            ProblemError: there is no such session, model or effect.
        """
        measured = self.measuring.of(request["session"])
        bench = self.models.bench(measured, request["model"])
        model = self.models.model(request["model"], measured)
        provenance = self.models.provenance(measured, bench, digest=True)
        readings = provenance["readings"]
        whole = measured.session
        return BenchInput(
            session=_document(measured),
            plateaus=dict(measured.plateaus),
            notes=measured.require().notes,
            model=model.document if isinstance(model, Revision) else model if isinstance(model, str) else None,
            effects=tuple(effect_document(e) for e in self.effects.named([n for n in used if "=" not in n])),
            readings_sha256=None if readings is None else readings["sha256_of_chunks"],
            provenance=provenance | {"specimen": "" if whole is None else whole.specimen.id},
            scan=measured.scan,
        )


def _study(request: Request) -> ReproduceInput:
    return ReproduceInput(request["study"])


def _document(measured: Measured) -> dict[str, Any]:
    """Return the session's document with what is measured of it, and what is left out."""
    document, session = measured.record.document, measured.session
    if document is None or session is None:
        raise InputError(f"session {measured.record.id} has no measured load case", "at least one")
    told = {c.id for c in session.cases} | measured.excluded.keys()
    kept = [w.model_dump(mode="json", exclude_none=True) for w in session.checks]
    out = document | {"cases": [c for c in document["cases"] if c["id"] in told]}
    if "amendments" in out:
        out["amendments"] = [a for a in out["amendments"] if a["case"] in told]
    out.pop("checks", None)
    out |= {"checks": kept} if kept else {}
    if not isinstance(session.tension_factor, TensionEstimate):
        # Where it could not be estimated, the published one stands in.
        out["tension_factor"] = session.tension_factor
    return out


def _why(job: Job) -> str:
    request = job.request
    if job.kind == "refit":
        return f"refitted to session {job.session} by {request['method']}"
    changes = [f"+{n}" for n in request["add"]] + [f"-{n}" for n in request["without"]]
    return f"{' '.join(changes)}, refitted to session {job.session}"


def _body(result: Any) -> dict[str, Any]:
    return plain(result["body"] | {"provenance": result["provenance"]})


def _kept_frozen(telling: Telling, job: Job, result: Any) -> dict[str, Any]:
    document = result["frozen"]
    if document is not None:
        known = select(frozen.c.sha256).where(frozen.c.sha256 == document["sha256"])
        if telling.connection.execute(known).first() is None:
            row = {
                "sha256": document["sha256"],
                "specimen": document["specimen"],
                "session": job.session,
                "created_utc": now_utc(),
                "document": document,
            }
            telling.connection.execute(insert(frozen).values(row))
    return _body(result)
