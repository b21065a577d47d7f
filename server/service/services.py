"""Components of a running service, and the order in which they start and stop."""

from __future__ import annotations

import threading
from contextlib import suppress
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

from starlette.requests import HTTPConnection

from daq.acquisition.blocks import Chunk
from fingermodel.compiled.compilation import prepare_jax
from fingermodel.fingers.files import finger_names
from server.application.bench_prediction import predictor
from server.service.answers import Tagged
from server.service.ingest.envelopes import Envelopes
from server.service.ingest.ingest import Ingest
from server.service.ingest.windows import Windows
from server.service.jobs.service import JobService
from server.service.jobs.supervisor import Supervisor
from server.service.jobs.task_kinds import Tasks
from server.service.live.hub import LiveHub
from server.service.models.case_updates import CaseUpdates
from server.service.models.effects import OwnEffects
from server.service.models.revisions import Revisions
from server.service.models.session_models import SessionModels
from server.service.operation.migrate import upgrade
from server.service.operation.scrub import Scrub
from server.service.sessions.measuring import Measuring
from server.service.sessions.sessions import Sessions
from server.service.sessions.turns import Made
from server.service.settings import Settings
from server.service.storage.database import Database
from server.service.storage.messages import Messages
from server.service.storage.purge import retain


@dataclass(eq=False)
class Services:
    """Everything that answers requests.

    Attributes:
        settings: of the service.
        database: that it keeps everything in.
        messages: that it tells.
        windows, envelopes: of stored readings, with what was looked at before.
        sessions, ingest, measuring, models, revisions, effects, jobs, live, case_updates, scrub: its parts.
        made: checks and reports of closed sessions that were asked for last.
        drawn: figures that were asked for last.
        ready: whether models are warm and the database is up to date.
        stopping: is set when the service ends.
    """

    settings: Settings
    database: Database
    messages: Messages
    windows: Windows
    envelopes: Envelopes
    sessions: Sessions
    ingest: Ingest
    measuring: Measuring
    models: SessionModels
    revisions: Revisions
    effects: OwnEffects
    jobs: JobService
    live: LiveHub
    case_updates: CaseUpdates
    scrub: Scrub
    made: Made[Any] = field(default_factory=lambda: Made(8))
    drawn: Made[Tagged] = field(default_factory=lambda: Made(512))
    ready: bool = False
    stopping: threading.Event = field(default_factory=threading.Event)


def of(connection: HTTPConnection) -> Services:
    """Return the running service's parts, for a request or a WebSocket."""
    found: Services = connection.app.state.services
    return found


def _load_pandas() -> None:
    """Load pandas before there are threads, where it is installed.

    Arrow loads it at its first array. Plotly, in another thread, would take it half loaded and fail.
    """
    with suppress(ImportError):
        import_module("pandas")


def build(settings: Settings) -> Services:
    """Put a service together; nothing runs yet.

    Raises:
        InputError: the database cannot be used.
    """
    prepare_jax()
    _load_pandas()
    if settings.database_url is None:
        settings.data.mkdir(parents=True, exist_ok=True)
    database = Database(settings.url)
    upgrade(database)
    messages = Messages(database)
    fingers = frozenset(finger_names())
    windows = Windows(database)
    sessions = Sessions(database, messages, fingers, windows)
    measuring = Measuring(sessions, windows)
    revisions = Revisions(database, messages)
    effects = OwnEffects(database)
    models = SessionModels(database, measuring, revisions, effects, fingers)
    case_updates = CaseUpdates(database, messages, measuring, models)
    live = LiveHub(messages, predictor, windows.one)

    def on_chunk(session: str, stream: str, chunk: Chunk) -> None:
        live.offer_chunk(session, stream, chunk)
        case_updates.on_readings(session)

    ingest = Ingest(database, messages, on_chunk)
    kinds = Tasks(settings, database, measuring, models, revisions, effects).kinds()
    workers = Supervisor(settings.worker_count, "server.service.jobs.tasks.warm" if settings.warm_workers else None)
    jobs = JobService(database, messages, workers, kinds, settings.job_timeout_s)
    return Services(
        settings,
        database,
        messages,
        windows,
        Envelopes(database),
        sessions,
        ingest,
        measuring,
        models,
        revisions,
        effects,
        jobs,
        live,
        case_updates,
        Scrub(database, lambda: retain(database, settings.keep_days)),
    )
