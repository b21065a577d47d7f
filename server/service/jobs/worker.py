"""Main loop of a worker process: one order after another, with reports of progress.

A worker ends with its parent, however that ends and whatever the worker computes at that moment. It leaves Ctrl-C and
the end of the service to its parent.
"""

from __future__ import annotations

import importlib
import multiprocessing
import os
import pickle
import signal
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from typing import Any

import psutil

from server.service.jobs.orders import Outcome

# News of progress that come faster than this are left out, unless the stage is another.
_NEWS_S = 0.2

# What a worker tells: ("ready",), perhaps ("unwarmed", trace) before; of each order ("taken",), ("progress", fraction,
# stage), ("part", key, result), and in the end ("ended", outcome).
Said = tuple[Any, ...]


class Tell:
    """Reporter of progress, handed to a function in a worker.

    Args:
        send: takes what is told.
        parts: results by key that an earlier, interrupted attempt has told with `part`.
    """

    def __init__(self, send: Callable[[Said], None], parts: Mapping[str, Any] | None = None) -> None:
        self.parts: Mapping[str, Any] = parts or {}
        self._send = send
        self._lock = threading.Lock()
        self._stage, self._said_s, self._open = "", -_NEWS_S, True

    def __call__(self, fraction: float, stage: str = "") -> None:
        """Tell the share that is done, 0 to 1, and what is being done, in a few words."""
        with self._lock:
            now = time.monotonic()
            if self._open and (stage != self._stage or now - self._said_s >= _NEWS_S):
                self._stage, self._said_s = stage, now
                self._send(("progress", float(fraction), stage))

    def part(self, key: str, result: Any) -> None:
        """Hand in a finished part, plain data, which is kept: an interrupted job goes on from there."""
        with self._lock:
            if self._open:
                self._send(("part", key, result))

    def close(self) -> None:
        """Stop reporting: late reports are not taken for progress of the next job."""
        with self._lock:
            self._open = False


def work(connection: Connection, warm_up: str | None) -> None:
    """Carry out orders until the other end is closed.

    Args:
        connection: to the supervisor; an order is a pickled (function, payload, parts).
        warm_up: function that is called once before the first order.
    """
    begin_worker()

    def send(said: Said) -> None:
        connection.send_bytes(pickle.dumps(said, pickle.HIGHEST_PROTOCOL))

    if warm_up is not None:
        try:
            function_of(warm_up)()
        except Exception:
            send(("unwarmed", traceback.format_exc()))
    send(("ready",))
    while True:
        try:
            order = connection.recv_bytes()
        except (EOFError, OSError):
            return
        send(("taken",))
        try:
            send(("ended", _carry_out(order, send)))
        except OSError:
            return
        except Exception as error:
            # The result itself could not be sent.
            send(("ended", Outcome.of_error(error)))


def _carry_out(order: bytes, send: Callable[[Said], None]) -> Outcome:
    tell = Tell(send)
    try:
        name, payload, tell.parts = pickle.loads(order)  # noqa: S301 - from our own parent
        return Outcome("done", function_of(name)(payload, tell))
    except (Exception, SystemExit) as error:
        return Outcome.of_error(error)
    finally:
        tell.close()


def function_of(name: str) -> Callable[..., Any]:
    """Import a function by its dotted name."""
    module, _, function = name.rpartition(".")
    found: Callable[..., Any] = getattr(importlib.import_module(module), function)
    return found


def begin_worker(niceness: int = 5) -> None:
    """Make this process one of the service's: it ends with it, leaves signals to it, and gives way to it.

    Args:
        niceness: on Linux and macOS; on Windows it is below normal.
    """
    for name in ("SIGINT", "SIGTERM"):
        signal.signal(getattr(signal, name), signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, name="end with parent", daemon=True).start()
    with suppress(psutil.Error, OSError):
        psutil.Process().nice(getattr(psutil, "BELOW_NORMAL_PRIORITY_CLASS", niceness))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
