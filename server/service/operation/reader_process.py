"""A process beside the service that answers what only reads, so that heavy readers take nothing from benches.

It listens on loopback, for the service alone, and writes nothing. Until it is there, and whenever it is not, the
service answers by itself.
"""

from __future__ import annotations

import asyncio
import hmac
import logging
import multiprocessing
import secrets
import socket
import threading
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess

import httpx
import uvicorn
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from server.service.jobs.worker import begin_worker
from server.service.settings import Settings
from server.service.web import logs
from server.service.web.workers import GoneError

_LOG = logging.getLogger(__name__)
# Benches come before readers, and readers before refits and searches.
NICENESS = 2
_SECRET = b"x-fingertwin-reader"
# A process that ended is replaced after so long, each time after twice as long while none gets ready [s].
_FIRST_WAIT_S, _MOST_WAIT_S = 1.0, 60.0
_CONNECT_S = 5.0
# Of a request: what the answer depends on, and what its body is.
# Of an answer: what holds for one connection, or is added on the way.
_ASKED = frozenset({b"accept", b"content-type", b"if-none-match"})
_OWN = frozenset({b"connection", b"date", b"keep-alive", b"server", b"transfer-encoding", b"x-request-id"})


class ReaderProcess:
    """Starts the process, replaces it when it dies, and passes requests on to it.

    Args:
        settings: of the service.
        make: makes the application in the process; at the top of a module.
    """

    def __init__(self, settings: Settings, make: Callable[[Settings], ASGIApp]) -> None:
        self._settings, self._make = settings, make
        self._secret = secrets.token_hex(16)
        self._process: SpawnProcess | None = None
        self._url = ""
        self._changed, self._closed = threading.Condition(), threading.Event()
        self._thread = threading.Thread(target=self._keep, name="readers", daemon=True)
        self._client = httpx.AsyncClient(
            timeout=httpx.Timeout(None, connect=_CONNECT_S), trust_env=False, limits=httpx.Limits(max_connections=None)
        )

    @property
    def pid(self) -> int | None:
        """Id of the process while it answers."""
        with self._changed:
            return self._process.pid if self._process is not None and self._url else None

    def start(self) -> None:
        """Start it, and a new one whenever it ends."""
        self._thread.start()

    def wait(self, timeout_s: float) -> bool:
        """Wait until it answers; return whether that came in time."""
        with self._changed:
            return self._changed.wait_for(lambda: bool(self._url), timeout_s)

    async def close(self) -> None:
        """End it."""
        self._closed.set()
        with self._changed:
            if self._process is not None:
                self._process.kill()
        await asyncio.to_thread(self._thread.join)
        await self._client.aclose()

    async def answer(self, request: Request) -> Response | None:
        """Pass a request on; None where the process does not answer, or has failed.

        Raises:
            GoneError: the client has gone.
        """
        scope, url = request.scope, self._url
        if not url:
            return None
        path = scope.get("raw_path") or scope["path"].encode()
        headers = [(n, v) for n, v in scope["headers"] if n in _ASKED]
        headers += [(_SECRET, self._secret.encode()), (b"x-request-id", logs.REQUEST_ID.get().encode())]
        try:
            target = httpx.URL(url).copy_with(raw_path=path + b"?" + scope["query_string"])
            body = await request.body() or None
            asked = self._client.build_request(request.method, target, headers=headers, content=body)
            answer = await _unless_gone(request, self._client.send(asked, stream=True))
            if answer.status_code < 500:
                return _Passed(answer)
            await answer.aclose()
            _LOG.warning("the readers' process failed with %d; the service answers by itself", answer.status_code)
            return None
        except (httpx.TransportError, httpx.InvalidURL) as error:
            _LOG.warning("the readers' process does not answer (%s)", type(error).__name__)
            return None

    def _keep(self) -> None:
        wait_s = _FIRST_WAIT_S
        while not self._closed.is_set():
            try:
                was_ready = self._run()
            except OSError:
                _LOG.exception("the readers' process was not started")
                was_ready = False
            if not self._closed.is_set():
                _LOG.error("the readers' process has ended; the service answers by itself until another is there")
            wait_s = _FIRST_WAIT_S if was_ready else min(2.0 * wait_s, _MOST_WAIT_S)
            self._closed.wait(wait_s)

    def _run(self) -> bool:
        """Run one process until it ends; return whether it was ready."""
        ours, theirs = multiprocessing.Pipe(duplex=False)
        arguments = (self._settings, self._make, self._secret, theirs)
        process = multiprocessing.get_context("spawn").Process(target=serve, args=arguments, name="fingertwin readers")
        try:
            process.start()
        finally:
            theirs.close()
        with self._changed:
            self._process = process
            if self._closed.is_set():
                process.kill()
        port = 0
        with suppress(EOFError):
            port = ours.recv()
        with self._changed:
            self._url = f"http://127.0.0.1:{port}" if port else ""
            self._changed.notify_all()
        wait([process.sentinel])
        with self._changed:
            self._url, self._process = "", None
        process.join()
        # Who else waited for it (a supervisor, a test) has its exit status, and it seems to run for ever.
        with suppress(ValueError):
            process.close()
        ours.close()
        return bool(port)


