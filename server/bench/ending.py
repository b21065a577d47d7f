"""Signals that end a log: Ctrl-C, a service manager, a closed terminal, a shutdown of the PC."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

# Windows sends SIGBREAK for Ctrl-Break and for a window that is closed, and knows no SIGHUP.
NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
ENDING = tuple(getattr(signal, name) for name in NAMES if hasattr(signal, name))


class Told:
    """Flag that is set once such a signal has come."""

    come = False


@contextmanager
def ended_by_signals(stop: Callable[[], None]) -> Iterator[Told]:
    """Let the first such signal stop something instead of breaking into what is being written; a second breaks off.

    Args:
        stop: called once, by a thread of its own: it may wait, which no handler may.
    """
    told = Told()
    if threading.current_thread() is not threading.main_thread():
        yield told
        return
    before = {n: h for n in ENDING if (h := signal.getsignal(n)) not in (None, signal.SIG_IGN)}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    def ended(number: int, frame: FrameType | None) -> None:
        told.come = True
        restore()
        threading.Thread(target=stop, daemon=True).start()

    for number in before:
        signal.signal(number, ended)
    try:
        yield told
    finally:
        restore()
