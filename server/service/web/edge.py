"""The outermost layer: every answer gets an id, security headers, a line in the log and its place in the metrics."""

from __future__ import annotations

import logging
import re
import secrets
import time
from typing import Any

from sqlalchemy.exc import DataError, DBAPIError, IntegrityError, ProgrammingError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.service.web.logs import REQUEST_ID, cleaned
from server.service.web.metrics import Metrics
from server.service.web.problems import ProblemError, failure, shortened
from server.service.web.workers import GoneError

_LOG = logging.getLogger("fingertwin.request")
# What went wrong is told by whichever process it went wrong in, the request itself by the service alone.
_FAULTS = logging.getLogger(__name__)
_ID = re.compile(rb"[A-Za-z0-9._-]{1,64}")
# Successes that come many times a second, or that nobody asked for by hand.
_QUIET = re.compile(r"/(chunks|events|streams)/|/(live|health|live/[a-z]+|ready|metrics)$")
_WARNED = (401, 403, 421, 429, 503)
RETRY_S = 2

# The service's own pages load nothing from elsewhere, run no script of the page's text, and stand in nobody's frame.
POLICY = (
    "default-src 'self'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
    "object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)
# HSTS is missing on purpose: the service speaks plain HTTP; whoever puts TLS before it says so there.
HEADERS: tuple[tuple[bytes, bytes], ...] = (
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-embedder-policy", b"require-corp"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
)


class Edge:
    """Sees each request and its answer.

    Args:
        app: that answers.
        metrics: that count.
    """

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self._app, self._metrics = app, metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        number = _request_id(scope)
        token = REQUEST_ID.set(number)
        answer = _Answer(send, number)
        began_s = time.perf_counter()
        try:
            await self._app(scope, receive, answer.send)
        except GoneError:
            pass
        except Exception as error:
            if scope["type"] == "websocket" or answer.status:
                _FAULTS.exception("failed")
                raise
            await _failed(error)(scope, receive, answer.send)
        finally:
            self._note(scope, answer.status or 499, time.perf_counter() - began_s)
            REQUEST_ID.reset(token)

    def _note(self, scope: Scope, status: int, seconds: float) -> None:
        route, method = template(scope), scope.get("method", "WEBSOCKET")
        if scope["type"] == "http":
            self._metrics.answered(method, route, status, seconds)
        level = logging.WARNING if status in _WARNED else logging.ERROR if status >= 500 else logging.INFO
        if status < 400 and scope["type"] == "http" and _QUIET.search(route):
            level = logging.DEBUG
        if not _LOG.isEnabledFor(level):
            return
        path, ms = shortened(cleaned(scope["path"])), round(1000 * seconds, 2)
        client = (scope.get("client") or ("",))[0]
        extra = {"method": method, "route": route, "path": path, "status": status, "ms": ms, "client": client}
        _LOG.log(level, "%s %s %s %d %.1f ms", client, method, path, status, ms, extra=extra)


class _Answer:
    """An answer on its way out.

    Attributes:
        status: of HTTP; 0 until it begins, 101 for an open WebSocket.
    """

    def __init__(self, send: Send, number: str) -> None:
        self._send, self._number, self.status = send, number.encode(), 0

    async def send(self, message: Message) -> None:
        """Pass a message on."""
        kind = message["type"]
        if kind in ("http.response.start", "websocket.http.response.start"):
            self.status = message["status"]
            given = list(message.get("headers", ()))
            names = {name.lower() for name, _ in given}
            given += [(name, value) for name, value in HEADERS if name not in names]
            message = {**message, "headers": [*given, (b"x-request-id", self._number)]}
        elif kind == "websocket.accept":
            self.status = 101
        elif kind == "websocket.close" and not self.status:
            self.status = 403
        await self._send(message)


def template(scope: Scope) -> str:
    """Return the template of a request's address, with the names of its parts; `other` where it has none."""
    framework: dict[str, Any] = scope.get("fastapi", {})
    # FastAPI keeps the prefixes of included routers beside the route.
    for found in (framework.get("effective_route_context"), scope.get("route")):
        path = getattr(found, "path", None)
        if path:
            return str(path)
    return "other"


def _request_id(scope: Scope) -> str:
    for name, value in scope["headers"]:
        if name == b"x-request-id" and _ID.fullmatch(value):
            return str(value, "ascii")
    return secrets.token_hex(8)


def _failed(error: Exception) -> ASGIApp:
    if isinstance(error, ProblemError):
        return error.answer()
    ours = isinstance(error, IntegrityError | DataError | ProgrammingError)
    if isinstance(error, PoolTimeoutError) or (isinstance(error, DBAPIError) and not ours):
        said = " ".join(str(getattr(error, "orig", "") or "it is too busy").split())
        _FAULTS.error("the database cannot be used: %s", said)
        return ProblemError(
            503,
            f"the database cannot be used now ({shortened(cleaned(said))})",
            "one that answers, on a disk with space that may be written",
            "See GET /api/v1/health, and send the request again later; nothing of it was kept",
            headers={"Retry-After": str(RETRY_S)},
        ).answer()
    _FAULTS.error("failed", exc_info=error)
    return failure()
