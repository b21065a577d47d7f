"""Store and forward: what a journal holds goes to the service, in its own time, and the journal lets go of nothing.

Acquisition never waits for any of this: it ends where the journal has a chunk, and the uplink begins there.
"""

from __future__ import annotations

import json
import random
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from daq.errors import JournalError
from daq.journal.writer import Event, Journal
from daq.uplink.chunks import ChunkFeed
from daq.uplink.events import EventFeed
from daq.uplink.link import Link, open_client, said
from daq.uplink.wire import API

if TYPE_CHECKING:
    import httpx

POLL_S = 0.1
# Nothing to send: whether the service still has what it had. It may have been put back to an earlier state.
RECHECK_S = 60.0
# An exchange that takes longer is broken off at the end: the chunk is sent again another time.
ENOUGH_S = 5.0


@dataclass(frozen=True)
class UplinkStatus:
    """State of the uplink.

    Attributes:
        sent: chunks that the service has acknowledged to this uplink.
        quarantined: chunks that it refused to this uplink.
        events_refused: events that it refused; they stay in the journal.
        caught_up: whether the service had all when it was last looked.
        barred: whether the service does not give the session to this journal; another name is needed.
        problem: what is wrong, in one line; None where all is well.
    """

    sent: int
    quarantined: int
    events_refused: int
    caught_up: bool
    barred: bool
    problem: str | None


