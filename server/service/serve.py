"""Run the service until it is told to stop: its data held by it alone, its address bound, its requests finished."""

from __future__ import annotations

import asyncio
import errno
import logging
import signal
import socket
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from types import FrameType

import uvicorn
from sqlalchemy.exc import DBAPIError
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.server import HANDLED_SIGNALS

from daq.errors import LATER, InputError, LaterError
from server.service.operation.folder import alone, folder_of, held, made
from server.service.operation.migrate import upgrade
from server.service.security.tokens import listed
from server.service.settings import Settings
from server.service.storage.database import Database
from server.service.storage.reserve import occupy
from server.service.web import logs
from server.service.web.wire import Wire

_LOG = logging.getLogger("fingertwin.serve")
# After a signal, requests and WebSockets have so long to come to their end [s].
FINISH_S = 10
# How often the server looks after itself: ten times a second, as uvicorn does, costs as much as a live client.
LOOK_S = 1.0
# How long a thread may go on while others wait for the interpreter [s].
SWITCH_S = 5e-4
# Of one message of a live client's, which says only what it wants to see.
_MOST_MESSAGE = 64 << 10


def serve(settings: Settings, make: Callable[[Settings], ASGIApp], ready: Callable[[str], None]) -> None:
    """Serve until SIGINT, SIGTERM or, on Windows, Ctrl-Break.

    Args:
        settings: of the service.
        make: the application, which starts and stops what it needs.
        ready: is told the address as soon as it answers.

    Raises:
        InputError: the data are in use or cannot be written, the address cannot be had, or nobody could get in.
    """
    settings = settings.model_copy(update={"data": made(settings.data)})
    logs.configure(settings)
    # A bench's chunk needs the interpreter some twenty times: busy readers would keep it from it for 5 ms each time.
    sys.setswitchinterval(SWITCH_S)
    with held(made(folder_of(settings))), closing(Database(settings.url)) as database, alone(database):
        upgrade(database)
        if database.file is not None:
            occupy(database.file.parent)
        if not settings.loopback and not any(t.state() == "valid" for t in listed(database)):
            raise InputError(
                f"{settings.host} can be reached from elsewhere, and there is no valid token",
                "a token for whoever is to get in",
                "fingertwin token create NAME --role read|write makes one",
            )
        with closing(bound(settings.host, settings.port)) as listener:
            _run(settings, make(settings), listener, ready)
    _LOG.info("stopped")


def bound(host: str, port: int) -> socket.socket:
    """Return a socket that is bound to an address and does not listen yet.

    Raises:
        InputError: there is no such address here, or it is in use.
    """
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (OSError, UnicodeError) as error:
        raise InputError(f"the host {host!r} is not known", "a name or an address of this machine") from error
    # A name of both kinds is reached at the older one by everybody.
    family, kind, protocol, _, address = min(found, key=lambda f: f[0] != socket.AF_INET)
    listener = socket.socket(family, kind, protocol)
    try:
        if hasattr(socket, "SO_EXCLUSIVEADDRUSE"):
            # On Windows, others could take an address that is in use.
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        else:
            # Elsewhere an address is free again as soon as the service has ended.
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.setblocking(False)
    except OSError as error:
        listener.close()
        raise _not_bound(host, port, error) from error
    return listener


def _not_bound(host: str, port: int, error: OSError) -> InputError:
    if error.errno == errno.EADDRINUSE:
        return InputError(f"port {port} of {host} is in use", "a free one", "End what uses it, or give another --port")
    if error.errno == errno.EADDRNOTAVAIL:
        return InputError(f"the host {host} is none of this machine's addresses", "one of them, such as 127.0.0.1")
    if error.errno in (errno.EACCES, errno.EPERM):
        return InputError(f"port {port} of {host} may not be used", "one above 1023", "Give another --port")
    return InputError(f"{host}:{port} cannot be used ({error.strerror or error})", "a free address", "Give another")


def _run(settings: Settings, app: ASGIApp, listener: socket.socket, ready: Callable[[str], None]) -> None:
    started = _Started(app)
    config = uvicorn.Config(
        started,
        # Beyond loopback the parser that limits the size of headers; the other is faster.
        http="auto" if settings.loopback else "h11",
        log_config=None,
        access_log=False,
        server_header=False,
        # Who asks is who is connected: what a request says about it is not believed.
        proxy_headers=False,
        lifespan="on",
        ws_max_size=_MOST_MESSAGE,
        ws=Wire,
        # On loopback and in a lab the wire is wider than the core that would pack for it.
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=FINISH_S,
    )
    host, port = listener.getsockname()[:2]
    _LOG.info("starting on the data in %s", settings.data)
    name = f"[{host}]" if ":" in host else host
    server = Server(config, lambda: ready(f"http://{name}:{port}"))
    try:
        server.run([listener])
    except SystemExit:
        # Of uvicorn, where the application could not start.
        if started.refusal is not None:
            raise started.refusal from None
        raise SystemExit(1) from None


class _Started:
    """Application that explains its refusal to start in one line, as any command does."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self.refusal: InputError | None = None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass everything on."""
        if scope["type"] != "lifespan":
            await self._app(scope, receive, send)
            return
        failed: list[Message] = []

        async def later(message: Message) -> None:
            if message["type"] == "lifespan.startup.failed":
                failed.append(message)
            else:
                await send(message)

        try:
            await self._app(scope, receive, later)
        except InputError as error:
            self.refusal = error
            failed = [{**message, "message": ""} for message in failed]
        except Exception as error:
            if not failed:
                raise
            cause = error.orig if isinstance(error, DBAPIError) else error
            if isinstance(error, DBAPIError) or (isinstance(error, OSError) and error.errno in LATER):
                self.refusal = LaterError(
                    f"the service cannot start now ({cause})", "space and free files", "Start it again"
                )
                failed = [{**message, "message": ""} for message in failed]
        for message in failed:
            await send(message)


class Server(uvicorn.Server):
    """A server that says when it answers, and ends as asked without being killed by the signal that asked."""

    def __init__(self, config: uvicorn.Config, ready: Callable[[], None]) -> None:
        super().__init__(config)
        self._ready = ready
        self._stop = asyncio.Event()
        self._loop: asyncio.AbstractEventLoop | None = None

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start, and say so."""
        await super().startup(sockets)
        if self.started:
            self._ready()

    async def main_loop(self) -> None:
        """Serve until asked to stop."""
        self._loop = asyncio.get_running_loop()
        while not await self.on_tick(0):
            with suppress(TimeoutError):
                async with asyncio.timeout(LOOK_S):
                    await self._stop.wait()

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Stop in order, at once."""
        super().handle_exit(sig, frame)
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._stop.set)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Say so, and stop."""
        _LOG.info("stopping: requests have %d s to end", FINISH_S)
        await super().shutdown(sockets)

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Stop in order at the first signal."""
        before = {number: signal.signal(number, self.handle_exit) for number in HANDLED_SIGNALS}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
