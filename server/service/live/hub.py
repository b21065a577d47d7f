"""The hub of the live path: whatever is to be told comes in from any thread, and goes out in frames, client by client.

One tick of the event loop at a time takes all that came since the last: however many threads tell how much, they wake
the loop at most once a tick, and wait for nobody.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from daq.blocks import Chunk
from server.service.answers import dumps
from server.service.database import now_utc
from server.service.live.bodies import LiveMessage
from server.service.live.clients import RESTART, Client, Group, Kept, Subscription
from server.service.live.estimates import Estimates, MakePredict, Tares
from server.service.live.order import InOrder
from server.service.live.traces import Rows, Traces, rows_of, rows_of_chunk
from server.service.messages import Message, Messages

TICK_S, HEARTBEAT_S = 1.0 / 30.0, 5.0
# A kept message that was told before its predecessor: so long the other thread is waited for, then the database asked.
GAP_S = 0.1
# Every so often, a session that posts is looked for in the database.
TRUSTED_S = 5.0
PAGE = 500
# Frames that are due so soon go at once.
_SLACK_S = 0.001
_LOG = logging.getLogger(__name__)


@dataclass
class Counters:
    """What the hub has done since it started.

    Attributes:
        envelopes: of traces that came in and were new.
        encoded: frames that were made.
        frames: that were sent, to all clients together.
        bytes: of these; letters beyond ASCII count once.
        dropped: traces and estimates that slow clients were not sent.
        resumes: clients that were told to connect again, being too slow.
        wakes: of the event loop.
        refused: clients that were not let in.
    """

    envelopes: int = 0
    encoded: int = 0
    frames: int = 0
    bytes: int = 0
    dropped: int = 0
    resumes: int = 0
    wakes: int = 0
    refused: int = 0


class LiveHub:
    """Hands on what is told.

    Args:
        messages: those that are kept; all of them are handed on.
        make_predict: returns what predicts the cases of a bench; None where nothing is predicted.
        tares: returns a window of stored readings, reduced; for tares from before the service started.

    Attributes:
        counters: for whoever watches the service.
        traces: the last minutes.
    """

    def __init__(self, messages: Messages, make_predict: MakePredict | None = None, tares: Tares | None = None) -> None:
        self.messages = messages
        self.counters, self.traces = Counters(), Traces()
        self.closed = False
        self._estimates = Estimates(self.publish, messages, make_predict, tares)
        self._order = InOrder(0)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._lock = threading.Lock()
        self._inbox: list[Message | tuple[str, str, Rows, bool]] = []
        self._woken = False
        self._clients: dict[Client, asyncio.Task[None]] = {}
        self._groups: dict[Subscription, Group] = {}
        self._timer: asyncio.TimerHandle | None = None
        self._beat_timer: asyncio.TimerHandle | None = None
        self._ticked_s = 0.0
        self._gap_s: float | None = None
        self._filling = asyncio.Lock()
        self._filler: asyncio.Task[None] | None = None
        self._bench_dropped: dict[str, int] = {}
        self._shown_until_s: dict[str, float] = {}

    @property
    def clients(self) -> int:
        """Number of clients that are connected."""
        return len(self._clients)

    @property
    def last(self) -> int:
        """Number of the last kept message that was handed on."""
        return self._order.last

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Hand on from now on; on the thread of the loop."""
        self.messages.listen(self.publish)
        self._order = InOrder(self.messages.latest())
        self._loop = loop
        self._estimates.start()
        self._beat_timer = loop.call_later(HEARTBEAT_S, self._beat)
        self._tick()

    async def close(self) -> None:
        """Tell what is left, and hang up."""
        self._tick()
        with self._lock:
            self.closed = True
        for timer in (self._timer, self._beat_timer):
            if timer is not None:
                timer.cancel()
        for group in self._groups.values():
            self._flush(group)
        tasks = [*self._clients.values(), *([self._filler] if self._filler else [])]
        for client in self._clients:
            client.close(RESTART, f"the service stops: connect again with after={self.last}")
        if tasks:
            # Who does not take it now asks for it later.
            _, late = await asyncio.wait(tasks, timeout=1.0)
            for task in late:
                task.cancel()
        await asyncio.to_thread(self._estimates.close)

    # ----- from any thread

    def publish(self, message: Message) -> None:
        """Hand on a message; one that has no number is told to those who listen now, and to no one else."""
        self._put(message)

    def trace(self, session: str, message: LiveMessage | Mapping[str, Any]) -> None:
        """Hand on what a bench posted to its session's live path.

        Raises:
            ValidationError: it is a mapping that is no such message.
        """
        checked = message if isinstance(message, LiveMessage) else LiveMessage.model_validate(message)
        if not self.is_shown(session):
            self._shown_until_s[session] = time.monotonic() + TRUSTED_S
        self._bench_dropped[session] = checked.dropped
        for stream, rows in rows_of(checked).items():
            self._put((session, stream, rows, True))

    def is_shown(self, session: str) -> bool:
        """Whether envelopes of a session were taken seconds ago, so that it need not be looked for again."""
        return self._shown_until_s.get(session, 0.0) > time.monotonic()

    def offer_chunk(self, session: str, stream: str, chunk: Chunk) -> None:
        """Show a stored chunk, as far as the live path has not shown its times already."""
        rows = rows_of_chunk(chunk, self.traces.shown_s(session, stream))
        if len(rows):
            self._put((session, stream, rows, False))

    def _put(self, item: Message | tuple[str, str, Rows, bool]) -> None:
        with self._lock:
            if self.closed:
                return
            self._inbox.append(item)
            if self._woken or self._loop is None:
                return
            self._woken = True
        # A loop that has ended needs no waking.
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._wake)

    # ----- on the loop's thread

    def _wake(self) -> None:
        self.counters.wakes += 1
        self._plan(min([self._ticked_s + TICK_S, *(g.due_s for g in self._groups.values())]))

    def _plan(self, at_s: float) -> None:
        """See to it that there is a tick by then."""
        if self._loop is None or self.closed or (self._timer is not None and self._timer.when() <= at_s):
            return
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._loop.call_at(at_s, self._tick)

    def _tick(self) -> None:
        if self._loop is None:
            return
        self._timer, self._ticked_s = None, self._loop.time()
        with self._lock:
            items, self._inbox, self._woken = self._inbox, [], False
        for item in items:
            self._take(item)
        self._hand_on(self._order.ready())
        self._look_for_gaps()
        for group in self._groups.values():
            if group.pending:
                if group.due_s <= self._ticked_s + _SLACK_S:
                    self._flush(group)
                else:
                    self._plan(group.due_s)

    def _take(self, item: Message | tuple[str, str, Rows, bool]) -> None:
        if isinstance(item, Message):
            if item.id is not None:
                self._order.offer(item)
                return
            # Of estimates only the latest counts.
            key = (item.kind, item.session) if item.kind == "estimate" else object()
            told = {"kind": item.kind, "session": item.session, "body": item.body}
            self._pass(item.session, key, told)
            return
        session, stream, rows, live = item
        rows = self.traces.add(session, stream, rows, self._ticked_s, live)
        if not len(rows):
            return
        self.counters.envelopes += len(rows)
        self._estimates.trace(session, stream, rows)
        for group in self._groups.values():
            if group.subscription.traces and group.subscription.wants(session):
                group.rows.setdefault((session, stream), []).append(rows)

    def _pass(self, session: str | None, key: object, told: Mapping[str, Any]) -> None:
        wanting = [g for g in self._groups.values() if g.subscription.wants(session)]
        text = dumps(told) if wanting else b""
        for group in wanting:
            group.passing[key] = text

    def _hand_on(self, messages: Iterable[Message]) -> None:
        for message in messages:
            if message.kind == "event":
                self._estimates.event(message)
            wanting = [g for g in self._groups.values() if g.subscription.wants(message.session)]
            if wanting:
                kept = Kept.of(message)
                for group in wanting:
                    group.kept.append(kept)

    def _flush(self, group: Group) -> None:
        if not group.pending:
            return
        period_s = 1.0 / group.subscription.rate_hz
        late_s = self._ticked_s - group.due_s
        group.due_s = (group.due_s if late_s < period_s else self._ticked_s) + period_s
        frame = group.frame()
        self.counters.encoded += 1
        for client in list(group.clients):
            before = client.dropped
            if not client.push(frame):
                group.clients.discard(client)
                self.counters.resumes += 1
            self.counters.dropped += client.dropped - before

    def _look_for_gaps(self) -> None:
        if not self._order.gap:
            self._gap_s = None
        elif self._gap_s is None:
            self._gap_s = self._ticked_s
            self._plan(self._ticked_s + GAP_S)
        elif self._ticked_s - self._gap_s >= GAP_S and (self._filler is None or self._filler.done()):
            self._gap_s = None
            self._filler = asyncio.ensure_future(self._fill())

    async def _fill(self) -> None:
        try:
            await self.catch_up()
        except Exception as error:  # a database that does not answer now may do so soon
            _LOG.warning("messages could not be read for the live path: %s", error)
            self._plan(self._ticked_s + 1.0)

    async def catch_up(self) -> None:
        """Hand on all that is kept by now."""
        async with self._filling:
            full = True
            while full:
                stored = await asyncio.to_thread(self.messages.after, self._order.last, None, PAGE)
                full = len(stored) == PAGE
                self._hand_on(self._order.fill(stored))
        self._wake()

    def _beat(self) -> None:
        """Tell that the service is there, and which benches are not silent."""
        if self._loop is None or self.closed:
            return
        now = self._loop.time()
        self.traces.let_go(now)
        sessions = {session for session, _, _ in self.traces.of(None)}
        for known in (self._bench_dropped, self._shown_until_s):
            for session in [s for s in list(known) if s not in sessions]:
                known.pop(session, None)
        for group in self._groups.values():
            group.beat = dumps(
                {"kind": "heartbeat", "at_utc": now_utc(), "latest": self.last, "live": self.live(group.subscription)}
            )
        self._beat_timer = self._loop.call_later(HEARTBEAT_S, self._beat)
        self._wake()

    # ----- for connections, on the loop's thread

    def live(self, subscription: Subscription) -> list[dict[str, Any]]:
        """Return the streams that have a trace, how long each has been silent, and what its bench dropped."""
        now = 0.0 if self._loop is None else self._loop.time()
        return [
            {
                "session": session,
                "stream": stream,
                "silent_s": round(now - trace.arrived_s, 3),
                "dropped": self._bench_dropped.get(session, 0),
            }
            for session, stream, trace in self.traces.of(subscription.sessions)
        ]

    def connect(self, client: Client, task: asyncio.Task[None]) -> None:
        """Count a client in, and hang up on it when the hub closes."""
        self._clients[client] = task

    def join(self, client: Client) -> list[tuple[str, str, Rows]]:
        """Let a client hear all after `last` from now on; return the last minutes that it wants to see."""
        group = self._groups.setdefault(client.subscription, Group(client.subscription))
        # What is due to the others is in what the client has been told.
        self._flush(group)
        group.clients.add(client)
        if not client.subscription.traces:
            return []
        return [(s, stream, trace.recent()) for s, stream, trace in self.traces.of(client.subscription.sessions)]

    def leave(self, client: Client) -> None:
        """Forget a client."""
        self._clients.pop(client, None)
        group = self._groups.get(client.subscription)
        if group is not None:
            group.clients.discard(client)
            if not group.clients:
                del self._groups[client.subscription]
