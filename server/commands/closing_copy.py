"""`fingertwin log --copy-to`: a checked copy of the journal on another disk or share, once the log has ended."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from daq.errors import InputError, JournalError
from server.console import progress, say


@contextmanager
def copied_at_end(journal: Path, folder: Path | None, quiet: bool) -> Iterator[None]:
    """Copy a journal when the block has ended, in whatever way, if it wrote anything; without a folder, do nothing.

    Args:
        journal: its file, closed when the block ends.
        folder: for the copy.
        quiet: say nothing of a copy that was made.

    Raises:
        InputError: nothing can be written into the folder (before the block), or there is no copy (after it).
    """
    if folder is None:
        yield
        return
    from daq.journal.copies import require_folder

    require_folder(folder)
    before = _written_ns(journal)
    try:
        yield
    except BaseException:
        # What ended the log is what is to be said; of the copy only where there is none.
        fault = _copied(journal, folder, quiet) if _written_ns(journal) != before else None
        if fault is not None:
            sys.stderr.write(f"fingertwin: {fault}\n")
        raise
    fault = _copied(journal, folder, quiet)
    if fault is not None:
        raise fault


def _copied(journal: Path, folder: Path, quiet: bool) -> InputError | None:
    """Write the copy; return why there is none."""
    from daq.journal.copies import write_copy

    safe = f"The log itself is whole: {journal}"
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


def _written_ns(journal: Path) -> int | None:
    return journal.stat().st_mtime_ns if journal.is_file() else None
