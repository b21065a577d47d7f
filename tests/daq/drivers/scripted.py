"""A transport that expects a conversation: each thing sent is answered as scripted; what is left over is a failure."""

from __future__ import annotations

from collections import deque

from daq.errors import LinkLostError


class Scripted:
    """Plays the device's part of a conversation.

    Args:
        pairs: (sent by the host, answered by the device), in order.
        then: what comes afterwards, one portion a read; None is a pulled cable.
    """

    def __init__(self, pairs: list[tuple[bytes, bytes]], then: list[bytes | None] | None = None) -> None:
        self._pairs = deque(pairs)
        self._pending: deque[bytes | None] = deque()
        self._then = deque(then or [])
        self._sent = b""

    def write(self, data: bytes) -> None:
        self._sent += data
        while self._pairs and self._sent.startswith(self._pairs[0][0]):
            expected, answer = self._pairs.popleft()
            self._sent = self._sent[len(expected) :]
            if answer:
                self._pending.append(answer)
        if self._sent:
            wanted = self._pairs[0][0] if self._pairs else b""
            assert wanted.startswith(self._sent), f"sent {self._sent!r}, expected {wanted!r}"

    def read(self, timeout_s: float) -> bytes:
        assert timeout_s >= 0.0
        queue = self._pending or self._then
        if not queue:
            return b""
        data = queue.popleft()
        if data is None:
            raise LinkLostError("the cable was pulled")
        return data

    def close(self) -> None:
        assert not self._pairs, f"never sent: {list(self._pairs)}"
        assert not self._sent, f"sent and not expected: {self._sent!r}"
