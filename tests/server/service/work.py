"""What workers do in tests."""

from __future__ import annotations

import os
import signal
import threading
from pathlib import Path
from typing import Any

from daq.errors import InputError
from server.service.jobs.executors import ProcessExecutor
from server.service.jobs.worker import Tell

HERE = __name__


def double(payload: Any, tell: Tell) -> dict[str, Any]:
    tell(0.5, "doubling")
    return {"value": 2 * payload["value"], "process": os.getpid()}


def refuse(payload: Any, tell: Tell) -> None:
    raise InputError("a finger of wood", "one of bone", "Look for another")


def fail(payload: Any, tell: Tell) -> None:
    raise KeyError("middle phalanx")


def leave(payload: Any, tell: Tell) -> None:
    os._exit(3)


def interrupted(payload: Any, tell: Tell) -> str:
    for number in (signal.SIGINT, signal.SIGTERM):
        os.kill(os.getpid(), number)
    return "went on"


def unsendable(payload: Any, tell: Tell) -> Any:
    return threading.Lock()


def hold(payload: Any, tell: Tell) -> None:
    """Compute for ever, once it has been told that it does."""
    tell(0.25, f"holding in {os.getpid()}")
    while True:
        pass


def in_parts(payload: Any, tell: Tell) -> dict[str, Any]:
    """Do `parts` parts, as far as they are not done; hold before the one of the number `until`."""
    made = []
    for k in range(payload["parts"]):
        if k == payload.get("until") and not Path(payload["file"]).exists():
            hold(payload, tell)
        if str(k) not in tell.parts:
            made.append(k)
            tell.part(str(k), {"square": k * k})
    total = sum(p["square"] for p in tell.parts.values()) + sum(k * k for k in made)
    return {"total": total, "made": made}


def with_helpers(payload: Any, tell: Tell) -> None:
    """Have two processes of its own compute for ever."""
    for _ in ProcessExecutor(2).map(endless, [("a", payload), ("b", payload)]):
        pass


def endless(path: str) -> None:
    with Path(path).open("a") as file:
        file.write(f"{os.getpid()}\n")
    while True:
        pass


def square(number: int) -> int:
    return number * number


def picky(number: int) -> int:
    if number == 3:
        raise InputError("a three", "another number")
    if number == 4:
        raise ValueError("four")
    if number == 5:
        os._exit(1)
    return number


def broken_warm_up() -> None:
    raise RuntimeError("no fuel")
