"""The one connection that writes a journal: how it is opened, how it writes, and how it is left."""

from __future__ import annotations

import json
import os
import socket
import sqlite3
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from daq.errors import JournalError
from daq.journal.lock import InUseError, WriterLock
from daq.journal.mark import MarkWriter, read_mark
from daq.journal.place import Place
from daq.journal.reader import JournalReader
from daq.journal.rows import INSERT_EVENT, ROWS, SAMPLES, UNDECODED, Event, event_row, now_utc, said
from daq.journal.successor import free_beside, write_anew

# Of the write-ahead log, before it is emptied: 4 MiB, some seconds of the fastest load cell.
_LOG_PAGES = 256
_WRITER = "writer"


@dataclass(frozen=True)
class Pending:
    """A chunk that waits to be sent."""

    stream: str
    first_seq: int
    n: int
    sha256: str
    tries: int
    payload: bytes


class Writer(JournalReader):
    """A journal that this process alone may write.

    Attributes:
        alarms: codes and words for whoever looks on: the files are no longer where they were, or a service takes none.
        displaced: what has become of them, and where everything is now; None where nothing has.
        lost: what was committed and was missing when it was opened; None where nothing was.
    """

    def __init__(self, connection: sqlite3.Connection, path: Path, lock: WriterLock) -> None:
        super().__init__(connection, path)
        self._writer_lock = lock
        self._within = False
        self._marks = MarkWriter(path)
        self._marked_epoch, self._marked_samples, self._counted = "", 0, 0
        self._place = Place(path)
        # Of the streams that are written: their rows, and where each goes on, None once an empty chunk has ended it.
        self._described: dict[str, tuple[Any, ...]] = {}
        self._ends: dict[str, int | None] = {}
        self.alarms: SimpleQueue[tuple[str, str]] = SimpleQueue()
        self.displaced: JournalError | None = None
        self.lost: JournalError | None = None

    def settle(self) -> None:
        """Note who writes, and take a new epoch unless this is the journal that was last written here."""
        rows, mark = self.rows(), read_mark(self.path)
        self._marked_samples = int(self._rows(SAMPLES)[0][0])
        missing = None if mark is None else mark.missing(self.epoch, rows, self._marked_samples)
        if missing is not None:
            remedy = f"{self.path} goes on without them, and says so in an event"
            self.lost = JournalError(f"{self.path.name}: {missing}", "a journal with all its readings", remedy)
        with self.transaction() as connection:
            if missing is not None or not self._writer_lock.vouches(self.epoch, rows):
                connection.execute("UPDATE meta SET value = ? WHERE key = 'epoch'", (uuid.uuid4().hex,))
            writer = json.dumps({"pid": os.getpid(), "host": socket.gethostname(), "since": now_utc()})
            connection.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (_WRITER, writer))
            if missing is not None:
                connection.execute(INSERT_EVENT, event_row(Event("warning", 0.0, {"code": "lost", "text": missing})))
            if self.displaced is not None:
                value = {"code": "displaced", "text": str(self.displaced)}
                connection.execute(INSERT_EVENT, event_row(Event("warning", 0.0, value)))
        self._writer_lock.note(self.epoch, rows)
        self._marked_epoch = self.epoch
        self._marks.note(self._marked_epoch, self.rows(), self._marked_samples)

    def counted(self, samples: int) -> None:
        """Count the samples of a chunk that this transaction keeps."""
        self._counted += samples

    def rows(self) -> int:
        """Return rows that were ever written: they are never deleted."""
        return int(self._rows(ROWS)[0][0])

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """Write all changes or none, on the disk at the end; a nested one in the same thread joins it."""
        with self._lock:
            if self._within:
                yield self._connection
                return
            self.stay()
            connection = self._connection
            self._within, self._counted = True, 0
            try:
                connection.execute("BEGIN IMMEDIATE")
                yield connection
                connection.execute("COMMIT")
                self._marked_samples += self._counted
                if self._marked_epoch:
                    self._marks.note(self._marked_epoch, self.rows(), self._marked_samples)
            except BaseException as error:
                with suppress(sqlite3.Error):
                    if connection.in_transaction:
                        connection.execute("ROLLBACK")
                if self._place.lost(written=True) is None:
                    self._place.note()  # part of it may have been written
                if isinstance(error, sqlite3.ProgrammingError):
                    raise JournalError(f"{self.path.name} is closed", "an open journal") from error
                if isinstance(error, sqlite3.Error):
                    raise said(error, self.path) from error
                raise
            finally:
                self._within = False
            # What went into a file that is not there is acknowledged only once it is in another.
            self.stay(written=True)

    def stay(self, *, written: bool = False) -> None:
        """Go on in a new file beside, with all that is kept, where the journal's files are not where they were.

        Args:
            written: whether the journal was written since it was last looked.

        Raises:
            JournalError: there can be no such file, as on a full disk.
        """
        with self._lock:
            if self._within:
                return  # looked for when that transaction has ended
            why = self._place.lost(written=written)
            if why is not None:
                self._go_on_beside(why)
            elif written:
                self._place.note()

    def _go_on_beside(self, why: str) -> None:
        target, old, before = free_beside(self.path), self._connection, self._marked_samples
        self.alarms.put(("displaced", f"{why} while it was written: all goes to {target} from here on"))
        lock: WriterLock | None = None
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            lock = locked(target)
            epoch, kept = write_anew(old, self.path, target, self._described.values(), self._ends)
            if epoch is not None:
                lock.note(epoch, 0)
            self._connection = connect_write(target)
        except (sqlite3.Error, OSError, JournalError) as error:
            if lock is not None:
                lock.close()
            raise JournalError(
                f"{why} while it was written, and {target} cannot be written instead ({error})", "a disk with room"
            ) from error
        with suppress(sqlite3.Error):
            # Whoever has the file under another name has it whole, without its log.
            old.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        old.close()
        self._marks.close()
        self._writer_lock.close()
        self.path, self._writer_lock, self._marks, self._place = target, lock, MarkWriter(target), Place(target)
        self._marked_epoch = ""
        many = f"All {kept}" if kept >= before else f"{kept} of {before}"
        self.displaced = JournalError(
            f"{why} while it was written",
            "a journal that is left alone until its log has ended",
            f"{many} readings from before, and all since, are in {target}",
        )
        self.settle()

    def leave(self) -> None:
        """Close, and let others write."""
        try:
            with suppress(sqlite3.Error, JournalError):  # closed already, or no space: both lose nothing
                self._connection.execute("DELETE FROM meta WHERE key = ?", (_WRITER,))
                self._writer_lock.note(self.epoch, self.rows())
        finally:
            self._connection.close()
            self._marks.close()
            self._writer_lock.close()
            self._place = Place(self.path)  # what becomes of the files now is nobody's loss


