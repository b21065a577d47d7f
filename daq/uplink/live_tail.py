"""The live path: what a load cell says now, on a screen elsewhere within 60 ms. Nothing of it is kept or sent again.

Readings become envelopes (least, most, mean and latest of some hundredths of a second), so that no peak is hidden, and
what hangs can be estimated. Where the service is slow, old envelopes are dropped and counted; the journal and its
uplink see to it that nothing is lost.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from daq.uplink.live_wire import Command, LiveSocket, LiveWire, Posts
from daq.uplink.wire import session_path

if TYPE_CHECKING:
    import httpx

Floats = NDArray[np.float64]

# A little less than a picture of a live view lasts.
WINDOW_S = 0.03
# Half a second: what is older is no longer live.
WAITING = 15
# How often a bench that can be asked for something listens while its cell is silent.
LISTEN_S = 0.05
# After a failure.
PAUSE_S = 0.25


@dataclass(eq=False)
class _Window:
    """Live readings of one stream in one window: blocks as they came, joined only when they are sent."""

    stream: str
    since_s: float
    from_s: float
    to_s: float
    blocks: list[Floats]
    overload: bool

    @property
    def latest(self) -> Floats:
        """The last reading (6,)."""
        latest: Floats = self.blocks[-1][-1]
        return latest

    def message(self) -> dict[str, Any]:
        readings = np.concatenate(self.blocks)
        # One component that is no number hides no other reading of it.
        known = np.isfinite(readings)
        numbers, total = known.sum(axis=0, dtype=float), np.where(known, readings, 0.0).sum(axis=0)
        mean = np.divide(total, numbers, out=np.full(6, np.nan), where=numbers > 0.0)
        return {
            "stream": self.stream, "from_s": self.from_s, "to_s": self.to_s, "count": len(readings),
            "latest": _numbers(self.latest), "least": _numbers(np.fmin.reduce(readings, axis=0)),
            "most": _numbers(np.fmax.reduce(readings, axis=0)), "mean": _numbers(mean), "overload": self.overload,
        }  # fmt: skip


class LiveTail:
    """Sends envelopes to `…/sessions/{id}/live`, from a thread of its own.

    Args:
        url: of the service.
        session: that is watched.
        token: for the service, where it wants one.
        client: to post with, instead of a connection of its own.
        window_s: length of an envelope [s].
        waiting: envelopes that may wait.
        clock: monotonic seconds.

    Attributes:
        sent: envelopes that the service took.
        dropped: envelopes that it never saw.
        asked: takes what the service asks of the bench, on this thread; None where nothing is to be asked.

    Raises:
        InputError: the address is none.
    """

    def __init__(
        self,
        url: str,
        session: str,
        *,
        token: str | None = None,
        client: httpx.Client | None = None,
        window_s: float = WINDOW_S,
        waiting: int = WAITING,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._wire: LiveWire
        if client is None:
            self._wire = LiveSocket(url, session, token)
        else:
            self._wire = Posts(client, f"{session_path(session)}/live")
        self._window_s, self._clock = window_s, clock
        self._open: dict[str, _Window] = {}
        self._queue: deque[_Window] = deque()
        self._waiting = waiting
        self._some = threading.Condition()
        self._halt = False
        self.sent = self.dropped = 0
        self.asked: Callable[[Command], None] | None = None
        self._bench: Mapping[str, Any] | None = None
        self._told: tuple[int, Mapping[str, Any] | None] = (0, None)
        self._answers: list[dict[str, Any]] = []
        self._thread = threading.Thread(target=self._run, name="live", daemon=True)

    def start(self) -> None:
        """Post in the background from now on."""
        self._thread.start()

    def offer(self, stream: str, t_s: Floats, wrench: Floats, overload: NDArray[np.bool_]) -> None:
        """Show some readings; waits for nothing.

        Args:
            stream: its id.
            t_s: (n,) time since the stream began [s].
            wrench: (n, 6) [N, N mm]; held for a while, so it is not to be changed.
            overload: (n,) whether the device was beyond its range.
        """
        if len(t_s) == 0:
            return
        now, over = self._clock(), bool(overload.any())
        with self._some:
            open_one = self._open.get(stream)
            if open_one is not None and now - open_one.since_s >= self._window_s:
                self._close(open_one)
                open_one = None
            if open_one is not None:
                open_one.to_s = float(t_s[-1])
                open_one.blocks.append(wrench)
                open_one.overload |= over
                return
            if not self._open:
                # The thread waits for no more than this: it knows when an open one is due.
                self._some.notify()
            self._open[stream] = _Window(stream, now, float(t_s[0]), float(t_s[-1]), [wrench], over)

    def take(self) -> list[_Window]:
        """Return the envelopes whose time is over, the oldest first; they wait no longer."""
        with self._some:
            now = self._clock()
            for window in [w for w in self._open.values() if now - w.since_s >= self._window_s]:
                self._close(window)
            out = list(self._queue)
            self._queue.clear()
        return out

    def show(self, bench: Mapping[str, Any]) -> None:
        """Show what the bench waits for; told when it changes, and to each new connection."""
        with self._some:
            self._bench = bench

    def answer(self, number: int, refused: str | None) -> None:
        """Answer a command: with why it was not carried out, or None where it was."""
        with self._some:
            self._answers.append({"number": number, "refused": refused})
            self._some.notify()

    def post(self, windows: list[_Window]) -> bool:
        """Send envelopes, once, with what the bench waits for and its answers; return whether the service took them."""
        with self._some:
            answers, self._answers = self._answers, []
            bench = self._bench
        body: dict[str, Any] = {"dropped": self.dropped, "envelopes": [w.message() for w in windows]}
        if answers:
            body["answers"] = answers
        if self._told != (self._wire.connections, bench):
            body["bench"] = bench
        taken = self._wire.send(body)
        if taken and "bench" in body:
            self._told = (self._wire.connections, bench)
        with self._some:
            self.sent += len(windows) if taken else 0
            self.dropped += 0 if taken else len(windows)
        return taken

    def stop(self) -> None:
        """Send the answers that are left, end the thread and hang up."""
        with self._some:
            self._halt = True
            self._some.notify()
        if self._thread.is_alive():
            self._thread.join(timeout=5.0)
        self._wire.close()

    def _close(self, window: _Window) -> None:
        del self._open[window.stream]
        self._queue.append(window)
        while len(self._queue) > self._waiting:
            self._queue.popleft()
            self.dropped += 1

    def _run(self) -> None:
        pause_s = 0.0
        while True:
            with self._some:
                if not self._halt:
                    self._some.wait(self._rest_s(pause_s))
                halt = self._halt
            if halt and not self._news():
                return
            # What a command led to is told even where it was the end of the bench.
            windows = self.take()
            try:
                if windows or self._news():
                    pause_s = 0.0 if self.post(windows) else PAUSE_S
                if halt:
                    return
                for command in self._wire.heard():
                    if self.asked is not None:
                        self.asked(command)
            except RuntimeError:  # hung up meanwhile
                return

    def _news(self) -> bool:
        """Return whether there is something to tell beside envelopes."""
        return bool(self._answers) or (self.asked is not None and self._told != (self._wire.connections, self._bench))

    def _rest_s(self, pause_s: float) -> float | None:
        """Return the time for which nothing has to be done [s]; None until something is offered."""
        if pause_s:
            return pause_s
        if self._queue:
            return 0.0
        due_s = max(min((w.since_s for w in self._open.values()), default=0.0) + self._window_s - self._clock(), 0.0)
        if self.asked is None:
            return due_s if self._open else None
        return min(due_s, LISTEN_S) if self._open else LISTEN_S


def _numbers(values: Floats) -> list[float | None]:
    return [float(v) if np.isfinite(v) else None for v in values]
