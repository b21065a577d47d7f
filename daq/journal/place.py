"""Places of a journal's files: SQLite goes on writing, without a word, into a file that was deleted or moved.

Windows lets nobody delete or rename a file that is open; elsewhere anybody may. Only the journal's one writer changes
the size of the file and of its write-ahead log.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from daq.journal.wal import log_file


class _Seen(NamedTuple):
    device: int
    inode: int
    size: int


class Place:
    """Places of the journal files that one connection writes.

    Args:
        path: of the journal.
    """

    def __init__(self, path: Path) -> None:
        self._files = (path, log_file(path))
        # Its size is anybody's, and told to nobody.
        self._index = path.with_name(path.name + "-shm")
        self._known: dict[Path, _Seen | None] = {}

    def note(self) -> None:
        """Remember how the files are now."""
        self._known = self._look()

    def lost(self, *, written: bool = False) -> str | None:
        """Describe the loss of a file since it was noted; None where all are as they were.

        Args:
            written: whether their writer has written since, so that their sizes may differ.
        """
        if not self._known:
            return None
        now = self._look()
        for file, before in self._known.items():
            found = now[file]
            if before is None or found == before:
                continue
            if found is None:
                other = _renamed(file, before)
                return f"{file.name} was {f'renamed to {other.name}' if other else 'deleted or moved away'}"
            if found[:2] != before[:2]:
                return f"{file.name} was replaced by another file"
            if not written:
                return f"{file.name} was overwritten"
        return None

    def _look(self) -> dict[Path, _Seen | None]:
        seen = {file: _seen(file) for file in self._files}
        index = _seen(self._index)
        return seen | {self._index: index and index._replace(size=0)}


def _seen(file: Path) -> _Seen | None:
    try:
        found = file.stat()
    except OSError:
        return None
    return _Seen(found.st_dev, found.st_ino, found.st_size)


def _renamed(file: Path, before: _Seen) -> Path | None:
    """Return the file of another name in the same folder."""
    try:
        return next((f for f in file.parent.iterdir() if (s := _seen(f)) is not None and s[:2] == before[:2]), None)
    except OSError:
        return None
