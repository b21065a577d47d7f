"""The sampling thread: reads a load cell, decodes, tells the time, and hands chunks and events on. It waits for nobody.

Whatever happens is a record: a gap, an overload, bytes that made no sense, silence, a pulled cable and its return. What
nobody takes from the bounded queue in time is counted and said, never silently dropped.
"""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.acquisition.blocks import Chunk
from daq.acquisition.gathering import Gathered, Listening
from daq.acquisition.records import Kind, Record, StreamEvent
from daq.acquisition.sample_clock import LOST_S, SampleClock
from daq.acquisition.stream_gaps import StreamGaps, Told
from daq.drivers.base import NOTHING, Decoder, LoadCell, Recorded, Samples, Transport, samples
from daq.drivers.looks import looks_like
from daq.errors import DriverError, InputError, LinkLostError

CHUNK_S = 0.1
# Longer silence is one; then a new connection is tried.
STALE_S = 0.5
GIVEN_UP_S = 2.0
BACK_OFF_S = (0.25, 0.5, 1.0, 2.0, 5.0)
# Chunks that wait for whoever writes them: half a minute.
WAITING = 300
READ_S = 0.05
REST_S, REST_READS = 0.01, 3
# A device that sends so many times the stated readings was given a wrong rate. As many as in some seconds may have been
# waiting to be read when it was opened.
RATE_OFF, WAITED_S = 1.1, 3.0
# Bytes that make no sample for so long are kept as they are; that they make none is said then, and so often.
UNDECODED_S, SAID_AGAIN_S = 0.5, 10.0


