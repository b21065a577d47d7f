"""A small application behind the guard, for tests."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from fastapi import APIRouter, FastAPI, Request, WebSocket
from sqlalchemy.exc import OperationalError
from starlette.responses import StreamingResponse

from daq.errors import InputError
from server.service.operation.migrate import upgrade
from server.service.security.guard import protect
from server.service.security.tokens import Role, TokenBook, create
from server.service.settings import DATABASE_FILE, Settings
from server.service.storage.database import Database
from server.service.web import problems
from server.service.web.metrics import Metrics
from server.service.web.wire import Wire, wire_of

MOST_BYTES = 1 << 16


class Guarded:
    """An application, and what it is guarded with.

    Args:
        folder: of its database.
        settings: other than the defaults.

    Attributes:
        app: takes and gives things, and fails when asked to.
        seen: what the application itself was asked for.
        wires: what it could write to past all layers, of each WebSocket.
    """

    def __init__(self, folder: Path, **settings: Any) -> None:
        self.settings = Settings(data=folder, **({"most_body_bytes": MOST_BYTES} | settings))
        self.database = Database(f"sqlite:///{folder / DATABASE_FILE}")
        upgrade(self.database)
        self.metrics = Metrics()
        self.book = TokenBook(lambda: self.database)
        self.seen: list[tuple[str, str]] = []
        self.wires: list[Wire | None] = []
        self.app = self._made()
        protect(self.app, self.settings, self.book, self.metrics)

    def token(self, role: Role) -> str:
        """Return the text of a new token."""
        return create(self.database, "test", role)[1]

    def _made(self) -> FastAPI:
        app, api = FastAPI(), APIRouter(prefix="/api/v1")
        app.add_exception_handler(problems.ProblemError, problems.answer_problem)
        app.add_exception_handler(InputError, problems.answer_input_error)
        app.add_exception_handler(Exception, problems.answer_failure)

        @api.api_route("/things", methods=["GET", "HEAD", "OPTIONS"])
        def things(request: Request) -> dict[str, str | None]:
            self.seen.append(("GET", ""))
            token = request.state.token
            return {"token": token and token.id}

        @api.get("/things/{name}")
        def thing(name: str) -> str:
            return name

        @api.api_route("/things", methods=["POST", "PUT", "PATCH", "DELETE"])
        @api.post("/predictions")
        async def take(request: Request) -> int:
            body = await request.body()
            self.seen.append((request.method, request.url.path))
            return len(body)

        @api.get("/slow")
        async def slow() -> StreamingResponse:
            async def parts() -> AsyncIterator[bytes]:
                for part in (b"one", b"two", b"three"):
                    yield part

            return StreamingResponse(parts())

        @api.get("/broken")
        def broken() -> None:
            raise ZeroDivisionError("secret of ours")

        @api.get("/readonly")
        def readonly() -> None:
            raise OperationalError("INSERT", {"body": "somebody's"}, Exception("attempt to write a readonly database"))

        @api.get("/health/live")
        async def live() -> bool:
            return True

        @app.websocket("/live")
        async def socket(socket: WebSocket) -> None:
            await socket.accept()
            self.seen.append(("WEBSOCKET", str(socket.headers)))
            self.wires.append(wire_of(socket.scope))
            async for text in socket.iter_text():
                await socket.send_text(text)

        app.include_router(api)
        return app