def locked(path: Path) -> WriterLock:
    """Become the writer of a journal.

    Raises:
        JournalError: another process is.
    """
    try:
        return WriterLock(path)
    except InUseError:
        who = "another process"
        with suppress(JournalError), JournalReader.open(path) as reader:
            writer = json.loads(reader.meta(_WRITER) or "{}")
            if writer:
                who = f"process {writer['pid']} on {writer['host']} since {writer['since']}"
        raise JournalError(f"{path.name} is being written by {who}", "one writer", "Stop that one first") from None


def connect_write(path: Path) -> sqlite3.Connection:
    """Connect so that a commit is on the disk when it returns.

    Raises:
        JournalError: there can be no write-ahead log.
    """
    address = path.resolve().as_uri() + "?mode=rw"
    connection = sqlite3.connect(address, uri=True, timeout=5.0, isolation_level=None, check_same_thread=False)
    try:
        for pragma in (
            "trusted_schema=OFF", "foreign_keys=ON", "synchronous=FULL", "fullfsync=ON", "checkpoint_fullfsync=ON",
            f"wal_autocheckpoint={_LOG_PAGES}", f"journal_size_limit={64 << 20}",
        ):  # fmt: skip
            connection.execute(f"PRAGMA {pragma}")
        if connection.execute("PRAGMA journal_mode=WAL").fetchone()[0] != "wal":
            raise JournalError(f"{path.name} cannot keep a write-ahead log", "a local disk", "Move it to one")
        # What the log holds may never have reached the disk, where a sync failed before: it is written once more.
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        connection.execute(f"CREATE {UNDECODED}")
    except BaseException:
        connection.close()
        raise
    return connection
