"""A line every minute that says how far the tests are, and at which: a log of a long run shows that it lives."""

from __future__ import annotations

import threading
import time

import pytest

EVERY_S = 60.0


class Progress:
    """Plugin of the process that reports, and runs no test itself: what is written during a test is captured.

    Args:
        every_s: time between two lines.
    """

    def __init__(self, every_s: float = EVERY_S) -> None:
        self._every_s = every_s
        self._began = time.monotonic()
        self._done = 0
        self._running: dict[str, float] = {}
        self._end = threading.Event()
        self._thread: threading.Thread | None = None

    def pytest_sessionstart(self, session: pytest.Session) -> None:
        self._thread = threading.Thread(target=self._tell, args=(session,), name="progress", daemon=True)
        self._thread.start()

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._running[nodeid] = time.monotonic()

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        self._running.pop(nodeid, None)
        self._done += 1

    def pytest_sessionfinish(self) -> None:
        self._end.set()
        if self._thread is not None:
            self._thread.join()

    def line(self, total: int) -> str:
        """How many tests are done, after how long, and which run, since when."""
        now = time.monotonic()
        running = ", ".join(f"{name} ({now - since:.0f} s)" for name, since in list(self._running.items()))
        return f"{(now - self._began) / 60.0:.0f} min: {self._done} of {total} tests; now {running or 'none'}"

    def _tell(self, session: pytest.Session) -> None:
        reporter = session.config.pluginmanager.get_plugin("terminalreporter")
        while reporter is not None and not self._end.wait(self._every_s):
            if session.testscollected:
                reporter.write_line("\n" + self.line(session.testscollected))
