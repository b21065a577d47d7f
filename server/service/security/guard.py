"""Checks that every request passes: its address, page of origin, token, rate and size."""

from __future__ import annotations

import math
import time
from functools import partial

from fastapi import FastAPI
from limits import RateLimitItemPerSecond
from limits.storage import MemoryStorage
from limits.strategies import MovingWindowRateLimiter
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.service.security.body_limit import LimitedBody, refuse
from server.service.security.origins import is_foreign, is_ours, is_same, scheme_of
from server.service.security.tokens import Token, TokenBook
from server.service.settings import Settings
from server.service.storage.audit import acting
from server.service.web.edge import Edge
from server.service.web.metrics import Metrics
from server.service.web.problems import ProblemError, shortened
from server.service.web.wire import hide_wire
from server.service.web.workers import run

# What a machine that watches the service asks (the answers say no more than that it runs), and the pages, which hold no
# data: they ask whoever opens them for a token.
OPEN = frozenset({"/api/v1/health/live", "/api/v1/health/ready", "/", "/favicon.ico"})
PAGES = "/pages/"
# Sent with POST for the size of their body, but nothing is kept of them.
READING = ("/api/v1/predictions", "/api/v1/effects/check", "/api/v1/recordings")
# Of a WebSocket: a browser can send a token in no other way.
PROTOCOL, BEARER_PROTOCOL = "fingertwin", "fingertwin.bearer."
_SAFE = ("GET", "HEAD", "OPTIONS")
_MOST_ADDRESS, _MOST_HEADERS = 8 << 10, 32 << 10
# So long a burst may last at ten times the rate [s].
_BURST_S = 10
_HEADERS = frozenset({
    b"host", b"origin", b"authorization", b"content-length", b"sec-websocket-protocol", b"sec-fetch-site",
    b"sec-fetch-mode", b"forwarded", b"x-forwarded-for", b"x-forwarded-host", b"x-forwarded-proto", b"via",
})  # fmt: skip
_FORWARDED = frozenset({b"forwarded", b"x-forwarded-for", b"x-forwarded-host", b"x-forwarded-proto", b"via"})
# These may be given in several parts.
_LISTS = (_FORWARDED - {b"x-forwarded-proto"}) | {b"sec-websocket-protocol"}
Headers = dict[bytes, str]


def protect(app: FastAPI, settings: Settings, tokens: TokenBook, metrics: Metrics) -> None:
    """Put the guard around an application, and the outermost layer around both."""
    app.add_middleware(Guard, settings=settings, tokens=tokens)
    app.add_middleware(Edge, metrics=metrics)


