"""Files that only their owner reads: what a specimen's readings and a service's tokens are kept in."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import wraps
from pathlib import Path
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

# Whatever the user's own mask: nothing for the group, nothing for others. Windows keeps a user's folders to that user.
_MASK = 0o077


@contextmanager
def private() -> Iterator[None]:
    """Make files for their owner alone (0600, folders 0700) while the block runs."""
    before = os.umask(_MASK)
    try:
        yield
    finally:
        os.umask(before)


def privately(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function make files for their owner alone."""

    @wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> R:
        with private():
            return function(*args, **kwargs)

    return called


def close_to_others(folder: Path) -> None:
    """Take a folder's rights from everybody but its owner, where the system has such rights and lets us."""
    with suppress(OSError):
        folder.chmod(0o700)