async def _unless_gone(request: Request, sending: Awaitable[httpx.Response]) -> httpx.Response:
    """Wait for the beginning of an answer while its client waits too; for one that has gone nothing is computed."""

    async def gone() -> None:
        while (await request.receive())["type"] != "http.disconnect":
            pass

    answer, end = asyncio.ensure_future(sending), asyncio.ensure_future(gone())
    try:
        await asyncio.wait((answer, end), return_when=asyncio.FIRST_COMPLETED)
        if not answer.done():
            raise GoneError
        return answer.result()
    finally:
        for task in (answer, end):
            task.cancel()
            with suppress(asyncio.CancelledError, httpx.TransportError):
                await task


class _Passed(StreamingResponse):
    """An answer as it comes."""

    def __init__(self, answer: httpx.Response) -> None:
        super().__init__(answer.aiter_raw(), answer.status_code)
        self._answer = answer
        self.raw_headers = [(n.lower(), v) for n, v in answer.headers.raw if n.lower() not in _OWN]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send it, and let go of it, whether or not the client has waited for all of it."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            await self._answer.aclose()


def serve(settings: Settings, make: Callable[[Settings], ASGIApp], secret: str, told: Connection) -> None:
    """Be the process: tell the port once the application answers, and end with the service."""
    begin_worker(NICENESS)
    logs.configure(settings)
    # The service tells of each request itself.
    logging.getLogger("fingertwin.request").setLevel(logging.CRITICAL)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        app = _Private(make(settings), secret.encode())
        config = uvicorn.Config(app, log_config=None, access_log=False, server_header=False, lifespan="on", ws="none")
        _Server(config, told, listener.getsockname()[1]).run([listener])


class _Private:
    """Answers the service alone."""

    def __init__(self, app: ASGIApp, secret: bytes) -> None:
        self._app, self._secret = app, secret

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or refuse."""
        given = next((v for n, v in scope.get("headers", ()) if n == _SECRET), b"")
        if scope["type"] == "http" and not hmac.compare_digest(given, self._secret):
            await Response("for the service alone", 403)(scope, receive, send)
        else:
            await self._app(scope, receive, send)


class _Server(uvicorn.Server):
    """Tells its port as soon as it answers, and leaves signals to the service."""

    def __init__(self, config: uvicorn.Config, told: Connection, port: int) -> None:
        super().__init__(config)
        self._told, self._port = told, port

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start, and say so."""
        await super().startup(sockets)
        if self.started:
            self._told.send(self._port)

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Capture none."""
        yield