class Guard:
    """Refuses what is not to be answered.

    Args:
        app: that answers the rest.
        settings: address, sizes and rates.
        tokens: that requests may carry.
    """

    def __init__(self, app: ASGIApp, settings: Settings, tokens: TokenBook) -> None:
        self._app, self._settings, self._tokens = app, settings, tokens
        self._loopback = settings.loopback
        self._rate = RateLimitItemPerSecond(max(1, math.ceil(settings.requests_per_s * _BURST_S)), _BURST_S)
        self._limiter = MovingWindowRateLimiter(MemoryStorage())
        self._refusal = self._too_large("").answer()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse a request, or pass it on with its token as `state.token`."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        try:
            headers = _headers(scope)
            self._check_page(scope, headers)
            token = await self._admit(scope, headers)
            self._check_size(headers)
        except ProblemError as error:
            await refuse(scope, receive, send, error.answer())
            return
        scope.setdefault("state", {})["token"] = token
        with acting(*_actor(scope, token)):
            await self._pass_on(scope, receive, send, token)

    async def _pass_on(self, scope: Scope, receive: Receive, send: Send, token: Token | None) -> None:
        if scope["type"] == "websocket":
            if token is not None:
                # What goes past `_Socket` would go on when the token is no longer valid.
                hide_wire(scope)
            await self._app(_without_token(scope), receive, _Socket(scope, send, self._tokens, token).send)
            return
        body = LimitedBody(scope, receive, send, self._settings.most_body_bytes, self._refusal)
        try:
            await self._app(scope, body.receive, body.send)
        except Exception:
            # Who read the body was told that its sender has gone.
            if not body.refused:
                raise

    def _check_page(self, scope: Scope, headers: Headers) -> None:
        host, origin = headers.get(b"host", ""), headers.get(b"origin")
        if self._loopback and not is_ours(host, self._settings.host):
            raise ProblemError(
                421, f"the host {shortened(host)!r}", "localhost or 127.0.0.1", "Use the address that serve printed"
            )
        method = scope.get("method", "GET")
        changing = scope["type"] == "websocket" or method not in _SAFE
        foreign = is_foreign(headers.get(b"sec-fetch-site", ""), headers.get(b"sec-fetch-mode", ""), method)
        forwarded = not _FORWARDED.isdisjoint(headers)
        spoken = scheme_of(scope.get("scheme", "http"), headers.get(b"x-forwarded-proto"), forwarded=forwarded)
        if foreign or (changing and origin is not None and not is_same(origin, host, spoken)):
            remedy = "A proxy must pass on Host and X-Forwarded-Proto" if forwarded else ""
            raise ProblemError(
                403, f"a page of {shortened(origin or 'another site')}", "the service's own pages", remedy
            )

    async def _admit(self, scope: Scope, headers: Headers) -> Token | None:
        """Return the token of a request, None where it needs none."""
        given = _given(scope, headers)
        remote = not self._loopback or not _FORWARDED.isdisjoint(headers)
        token = None
        if given is not None:
            token = await _find(self._tokens, given)
        if remote:
            self._check_rate(scope, token)
        if token is None and (given is not None or (remote and not _is_open(scope))):
            raise _unauthorised(given is not None)
        writing = scope.get("method", "GET") not in _SAFE and not scope["path"].startswith(READING)
        if token is not None and token.role != "write" and writing:
            raise ProblemError(
                403,
                f"the token {token.id} may only read",
                "one that may write",
                "fingertwin token create NAME --role write makes one",
                headers={"WWW-Authenticate": 'Bearer realm="fingertwin", error="insufficient_scope"'},
            )
        return token

    def _check_rate(self, scope: Scope, token: Token | None) -> None:
        client = (scope.get("client") or ("",))[0]
        key = f"{token.id if token else ''}@{client}"
        if self._limiter.hit(self._rate, key):
            return
        wait_s = max(1, math.ceil(self._limiter.get_window_stats(self._rate, key).reset_time - time.time()))
        raise ProblemError(
            429,
            "too many requests",
            f"at most {self._settings.requests_per_s:g} a second",
            f"Wait {wait_s} s",
            headers={"Retry-After": str(wait_s)},
        )

    def _check_size(self, headers: Headers) -> None:
        length = headers.get(b"content-length", "0")
        if not length.isascii() or not length.isdecimal():
            raise ProblemError(400, f"the Content-Length {shortened(length)!r}", "a number of bytes")
        # Longer than any number of bytes that is allowed, and not worth reading as a number.
        if len(length) > 18 or int(length) > self._settings.most_body_bytes:
            raise self._too_large(length)

    def _too_large(self, length: str) -> ProblemError:
        return ProblemError(
            413,
            f"a body of {shortened(length)} bytes" if length else "a body that is too large",
            f"at most {self._settings.most_body_bytes} bytes",
            "Send it in parts",
            headers={"Connection": "close"},
        )


