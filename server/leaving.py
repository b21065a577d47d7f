"""What Ctrl-C ends with. It imports next to nothing, to be there first."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import NoReturn

INTERRUPTED = "Interrupted; nothing that was already written is lost."
INTERRUPTED_CODE = 130


def leave() -> NoReturn:
    """End the process with that line and 130, where nothing has been begun."""
    os.write(2, f"fingertwin: {INTERRUPTED}\n".encode())
    os._exit(INTERRUPTED_CODE)


def end() -> NoReturn:
    """End the process with 130 and run nothing more: a jaxlib that was interrupted may crash by that."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # its reader has gone, or it is closed
            stream.flush()
    os._exit(INTERRUPTED_CODE)