class Acquisition:
    """Reads one load cell in a thread of its own.

    Args:
        cell: the driver.
        connect: opens its transport; called again after it was lost.
        chunk_s: length of a chunk [s].
        stale_s: silence that is said [s].
        waiting: chunks that may wait to be taken.
        clock: monotonic seconds.
        wall: wall-clock seconds.

    Attributes:
        live: is shown every sample with its time as soon as it is decoded, before it is kept; must not wait.
    """

    def __init__(
        self,
        cell: LoadCell,
        connect: Callable[[], Transport],
        *,
        chunk_s: float = CHUNK_S,
        stale_s: float = STALE_S,
        waiting: int = WAITING,
        clock: Callable[[], float] = time.monotonic,
        wall: Callable[[], float] = time.time,
    ) -> None:
        self.cell = cell
        self.live: Callable[[NDArray[np.float64], Samples], None] | None = None
        self._connect = connect
        self._chunk_s, self._stale_s = chunk_s, stale_s
        self._monotonic, self._wall = clock, wall
        self._out: queue.Queue[Record] = queue.Queue(waiting)
        self._done = threading.Event()
        self._unsaid: list[StreamEvent] = []
        self._halt = threading.Event()
        self._thread = threading.Thread(target=self._run, name="acquisition", daemon=True)
        self._failure: Exception | None = None
        self._began_s = self._from_s = 0.0
        self._clock = SampleClock(cell.rate_hz, held_back=cell.held_back)
        self._next_seq = 0
        self._lost_samples = self._lost_bytes = 0
        # Of this connection: what came while it was started, and whether anything has made a sample.
        self._heard: list[tuple[bytes, float]] = []
        self._understood = False
        self._since_s: float | None = None
        self._got = 0
        self._said_undecoded_s = -SAID_AGAIN_S
        self._overloaded = False
        self._gaps = StreamGaps()

    def go_on_from(self, first_seq: int, last_s: float, from_s: float) -> None:
        """Number samples and tell time as of a stream that broke off; before `start`.

        Args:
            first_seq: number of the next sample.
            last_s: time of the last one [s].
            from_s: time when `start` is called, later than that [s].
        """
        self._next_seq, self._from_s = first_seq, from_s
        self._clock = SampleClock(self.cell.rate_hz, last_s, self.cell.held_back)
        self._gaps.go_on_from(last_s)

    def start(self) -> None:
        """Connect, make the device stream, and read on in the background.

        Raises:
            DriverError: the device cannot be reached or is another; nothing has started then.
        """
        self._began_s = self._monotonic()
        self._first = self._open()
        self._thread.start()

    def stop(self) -> None:
        """Stop the device and the thread; what was read can still be taken."""
        self._halt.set()
        if self._thread.is_alive():
            self._thread.join(timeout=10.0)

    def records(self) -> Iterator[Record]:
        """Yield what is handed on until the stream ends.

        Raises:
            Exception: what ended the sampling thread: a device that says, after a reconnection, that it is another.
        """
        while True:
            over = self._done.is_set()
            try:
                yield self._out.get(timeout=0.0 if over else 0.1)
            except queue.Empty:
                if not over:
                    continue
                # What found no room is said last.
                last = [*self._overrun(), *self._unsaid]
                if last:
                    yield Record(None, tuple(last))
                if self._failure is not None:
                    raise self._failure from None
                return

    def _open(self) -> Transport:
        transport = self._connect()
        listening = Listening(transport, self._now)
        try:
            self.cell.start(listening)
        except (DriverError, LinkLostError) as error:
            transport.close()
            if isinstance(error, LinkLostError):
                raise DriverError(f"the device went away at once ({error})", "a load cell that stays") from error
            raise
        self._heard, self._understood = listening.heard, False
        self._since_s, self._got = None, 0
        return transport

    def _now(self) -> float:
        return self._monotonic() - self._began_s + self._from_s

    def _event(self, kind: Kind, **value: Any) -> StreamEvent:
        return StreamEvent(kind, self._now(), self._wall(), value)

    def _run(self) -> None:
        transport: Transport | None = self._first
        self._hand_on(None, [self._event("started", driver=self.cell.name, clock=self.cell.clock)])
        try:
            while transport is not None and not self._halt.is_set():
                why = self._read_on(transport)
                if why is None:
                    break
                transport.close()
                transport = self._come_back(why)
        except Exception as error:  # raised where the readings are taken, which else would wait for ever
            self._failure = error
        finally:
            try:
                if transport is not None:
                    # What can no longer be reached needs no stopping.
                    with contextlib.suppress(LinkLostError, DriverError):
                        self.cell.stop(transport)
                    transport.close()
                ended = self._event("ended", samples=self._next_seq)
                self._hand_on(None, [*self._gap_events(self._gaps.finish()), ended])
            finally:
                self._done.set()

    def _read_on(self, transport: Transport) -> str | None:
        """Read until the device has gone (why), has nothing more (None), or a stop is asked for (None)."""
        gathered = Gathered(self._now())
        decoder, heard_s, silent = self.cell.decoder(), self._now(), False
        recorded = transport if isinstance(transport, Recorded) else None
        for data, arrived_s in self._heard:
            self._take(data, decoder, gathered, arrived_s)
        while not self._halt.is_set():
            try:
                data = transport.read(min(READ_S, self._chunk_s))
            except LinkLostError as error:
                self._close_chunk(gathered)
                return str(error)
            except (EOFError, InputError) as error:
                # Of a recording that cannot be read on, what was read is kept.
                self._close_chunk(gathered)
                self._failure = error if isinstance(error, InputError) else None
                return None
            now = self._now()
            if data:
                if self.cell.link == "serial" and now - heard_s > LOST_S:
                    data, now = self._with_rest(transport, data), self._now()
                heard_s = now
                if silent:
                    gathered.events.append(self._event("stale", ended=True))
                    silent = False
                self._take(data, decoder, gathered, now if recorded is None else recorded.arrival_s + self._from_s)
            elif self.cell.link != "file" and now - heard_s > GIVEN_UP_S + self._stale_s:
                self._close_chunk(gathered)
                return f"nothing has come for {now - heard_s:.1f} s"
            elif now - heard_s > self._stale_s and not silent:
                gathered.events.append(self._event("stale", silent_s=round(now - heard_s, 3)))
                silent = True
            if now - gathered.since_s >= self._chunk_s:
                # Bytes that have made no sample yet wait for one a while.
                if gathered.samples or gathered.waited_s(now) >= UNDECODED_S:
                    self._close_chunk(gathered, warn=True)
                    gathered = Gathered(now)
                    self._require_rate(now, recorded)
                else:
                    self._say(gathered)
        self._close_chunk(gathered)
        return None

    def _require_rate(self, now: float, recorded: Recorded | None) -> None:
        """Refuse a device that is faster than the rate that was set: the times of its readings would run ahead."""
        passed_s = 0.0 if self._since_s is None else now - self._since_s
        # A rate that is no setting is the maker's, and a recording is read as fast as it goes.
        rate_hz = self.cell.rate_hz if "rate_hz" in self.cell.values and recorded is None else None
        if rate_hz is not None and self._got > rate_hz * max(RATE_OFF * passed_s, passed_s + WAITED_S):
            raise DriverError(
                f"{self.cell.name} sends {self._got / max(passed_s, CHUNK_S):.4g} readings a second",
                f"{rate_hz:g}, as rate_hz says",
                "Give the rate that is set at the device with --set rate_hz=RATE, and log anew",
            )

    @staticmethod
    def _with_rest(transport: Transport, data: bytes) -> bytes:
        """Return bytes that came after a silence with those behind them: a network brings them in pieces."""
        with contextlib.suppress(LinkLostError, EOFError):  # which the next read finds again
            for _ in range(REST_READS):
                data += transport.read(REST_S)
        return data

    def _take(self, data: bytes, decoder: Decoder, gathered: Gathered, now: float) -> None:
        decoded = decoder.feed(data)
        gathered.raw.append(data)
        gathered.reads.append((len(data), now))
        gathered.rejected += decoded.rejected
        gathered.skipped += decoded.skipped
        if not len(decoded):
            return
        if not self._understood:
            # Before the first record were answers and the rest of another one: no damage.
            self._understood, gathered.rejected, gathered.skipped = True, 0, 0
        self._said_undecoded_s = -SAID_AGAIN_S
        self._got += 0 if self._since_s is None else len(decoded)
        self._since_s = now if self._since_s is None else self._since_s
        if self.cell.clock == "recording" and decoded.device_s is not None:
            times = decoded.device_s + self._from_s
        else:
            times = self._clock.times(decoded, now, len(data))
        gathered.events += self._gap_events(self._gaps.counted(decoded, times, self._clock))
        if self.live is not None:
            self.live(times, decoded)
        gathered.samples.append(decoded)
        gathered.times.append(times)
        over = bool(decoded.overload[-1])
        if decoded.overload.any() and not self._overloaded:
            first = int(np.argmax(decoded.overload))
            gathered.events.append(
                StreamEvent("overload", float(times[first]), self._wall(), {"status": int(decoded.status[first])})
            )
            self._overloaded = True
        if self._overloaded and not over:
            gathered.events.append(StreamEvent("overload_ended", float(times[-1]), self._wall()))
            self._overloaded = False

    def _gap_events(self, told: list[Told]) -> list[StreamEvent]:
        """Return events of gaps."""
        return [StreamEvent("gap", at_s, self._wall(), value) for at_s, value in told]

    def _say(self, gathered: Gathered) -> None:
        """Hand on what happened, before there is a sample to hand on with it."""
        if gathered.events:
            self._hand_on(None, gathered.events)
            gathered.events = []

    def _close_chunk(self, gathered: Gathered, *, warn: bool = False) -> None:
        """Hand on what was gathered.

        Args:
            gathered: with or without samples.
            warn: whether bytes without a sample are to be said, as they waited long enough for one.
        """
        events, raw, parts = gathered.events, b"".join(gathered.raw), gathered.samples
        if not raw:
            self._say(gathered)
            return
        if parts and (gathered.rejected or gathered.skipped):
            events.append(self._event("damaged", rejected=gathered.rejected, skipped_bytes=gathered.skipped))
        if not parts:
            parts, gathered.times = [_NONE], [np.zeros(0)]
            if warn and self._now() - self._said_undecoded_s >= SAID_AGAIN_S:
                events.append(self._event("undecoded", bytes=len(raw), looks=looks_like(raw)))
                self._said_undecoded_s = self._now()
        times = np.concatenate(gathered.times)
        events += self._gap_events(self._gaps.timed(times))
        chunk = Chunk(
            self._next_seq,
            times,
            np.concatenate([p.wrench for p in parts]),
            np.concatenate([p.status for p in parts]),
            np.concatenate([p.overload for p in parts]),
            raw,
            tuple(gathered.reads),
            self._wall(),
            gathered.rejected,
            gathered.skipped,
        )
        if self._hand_on(chunk, events):
            self._next_seq = chunk.next_seq

    def _hand_on(self, chunk: Chunk | None, events: list[StreamEvent]) -> bool:
        """Put a record where it can be taken; while nobody takes, count lost samples and keep events."""
        events = [*self._unsaid, *events]
        lost = self._overrun()
        events += lost
        try:
            self._out.put_nowait(Record(chunk, tuple(events)))
        except queue.Full:
            if lost:
                events.pop()
            self._unsaid = events
            if chunk is not None:
                self._lost_samples, self._lost_bytes = (
                    self._lost_samples + len(chunk),
                    self._lost_bytes + len(chunk.raw),
                )
            return False
        self._unsaid, self._lost_samples, self._lost_bytes = [], 0, 0
        return True

    def _overrun(self) -> list[StreamEvent]:
        """Return the event of what was lost because nobody took it, where anything was."""
        if not (self._lost_samples or self._lost_bytes):
            return []
        return [self._event("overrun", lost_samples=self._lost_samples, lost_bytes=self._lost_bytes)]

    def _come_back(self, why: str) -> Transport | None:
        """Try to connect again, ever more slowly, until it works or a stop is asked for."""
        gone_s, tries = self._now(), 0
        self._hand_on(None, [self._event("disconnected", why=why)])
        while not self._halt.is_set():
            self._halt.wait(BACK_OFF_S[min(tries, len(BACK_OFF_S) - 1)])
            tries += 1
            if self._halt.is_set():
                return None
            back_s = self._now()
            try:
                transport = self._open()
            except DriverError:
                continue
            # A device that was switched off counts from the start; what it did meanwhile nobody knows.
            self._clock.restart()
            self._gaps.reconnected()
            value = {"away_s": round(self._now() - gone_s, 3), "tries": tries}
            # Before what was heard since.
            self._hand_on(None, [StreamEvent("reconnected", back_s, self._wall(), value)])
            return transport
        return None


_NONE = samples(NOTHING)
