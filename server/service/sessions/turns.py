"""One at a time for each name: whoever asks for what is being computed already waits for it."""

from __future__ import annotations

import threading
from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from weakref import WeakValueDictionary


class Turns:
    """Locks by name, which are gone when nobody holds or awaits them."""

    def __init__(self) -> None:
        self._locks: WeakValueDictionary[Hashable, threading.Lock] = WeakValueDictionary()
        self._guard = threading.Lock()

    @contextmanager
    def of(self, name: Hashable) -> Iterator[None]:
        """Hold the turn of a name."""
        with self._guard:
            lock = self._locks.get(name)
            if lock is None:
                self._locks[name] = lock = threading.Lock()
        with lock:
            yield
