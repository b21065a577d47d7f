"""An application behind a real socket on loopback, with the service's own connections or uvicorn's."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import uvicorn
from starlette.types import ASGIApp

PATIENCE_S = 20.0


@contextmanager
def listening(app: ASGIApp, ws: Any) -> Iterator[str]:
    """Serve until the end; gives host and port."""
    config = uvicorn.Config(app, port=0, log_level="error", ws_per_message_deflate=False, ws=ws)
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        while not server.started:
            threading.Event().wait(0.01)
        yield f"127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}"
    finally:
        server.should_exit = True
        thread.join(PATIENCE_S)
