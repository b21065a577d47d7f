"""Ctrl-C where Python would drop it, and where it cannot be raised at once."""

from __future__ import annotations

import _thread
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from server.leaving import leave

# When an interrupt comes again [s]: by then a callback has ended, however busy the machine is.
_AGAIN_S = 0.2


def _importing(frame: FrameType) -> bool:
    """Return whether a frame is that of an import: an interrupt that is raised within one may crash jaxlib."""
    return frame.f_code.co_name == "_find_and_load" and frame.f_code.co_filename == "<frozen importlib._bootstrap>"


def _beginning(importing: FrameType) -> bool:
    """Return whether an import is that of a command's own module, before the command has done anything."""
    by = importing.f_back
    return by is not None and str(by.f_globals.get("__name__")).startswith("server.cli")


@contextmanager
def lost_interrupts_repeated() -> Iterator[None]:
    """Repeat an interrupt where it cannot be raised at once.

    Python drops it within a callback, such as JAX's of the garbage collector. An import is to end first. While a
    command is still being imported, the process ends at once.
    """
    before, handled = sys.unraisablehook, signal.getsignal(signal.SIGINT)
    waiting: list[threading.Timer] = []

    def interrupt_later() -> None:
        again = threading.Timer(_AGAIN_S, _thread.interrupt_main)
        again.daemon = True
        waiting.append(again)
        again.start()

    def dropped(what: sys.UnraisableHookArgs) -> None:
        if issubclass(what.exc_type, KeyboardInterrupt):
            interrupt_later()
        else:
            before(what)

    def interrupted(number: int, frame: FrameType | None) -> None:
        at, later = frame, False
        while at is not None:
            imports = _importing(at)
            if imports and _beginning(at):
                leave()
            later = later or imports or at.f_code is dropped.__code__
            at = at.f_back
        if later:
            interrupt_later()
        elif callable(handled):
            handled(number, frame)

    takes_part = callable(handled) and threading.current_thread() is threading.main_thread()
    sys.unraisablehook = dropped
    if takes_part:
        signal.signal(signal.SIGINT, interrupted)
    try:
        yield
    finally:
        for again in waiting:
            again.cancel()
        sys.unraisablehook = before
        if takes_part and signal.getsignal(signal.SIGINT) is interrupted:
            signal.signal(signal.SIGINT, handled)
