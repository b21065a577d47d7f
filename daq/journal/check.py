"""Checking a journal, and recovering what is sound of a damaged one; what is lost is listed, never made up."""

from __future__ import annotations

import json
import shutil
import sqlite3
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from daq.errors import JournalError
from daq.files import replacing
from daq.journal.lock import InUseError, WriterLock, lock_file
from daq.journal.mark import Mark, read_mark
from daq.journal.reader import connect_read
from daq.journal.rows import APPLICATION_ID, HOLES, ROWS, SAMPLES, VERSION, require_journal, said
from daq.journal.salvage import Fault, Report, Salvage, gap
from daq.journal.wal import log_file, read_log, require_sound_log
from daq.quoting import quoted


def check(path: str | Path) -> Report:
    """Read all of a journal, also while it is written.

    Raises:
        JournalError: it is absent or no journal.
    """
    file = Path(path)
    with closing(connect_read(file, damaged=True)) as connection:
        faults: list[Fault] = []
        version = _identity(connection, file)
        if version > VERSION:
            text = f"version {version}, and this program knows {VERSION} at most: use the newer fingertwin"
            return Report("", "", {}, {}, 0, 0, 0, 0, 0, (Fault("version", text),))
        log = read_log(file)
        if log is not None and log.damaged:
            text = f"{log_file(file).name} is damaged from frame {log.first_bad} on and hides {log.hidden} transactions"
            faults.append(Fault("log", text))
        # Before the state that is read: what is committed meanwhile is no loss.
        mark = read_mark(file)
        with suppress(sqlite3.DatabaseError):
            connection.execute("BEGIN")  # one state throughout, whatever is written meanwhile
        faults += _integrity(connection)
        faults += _behind(connection, mark)
        return Salvage(connection, file, faults).report()


def recover(path: str | Path, out: str | Path) -> Report:
    """Write a new journal with everything that is sound; what is lost becomes an event `lost` of its stream.

    Raises:
        JournalError: the journal is in use, absent, no journal or newer; or `out` exists or cannot be written.
    """
    file, target = Path(path), Path(out)
    if target.exists():
        raise JournalError(f"{target.name} exists", "a new name", "Choose another --out")
    with ExitStack() as held:
        if lock_file(file).exists():
            try:
                held.enter_context(closing(WriterLock(file)))
            except InUseError:
                raise JournalError(f"{file.name} is being written", "no writer", "Stop the log first") from None
        log, faults = read_log(file) if file.is_file() else None, []
        source = file
        if log is not None and log.damaged:
            # Read a copy whose log has its checksums made anew: the chunks' own tell which of them are sound.
            target.parent.mkdir(parents=True, exist_ok=True)
            source = Path(held.enter_context(TemporaryDirectory(dir=target.parent))) / "copy"
            shutil.copyfile(file, source)
            with file.open("rb") as whole:
                log_file(source).write_bytes(log.mended(whole.read(log.page_bytes)))
            faults.append(Fault("log", f"{log_file(file).name} is damaged from frame {log.first_bad} on"))
        connection = held.enter_context(closing(connect_read(source, damaged=True)))
        require_journal(connection, file)
        faults += _behind(connection, read_mark(file))
        try:
            with replacing(target) as temporary, closing(sqlite3.connect(temporary, isolation_level=None)) as new:
                report = Salvage(connection, file, faults).into(new)
        except sqlite3.Error as error:
            raise said(error, target) from error
    return report


def require_complete(path: Path) -> None:
    """Check that a journal shows all that was ever committed to it, also while it is written.

    Raises:
        JournalError: readings were lost with its write-ahead log, are hidden by its damage, or are missing between
            others, and no recovery has noted it.
    """
    require_sound_log(path)
    mark = read_mark(path)
    with closing(connect_read(path)) as connection:
        for fault in (*_behind(connection, mark), *_holes(connection)):
            remedy = f"fingertwin journal recover {quoted(path)} --out NEW keeps the others"
            raise JournalError(f"{path.name}: {fault.text}", "a journal with all its readings", remedy)


def _identity(connection: sqlite3.Connection, path: Path) -> int:
    """Return the version of a journal, of whatever version."""
    application = connection.execute("PRAGMA application_id").fetchone()[0]
    if application != APPLICATION_ID:
        raise JournalError(f"{path.name} is no journal", "a journal that fingertwin wrote", "Give another file")
    return int(connection.execute("PRAGMA user_version").fetchone()[0])


def _behind(connection: sqlite3.Connection, mark: Mark | None) -> list[Fault]:
    """Return committed rows that are missing now."""
    with suppress(sqlite3.DatabaseError):
        epoch = connection.execute("SELECT value FROM meta WHERE key = 'epoch'").fetchone()
        (rows,) = connection.execute(ROWS).fetchone()
        (samples,) = connection.execute(SAMPLES).fetchone()
        missing = None if mark is None or epoch is None else mark.missing(epoch[0], rows, samples)
        if missing is not None:
            text = f"{missing}: the write-ahead log was lost, cut or damaged"
            return [Fault("log", text, n=mark.samples - samples if mark else None)]
    return []


def _holes(connection: sqlite3.Connection) -> list[Fault]:
    """Return the samples that are missing before others, but those that a recovery has noted."""
    with suppress(sqlite3.DatabaseError):
        noted = set()
        for stream, value in connection.execute("SELECT stream, value FROM events WHERE kind = 'lost'"):
            with suppress(ValueError, AttributeError):  # a damaged event notes nothing
                noted.add((stream, json.loads(value).get("first_seq")))
        holes = connection.execute(HOLES).fetchall()
        return [gap(stream, first, n) for stream, first, n in holes if (stream, first) not in noted]
    return []


def _integrity(connection: sqlite3.Connection) -> list[Fault]:
    try:
        answers = [str(row[0]) for row in connection.execute("PRAGMA integrity_check(20)")]
    except sqlite3.DatabaseError as error:
        return [Fault("file", f"SQLite cannot check it ({error})")]
    lines = [line for answer in answers for line in answer.splitlines() if line.strip()]
    return [] if lines == ["ok"] else [Fault("file", f"SQLite: {line}") for line in lines]


__all__ = ["Fault", "Report", "check", "recover", "require_complete"]
