"""Requests to an ASGI application without a network, part by part: what comes in, what goes out, and in which order."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from starlette.types import ASGIApp, Message


@dataclass
class Answer:
    """What an application sent.

    Attributes:
        messages: as they were sent.
        taken: parts of the body that it asked for.
    """

    messages: list[Message] = field(default_factory=list)
    taken: int = 0

    @property
    def status(self) -> int:
        return int(self.messages[0]["status"])

    @property
    def headers(self) -> dict[str, str]:
        return {n.decode().lower(): v.decode() for n, v in self.messages[0]["headers"]}

    @property
    def body(self) -> bytes:
        return b"".join(m.get("body", b"") for m in self.messages[1:])

    def json(self) -> Any:
        return json.loads(self.body)

    @property
    def problem(self) -> dict[str, Any]:
        """The body of a refusal, which says its status again."""
        assert self.headers["content-type"] == "application/problem+json"
        body: dict[str, Any] = self.json()
        assert body["status"] == self.status
        assert body["detail"]
        assert not self.messages[-1].get("more_body", False)
        return body


def ask(
    app: ASGIApp,
    method: str = "GET",
    path: str = "/api/v1/things",
    headers: Mapping[str, str] | Iterable[tuple[str, str]] = (),
    body: Iterable[bytes] = (b"",),
    *,
    query: bytes = b"",
    client: str = "127.0.0.1",
) -> Answer:
    """Ask once.

    Args:
        app: that answers.
        method: of HTTP.
        path: decoded.
        headers: besides a Host of this machine's, which they may replace.
        body: in parts.
        query: as sent.
        client: its address.
    """
    scope = scope_of("http", path, headers, client) | {"method": method, "query_string": query}
    parts = list(body)
    answer = Answer()

    async def receive() -> Message:
        if answer.taken >= len(parts):
            await asyncio.Event().wait()
        answer.taken += 1
        return {"type": "http.request", "body": parts[answer.taken - 1], "more_body": answer.taken < len(parts)}

    async def send(message: Message) -> None:
        answer.messages.append(message)

    asyncio.run(asyncio.wait_for(app(scope, receive, send), 30))
    return answer


def scope_of(
    kind: str, path: str, headers: Mapping[str, str] | Iterable[tuple[str, str]], client: str
) -> dict[str, Any]:
    """The scope of a request."""
    given = list(headers.items() if isinstance(headers, Mapping) else headers)
    if not any(name.lower() == "host" for name, _ in given):
        given.insert(0, ("host", "127.0.0.1:8765"))
    return {
        "type": kind, "asgi": {"version": "3.0"}, "http_version": "1.1", "scheme": "http", "path": path,
        "raw_path": path.encode(), "root_path": "", "query_string": b"", "client": (client, 50000),
        "server": ("127.0.0.1", 8765), "extensions": {}, "state": {},
        "headers": [(name.lower().encode(), value.encode("latin-1")) for name, value in given],
    }  # fmt: skip


def open_socket(
    app: ASGIApp, headers: Mapping[str, str], said: Iterable[str] = (), *, path: str = "/live", extended: bool = True
) -> list[Message]:
    """Open a WebSocket, say something, hang up; return what was sent.

    Args:
        app: that answers.
        headers: of the handshake.
        said: texts that are sent once it is open.
        path: of the WebSocket.
        extended: whether the server can refuse it with an answer of HTTP.
    """
    scope = scope_of("websocket", path, headers, "127.0.0.1")
    offered = dict(headers).get("sec-websocket-protocol", "")
    scope |= {"subprotocols": [p.strip() for p in offered.split(",") if p.strip()], "scheme": "ws"}
    scope["extensions"] = {"websocket.http.response": {}} if extended else {}
    waiting: list[Message] = [{"type": "websocket.connect"}]
    waiting += [{"type": "websocket.receive", "text": text} for text in said]
    waiting.append({"type": "websocket.disconnect", "code": 1000})
    sent: list[Message] = []

    async def receive() -> Message:
        return waiting.pop(0)

    async def send(message: Message) -> None:
        sent.append(message)

    asyncio.run(asyncio.wait_for(app(scope, receive, send), 30))
    return sent
