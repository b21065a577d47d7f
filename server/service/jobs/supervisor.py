"""A pool of worker processes: first come first served, one order at a time each, replaced when they die."""

from __future__ import annotations

import atexit
import threading
from collections import deque
from dataclasses import dataclass
from functools import partial
from typing import Literal

from server.service.jobs.orders import Order, Outcome
from server.service.jobs.slots import Slot


@dataclass(frozen=True)
class Workers:
    """Numbers of worker processes allowed, alive and busy, and of waiting orders."""

    most: int
    alive: int
    busy: int
    waiting: int


class Supervisor:
    """Runs orders in worker processes.

    Args:
        workers: at most so many; each starts when it is first needed.
        warm_up: dotted name of a function that every new worker calls once.
    """

    def __init__(self, workers: int, warm_up: str | None = None) -> None:
        self._waiting: deque[Order] = deque()
        self._changed = threading.Condition()
        self._started = self._eager = self._closed = False
        self._slots = [Slot(n, warm_up, self._take) for n in range(max(workers, 1))]
        self._idle: set[Slot] = set()

    def submit(self, order: Order) -> None:
        """Put an order at the end of the queue.

        Raises:
            RuntimeError: the supervisor is closed.
        """
        with self._changed:
            if self._closed:
                raise RuntimeError("the supervisor is closed")
            self._waiting.append(order)
            self._start()

    def warm(self) -> None:
        """Start all workers now, and from now on a new one as soon as one is gone."""
        with self._changed:
            if not self._closed:
                self._eager = True
                self._start()

    def cancel(self, order: str) -> bool:
        """Take an order out of the queue, or kill its worker; False where there is no such order (any more)."""
        with self._changed:
            found = next((o for o in self._waiting if o.id == order), None)
            if found is None:
                return any(slot.cancel(order) for slot in self._slots)
            self._waiting.remove(found)
        found.tell(lambda: found.watcher.ended(Outcome("cancelled")))
        return True

    def state(self) -> Workers:
        """Count workers and orders."""
        with self._changed:
            busy = sum(slot.order is not None for slot in self._slots)
            return Workers(len(self._slots), sum(s.alive for s in self._slots), busy, len(self._waiting))

    def processes(self) -> list[int]:
        """Return the ids of the worker processes."""
        return [pid for slot in self._slots if (pid := slot.pid) is not None]

    def close(self) -> None:
        """End all workers; orders that wait or run end as stopped. Returns when that is done and told."""
        atexit.unregister(self.close)
        with self._changed:
            self._closed = True
            waiting = list(self._waiting)
            self._waiting.clear()
            for slot in self._slots:
                slot.stop()
            self._changed.notify_all()
        for order in waiting:
            order.tell(partial(order.watcher.ended, Outcome("stopped")))
        if self._started:
            for slot in self._slots:
                slot.thread.join()

    def _start(self) -> None:
        if not self._started:
            self._started = True
            # Otherwise the interpreter would wait for workers that nobody ends.
            atexit.register(self.close)
            for slot in self._slots:
                slot.thread.start()
        self._changed.notify_all()

    def _take(self, slot: Slot) -> Order | Literal["warm"] | None:
        """Wait for what a slot shall do next."""
        with self._changed:
            self._idle.add(slot)
            try:
                while not self._closed:
                    # Who has a worker already goes first.
                    others = 0 if slot.alive else sum(s.alive for s in self._idle)
                    if len(self._waiting) > others:
                        slot.order = self._waiting.popleft()
                        return slot.order
                    if self._eager and not slot.tried:
                        return "warm"
                    self._changed.wait()
                return None
            finally:
                self._idle.discard(slot)
