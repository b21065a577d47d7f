"""One at a time for each name: whoever asks for what is being computed already waits for it."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from typing import Generic, TypeVar
from weakref import WeakValueDictionary

T = TypeVar("T")


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


class Made(Generic[T]):
    """Cache of results by their inputs; callers of a result that is being made wait for it.

    Args:
        most: so many are kept.
    """

    def __init__(self, most: int) -> None:
        self._most, self._turns, self._lock = most, Turns(), threading.Lock()
        self._known: OrderedDict[Hashable, T] = OrderedDict()

    def of(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return the cached result of a key, or make it; nothing is kept where that fails."""
        with self._turns.of(key):
            with self._lock:
                if key in self._known:
                    self._known.move_to_end(key)
                    return self._known[key]
            made = make()
            with self._lock:
                self._known[key] = made
                while len(self._known) > self._most:
                    self._known.popitem(last=False)
        return made
