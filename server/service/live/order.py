"""Kept messages in the order of their numbers, each once, whatever order the threads that kept them tell them in.

A number is given within the transaction that keeps the message, and transactions follow each other in the order of
their numbers. So all messages below one that was told are in the database, and where one of them is late, or was never
kept (its transaction was rolled back), the database tells.
"""

from __future__ import annotations

from collections.abc import Iterable

from server.service.storage.messages import Message


class InOrder:
    """Puts messages in order.

    Args:
        last: number of the last message that is not to come.

    Attributes:
        last: number of the last that came out, or that is known not to come.
    """

    def __init__(self, last: int) -> None:
        self.last = last
        self._waiting: dict[int, Message] = {}

    @property
    def gap(self) -> bool:
        """True if a message waits for one before it."""
        return bool(self._waiting)

    def offer(self, message: Message) -> None:
        """Take a message that was told."""
        if message.id is not None and message.id > self.last:
            self._waiting[message.id] = message

    def ready(self) -> list[Message]:
        """Return what follows without a gap."""
        out = []
        while (message := self._waiting.pop(self.last + 1, None)) is not None:
            self.last += 1
            out.append(message)
        return out

    def fill(self, stored: Iterable[Message]) -> list[Message]:
        """Return, of all messages that the database holds after one that came out before, those that did not yet."""
        out = []
        for message in stored:
            if message.id is not None and message.id > self.last:
                self.last = message.id
                out.append(message)
        self._waiting = {number: m for number, m in self._waiting.items() if number > self.last}
        return out + self.ready()
