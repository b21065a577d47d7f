"""Space that a purge can use on a full disk: it writes down first what it removes."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

# What SQLite logs before it moves it into its file (4 MB), and the same again in that file.
RESERVE_BYTES = 8 << 20
FILE = "purge-reserve"
# On a disk with less than this left, it is needed by the benches.
_PLENTY = 8 * RESERVE_BYTES


def occupy(folder: Path) -> None:
    """Write the reserve into a folder where it is absent and its disk has plenty of space."""
    file = folder / FILE
    try:
        if not file.exists() and shutil.disk_usage(folder).free >= _PLENTY:
            # Random, since a disk that compresses keeps no space for zeros.
            file.write_bytes(os.urandom(RESERVE_BYTES))
    except OSError:
        with suppress(OSError):
            file.unlink(missing_ok=True)


@contextmanager
def released(folder: Path) -> Iterator[None]:
    """Give a folder's reserve to the disk while the block runs; where there is none, none is made."""
    file = folder / FILE
    had = file.exists()
    with suppress(OSError):
        file.unlink(missing_ok=True)
    try:
        yield
    finally:
        if had:
            occupy(folder)
