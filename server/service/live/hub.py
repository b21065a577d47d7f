"""The hub of the live path: whatever is to be told comes in from any thread, and goes out in frames, client by client.

One tick of the event loop at a time takes all that came since the last: however many threads tell how much, they wake
the loop at most once a tick, and wait for nobody.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections.abc import Mapping
from typing import Any

from daq.acquisition.blocks import Chunk
from server.service.live.benches import Benches
from server.service.live.bodies import LiveMessage
from server.service.live.clients import RESTART, Client, Subscription
from server.service.live.estimate import MakePredict, Tares
from server.service.live.estimates import Estimates
from server.service.live.groups import SLACK_S, Counters, Groups
from server.service.live.traces import Rows, Traces, rows_of, rows_of_chunk
from server.service.storage.database import now_utc
from server.service.storage.messages import Message, Messages

TICK_S, HEARTBEAT_S = 1.0 / 30.0, 5.0
# Every so often, a session that posts is looked for in the database.
TRUSTED_S = 5.0


class LiveHub:
    """Hub of live messages.

    Args:
        messages: those that are kept; all of them are handed on.
        make_predict: returns what predicts the cases of a bench; None where nothing is predicted.
        tares: returns a window of stored readings, reduced; for tares from before the service started.

    Attributes:
        counters: for whoever watches the service.
        last: number of the last kept message that was handed on.
        traces: the last minutes.
        benches: that are connected.
    """

    def __init__(self, messages: Messages, make_predict: MakePredict | None = None, tares: Tares | None = None) -> None:
        self.messages = messages
        self.counters, self.traces = Counters(), Traces()
        self.closed = False
        self.benches = Benches(self.publish)
        self._estimates = Estimates(self.publish, messages, make_predict, tares)
        self.last = 0
        self._loop: asyncio.AbstractEventLoop | None = None
        self._loop_thread = 0
        self._lock = threading.Lock()
        self._inbox: list[Message | tuple[str, str, Rows, bool]] = []
        self._woken = False
        self._clients: dict[Client, asyncio.Task[None]] = {}
        self._groups = Groups(self.counters)
        self._timer: asyncio.TimerHandle | None = None
        self._beat_timer: asyncio.TimerHandle | None = None
        self._ticked_s = 0.0
        self._bench_dropped: dict[str, int] = {}
        self._shown_until_s: dict[str, float] = {}

    @property
    def clients(self) -> int:
        """Number of clients that are connected."""
        return len(self._clients)

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Hand on from now on; on the thread of the loop."""
        self.messages.listen(self.publish)
        self.last = self.messages.latest()
        self._loop, self._loop_thread = loop, threading.get_ident()
        self._estimates.start()
        self._beat_timer = loop.call_later(HEARTBEAT_S, self._beat)
        self._tick()

    async def close(self) -> None:
        """Send the remaining messages, and close the connection."""
        self._tick()
        with self._lock:
            self.closed = True
        for timer in (self._timer, self._beat_timer):
            if timer is not None:
                timer.cancel()
        self._groups.flush(self._ticked_s, all_of_them=True)
        for client in self._clients:
            client.close(RESTART, f"the service stops: connect again with after={self.last}")
        if self._clients:
            # Who does not take it now asks for it later.
            _, late = await asyncio.wait(self._clients.values(), timeout=1.0)
            for task in late:
                task.cancel()
        await asyncio.to_thread(self._estimates.close)

    # ----- from any thread

    def publish(self, message: Message) -> None:
        """Hand on a message; one without a number reaches present listeners only."""
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
        found = [(session, stream, rows, True) for stream, rows in rows_of(checked).items()]
        if self._keep(*found):
            if threading.get_ident() == self._loop_thread:
                # On the loop already, and in no tick: what is due goes out without another turn of it.
                self._look()
            else:
                self._call_soon()

    def is_shown(self, session: str) -> bool:
        """Return whether envelopes of a session were taken seconds ago, so that it need not be looked for again."""
        return self._shown_until_s.get(session, 0.0) > time.monotonic()

    def offer_chunk(self, session: str, stream: str, chunk: Chunk) -> None:
        """Show a stored chunk, as far as the live path has not shown its times already."""
        rows = rows_of_chunk(chunk, self.traces.shown_s(session, stream))
        if len(rows):
            self._put((session, stream, rows, False))

    def _put(self, item: Message | tuple[str, str, Rows, bool]) -> None:
        if self._keep(item):
            self._call_soon()

    def _keep(self, *items: Message | tuple[str, str, Rows, bool]) -> bool:
        """Let something wait for the next tick; return whether the loop is to be woken for it."""
        with self._lock:
            if self.closed or not items:
                return False
            self._inbox += items
            if self._woken or self._loop is None:
                return False
            self._woken = True
        return True

    def _call_soon(self) -> None:
        assert self._loop is not None  # noqa: S101 - something waits for it
        # A loop that has ended needs no waking; one that runs this very call is awake.
        with contextlib.suppress(RuntimeError):
            if threading.get_ident() == self._loop_thread:
                self._loop.call_soon(self._wake)
            else:
                self._loop.call_soon_threadsafe(self._wake)

    # ----- on the loop's thread

    def _wake(self) -> None:
        if self._loop is None or self.closed:
            return
        self.counters.wakes += 1
        self._look()

    def _look(self) -> None:
        """Hand out what is due now, or see to it that there is a tick when it is."""
        if self._loop is None or self.closed:
            return
        at_s = min(self._ticked_s + TICK_S, self._groups.due_s())
        if at_s <= self._loop.time() + SLACK_S:
            self._tick()
        else:
            self._plan(at_s)

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
        if self._timer is not None:
            self._timer.cancel()
        self._timer, self._ticked_s = None, self._loop.time()
        self._take_in()
        left_s = self._groups.flush(self._ticked_s)
        if left_s < float("inf"):
            self._plan(left_s)

    def _take_in(self) -> None:
        """Take all that was put in by now; what is due of it goes out with the next frames."""
        with self._lock:
            items, self._inbox, self._woken = self._inbox, [], False
        for item in items:
            if isinstance(item, Message):
                self._hand_on(item)
            else:
                self._show(*item)

    def _hand_on(self, message: Message) -> None:
        if message.id is None:
            self._groups.tell(message)
        elif message.id > self.last:
            self.last = message.id
            if message.kind == "event":
                self._estimates.event(message)
            self._groups.keep(message)

    def _show(self, session: str, stream: str, rows: Rows, live: bool) -> None:
        rows = self.traces.add(session, stream, rows, self._ticked_s, live)
        if not len(rows):
            return
        self.counters.envelopes += len(rows)
        self._estimates.trace(session, stream, rows)
        self._groups.show(session, stream, rows)

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
        common = {"kind": "heartbeat", "at_utc": now_utc(), "latest": self.last}
        self._groups.beat(lambda subscription: common | {"live": self.live(subscription)})
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

    def catch_up(self) -> None:
        """Hand on all that is kept by now."""
        self._take_in()
        self._look()

    def join(self, client: Client) -> list[tuple[str, str, Rows]]:
        """Let a client hear all after `last` from now on; return the last minutes that it wants to see."""
        self._groups.join(client, self._ticked_s)
        if not client.subscription.traces:
            return []
        return [(s, stream, trace.recent()) for s, stream, trace in self.traces.of(client.subscription.sessions)]

    def leave(self, client: Client) -> None:
        """Forget a client."""
        self._clients.pop(client, None)
        self._groups.leave(client)
