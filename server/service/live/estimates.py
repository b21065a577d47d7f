"""Estimates of all benches, made five times a second in a thread of their own; a model is computed in another."""

from __future__ import annotations

import logging
import queue
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from daq.journal.rows import Event
from server.service.live.estimate import MakePredict, Predictions, SessionEstimate, Tares
from server.service.live.traces import Rows
from server.service.storage.messages import Message, Messages

# While something hangs; else nobody waits for more than that envelopes are taken, and what happens is told at once.
EVERY_S, IDLE_S = 0.2, 1.0
MOST_SESSIONS = 64
# Envelopes beyond these wait for nobody: whoever computes is stuck.
MOST_WAITING = 20_000
_PAGE = 1000
_LOG = logging.getLogger(__name__)

Given = Message | tuple[str, str, Rows] | None


class Estimates:
    """Follows every bench that is live.

    Args:
        publish: takes an estimate.
        messages: that are kept; what happened at a bench before it was followed is read from them.
        make_predict: returns what predicts the cases of a bench.
        tares: returns a window of stored readings, reduced.
    """

    def __init__(
        self,
        publish: Callable[[Message], None],
        messages: Messages,
        make_predict: MakePredict | None,
        tares: Tares | None,
    ) -> None:
        self._publish, self._messages, self._tares = publish, messages, tares
        self._beside = ThreadPoolExecutor(1, "live-prediction")
        self._predictions = Predictions(make_predict, self._beside)
        self._sessions: OrderedDict[str, _Followed] = OrderedDict()
        self._given: queue.SimpleQueue[Given] = queue.SimpleQueue()
        self._halt, self._hurry = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="live-estimates", daemon=True)

    def start(self) -> None:
        """Follow from now on."""
        self._thread.start()

    def close(self) -> None:
        """Stop; waits for what is being computed now, but for no prediction."""
        self._halt.set()
        self._given.put(None)
        self._hurry.set()
        if self._thread.is_alive():
            self._thread.join(timeout=5.0)
        self._beside.shutdown(wait=False, cancel_futures=True)

    def event(self, message: Message) -> None:
        """Take an event of a bench, in the order in which they were kept."""
        self._given.put(message)
        self._hurry.set()

    def trace(self, session: str, stream: str, rows: Rows) -> None:
        """Take envelopes."""
        if self._given.qsize() < MOST_WAITING:
            self._given.put((session, stream, rows))

    def _run(self) -> None:
        while True:
            given = [self._given.get()]
            while not self._given.empty():
                given.append(self._given.get())
            if self._halt.is_set():
                return
            for session, found in self.step([g for g in given if g is not None]):
                self._publish(Message("estimate", session, found))
            self._hurry.wait(EVERY_S if self._hanging() else IDLE_S)
            self._hurry.clear()

    def _hanging(self) -> bool:
        return any(followed.bench.hanging for followed in self._sessions.values())

    def step(self, given: list[Message | tuple[str, str, Rows]]) -> list[tuple[str, dict[str, Any]]]:
        """Take what was given; return the estimates of the sessions that it is about."""
        # Envelopes that follow each other are taken together: it costs no more than one.
        together: dict[str, dict[str, list[Rows]]] = {}
        for item in given:
            if not isinstance(item, Message):
                session, stream, rows = item
                together.setdefault(session, {}).setdefault(stream, []).append(rows)
            elif item.session is not None:
                self._trace(item.session, together.pop(item.session, {}))
                with _of(item.session):
                    self._followed(item.session).take(item)
                together[item.session] = {}
        out = []
        for session, streams in together.items():
            self._trace(session, streams)
            with _of(session):
                found = self._followed(session).bench.estimate()
                if found is not None:
                    out.append((session, found))
        return out

    def _trace(self, session: str, streams: Mapping[str, list[Rows]]) -> None:
        for stream, rows in streams.items():
            with _of(session):
                self._followed(session).bench.trace(stream, np.concatenate(rows))

    def _followed(self, session: str) -> _Followed:
        """Return a session, from its first event on."""
        if session not in self._sessions:
            followed = self._sessions[session] = _Followed(SessionEstimate(session, self._predictions, self._tares))
            with _of(session):
                while stored := self._messages.after(followed.seen, session, _PAGE):
                    for message in stored:
                        with _of(session):
                            followed.take(message)
            while len(self._sessions) > MOST_SESSIONS:
                self._sessions.popitem(last=False)
        self._sessions.move_to_end(session)
        return self._sessions[session]


@dataclass
class _Followed:
    """A session, and the number of the last message that was taken of it."""

    bench: SessionEstimate
    seen: int = 0

    def take(self, message: Message) -> None:
        if message.id is None or message.id <= self.seen:
            return
        self.seen = message.id
        if message.kind == "event":
            body = message.body
            at_s, value = float(body.get("at_s") or 0.0), body.get("value") or {}
            self.bench.event(Event(str(body["kind"]), at_s, value, body.get("stream")))


@contextmanager
def _of(session: str) -> Iterator[None]:
    """Run a block for one session; a fault is logged, and the other sessions go on."""
    try:
        yield
    except Exception as error:
        _LOG.warning("no live estimate of session %s: %s: %s", session, type(error).__name__, error)
