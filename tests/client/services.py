"""Services for a client: in this process, on a port of this machine, or scripted."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import uvicorn

from server.service.app import create_app
from server.service.serve import bound
from server.service.settings import Settings
from server.service.web.wire import Wire
from tests.server.service.running import URL, ServiceReceiver

__all__ = ["URL", "InProcess", "receiver_in", "running", "said", "scripted"]

PATIENCE_S = 60.0


class InProcess(httpx.BaseTransport):
    """Hands requests to a service in this process, and notes them.

    After so many chunks the line goes dead: `break_before` the service has the next one, or `break_after` it has.
    """

    def __init__(self, receiver: ServiceReceiver) -> None:
        self._receiver = receiver
        self.asked: list[str] = []
        self.break_before: int | None = None
        self.break_after: int | None = None

    @property
    def chunks(self) -> list[str]:
        return [line for line in self.asked if "/chunks/" in line]

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        self.asked.append(f"{request.method} {request.url.path}")
        number = len(self.chunks) if "/chunks/" in request.url.path else None
        if number is not None and self.break_before is not None and number > self.break_before:
            raise httpx.ConnectError("the cable is out")
        answer = self._receiver.client().request(
            request.method, str(request.url), headers=dict(request.headers), content=request.read()
        )
        if number is not None and self.break_after is not None and number > self.break_after:
            raise httpx.ReadError("the cable is out")
        return httpx.Response(answer.status_code, headers=dict(answer.headers), content=answer.content)


@contextmanager
def receiver_in(folder: Path, **settings: Any) -> Iterator[ServiceReceiver]:
    receiver = ServiceReceiver(folder, **settings)
    try:
        yield receiver
    finally:
        receiver.close()


class _Server(uvicorn.Server):
    """Says when it answers."""

    def __init__(self, config: uvicorn.Config) -> None:
        super().__init__(config)
        self.answers = threading.Event()

    async def startup(self, sockets: Any = None) -> None:
        await super().startup(sockets)
        self.answers.set()


@contextmanager
def running(folder: Path, port: int = 0, **settings: Any) -> Iterator[str]:
    """Run a service on a free port of this machine, and give its address."""
    made = Settings(data=folder, port=port, **({"reader_process": False} | settings))
    listener = bound("127.0.0.1", port)
    config = uvicorn.Config(
        create_app(made), ws=Wire, ws_per_message_deflate=False, log_config=None, lifespan="on",
        timeout_graceful_shutdown=5,
    )  # fmt: skip
    server = _Server(config)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, name="uvicorn")
    thread.start()
    try:
        assert server.answers.wait(PATIENCE_S)
        yield f"http://127.0.0.1:{listener.getsockname()[1]}"
    finally:
        server.should_exit = True
        thread.join(PATIENCE_S)
        listener.close()
    assert not thread.is_alive()


def scripted(*answers: httpx.Response | Exception) -> tuple[httpx.MockTransport, list[httpx.Request]]:
    """Return a transport that gives these answers in turn, the last one for ever, and what it was asked."""
    asked: list[httpx.Request] = []

    def handle(request: httpx.Request) -> httpx.Response:
        asked.append(request)
        answer = answers[min(len(asked), len(answers)) - 1]
        if isinstance(answer, Exception):
            raise answer
        return httpx.Response(answer.status_code, headers=answer.headers, content=answer.content)

    return httpx.MockTransport(handle), asked


def said(value: Any, status: int = 200, **headers: str) -> httpx.Response:
    """Return an answer with a JSON body."""
    return httpx.Response(status, content=json.dumps(value), headers={"Content-Type": "application/json"} | headers)
