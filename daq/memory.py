"""Memory of a process that runs for days: what it has freed goes back to the system."""

from __future__ import annotations

import sys

# Of mallopt(3): parameters of glibc's allocator.
_MMAP_THRESHOLD, _ARENA_MAX = -3, -8
# Larger blocks are of the system's own pages, and leave no holes when they are freed.
LARGE_BYTES = 64 << 10


def keep_flat() -> bool:
    """Let glibc neither keep a pool for every thread nor raise the size from which blocks are given back at once.

    By default both grow with the largest blocks that were ever freed; a logger whose chunks come and go in several
    threads grows with them, by some MB an hour. Other allocators are left as they are.

    Returns:
        whether the allocator took it.
    """
    if not sys.platform.startswith("linux"):
        return False
    import ctypes

    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return False
    return bool(mallopt(_MMAP_THRESHOLD, LARGE_BYTES)) and bool(mallopt(_ARENA_MAX, 2))
