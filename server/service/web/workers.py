"""Threads that answer requests: some for each kind of work, so that no kind waits for another; who has gone ends it."""

from __future__ import annotations

import asyncio
import functools
import inspect
import threading
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from contextvars import ContextVar
from typing import Any, Literal, TypeVar

import anyio
import anyio.to_thread
from anyio.lowlevel import RunVar
from starlette.types import Message

# ingest: readings, events and live values of benches. health: what watches the service. readers: everything else; few,
# since they share one interpreter and more would only be slower each. apart: work that takes seconds.
Kind = Literal["ingest", "health", "readers", "apart"]
AT_ONCE: dict[Kind, int] = {"ingest": 8, "health": 2, "readers": 4, "apart": 2}

T = TypeVar("T")
_limiters: RunVar[dict[Kind, anyio.CapacityLimiter]] = RunVar("fingertwin_workers")
_gone: ContextVar[threading.Event | None] = ContextVar("gone", default=None)


class GoneError(Exception):
    """Whoever asked does not wait for the answer any more."""


def require_client() -> None:
    """End work whose client has gone; what takes long asks now and then.

    Raises:
        GoneError: it has.
    """
    gone = _gone.get()
    if gone is not None and gone.is_set():
        raise GoneError


async def run(kind: Kind, work: Callable[..., T], *args: Any) -> T:
    """Do work in a thread of a kind, once one is free.

    Raises:
        GoneError: the client has gone before that.
    """
    try:
        limiters = _limiters.get()
    except LookupError:
        limiters = {name: anyio.CapacityLimiter(most) for name, most in AT_ONCE.items()}
        _limiters.set(limiters)

    def begun() -> T:
        require_client()
        return work(*args)

    return await anyio.to_thread.run_sync(begun, limiter=limiters[kind])


def threaded(kind: Kind, answer: Callable[..., Any]) -> Callable[..., Any]:
    """Return what answers in a thread of a kind; what is a coroutine already stays on the event loop."""
    if inspect.iscoroutinefunction(answer):
        return answer

    @functools.wraps(answer)
    async def inner(*args: Any, **kwargs: Any) -> Any:
        return await run(kind, functools.partial(answer, *args, **kwargs))

    return inner


@asynccontextmanager
async def watched(receive: Callable[[], Awaitable[Message]]) -> AsyncIterator[None]:
    """Let `require_client` know when the client goes, whose whole request has been read."""
    gone = threading.Event()

    async def watch() -> None:
        while (await receive())["type"] != "http.disconnect":
            pass
        gone.set()

    watching = asyncio.create_task(watch())
    before = _gone.set(gone)
    try:
        yield
    finally:
        _gone.reset(before)
        watching.cancel()
        with suppress(asyncio.CancelledError):
            await watching
