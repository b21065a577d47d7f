"""Delivery of events to the service: each event of a journal by its place in it, once."""

from __future__ import annotations

import hashlib
import json
import time
from collections import deque
from collections.abc import Callable

from daq.errors import JournalError
from daq.journal.writer import Event, Journal
from daq.uplink.link import Link, answered, said
from daq.uplink.wire import EPOCH, SHA256, Cursor, events_path

# New events are looked for not more often than this.
READ_S = 0.5
# What the service does not take now it may take after an update.
AGAIN_S = 60.0
# What is wrong with an event itself.
_BAD = (400, 409, 413, 422)


class EventFeed:
    """Sends a journal's events, and never keeps its chunks waiting.

    Args:
        journal: whose events they are.
        link: to the service.
        session: that they belong to.
        clock: monotonic seconds.

    Attributes:
        problem: why none are sent, where that is so.
    """

    def __init__(self, journal: Journal, link: Link, session: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._journal, self._link, self._session, self._clock = journal, link, session, clock
        self.problem: str | None = None
        self._refused: set[int] = set()
        self._doubted: set[int] = set()
        self._epoch = ""
        self.begin("")

    def begin(self, epoch: str) -> None:
        """Ask anew what the service has."""
        if epoch != self._epoch:
            self._refused.clear()
            self._doubted.clear()
        self._epoch = epoch
        self._asked = False
        self._queue: deque[tuple[int, Event]] = deque()
        self._missing: list[int] = []
        self._next = 0
        self._rows = -1
        self._not_before_s = -float("inf")

    @property
    def refused(self) -> int:
        """Events that the service refused; they stay in the journal."""
        return len(self._refused)

    def recheck(self) -> None:
        """Ask again what the service has, unless events are on their way."""
        if not self._queue and self.problem is None:
            self.begin(self._epoch)

    def hurry(self) -> None:
        """Look for new events at once."""
        if self.problem is None:
            self._not_before_s = -float("inf")

    def step(self) -> bool:
        """Make one exchange where there is something to say; return whether."""
        if not self._queue and self._clock() < self._not_before_s:
            return False
        if not self._asked:
            self._ask()
            return True
        if not self._queue:
            self._read()
        if self._queue:
            self._send(*self._queue[0])
            return True
        return False

    def _ask(self) -> None:
        response = self._link.exchange("GET", f"{events_path(self._session, self._epoch)}/cursor")
        if response is None:
            return
        if not response.is_success:
            self._pause(said(response))
            return
        try:
            cursor = Cursor.of_answer(answered(response))
        except ValueError:
            # A login page, say, on the way to the service.
            self._link.back_off("the service does not say which events it has")
            return
        self._link.works()
        self._asked, self.problem = True, None
        self._missing = [n for begin, end in cursor.missing for n in range(begin, end)]
        self._next = cursor.next_seq

    def _read(self) -> None:
        self._not_before_s = self._clock() + READ_S
        rows = self._journal.rows()
        if rows == self._rows:
            return
        first = min([self._next, *self._missing])
        try:
            events = self._journal.events_from(first)
        except JournalError as error:
            self._pause(str(error))
            return
        end = first + len(events)
        numbers = [*self._missing, *range(self._next, end)]
        self._queue.extend((n, events[n - first]) for n in numbers if n < end and n not in self._refused)
        self._missing, self._next, self._rows = [], max(self._next, end), rows

    def _send(self, number: int, event: Event) -> None:
        body = encoded(event)
        headers = {
            "Content-Type": "application/json",
            SHA256: hashlib.sha256(body).hexdigest(),
            EPOCH: self._epoch,
        }
        response = self._link.exchange("PUT", f"{events_path(self._session, self._epoch)}/{number}", body, headers)
        if response is None:
            return
        if not response.is_success:
            if response.status_code in _BAD and number in self._doubted:
                if not self._refused:
                    self._journal.alarms.put(("event_refused", f"event {number} is only kept here: {said(response)}"))
                self._refused.add(number)
                self._queue.popleft()
            elif response.status_code in _BAD:
                # Once more: a bit may have been flipped on the way.
                self._doubted.add(number)
            else:
                self._pause(said(response))
            return
        try:
            held = Cursor.of_answer(answered(response)).holds(number, number + 1)
        except ValueError:
            held = False
        if not held:
            self._link.back_off(f"the service does not say that it holds event {number}")
            return
        self._link.works()
        self._queue.popleft()

    def _pause(self, problem: str) -> None:
        self.begin(self._epoch)
        self.problem, self._not_before_s = problem, self._clock() + AGAIN_S


def encoded(event: Event) -> bytes:
    """Return an event as it is sent."""
    value = {
        "stream": event.stream, "at_s": event.at_s, "utc_s": event.utc_s, "kind": event.kind,
        "value": dict(event.value),
    }  # fmt: skip
    return json.dumps(value, allow_nan=False, sort_keys=True, separators=(",", ":")).encode()
