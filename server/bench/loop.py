"""A bench as it runs: one thread keeps what the load cell says, the other answers the user and draws.

Nothing that is drawn or asked can hold up what is kept, and a silent cell holds up no key.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Sequence
from typing import Protocol

from daq.acquisition.acquire import Acquisition
from daq.acquisition.records import Record, StreamEvent
from daq.bench.commands import perform
from daq.bench.run import BenchRun
from daq.errors import InputError
from daq.journal.rows import Event
from daq.journal.writer import Journal
from server.bench.ending import ended_by_signals
from server.bench.keys import QUIT, KeyInput, Pressed
from server.bench.meter import StreamMeter

LOOK_S, DRAW_S, SPACE_S = 0.03, 0.2, 2.0
LITTLE_DISK_BYTES = 1 << 30


class View(Protocol):
    """A view of a bench."""

    def tell(self, events: Sequence[Event]) -> None:
        """Take what the run did."""

    def refuse(self, error: Exception) -> None:
        """Take why something was not done."""

    def draw(self, space_left: int | None = None) -> None:
        """Show how things stand."""


def from_keys(keys: KeyInput, read: Callable[[], str], run: BenchRun) -> Callable[[], list[Pressed]]:
    """Return what gives commands from keys."""

    def pressed() -> list[Pressed]:
        typed = read()
        if not typed:
            return []
        status = run.status()
        return keys.feed(typed, status.closed, status.answers_begin)

    return pressed


def from_lines(take: Callable[[], str | None]) -> Callable[[], list[Pressed]]:
    """Return what gives commands from lines of text: a command, and what belongs to it; `quit` ends the log."""

    def pressed() -> list[Pressed]:
        line = take()
        if line is None:
            return []
        command, _, argument = line.partition(" ")
        return [Pressed(command, argument)]

    return pressed


class BenchLoop:
    """Ties a load cell, a journal, a run and a view together.

    Args:
        acquisition: started; what the cell says until the journal is there waits.
        journal: that is written.
        stream: of the journal, that the readings belong to; the run's too.
        run: not started yet.
        meter: of the stream.
        view: that shows it.
        pressed: gives what the user asks for, without waiting.
        ends_when_closed: whether closing the session ends the log too, as where nobody looks on.
    """

    def __init__(
        self,
        acquisition: Acquisition,
        journal: Journal,
        stream: str,
        run: BenchRun,
        meter: StreamMeter,
        view: View,
        pressed: Callable[[], list[Pressed]],
        ends_when_closed: bool = False,
    ) -> None:
        self._acquisition, self._journal, self._stream = acquisition, journal, stream
        self._run, self._meter, self._view, self._pressed = run, meter, view, pressed
        self._ends_when_closed = ends_when_closed
        self._kept: queue.SimpleQueue[Record] = queue.SimpleQueue()
        self._failure: Exception | None = None
        self._space_left: int | None = None
        self._drawn_s = self._asked_s = -1e9
        self._warned = False

    def go_on(self) -> None:
        """Log until the user quits, the cell ends, or nothing more can be kept; then the cell is stopped.

        Raises:
            KeyboardInterrupt: a signal ended it, and the session is not closed: it broke off.
            DriverError: the cell has become another.
            JournalError: the disk is full; all before is kept.
        """
        writer = threading.Thread(target=self._keep, name="journal")
        broke_off = False
        try:
            with ended_by_signals(lambda: None) as told:
                writer.start()
                self._say(self._run.start())
                while writer.is_alive() and not told.come and self._turn():
                    time.sleep(LOOK_S)
                broke_off = told.come
        except KeyboardInterrupt:
            broke_off = True  # pressed where the terminal tells it as a key
        finally:
            self._acquisition.stop()
            writer.join()
            self._take()
            self._view.draw(self._space_left)
        if self._failure is not None:
            raise self._failure
        if broke_off and not self._run.record.closed:
            raise KeyboardInterrupt

    def _turn(self) -> bool:
        """Take what was kept, do what was asked for, draw; return whether to go on."""
        self._take()
        for pressed in self._pressed():
            if not self._do(pressed):
                return False
        now = time.monotonic()
        if now - self._asked_s > SPACE_S:
            self._space_left, self._asked_s = self._journal.space_left(), now
            if self._space_left < LITTLE_DISK_BYTES and not self._warned:
                self._warned = True
                value = {"code": "disk", "text": f"{self._space_left / 1e9:.1f} GB left; then logging stops cleanly"}
                self._say((Event("warning", self._run.status().now_s, value, self._stream),))
        if now - self._drawn_s > DRAW_S:
            self._view.draw(self._space_left)
            self._drawn_s = now
        return not (self._ends_when_closed and self._run.record.closed)

    def _do(self, pressed: Pressed) -> bool:
        """Do what was asked for; return whether to go on."""
        refused = None
        if pressed.command != QUIT:
            try:
                events = perform(self._run, pressed.command, pressed.argument)
            except InputError as error:
                self._view.refuse(error)
                refused = str(error)
            else:
                self._say(events)
        if pressed.answer is not None:
            pressed.answer(refused)
        return pressed.command != QUIT

    def _keep(self) -> None:
        """Write what the cell says; what was written may be shown."""
        try:
            for record in self._acquisition.records():
                events = [_of_stream(e, self._stream) for e in record.events]
                self._journal.keep(self._stream, record.chunk, events)
                self._kept.put(record)
        except Exception as error:  # raised where the user is
            self._failure = error

    def _take(self) -> None:
        while not self._journal.alarms.empty():
            code, self._meter.alarm = self._journal.alarms.get()
            value = {"code": code, "text": self._meter.alarm}
            # The journal has its own event of this.
            self._view.tell((Event("warning", self._run.status().now_s, value, self._stream),))
        while True:
            try:
                record = self._kept.get_nowait()
            except queue.Empty:
                return
            self._meter.take(record)
            if record.events:
                self._view.tell([_of_stream(e, self._stream) for e in record.events])
            if record.chunk is None or not len(record.chunk):
                continue
            try:
                events = self._run.take(record.chunk)
            except InputError as error:  # what cannot be measured now is kept all the same
                self._view.refuse(error)
            else:
                self._say(events)

    def _say(self, events: Sequence[Event]) -> None:
        if events:
            # In one transaction: a command is kept whole or not at all.
            self._journal.event(*events)
            self._view.tell(events)


def _of_stream(event: StreamEvent, stream: str) -> Event:
    return Event(event.kind, event.at_s, event.value, stream, event.utc_s)
