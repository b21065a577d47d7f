"""Orders for worker processes, and their outcomes."""

from __future__ import annotations

import logging
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from daq.errors import InputError

_log = logging.getLogger(__name__)

Ending = Literal["done", "refused", "failed", "died", "timed_out", "cancelled", "stopped"]


@dataclass(frozen=True)
class Outcome:
    """Outcome of an order."""

    # Done; refused (bad input), failed (an exception), died (the worker), timed_out, cancelled, or stopped (the
    # supervisor was closed).
    ending: Ending
    result: Any = None  # of the function, where it is done
    found: str = ""  # what was wrong, in one line; expected and remedy where they are known
    expected: str = ""
    remedy: str = ""
    trace: str = ""  # of a failure, for the log

    @classmethod
    def of_error(cls, error: BaseException) -> Outcome:
        """Return the outcome for an exception that is being handled."""
        if isinstance(error, InputError):
            return cls("refused", found=error.found, expected=error.expected, remedy=error.remedy)
        return cls("failed", found=said_of(error), trace=traceback.format_exc())


def said_of(error: BaseException) -> str:
    """Return type and message of an exception, in one line."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


class Watcher(Protocol):
    """Is told what becomes of an order, in a thread of the supervisor's."""

    def started(self) -> tuple[Any, Mapping[str, Any]]:
        """Mark an order as taken up; return its payload, and the parts that are finished already."""

    def progressed(self, fraction: float, stage: str) -> None:
        """Note the share that is done."""

    def part(self, key: str, result: Any) -> None:
        """Keep a finished part."""

    def ended(self, outcome: Outcome) -> None:
        """Note the end of an order; called once for each."""


@dataclass(frozen=True, eq=False)
class Order:
    """Task for a worker."""

    id: str  # under which it can be cancelled
    function: str  # dotted name; called with payload and `Tell`
    watcher: Watcher  # gives the payload and is told what happens
    timeout_s: float | None = None  # after which its worker is killed; None waits for ever

    def tell(self, call: Callable[[], None]) -> None:
        """Tell the watcher; what goes wrong there must not end the thread that tells."""
        try:
            call()
        except Exception:
            _log.exception("job %s: what became of it could not be kept", self.id)
