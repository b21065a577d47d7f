"""A database's file that appears whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import uuid4

# What stands beside a database's file while it is in use.
BESIDE = ("-wal", "-shm", "-journal")


@contextmanager
def beside(target: Path) -> Iterator[Path]:
    """Yield a temporary name in the folder of a file; a file left under it is removed afterwards."""
    temporary = target.with_name(f".{uuid4().hex[:12]}.{target.name}")
    try:
        yield temporary
    finally:
        for ending in ("", *BESIDE):
            with suppress(OSError):
                temporary.with_name(temporary.name + ending).unlink()


def settle(folder: Path) -> None:
    """Have the folder itself written, where the system can do that."""
    if os.name == "posix":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
