"""The live path: what a load cell says now, on a screen elsewhere within 60 ms. Nothing of it is kept or sent again.

Readings become envelopes (least, most, mean and latest of some hundredths of a second), so that no peak is hidden, and
what hangs can be estimated. Where the service is slow, old envelopes are dropped and counted; the journal and its
uplink see to it that nothing is lost.
"""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from daq.uplink.link import open_client
from daq.uplink.wire import session_path

if TYPE_CHECKING:
    import httpx

Floats = NDArray[np.float64]

WINDOW_S = 0.02
# Half a second: what is older is no longer live.
WAITING = 25
TIMEOUT_S = 0.5
# After a failure.
PAUSE_S = 0.25


@dataclass(eq=False)
class _Window:
    """What one stream said in one window."""

    stream: str
    since_s: float
    from_s: float
    to_s: float
    count: int
    latest: Floats
    least: Floats
    most: Floats
    # Of the components that are numbers, and how many are.
    total: Floats
    numbers: Floats
    overload: bool

    def message(self) -> dict[str, Any]:
        mean = np.divide(self.total, self.numbers, out=np.full(6, np.nan), where=self.numbers > 0.0)
        return {
            "stream": self.stream, "from_s": self.from_s, "to_s": self.to_s, "count": self.count,
            "latest": _numbers(self.latest), "least": _numbers(self.least), "most": _numbers(self.most),
            "mean": _numbers(mean), "overload": self.overload,
        }  # fmt: skip


class LiveTail:
    """Posts envelopes to `…/sessions/{id}/live`, from a thread of its own.

    Args:
        url: of the service.
        session: that is watched.
        token: for the service, where it wants one.
        client: to be used instead of one of its own.
        window_s: length of an envelope [s].
        waiting: envelopes that may wait.
        clock: monotonic seconds.

    Attributes:
        sent: envelopes that the service took.
        dropped: envelopes that it never saw.

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
        self._client = client or open_client(url, token, TIMEOUT_S)
        self._path = f"{session_path(session)}/live"
        self._window_s, self._clock = window_s, clock
        self._open: dict[str, _Window] = {}
        self._queue: deque[_Window] = deque()
        self._waiting = waiting
        self._some = threading.Condition()
        self._halt = False
        self.sent = self.dropped = 0
        self._thread = threading.Thread(target=self._run, name="live", daemon=True)

    def start(self) -> None:
        """Post in the background from now on."""
        self._thread.start()

    def offer(self, stream: str, t_s: Floats, wrench: Floats, overload: NDArray[np.bool_]) -> None:
        """Show some readings; waits for nothing.

        Args:
            stream: its id.
            t_s: (n,) time since the stream began [s].
            wrench: (n, 6) [N, N mm].
            overload: (n,) whether the device was beyond its range.
        """
        if len(t_s) == 0:
            return
        now = self._clock()
        # One component that is no number hides no other reading of it.
        least, most = np.fmin.reduce(wrench, axis=0), np.fmax.reduce(wrench, axis=0)
        known = np.isfinite(wrench)
        total, numbers = np.where(known, wrench, 0.0).sum(axis=0), known.sum(axis=0, dtype=float)
        times = (float(t_s[0]), float(t_s[-1]), len(t_s))
        new = _Window(stream, now, *times, wrench[-1].copy(), least, most, total, numbers, bool(overload.any()))
        with self._some:
            open_one = self._open.get(stream)
            if open_one is not None and now - open_one.since_s >= self._window_s:
                self._close(open_one)
                open_one = None
            if open_one is None:
                self._open[stream] = new
            else:
                _merge(open_one, new)
            self._some.notify()

    def take(self) -> list[_Window]:
        """Return the envelopes whose time is over, the oldest first; they wait no longer."""
        with self._some:
            now = self._clock()
            for window in [w for w in self._open.values() if now - w.since_s >= self._window_s]:
                self._close(window)
            out = list(self._queue)
            self._queue.clear()
        return out

    def post(self, windows: list[_Window]) -> bool:
        """Send envelopes, once; return whether the service took them."""
        import httpx

        body = {"dropped": self.dropped, "envelopes": [w.message() for w in windows]}
        headers = {"Content-Type": "application/json"}
        try:
            taken = self._client.post(self._path, content=json.dumps(body), headers=headers).is_success
        except (httpx.HTTPError, OSError):
            taken = False
        with self._some:
            self.sent += len(windows) if taken else 0
            self.dropped += 0 if taken else len(windows)
        return taken

    def stop(self) -> None:
        """End the thread and hang up."""
        with self._some:
            self._halt = True
            self._some.notify()
        if self._thread.is_alive():
            self._thread.join(timeout=5.0)
        self._client.close()

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
                if not self._halt and not self._open and not self._queue:
                    self._some.wait()
                if not self._halt:
                    self._some.wait_for(lambda: self._halt, pause_s or self._due_s())
                if self._halt:
                    return
            windows = self.take()
            if windows:
                try:
                    pause_s = 0.0 if self.post(windows) else PAUSE_S
                except RuntimeError:  # hung up meanwhile
                    return

    def _due_s(self) -> float:
        """How long until an envelope's time is over [s]."""
        if self._queue:
            return 0.0
        return max(min((w.since_s for w in self._open.values()), default=0.0) + self._window_s - self._clock(), 0.0)


def _merge(window: _Window, new: _Window) -> None:
    window.to_s, window.latest = new.to_s, new.latest
    window.count += new.count
    window.least, window.most = np.fmin(window.least, new.least), np.fmax(window.most, new.most)
    window.total, window.numbers = window.total + new.total, window.numbers + new.numbers
    window.overload |= new.overload


def _numbers(values: Floats) -> list[float | None]:
    return [float(v) if np.isfinite(v) else None for v in values]
