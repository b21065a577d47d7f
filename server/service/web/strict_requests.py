"""Requests read strictly: JSON as the standard has it, with nothing that a database cannot keep, nor too deep."""

from __future__ import annotations

import json
from collections.abc import Callable, Coroutine, Iterable, Sequence
from typing import Any, Protocol

import orjson
from fastapi import Request, Response
from fastapi.routing import APIRoute
from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect

from daq.documents import unique_keys
from daq.vocabulary import did_you_mean
from server.service.web.problems import ProblemError, shortened
from server.service.web.workers import GoneError, Kind, run, threaded, watched

# Nothing that is sent has a reason to be nested so deeply, and what answers is written has a limit too.
MOST_LEVELS = 32
# JSON of so many bytes is read beside the event loop, which others wait for.
_LARGE = 1 << 16
Handler = Callable[[Request], Coroutine[Any, Any, Response]]


class StrictRequest(Request):
    """A request whose JSON has neither NaN nor infinities, nor halves of surrogate pairs, nor zero bytes."""

    async def json(self) -> Any:
        """Return the body.

        Raises:
            json.JSONDecodeError: it is no JSON, or has a character that cannot be kept.
        """
        if not hasattr(self, "_json"):
            body = await self.body()
            self._json = read_json(body) if len(body) < _LARGE else await run("readers", read_json, body)
        return self._json


def read_json(body: bytes) -> Any:
    """Read JSON without NaN, infinities, halves of surrogate pairs, zero characters, many levels or a key given twice.

    Raises:
        json.JSONDecodeError: it is no JSON, or has what cannot be kept.
    """
    value = orjson.loads(body)
    if b"\\u0000" in body and _holds_zero(value):
        raise json.JSONDecodeError("a zero character, which cannot be kept", "", body.index(b"\\u0000"))
    if body.count(b"[") + body.count(b"{") > MOST_LEVELS and _levels(value) > MOST_LEVELS:
        raise json.JSONDecodeError(f"more than {MOST_LEVELS} levels", "", 0)
    json.loads(body, object_pairs_hook=unique_keys)
    return value


def _levels(value: Any) -> int:
    level, levels = [value], 0
    while level := [v for item in level for v in _within(item)]:
        levels += 1
    return levels


def _within(value: Any) -> Iterable[Any]:
    if isinstance(value, dict):
        return value.values()
    return value if isinstance(value, list) else ()


def _holds_zero(value: Any) -> bool:
    if isinstance(value, dict):
        return any("\0" in k for k in value) or any(map(_holds_zero, value.values()))
    return any(map(_holds_zero, value)) if isinstance(value, list) else isinstance(value, str) and "\0" in value


def _require_json(headers: Headers) -> None:
    kind = headers.get("content-type")
    base = (kind or "").partition(";")[0].strip().lower()
    empty = headers.get("content-length", "0") == "0" and "transfer-encoding" not in headers
    if base == "application/json" or (base.startswith("application/") and base.endswith("+json")) or empty:
        return
    raise ProblemError(415, f"a body of type {shortened(kind or 'unknown')!r}", "Content-Type: application/json")


def _require_known(given: Iterable[str], known: Sequence[str]) -> None:
    """Refuse query parameters that a route does not have: its defaults would be taken in their place."""
    for name in given:
        if name not in known:
            expected = f"one of {', '.join(known)}" if known else "none at this address"
            raise ProblemError(422, f"query parameter {shortened(name)!r}", expected, did_you_mean(name, known))


class Elsewhere(Protocol):
    """Something that may answer a request in the place of this process."""

    async def answer(self, request: Request) -> Response | None:
        """Return its answer; None where it gives none."""


class StrictRoute(APIRoute):
    """A route that reads its requests strictly, and answers in a thread of its kind."""

    workers: Kind = "readers"  # that kind
    # Methods of which a request needs what is stored, and nothing else of the running service.
    only_read: frozenset[str] = frozenset()

    def __init__(self, path: str, endpoint: Callable[..., Any], **more: Any) -> None:
        super().__init__(path, threaded(self.workers, endpoint), **more)

    def get_route_handler(self) -> Handler:
        """Return what answers a request."""
        handle = super().get_route_handler()
        takes_json = self.body_field is not None
        known = [p.alias for p in self.dependant.query_params]

        async def strictly(request: Request) -> Response:
            if "\0" in request.url.path or "%00" in request.url.path or "%00" in request.url.query:
                raise ProblemError(422, "a zero character in the address", "text without it")
            _require_known(request.query_params, known)
            if takes_json:
                _require_json(request.headers)
            asked = StrictRequest(request.scope, request.receive)
            try:
                await asked.body()
            except ClientDisconnect as error:
                raise GoneError from error
            elsewhere: Elsewhere | None = getattr(request.app.state, "reader_process", None)
            if elsewhere is not None and asked.method in self.only_read:
                answer = await elsewhere.answer(asked)
                if answer is not None:
                    return answer
            async with watched(asked.receive):
                return await handle(asked)

        return strictly


class ReadingRoute(StrictRoute):
    """A route of which whatever is asked with GET is answered by the readers' process, where there is one."""

    only_read = frozenset({"GET"})


class AskingRoute(ReadingRoute):
    """A route that keeps nothing, however it is asked: POST where a question is too long for an address."""

    only_read = frozenset({"GET", "POST"})


class ApartRoute(AskingRoute):
    """The same, whose work takes seconds."""

    workers = "apart"


class IngestRoute(StrictRoute):
    """A route that benches send to while they run."""

    workers = "ingest"
