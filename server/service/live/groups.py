"""Clients that want the same are a group: what is due to all of them is gathered and encoded once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from server.service.answers import dumps
from server.service.live.clients import Client, Frame, Kept, Subscription
from server.service.live.traces import Rows, as_columns, decimated
from server.service.storage.messages import Message

# Frames that are due so soon go at once. Benches send as often as clients look, never quite in step: with less, most
# frames would wait for a timer, with two envelopes in some and none in others.
SLACK_S = 0.01


@dataclass
class Counters:
    """Counts since the service started."""

    envelopes: int = 0  # of traces that came in and were new
    encoded: int = 0  # frames that were made
    frames: int = 0  # that were sent, to all clients together
    bytes: int = 0  # of these; letters beyond ASCII count once
    dropped: int = 0  # traces and estimates that slow clients were not sent
    resumes: int = 0  # clients that were told to connect again, being too slow
    wakes: int = 0  # of the event loop
    refused: int = 0  # clients that were not let in

    def sent(self, text: str) -> None:
        """Count a frame."""
        self.frames += 1
        self.bytes += len(text)


@dataclass(eq=False)
class Group:
    """All clients that want the same, and what is due to them."""

    subscription: Subscription  # that the clients share
    due_s: float = 0.0  # when the next frame may go, by the loop's clock
    clients: set[Client] = field(default_factory=set)
    kept: list[Kept] = field(default_factory=list)
    rows: dict[tuple[str, str], list[Rows]] = field(default_factory=dict)
    # Estimates and benches by session, of which the latest counts, and others that are not kept.
    passing: dict[object, bytes] = field(default_factory=dict)
    beat: bytes | None = None

    @property
    def pending(self) -> bool:
        """True if anything is due."""
        return bool(self.kept or self.rows or self.passing or self.beat)

    def frame(self) -> Frame:
        """Return what is due, as a frame; nothing is due afterwards."""
        rate_hz = self.subscription.rate_hz
        traces = [
            encoded_trace(*key, decimated(rows[0] if len(rows) == 1 else np.concatenate(rows), rate_hz))
            for key, rows in self.rows.items()
        ]
        passing = [*traces, *self.passing.values()]
        out = Frame(tuple(self.kept), (*passing, *([self.beat] if self.beat else [])), len(passing))
        self.kept, self.rows, self.passing, self.beat = [], {}, {}, None
        return out


class Groups:
    """All groups; of the event loop's thread only.

    Args:
        counters: that are kept.
    """

    def __init__(self, counters: Counters) -> None:
        self._counters = counters
        self._groups: dict[Subscription, Group] = {}

    @property
    def clients(self) -> int:
        """Clients that receive messages."""
        return sum(len(group.clients) for group in self._groups.values())

    def due_s(self) -> float:
        """Return when the next frame of any group may go."""
        return min((group.due_s for group in self._groups.values()), default=np.inf)

    def keep(self, message: Message) -> None:
        """Put a kept message into every group that wants it."""
        wanting = self._wanting(message.session)
        if wanting:
            kept = Kept.of(message)
            for group in wanting:
                group.kept.append(kept)

    def tell(self, message: Message) -> None:
        """Let a message that is not kept be due to who wants it; of estimates and benches only the latest counts."""
        wanting = self._wanting(message.session)
        if wanting:
            text = dumps({"kind": message.kind, "session": message.session, "body": message.body})
            key = (message.kind, message.session) if message.kind in ("estimate", "bench") else object()
            for group in wanting:
                group.passing[key] = text

    def show(self, session: str, stream: str, rows: Rows) -> None:
        """Let envelopes be due to all who want traces of a session."""
        for group in self._wanting(session):
            if group.subscription.traces:
                group.rows.setdefault((session, stream), []).append(rows)

    def beat(self, heartbeat: Callable[[Subscription], Mapping[str, Any]]) -> None:
        """Let a heartbeat be due to all."""
        for group in self._groups.values():
            group.beat = dumps(heartbeat(group.subscription))

    def flush(self, now_s: float, all_of_them: bool = False) -> float:
        """Hand out the frames that are due; return the time of the next one."""
        left_s = np.inf
        for group in self._groups.values():
            if group.pending and (all_of_them or group.due_s <= now_s + SLACK_S):
                self._flush(group, now_s)
            elif group.pending:
                left_s = min(left_s, group.due_s)
        return left_s

    def join(self, client: Client, now_s: float) -> None:
        """Let a client hear all from now on; what is due to the others it has been told already."""
        group = self._groups.setdefault(client.subscription, Group(client.subscription))
        if group.pending:
            self._flush(group, now_s)
        group.clients.add(client)

    def leave(self, client: Client) -> None:
        """Forget a client."""
        group = self._groups.get(client.subscription)
        if group is not None:
            group.clients.discard(client)
            if not group.clients:
                del self._groups[client.subscription]

    def _wanting(self, session: str | None) -> Iterable[Group]:
        return [group for group in self._groups.values() if group.subscription.wants(session)]

    def _flush(self, group: Group, now_s: float) -> None:
        period_s = 1.0 / group.subscription.rate_hz
        group.due_s = (group.due_s if now_s - group.due_s < period_s else now_s) + period_s
        frame = group.frame()
        self._counters.encoded += 1
        for client in list(group.clients):
            before = client.dropped
            if not client.push(frame):
                group.clients.discard(client)
                self._counters.resumes += 1
            self._counters.dropped += client.dropped - before


def encoded_trace(session: str, stream: str, rows: Rows, recent: bool = False) -> bytes:
    """Return a trace as it is sent; `recent` says that it is the past minutes, for who comes new."""
    body = {"stream": stream, "recent": recent, **as_columns(rows)}
    return dumps({"kind": "trace", "session": session, "body": body})
