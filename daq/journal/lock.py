"""One writer to a journal: a small database beside it that the writer keeps locked.

It also remembers how far the journal had come, so that a journal that was put back to an earlier state, or copied, is
known when it is next written.
"""

from __future__ import annotations

import sqlite3
from pathlib import Path

from daq.errors import JournalError


class InUseError(Exception):
    """Another process holds the lock."""


def lock_file(path: Path) -> Path:
    """Return the path of a journal's lock."""
    return path.with_name(path.name + "-writer")


class WriterLock:
    """Held until it is closed, or until the process ends, in whatever way.

    Raises:
        InUseError: another writer holds it.
        JournalError: it is damaged or cannot be made.
    """

    def __init__(self, path: Path) -> None:
        # SQLite locks files on every system in the way that works there.
        file = lock_file(path)
        self._file = file
        try:
            self._connection = sqlite3.connect(file, timeout=0.0, isolation_level=None, check_same_thread=False)
        except sqlite3.Error as error:
            raise _unusable(file, error) from error
        try:
            self._connection.execute("PRAGMA locking_mode=EXCLUSIVE")
            self._connection.execute("BEGIN EXCLUSIVE")
            self._connection.execute("CREATE TABLE IF NOT EXISTS seen (epoch TEXT, rows INTEGER)")
            self._connection.execute("COMMIT")
        except BaseException as error:
            self._connection.close()
            if isinstance(error, sqlite3.Error):
                code = getattr(error, "sqlite_errorcode", 0) & 0xFF
                if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
                    raise InUseError from error
                raise _unusable(file, error) from error
            raise

    def vouches(self, epoch: str, rows: int) -> bool:
        """Return whether this journal, with so many rows, goes on from where it was last seen here."""
        seen = self._connection.execute("SELECT epoch, rows FROM seen").fetchall()
        return len(seen) == 1 and seen[0][0] == epoch and seen[0][1] <= rows

    def note(self, epoch: str, rows: int) -> None:
        """Remember how far the journal has come."""
        try:
            self._connection.execute("BEGIN IMMEDIATE")
            self._connection.execute("DELETE FROM seen")
            self._connection.execute("INSERT INTO seen VALUES (?, ?)", (epoch, rows))
            self._connection.execute("COMMIT")
        except sqlite3.Error as error:
            raise _unusable(self._file, error) from error

    def close(self) -> None:
        """Let another writer in."""
        self._connection.close()


def _unusable(file: Path, error: sqlite3.Error) -> JournalError:
    return JournalError(
        f"{file.name} cannot be used ({error})",
        "a lock beside the journal",
        "Check the folder's rights and space; delete it if it is damaged and no writer runs",
    )
