"""Stand-in for a device: it plays readings in real time over a wire, obeys commands, and simulates faults."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from daq.recordings.readings import ReadingBlock
from daq.standins.base import Floats, Integers, StandIn
from daq.standins.faults import Faults, FaultyWire
from daq.standins.noise import Disturbance, Disturber
from daq.standins.wires import Wire

# So often the stand-in looks what it heard and writes what is due [s].
TICK_S = 0.004
# Readings that are written at once.
PORTION = 256


class Player:
    """Plays readings; they pass whether anybody listens or not, as they do in a real cell.

    Attributes:
        written: records that went onto the wire.
        passed_s: since the first reading [s].
    """

    def __init__(
        self,
        device: StandIn,
        wire: Wire,
        blocks: Iterable[ReadingBlock],
        faults: Faults | None = None,
        *,
        disturbance: Disturbance | None = None,
        seed: int = 0,
        full_scale: float = 1e4,
        rate_hz: float | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin with the first reading.

        Args:
            device: the stand-in.
            wire: its cable.
            blocks: readings in order of time.
            faults: that it has; none by default.
            disturbance: of the readings; none by default.
            seed: of faults and noise.
            full_scale: what a saturated axis is driven to, before the device cuts it [N].
            rate_hz: of the device; by default that of the readings.
            clock: monotonic seconds.
        """
        self.written = 0
        self.passed_s = 0.0
        self._device, self._wire, self._faults = device, wire, faults or Faults()
        self._carrier = FaultyWire(self._faults, seed)
        disturber = None if disturbance is None else Disturber(disturbance, seed)
        self._portions = _portions(blocks, self._faults, full_scale, rate_hz, disturber)
        self._portion = next(self._portions, None)
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
        self._pending += self._carrier.carry(self._due(now), now - self._last_s)
        if self._pending and now - self._sent_s >= self._faults.burst_s:
            if self._out_until_s is None:
                self._wire.send(_joined(self._pending, self._device.per_datagram))
                self.written += len(self._pending)
            self._pending, self._sent_s = [], now
        self._last_s = self.passed_s = now
        return self._portion is not None

    def run(self, ended: Callable[[], bool] = lambda: False, wait: Callable[[float], None] = time.sleep) -> None:
        """Play until the readings are over or the end is asked for."""
        while not ended() and self.turn():
            wait(TICK_S)

    def _due(self, now: float) -> list[bytes]:
        """Write the readings whose time has come, as the device has been told to by now."""
        out: list[bytes] = []
        while self._portion is not None:
            t_s, wrench, sequence = self._portion
            n = int(np.searchsorted(t_s, now, side="right"))
            if n and self._device.streaming:
                out += self._device.encode(wrench[:n], sequence[:n], t_s[:n])
            if n < len(t_s):
                self._portion = (t_s[n:], wrench[n:], sequence[n:])
                break
            self._portion = next(self._portions, None)
        return out

    def _cable(self, now: float) -> None:
        """Pull the cable when it is time, and plug it in again."""
        every = self._faults.pulled_every_s
        if self._out_until_s is not None:
            if now >= self._out_until_s:
                self._wire.plug_in()
                self._device.streaming, self._out_until_s = self._device.unasked, None
        elif every and now // every > self._last_s // every:
            self._wire.pull()
            self._out_until_s = now + self._faults.pulled_for_s


def _joined(records: list[bytes], count: int) -> list[bytes]:
    """Return records as datagrams of so many."""
    if count == 1:
        return records
    return [b"".join(records[a : a + count]) for a in range(0, len(records), count)]


def _portions(
    blocks: Iterable[ReadingBlock],
    faults: Faults,
    full_scale: float,
    rate_hz: float | None,
    disturber: Disturber | None,
) -> Iterator[tuple[Floats, Floats, Integers]]:
    """Yield times since the start (n,), wrenches (n, 6) and counts (n,) of readings."""
    count, first_s = faults.first_count, None
    for block in blocks if rate_hz is None else resampled(blocks, rate_hz):
        first_s = float(block.t_s[0]) if first_s is None else first_s
        for a in range(0, len(block), PORTION):
            t_s = block.t_s[a : a + PORTION] - first_s
            wrench = block.wrench[a : a + PORTION] + (0.0 if disturber is None else disturber.added(t_s))
            if faults.saturated_every_s:
                wrench[t_s % faults.saturated_every_s > faults.saturated_every_s - 1.0, 2] = full_scale
            yield t_s, wrench, (count + np.arange(len(t_s))).astype(np.int64)
            count += len(t_s)


def resampled(blocks: Iterable[ReadingBlock], rate_hz: float) -> Iterator[ReadingBlock]:
    """Yield readings at another rate, by straight lines between those that there are."""
    held: ReadingBlock | None = None
    next_s: float | None = None
    for block in blocks:
        t_s, wrench = block.t_s, block.wrench
        if held is not None:
            t_s, wrench = np.concatenate([held.t_s, t_s]), np.concatenate([held.wrench, wrench])
        first_s = float(t_s[0]) if next_s is None else next_s
        count = int(np.floor((t_s[-1] - first_s) * rate_hz + 1e-9)) + 1
        times = first_s + np.arange(max(count, 0)) / rate_hz
        if len(times):
            columns = [np.interp(times, t_s, wrench[:, k]) for k in range(6)]
            yield ReadingBlock(times, np.stack(columns, axis=1))
            next_s = float(times[-1]) + 1.0 / rate_hz
        held = ReadingBlock(t_s[-1:], wrench[-1:])