class Uplink:
    """Sends a journal's chunks and events to one session of a service.

    Args:
        journal: open for writing; threads share it.
        url: of the service.
        session: that all streams of the journal belong to.
        token: for the service, where it wants one.
        client: to be used instead of one of its own.
        begins: whether the session is begun at the service, where it is not there yet.
        document: of the session that is begun; None where the journal's events are its record.
        bench: whether these are a bench's, which takes no session of another's.
        begun: called once the session may be sent to.
        clock: monotonic seconds.
        wall: wall-clock seconds, for dates in the service's answers only.
        chance: of 0 to 1.

    Raises:
        InputError: the address is none.
    """

    def __init__(
        self,
        journal: Journal,
        url: str,
        session: str,
        *,
        token: str | None = None,
        client: httpx.Client | None = None,
        begins: bool = False,
        document: Mapping[str, Any] | None = None,
        bench: bool = False,
        begun: Callable[[], None] = lambda: None,
        clock: Callable[[], float] = time.monotonic,
        wall: Callable[[], float] = time.time,
        chance: Callable[[], float] = random.random,
    ) -> None:
        self._journal, self._clock = journal, clock
        self._link = Link(client or open_client(url, token), clock, wall, chance)
        self._session, self._document = session, document
        self._begins, self._begun, self._bench, self._on_begun = begins, False, bench, begun
        self._refusal: str | None = None
        self._chunks = ChunkFeed(journal, self._link, session)
        self._events = EventFeed(journal, self._link, session, clock)
        self._epoch = ""
        self._checked_s = 0.0
        self._trouble: str | None = None
        self._halt = threading.Event()
        self._woken = threading.Event()
        self._looked = threading.Condition()
        self._steps = self._idle_step = 0
        self._thread = threading.Thread(target=self._run, name="uplink", daemon=True)

    def start(self) -> None:
        """Send in the background from now on."""
        self._thread.start()

    def wake(self) -> None:
        """Say that there is something new; without it, it is found a little later."""
        self._woken.set()

    def flush(self, timeout_s: float) -> bool:
        """Wait until all that is in the journal by now is at the service; return whether it is.

        A session that the service does not give to this journal is not waited for.
        """
        with self._looked:
            now = self._steps
            self._events.hurry()
            self.wake()
            self._looked.wait_for(lambda: self._idle_step > now or self._barred, timeout_s)
            return self._idle_step > now and self._events.problem is None

    @property
    def _barred(self) -> bool:
        return self._refusal is not None and not self._begun

    def stop(self) -> None:
        """End the thread and hang up; what was not sent waits in the journal."""
        self._halt.set()
        self._woken.set()
        if self._thread.is_alive():
            self._thread.join(timeout=ENOUGH_S)
        self._link.close()  # which also ends an exchange that hangs

    def status(self) -> UplinkStatus:
        """Return the state of the uplink."""
        problem = self._trouble or self._link.problem or self._events.problem
        if problem and self._refusal not in (None, problem):  # it is why a session is not there
            problem = f"{self._refusal}; {problem}"
        caught_up = self._idle_step == self._steps > 0
        sent, aside, refused = self._chunks.sent, self._chunks.quarantined, self._events.refused
        return UplinkStatus(sent, aside, refused, caught_up, self._barred, problem)

    def step(self) -> float:
        """Make one exchange with the service at most; return how long to wait before the next [s]."""
        if (wait_s := self._link.wait_s()) > 0.0:
            return wait_s
        with self._looked:
            self._steps += 1
        try:
            busy = self._exchange()
            if self._trouble is not None and self._link.problem == self._trouble:
                self._link.works()  # it was the journal's, and is over
            self._trouble = None
        except JournalError as error:
            # A full disk, say: the service may have the chunk already, and will be asked again.
            self._trouble = str(error)
            self._link.back_off(str(error))
            busy = True
        if busy:
            return self._link.wait_s()
        with self._looked:
            self._idle_step = self._steps
            self._looked.notify_all()
        return POLL_S

    def _run(self) -> None:
        while not self._halt.is_set():
            try:
                wait_s = self.step()
            except Exception as error:  # nothing may end the uplink unseen while the bench goes on
                self._trouble = f"the uplink failed ({type(error).__name__}: {error})"
                self._link.back_off(self._trouble)
                wait_s = self._link.wait_s()
            if wait_s and self._woken.wait(wait_s):
                self._woken.clear()
                # Being woken does not make a service ready that asked to be left alone.
                self._halt.wait(self._link.wait_s())
        with suppress(JournalError):  # else it is sent again another time
            self._chunks.note()

    def _exchange(self) -> bool:
        """Do what is due next; return whether anything was."""
        epoch = self._journal.epoch
        if epoch != self._epoch:
            self._chunks.begin(epoch)
            self._events.begin(epoch)
            self._epoch, self._checked_s = epoch, self._clock()
        if self._begins and not self._begun:
            self._begin_session()
            return True
        # In turns: neither may keep the other waiting.
        turns = (self._chunks.step, self._events.step)
        if self._chunks.greet() or any(turn() for turn in turns[:: 1 if self._steps % 2 else -1]):
            return True
        if self._clock() - self._checked_s < RECHECK_S:
            return False
        self._checked_s = self._clock()
        self._chunks.recheck()
        self._events.recheck()
        return True

    def _begin_session(self) -> None:
        """Begin the session at the service if it is absent; chunks and events are sent where it is no other's."""
        known: dict[str, Any] = {"id": self._session, "document": self._document}
        known |= {"bench": [s.id for s in self._journal.streams()]} if self._bench else {}
        body = json.dumps(known, allow_nan=False).encode()
        response = self._link.exchange("POST", f"{API}/sessions", body, {"Content-Type": "application/json"})
        if response is None:
            return
        if response.status_code in (401, 403):
            self._chunks.turned_away(response)
            return
        if response.status_code == 409 and (self._bench or self._document is not None):
            # Readings of one session must not go to another of its name. Who waits for the refusal wants its reason.
            self._link.back_off(said(response))
            self._refuse(said(response))
            return
        self._begun, self._refusal = True, None
        if response.status_code == 422:
            self._refuse(said(response))
        self._on_begun()

    def _refuse(self, why: str) -> None:
        """Tell why the session was not begun, once."""
        if why == self._refusal:
            return
        with self._looked:
            self._refusal = why
            self._looked.notify_all()
        self._journal.event(Event("session_refused", 0.0, {"why": why}))
        self._journal.alarms.put(("session_refused", f"session {self._session} was not begun: {why}"))
