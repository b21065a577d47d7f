"""`fingertwin log --copy-to`: a checked copy of the journal on another disk or share, once the log has ended."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from daq.errors import InputError, JournalError
from daq.journal.copies import require_folder, write_copy
from server.commands.console import progress, say


@dataclass
class Closed:
    """A journal that was written and closed."""

    path: Path | None = None  # of its file, None where there is none
    displaced: JournalError | None = None  # what became of the file that it began in, None where that is this one
    # What an earlier log had written into it and was gone when this one began, None where nothing was.
    lost: JournalError | None = None


@contextmanager
def copied_at_end(folder: Path | None, quiet: bool) -> Iterator[Closed]:
    """Copy the journal that the block closed when it has ended, in whatever way; without a folder, make no copy.

    Args:
        folder: for the copy.
        quiet: say nothing of a copy that was made.

    Yields:
        What takes the journal that was closed.

    Raises:
        InputError: nothing can be written into the folder (before the block), or there is no copy, or the journal is
            not where it was begun or lacks what it once held (after it).
    """
    if folder is not None:
        require_folder(folder)
    closed = Closed()
    try:
        yield closed
    except BaseException:
        # What ended the log is what is to be said; beside it only what went wrong as well.
        for fault in _faults(closed, folder, quiet):
            sys.stderr.write(f"fingertwin: {fault}\n")
        raise
    faults = _faults(closed, folder, quiet)
    for fault in faults[:-1]:
        sys.stderr.write(f"fingertwin: {fault}\n")
    if faults:
        raise faults[-1]


def _faults(closed: Closed, folder: Path | None, quiet: bool) -> list[InputError]:
    """Write the copy, where one is asked for; return what is not as it should be."""
    copied = None if folder is None or closed.path is None else _copied(closed.path, folder, quiet)
    return [fault for fault in (closed.displaced, closed.lost, copied) if fault is not None]


def _copied(journal: Path, folder: Path, quiet: bool) -> InputError | None:
    """Write the copy; return why there is none."""
    safe = f"The log itself is whole: {journal}" if journal.is_file() else f"The log has gone too: {journal}"
    try:
        with progress("Copying and checking"):
            copy = write_copy(journal, folder)
    except KeyboardInterrupt:
        return InputError(f"no closing copy in {folder}: it was broken off", "", safe)
    except JournalError as error:
        return InputError(f"no closing copy in {folder}: {error.found}", error.expected, safe)
    if not quiet:
        say(f"Copy, read back: {copy}")
    return None
