"""A journal written anew, through the connection that still holds what its name no longer leads to."""

from __future__ import annotations

import itertools
import sqlite3
from collections.abc import Iterable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

from daq.files import replacing
from daq.journal.lock import lock_file
from daq.journal.rows import INSERT_EVENT, INSERT_STREAM, Event, event_row
from daq.journal.salvage import Salvage
from daq.journal.wal import log_file

_DESCRIBE = f"{INSERT_STREAM} ON CONFLICT (id) DO UPDATE SET " + ", ".join(
    f"{name} = excluded.{name}" for name in ("driver", "settings", "cell", "started_utc", "clock", "crc")
)
_NEXT = "SELECT ifnull(max(first_seq + n), 0) FROM chunks WHERE stream = ?"


def free_beside(path: Path) -> Path:
    """Return a free name like a journal's, which no journal has or had."""
    names = (path.with_name(f"{path.stem}-{number}{path.suffix}") for number in itertools.count(2))
    return next(n for n in names if not any(f.exists() for f in (n, log_file(n), lock_file(n))))


def write_anew(
    connection: sqlite3.Connection,
    path: Path,
    target: Path,
    streams: Iterable[tuple[Any, ...]],
    ends: Mapping[str, int | None],
) -> tuple[str | None, int]:
    """Write all that a connection can still read into a new journal; what it cannot read is an event `lost` there.

    Args:
        connection: to the journal.
        path: that the journal had.
        target: of the new one.
        streams: rows of the streams that are being written.
        ends: number of each one's next sample, None where it has ended.

    Returns:
        The epoch, that of the journal where nothing is lost, None where something is; and the number of samples.

    Raises:
        sqlite3.Error: it cannot be written.
        OSError: it cannot be written.
    """
    with replacing(target) as temporary, closing(sqlite3.connect(temporary, isolation_level=None)) as new:
        report = Salvage(connection, path, []).into(new)
        new.execute("BEGIN IMMEDIATE")
        new.executemany(_DESCRIBE, streams)
        whole = not report.faults
        for stream, end in ends.items():
            (kept,) = new.execute(_NEXT, (stream,)).fetchone()
            if end is not None and kept < end:
                whole = False
                value = {"first_seq": kept, "n": end - kept, "reason": f"{path.name} was not there any more"}
                new.execute(INSERT_EVENT, event_row(Event("lost", 0.0, value, stream)))
        if whole:
            # The service goes on with what it knows under this name.
            new.execute("UPDATE meta SET value = ? WHERE key = 'epoch'", (report.epoch,))
        new.execute("COMMIT")
    return report.epoch if whole else None, sum(report.samples.values())
