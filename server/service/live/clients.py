"""Clients of the live path: what each wants to hear, and what waits for it. What waits is bounded; nobody waits for it.

Text frames are JSON arrays of messages. A frame is made once for all clients that want the same; a client that does
not keep up loses the oldest traces, which it is told, and never a kept message: where even those become too many, it
is told from where to resume.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from websockets import frames

from server.service.answers import dumps
from server.service.storage.messages import Message

# Half a second at 30 Hz: what is older is no longer live.
FRAMES_WAITING = 15
MOST_KEPT, MOST_KEPT_BYTES = 2000, 4 << 20
# Codes of RFC 6455 with which a connection is closed, and those that are this service's own.
POLICY, FAILED, RESTART, TRY_AGAIN = 1008, 1011, 1012, 1013
BAD_PARAMETERS, NOT_FOUND = 4422, 4404
# The reason in a close frame has room for so many bytes.
_REASON_BYTES = 120


@dataclass(frozen=True)
class Subscription:
    """Subscription of a client."""

    sessions: frozenset[str] | None = None  # ids, None for all
    traces: bool = False  # whether traces are wanted
    rate_hz: float = 30.0  # frames a second, at most

    def wants(self, session: str | None) -> bool:
        """Return whether messages of a session, or of none, are wanted."""
        return self.sessions is None or session in self.sessions


@dataclass(frozen=True)
class Kept:
    """A kept message as it is sent."""

    id: int
    session: str | None
    text: bytes

    @classmethod
    def of(cls, message: Message) -> Kept:
        """Keep a message that has a number."""
        return cls(message.id or 0, message.session, dumps(message.as_dict()))


@dataclass(frozen=True)
class Frame:
    """Frame due at one moment for all clients with the same subscription."""

    kept: tuple[Kept, ...] = ()  # messages that must not be lost, in order
    passing: tuple[bytes, ...] = ()  # traces, estimates and heartbeats, as they are sent
    live: int = 0  # how many of these are lost with the frame: traces and estimates

    @cached_property
    def text(self) -> str:
        """JSON text of the frame."""
        return array([*(k.text for k in self.kept), *self.passing])

    @cached_property
    def wire(self) -> bytes:
        """Bytes of the frame on the wire, framed by RFC 6455."""
        return frames.Frame(frames.Opcode.TEXT, self.text.encode()).serialize(mask=False)


def array(messages: list[bytes]) -> str:
    """Return a frame of messages."""
    return (b"[" + b",".join(messages) + b"]").decode()


def short_reason(text: str) -> str:
    """Cut a reason to the room of a close frame."""
    return text.encode()[:_REASON_BYTES].decode(errors="ignore")


class Client:
    """Queue of one client; used by the event loop's thread only.

    Args:
        subscription: what it wants to hear.
        after: number of the last kept message that it was sent.
        write: sends a frame at once; False where it would have to wait. None lets every frame wait to be taken.

    Attributes:
        after: as above, as it goes on.
        dropped: traces and estimates that it was never sent.
        closing: code and reason with which to hang up, once all that waits was sent.
    """

    def __init__(self, subscription: Subscription, after: int, write: Callable[[Frame], bool] | None = None) -> None:
        self.subscription, self.after = subscription, after
        self._write = write
        self._waiting = False
        self.dropped = 0
        self.closing: tuple[int, str] | None = None
        self._frames: deque[Frame] = deque()
        self._saved: list[Kept] = []
        self._saved_bytes = 0
        self._told = 0
        self._some = asyncio.Event()

    def push(self, frame: Frame) -> bool:
        """Send a frame or let it wait; return False where the client is too slow for what must not be lost."""
        if self.closing is not None:
            return False
        if self._waiting and not self._some.is_set() and self._write is not None and self._write(frame):
            self._sent(frame)
            return True
        self._frames.append(frame)
        self._some.set()
        if len(self._frames) > FRAMES_WAITING:
            oldest = self._frames.popleft()
            self.dropped += oldest.live
            self._saved += oldest.kept
            self._saved_bytes += sum(len(k.text) for k in oldest.kept)
        if len(self._saved) <= MOST_KEPT and self._saved_bytes <= MOST_KEPT_BYTES:
            return True
        self._frames.clear()
        self._saved.clear()
        self._frames.append(Frame(passing=(dumps({"kind": "resume", "after": self.after}),)))
        self.close(TRY_AGAIN, f"too slow: connect again with after={self.after}")
        return False

    def close(self, code: int, reason: str) -> None:
        """Hang up once what waits was sent."""
        self.closing = self.closing or (code, short_reason(reason))
        self._some.set()

    async def wait(self) -> None:
        """Wait until there is something to send, or to hang up."""
        self._waiting = True
        await self._some.wait()
        self._waiting = False
        self._some.clear()

    def take(self) -> str | None:
        """Return the next text to be sent, None where nothing waits."""
        if self._saved or self.dropped > self._told:
            said = [k.text for k in self._saved]
            if self.dropped > self._told:
                said.append(dumps({"kind": "dropped", "count": self.dropped - self._told, "total": self.dropped}))
            self.after = self._saved[-1].id if self._saved else self.after
            self._saved, self._saved_bytes, self._told = [], 0, self.dropped
            return array(said)
        if not self._frames:
            return None
        frame = self._frames.popleft()
        self._sent(frame)
        return frame.text

    def _sent(self, frame: Frame) -> None:
        self.after = frame.kept[-1].id if frame.kept else self.after
