"""A closing copy of a journal, on another disk or share, read back before it has its name."""

from __future__ import annotations

import datetime as dt
import shutil
import tempfile
from pathlib import Path

from daq.errors import InputError, JournalError
from daq.journal.check import check
from daq.journal.reader import JournalReader
from daq.journal.rows import disk_full


def require_folder(folder: Path) -> None:
    """Find out before the readings are taken whether a copy can go there.

    A folder that is absent is not made: where a share is not mounted it would be one of this disk.

    Raises:
        InputError: there is no such folder, or nothing can be written into it.
    """
    if not folder.is_dir():
        raise InputError(
            f"there is no folder {folder} for the copy", "one that exists, on another disk", "Is it mounted?"
        )
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(
            f"nothing can be written into {folder} ({error.strerror})", "a folder for the copy", "Check its rights"
        ) from error


def write_copy(journal: Path, folder: Path, now: dt.datetime | None = None) -> Path:
    """Write a compact copy of a journal that nobody writes, check all of it, and then give it its name.

    Args:
        journal: its file.
        folder: that the copy goes to; it must be there.
        now: in its name, with the name of the journal's folder; by default the time that it is.

    Returns:
        The copy's file.

    Raises:
        JournalError: it exists, cannot be written, or does not hold what the journal does; nothing is left of it then.
    """
    stamp = (now or dt.datetime.now(dt.UTC)).strftime("%Y%m%dT%H%M%SZ")
    target = folder / f"{journal.resolve().parent.name}-{stamp}{journal.suffix}"
    if not folder.is_dir():
        raise JournalError(f"the folder {folder} has gone", "the folder for the copy", "Is the share still there?")
    with JournalReader.open(journal) as source:
        if shutil.disk_usage(folder).free < journal.stat().st_size:
            raise disk_full(target)
        counts = source.counts()

        def proof(copy: Path) -> None:
            report = check(copy)
            found = (sum(report.chunks.values()), sum(report.samples.values()), report.events)
            if report.faults or found != counts:
                what = report.faults[0].text if report.faults else f"{found} chunks, samples and events for {counts}"
                raise JournalError(f"the copy is not as the journal ({what})", "the same", f"Check {journal.name}")

        source.copy_to(target, proof)
    return target
