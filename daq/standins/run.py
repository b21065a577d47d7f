"""A stand-in at work: it plays readings in real time over a wire, hears what it is told, and suffers faults."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from daq.readings import ReadingBlock
from daq.standins.base import StandIn
from daq.standins.faults import Faults, FaultyWire
from daq.standins.wires import Wire

# So often the stand-in looks what it heard and writes what is due [s].
TICK_S = 0.004
# Readings that are written at once.
PORTION = 256


class Player:
    """Plays readings; they pass whether anybody listens or not, as they do in a real cell.

    Attributes:
        written: records that went onto the wire.
    """

    def __init__(
        self,
        device: StandIn,
        wire: Wire,
        blocks: Iterable[ReadingBlock],
        faults: Faults | None = None,
        *,
        seed: int = 0,
        full_scale: float = 1e4,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin with the first reading.

        Args:
            device: the stand-in.
            wire: its cable.
            blocks: readings in order of time.
            faults: that it has; none by default.
            seed: of the faults.
            full_scale: what a saturated axis is driven to, before the device cuts it [N].
            clock: monotonic seconds.
        """
        self.written = 0
        self._device, self._wire, self._faults = device, wire, faults or Faults()
        self._carrier = FaultyWire(self._faults, seed)
        self._rows = _rows(blocks, device, self._faults, full_scale)
        self._next = next(self._rows, None)
        self._clock, self._began = clock, clock()
        self._last_s = self._sent_s = 0.0
        self._out_until_s: float | None = None
        self._pending: list[bytes] = []

    def turn(self) -> bool:
        """Do what is due; return whether there is more to come."""
        now = self._clock() - self._began
        self._cable(now)
        heard = self._wire.receive() if self._out_until_s is None else b""
        answer = self._device.hear(heard) if heard else b""
        if answer:
            self._wire.send([answer])
        due: list[bytes] = []
        while self._next is not None and self._next[0] <= now:
            if self._device.streaming:
                due.append(self._next[1])
            self._next = next(self._rows, None)
        self._pending += self._carrier.carry(due, now - self._last_s)
        if self._pending and now - self._sent_s >= self._faults.burst_s:
            if self._out_until_s is None:
                self._wire.send(self._pending)
                self.written += len(self._pending)
            self._pending, self._sent_s = [], now
        self._last_s = now
        return self._next is not None

    def run(self, ended: Callable[[], bool] = lambda: False, wait: Callable[[float], None] = time.sleep) -> None:
        """Play until the readings are over or the end is asked for."""
        while not ended() and self.turn():
            wait(TICK_S)

    def _cable(self, now: float) -> None:
        """Pull the cable when it is time, and plug it in again."""
        every = self._faults.pulled_every_s
        if self._out_until_s is not None:
            if now >= self._out_until_s:
                self._wire.plug_in()
                self._device.streaming, self._out_until_s = False, None
        elif every and now // every > self._last_s // every:
            self._wire.pull()
            self._out_until_s = now + self._faults.pulled_for_s


def _rows(
    blocks: Iterable[ReadingBlock], device: StandIn, faults: Faults, full_scale: float
) -> Iterator[tuple[float, bytes]]:
    """(time since the start, bytes) of every record."""
    count, first_s = faults.first_count, None
    for block in blocks:
        first_s = float(block.t_s[0]) if first_s is None else first_s
        for a in range(0, len(block), PORTION):
            t = block.t_s[a : a + PORTION] - first_s
            wrench = block.wrench[a : a + PORTION].copy()
            if faults.saturated_every_s:
                wrench[t % faults.saturated_every_s > faults.saturated_every_s - 1.0, 2] = full_scale
            records = device.encode(wrench, count + np.arange(len(t)), t)
            count += len(t)
            yield from zip(t.tolist(), records, strict=True)
