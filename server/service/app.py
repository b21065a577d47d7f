"""The model service as an ASGI application."""

from __future__ import annotations

import asyncio
import gc
import logging
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from importlib.metadata import version

import numpy as np
from fastapi import APIRouter, FastAPI
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.types import Lifespan

from daq.errors import InputError
from daq.recordings.plateaus import reduce_window
from daq.uplink.wire import API
from server.service.answers import JsonAnswer
from server.service.operation.health import Health
from server.service.operation.reader_process import ReaderProcess
from server.service.routes import (
    audit,
    bench_view,
    catalogue,
    exports,
    figures,
    fingers,
    fits,
    forces,
    health,
    ingest,
    jobs,
    live,
    pages,
    predictions,
    readings,
    recordings,
    sessions,
    studies,
)
from server.service.security.guard import protect
from server.service.security.tokens import TokenBook
from server.service.services import Services, build
from server.service.settings import Settings
from server.service.storage.checksums import DamagedError
from server.service.web import problems
from server.service.web.edge import Edge
from server.service.web.metrics import Metrics
from server.service.web.openapi import answer_wrong_method, document_of

_LOG = logging.getLogger(__name__)
# So long a compilation that has begun may hold up the end of the service.
_COMPILED_S = 30.0
# What fails while the service gets ready is tried again after so long, and each time after twice as long [s].
FIRST_WAIT_S, _MOST_WAIT_S = 1.0, 60.0
_DESCRIPTION = """\
The digital twin of a finger on a test bench. It takes a load cell's readings in, keeps them, predicts and compares the
forces of every load case, refits the model, and finds the physical effect that is missing.

Units are in the names: `_N`, `_Nmm`, `_g`, `_deg`, `_s`. Axes: x proximal, y dorsal, z radial. Refusals are
`application/problem+json` and say what was found, what was expected and what to do.
"""


def create_app(settings: Settings) -> FastAPI:
    """Make the application; its parts are built and started with it.

    Args:
        settings: of the service.
    """

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        parts = await asyncio.to_thread(build, settings)
        await asyncio.to_thread(parts.sessions.forget_arrivals)
        app.state.services = parts
        readers = ReaderProcess(settings, create_reading_app) if settings.reader_process else None
        app.state.reader_process = readers
        folder = None if settings.database_url else settings.data
        app.state.health = Health(parts.database, lambda: parts.ready, parts.jobs.workers, parts.scrub, folder)
        _measure(parts, app.state.health, app.state.metrics)
        parts.live.start(asyncio.get_running_loop())
        parts.case_updates.start()
        parts.scrub.start()
        warming = threading.Thread(target=_warm, args=(parts,), name="warm", daemon=True)
        warming.start()
        if readers is not None:
            app.state.metrics.reader_process.set_function(lambda: float(readers.pid is not None))
            readers.start()
        try:
            yield
        finally:
            parts.stopping.set()
            if readers is not None:
                await readers.close()
            await parts.live.close()
            # The interpreter must not end while a thread is inside the compiler: that would end it with a crash.
            await asyncio.to_thread(warming.join, _COMPILED_S)
            await asyncio.to_thread(_stop, parts)

    app = _application(lifespan)
    metrics = app.state.metrics = Metrics()
    tokens = TokenBook(lambda: app.state.services.database)
    app.openapi = lambda: document_of(app)  # type: ignore[method-assign]

    @app.get(f"{API}/openapi.json", include_in_schema=False)
    def openapi() -> JsonAnswer:
        """Return the OpenAPI document; making it takes a moment, which a thread waits."""
        return JsonAnswer(document_of(app))

    protect(app, settings, tokens, metrics)
    return app


def create_reading_app(settings: Settings) -> FastAPI:
    """Make the application of the readers' process: the same answers, without what runs beside them.

    Args:
        settings: of the service, which has prepared the database.
    """

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        parts = app.state.services = await asyncio.to_thread(build, settings)
        await asyncio.to_thread(_compile, parts)
        gc.freeze()
        yield
        parts.database.close()

    app = _application(lifespan)
    app.add_middleware(Edge, metrics=Metrics())
    return app


def _application(lifespan: Lifespan[FastAPI]) -> FastAPI:
    app = FastAPI(
        title="fingertwin",
        version=version("fingertwin"),
        description=_DESCRIPTION,
        openapi_url=None,
        docs_url=None,
        redoc_url=None,
        default_response_class=JsonAnswer,
        lifespan=lifespan,
        license_info={"name": "Apache-2.0", "identifier": "Apache-2.0"},
    )
    app.add_exception_handler(problems.ProblemError, problems.answer_problem)
    app.add_exception_handler(InputError, problems.answer_input_error)
    app.add_exception_handler(DamagedError, problems.answer_damaged)
    app.add_exception_handler(RequestValidationError, problems.answer_invalid)
    app.add_exception_handler(HTTPException, problems.answer_http)
    app.add_exception_handler(405, answer_wrong_method)
    app.add_exception_handler(Exception, problems.answer_failure)
    _add_routes(app)
    return app


def _add_routes(app: FastAPI) -> None:
    api = APIRouter(prefix=API)
    parts = (
        health,
        sessions,
        bench_view,
        ingest,
        readings,
        recordings,
        live,
        predictions,
        fits,
        jobs,
        figures,
        fingers,
        forces,
        exports,
        catalogue,
        studies,
        audit,
    )
    for part in parts:
        api.include_router(part.router)
    app.include_router(api)
    app.include_router(pages.router)
    app.include_router(health.metrics_router)


def _measure(parts: Services, health: Health, metrics: Metrics) -> None:
    """Let the metrics ask for what the parts count by themselves."""
    health.report(metrics)
    parts.ingest.stored = metrics.ingested
    metrics.live_clients.set_function(lambda: float(parts.live.clients))
    metrics.ask("fingertwin_live", "Of the live stream, since the start.", lambda: vars(parts.live.counters), "what")


def _warm(parts: Services) -> None:
    """Compile what the first request would wait for, and only then take up queued jobs, whose workers compile too."""
    if not _until_done(parts, lambda: _compile(parts), "the model was not warmed, and the service is not ready yet"):
        return
    parts.ready = True
    if not gc.isenabled():
        # What was loaded stays as long as the service runs: it is looked through no more.
        gc.freeze()
        gc.enable()
    # What the first weight that hangs would wait for: a window's statistics load what they need.
    reduce_window(np.arange(100.0), np.random.default_rng(0).normal(size=(100, 6)))
    if parts.settings.warm_workers:
        parts.jobs.warm()
    _until_done(parts, parts.jobs.start, "the jobs of the run before were not taken up yet")


def _compile(parts: Services) -> None:
    predictor = parts.models.predictor("an1979_middle")
    rotations, muscles = len(predictor.topology.rotations), len(predictor.topology.muscles)
    predictor.predict(np.full((1, rotations), 0.5), np.zeros((1, muscles)), 0.0)


def _until_done(parts: Services, work: Callable[[], None], failed: str) -> bool:
    """Do what the service cannot do without, again and again until it succeeds: whatever it lacked may come back."""
    wait_s = FIRST_WAIT_S
    while not parts.stopping.is_set():
        try:
            work()
        except Exception:
            _LOG.exception("%s; again in %g s", failed, wait_s)
            parts.stopping.wait(wait_s)
            wait_s = min(2.0 * wait_s, _MOST_WAIT_S)
        else:
            return True
    return False


def _stop(parts: Services) -> None:
    parts.ready = False
    parts.jobs.close()
    parts.case_updates.close()
    parts.scrub.close()
    parts.database.close()
