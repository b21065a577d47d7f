"""One place for a worker process, with the thread that starts it, gives it orders, and kills it."""

from __future__ import annotations

import logging
import multiprocessing
import pickle
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Literal

from server.service.jobs.orders import Ending, Order, Outcome, said_of
from server.service.jobs.worker import Said, work

_log = logging.getLogger(__name__)

# A worker that has not said that it is ready by then is given up; compiling on a slow machine takes a minute.
_START_S = 300.0
# Longer waits are made in pieces: systems limit them.
_LONGEST_WAIT_S = 3600.0
# A process that has closed its pipe is about to end by itself.
_LAST_BREATH_S = 2.0
_KILLED = "If nobody killed it, memory ran out: run fewer workers"

Next = Callable[["Slot"], Order | Literal["warm"] | None]


@dataclass(eq=False)
class _Worker:
    process: SpawnProcess
    connection: Connection


class Slot:
    """Takes one order after another.

    Args:
        number: of the place.
        warm_up: dotted name of a function that a new worker calls once.
        take: waits for the next order, or for "warm" to start a worker in advance; None ends the thread.

    Attributes:
        order: that is being carried out; set by whoever hands it out.
        tried: whether a worker was started in advance since the last one died.
    """

    def __init__(self, number: int, warm_up: str | None, take: Next) -> None:
        self.order: Order | None = None
        self.tried = False
        self.thread = threading.Thread(target=self._run, name=f"worker {number}", daemon=True)
        self._number, self._warm_up, self._take = number, warm_up, take
        self._lock = threading.Lock()
        self._why: Ending | None = None
        self._worker: _Worker | None = None

    @property
    def alive(self) -> bool:
        """True if its process runs."""
        with self._lock:
            return self._worker is not None and self._worker.process.is_alive()

    @property
    def pid(self) -> int | None:
        """Id of the worker's process; None without one."""
        with self._lock:
            return None if self._worker is None else self._worker.process.pid

    def cancel(self, order: str) -> bool:
        """Kill the worker of an order; False where it is not here (any more)."""
        with self._lock:
            mine = self.order is not None and self.order.id == order and self._why is None
            if mine:
                self._kill("cancelled")
            return mine

    def stop(self) -> None:
        """Kill the worker, for good."""
        with self._lock:
            self._kill("stopped")

    def _kill(self, why: Ending) -> None:
        self._why = why
        if self._worker is not None:
            self._worker.process.kill()

    def _run(self) -> None:
        while (order := self._take(self)) is not None:
            if order == "warm":
                self.tried = True
                self._ready()
                continue
            outcome = self._carry_out(order)
            with self._lock:
                why, self.order = self._why, None
                if why != "stopped":
                    self._why = None
            if why is not None:
                outcome = Outcome(why)
            if outcome.ending not in ("done", "refused", "failed"):
                self._discard()
                self.tried = False
            if outcome.trace:
                _log.error("job %s failed: %s\n%s", order.id, outcome.found, outcome.trace)
            elif outcome.ending in ("died", "timed_out"):
                _log.error("job %s failed: %s", order.id, outcome.found)
            order.tell(partial(order.watcher.ended, outcome))
        self._discard()

    def _carry_out(self, order: Order) -> Outcome:
        try:
            payload, parts = order.watcher.started()
            words = pickle.dumps((order.function, payload, dict(parts)), pickle.HIGHEST_PROTOCOL)
        except Exception as error:
            return Outcome.of_error(error)
        # That a worker died while it was idle costs no order.
        for _ in range(2):
            worker = self._ready()
            if worker is None:
                return Outcome("died", found="no worker process could be started")
            outcome = self._hand_over(worker, words, order)
            if outcome is not None:
                return outcome
        return Outcome("died", found="two workers died before they took the job")

    def _hand_over(self, worker: _Worker, words: bytes, order: Order) -> Outcome | None:
        """Give an order to a worker and wait for its end; None where the worker did not even take it."""
        limit_s, watcher, taken = order.timeout_s, order.watcher, False
        until = None if limit_s is None else time.monotonic() + limit_s
        try:
            worker.connection.send_bytes(words)
            while (said := _heard(worker, until)) is not None:
                match said:
                    case ("taken",):
                        taken = True
                    case ("progress", fraction, stage):
                        order.tell(partial(watcher.progressed, fraction, stage))
                    case ("part", key, result):
                        order.tell(partial(watcher.part, key, result))
                    case ("ended", Outcome() as outcome):
                        return outcome
        except (EOFError, OSError):
            died = self._discard(_LAST_BREATH_S)
            if not taken and self._why is None:
                return None
            return Outcome("died", found=died, remedy=_KILLED if "SIGKILL" in died else "")
        return Outcome("timed_out", found=f"timed out after {limit_s:g} s")

    def _ready(self) -> _Worker | None:
        """Return a worker that waits for an order, a new one if need be; None where none starts."""
        with self._lock:
            worker = self._worker
            if worker is not None and worker.process.is_alive():
                return worker
        self._discard()
        try:
            worker = self._start()
            until = time.monotonic() + _START_S
            while (said := _heard(worker, until)) is not None:
                if said[0] == "ready":
                    return worker
                _log.error("a worker could not be warmed up\n%s", said[-1])
        except (EOFError, OSError) as error:
            if self._why is None:
                _log.error("a worker did not start: %s, %s", said_of(error), self._discard(_LAST_BREATH_S))
        self._discard()
        return None

    def _start(self) -> _Worker:
        ours, theirs = multiprocessing.Pipe()
        process = multiprocessing.get_context("spawn").Process(
            target=work, args=(theirs, self._warm_up), name=f"fingertwin worker {self._number}"
        )
        try:
            process.start()
        finally:
            # Ours must be the only other end, so that the worker's death is seen.
            theirs.close()
        with self._lock:
            self._worker = worker = _Worker(process, ours)
            if self._why is not None:
                process.kill()
        return worker

    def _discard(self, patience_s: float = 0.0) -> str:
        """Kill the worker, unless it ends by itself within a time [s], and say how it ended."""
        with self._lock:
            worker, self._worker = self._worker, None
        if worker is None:
            return "the worker died"
        worker.process.join(patience_s)
        worker.process.kill()
        worker.process.join(_LONGEST_WAIT_S)
        code = worker.process.exitcode
        worker.connection.close()
        worker.process.close()
        if code is not None and code < 0:
            return f"the worker died (signal {signal.Signals(-code).name})"
        return f"the worker died (exit code {code})"


def _heard(worker: _Worker, until: float | None) -> Said | None:
    """Wait for what a worker says next; None where it says nothing in time.

    Raises:
        EOFError, OSError: it is dead.
    """
    while True:
        left = _LONGEST_WAIT_S if until is None else until - time.monotonic()
        if left <= 0.0:
            return None
        ready = wait([worker.connection, worker.process.sentinel], min(left, _LONGEST_WAIT_S))
        # What it said before it died is still there.
        if worker.connection in ready or (ready and worker.connection.poll()):
            words = worker.connection.recv_bytes()
            try:
                said: Said = pickle.loads(words)  # noqa: S301 - from our own worker
            except Exception as error:
                return ("ended", Outcome("failed", found=f"its result cannot be read here ({said_of(error)})"))
            return said
        if ready:
            raise EOFError