class _Socket:
    """WebSocket that sends only while its token is valid."""

    def __init__(self, scope: Scope, send: Send, tokens: TokenBook, token: Token | None) -> None:
        self._send, self._tokens, self._token = send, tokens, token
        self._offered = PROTOCOL in scope.get("subprotocols", ())
        self._closed = False

    async def send(self, message: Message) -> None:
        """Pass a message on."""
        if self._closed:
            return
        if message["type"] == "websocket.accept" and self._offered and not message.get("subprotocol"):
            # A browser that offered some hangs up where none is chosen.
            message = {**message, "subprotocol": PROTOCOL}
        if message["type"] == "websocket.send" and self._token is not None:
            await _fresh(self._tokens, known=True)
            if not self._tokens.holds(self._token):
                self._closed = True
                message = {"type": "websocket.close", "code": 1008, "reason": "the token is no longer valid"}
        await self._send(message)


def _headers(scope: Scope) -> Headers:
    """Return the headers that are looked at; refuse what is too long, or given twice."""
    address = len(scope.get("raw_path") or scope["path"]) + len(scope.get("query_string", b""))
    if address > _MOST_ADDRESS:
        raise ProblemError(414, f"an address of {address} characters", f"at most {_MOST_ADDRESS}")
    if not scope["path"].isprintable():
        raise ProblemError(404, "an address with characters that cannot be printed", "letters, digits and signs")
    if b"%00" in scope.get("query_string", b""):
        raise ProblemError(400, "a query with the character NUL", "text")
    found: Headers = {}
    size = 0
    for name, value in scope["headers"]:
        size += len(name) + len(value)
        if name in _HEADERS:
            text = value.decode("latin-1")
            if name in found and name not in _LISTS:
                raise ProblemError(400, f"the header {name.decode()} twice", "one")
            found[name] = f"{found[name]}, {text}" if name in found else text
    if size > _MOST_HEADERS:
        raise ProblemError(400, f"headers of {size} bytes", f"at most {_MOST_HEADERS}")
    return found


def _actor(scope: Scope, token: Token | None) -> tuple[str, str]:
    """Return the actor for the audit trail: a token's name and address, never a statement of the request itself."""
    address = (scope.get("client") or ("",))[0]
    return (token.name, f"{address}, token {token.id}") if token else ("local", address)


def _is_open(scope: Scope) -> bool:
    path = scope["path"]
    return scope.get("method") in ("GET", "HEAD") and (path in OPEN or path.startswith(PAGES))


def _given(scope: Scope, headers: Headers) -> str | None:
    """Return the token that a request carries; empty where it carries something else."""
    authorization = headers.get(b"authorization")
    if authorization is not None:
        scheme, _, rest = authorization.partition(" ")
        return rest.strip() if scheme.lower() == "bearer" else ""
    if scope["type"] == "websocket":
        for protocol in scope.get("subprotocols", ()):
            if protocol.startswith(BEARER_PROTOCOL):
                return str(protocol.removeprefix(BEARER_PROTOCOL))
    return None


async def _find(tokens: TokenBook, text: str) -> Token | None:
    found = tokens.find(text)
    return tokens.find(text) if await _fresh(tokens, known=found is not None) else found


async def _fresh(tokens: TokenBook, *, known: bool) -> bool:
    """Read the tokens again where that is due; return whether it was."""
    due = tokens.stale(known=known)
    if due:
        await run("health", partial(tokens.refresh, known=known))
    return due


def _without_token(scope: Scope) -> Scope:
    protocols = [p for p in scope.get("subprotocols", ()) if not p.startswith(BEARER_PROTOCOL)]
    headers = [(n, v) for n, v in scope["headers"] if n not in (b"authorization", b"sec-websocket-protocol")]
    return {**scope, "subprotocols": protocols, "headers": headers}


def _unauthorised(given: bool) -> ProblemError:
    wrong = ', error="invalid_token"' if given else ""
    return ProblemError(
        401,
        "a token that is not valid" if given else "no token",
        "Authorization: Bearer ft_…",
        "fingertwin token create NAME --role read|write makes one",
        headers={"WWW-Authenticate": f'Bearer realm="fingertwin"{wrong}'},
    )
