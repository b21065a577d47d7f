"""Audit trail of changes: author, time and address; entries are only added, each chained to the one before.

An entry holds the SHA-256 of the entry before it and of itself, so that none can be changed, left out or put in without
all that follow being made anew. What the last entry is has to be known from elsewhere: a copy, or a published figure.
"""

from __future__ import annotations

import datetime as dt
import getpass
import hashlib
import json
import os
import platform
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from daq.documents import unique_keys
from daq.errors import InputError

FILE = "audit.jsonl"
# Beside it: an empty database, which SQLite locks on every system in the way that works there, while its holder lives.
LOCK = ".audit-writer"
# So long another program may take to add its entry [s].
_PATIENCE_S = 60.0
# Before the first entry.
BEGIN = "0" * 64
# Adds an entry: what was done, about which session or file, and plain data.
Note = Callable[[str, str | None, Mapping[str, Any]], None]


@dataclass(frozen=True)
class Entry:
    """One change.

    Attributes:
        number: from 1.
        at_utc: when it was made.
        who: token's name, or local user.
        origin: address or machine that it came from.
        what: kind of change, such as `amend`.
        about: session or file; None for what concerns none.
        details: plain data.
        before: SHA-256 of the entry before it.
        sha256: of all the rest.
    """

    number: int
    at_utc: str
    who: str
    origin: str
    what: str
    about: str | None
    details: Mapping[str, Any]
    before: str
    sha256: str = ""

    def digest(self) -> str:
        """Return the SHA-256 of everything but itself."""
        body = asdict(self) | {"sha256": None}
        return hashlib.sha256(json.dumps(body, sort_keys=True, ensure_ascii=True).encode()).hexdigest()


def following(
    last: tuple[int, str] | None, who: str, origin: str, what: str, about: str | None, details: Mapping[str, Any]
) -> Entry:
    """Make the entry that follows one of a number and digest; the first where that is None."""
    number, before = last or (0, BEGIN)
    at = dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds")
    # As it is read back: a number that JSON writes otherwise would break the chain.
    plain = json.loads(json.dumps(dict(details), default=str))
    entry = Entry(number + 1, at, who, origin, what, about, plain, before)
    return Entry(**{**vars(entry), "sha256": entry.digest()})


def faults(entries: Iterable[Entry]) -> list[str]:
    """Say where a trail is not as it was written; empty where it is sound."""
    out = []
    number, before = 0, BEGIN
    for entry in entries:
        if entry.number != number + 1:
            out.append(f"entry {entry.number} follows entry {number}")
        elif entry.before != before:
            out.append(f"entry {entry.number} does not follow the entry {number} that is here")
        if entry.sha256 != entry.digest():
            out.append(f"entry {entry.number} was changed")
        number, before = entry.number, entry.sha256
    return out


def local_user() -> str:
    """Name of the user of this machine who runs the program."""
    try:
        return getpass.getuser()
    except (KeyError, OSError, ImportError):  # a user id without a name
        return "unknown"


def note(folder: Path, what: str, about: str | None, details: Mapping[str, Any]) -> None:
    """Add a change that the local user has made to the trail of a folder, after whatever others add to it meanwhile.

    Raises:
        InputError: the trail cannot be read or written.
    """
    with changing(folder) as note_it:
        note_it(what, about, details)


@contextmanager
def changing(folder: Path) -> Iterator[Note]:
    """Keep other programs from a folder whose files are read, written and noted in its trail, as one change.

    A program that is killed holds the folder no longer. What is yielded adds an entry: what, about, details.

    Raises:
        InputError: the trail cannot be read or written, or another program has held the folder for a minute.
    """
    with closing(_held(folder)):

        def note_it(what: str, about: str | None, details: Mapping[str, Any]) -> None:
            entries = read(folder)
            last = (entries[-1].number, entries[-1].sha256) if entries else None
            entry = following(last, local_user(), platform.node() or "this machine", what, about, details)
            try:
                _add(folder / FILE, entry)
            except OSError as error:
                raise _unwritten(folder, error) from error

        yield note_it


def _held(folder: Path) -> sqlite3.Connection:
    """Wait for a folder's lock and take it; closing the connection leaves it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        connection = sqlite3.connect(folder / LOCK, timeout=_PATIENCE_S, isolation_level=None)
    except (OSError, sqlite3.Error) as error:
        raise _unwritten(folder, error) from error
    try:
        connection.execute("BEGIN EXCLUSIVE")
    except sqlite3.Error as error:
        connection.close()
        raise _unwritten(folder, error) from error
    return connection


def _unwritten(folder: Path, error: OSError | sqlite3.Error) -> InputError:
    said = getattr(error, "strerror", None) or error
    return InputError(f"{folder / FILE} cannot be written ({said})", "a folder that may be written")


def _add(file: Path, entry: Entry) -> None:
    """Add an entry whole or, where the disk is full, not at all."""
    line = (json.dumps(asdict(entry), ensure_ascii=False) + "\n").encode()
    with file.open("ab") as stream:
        before = stream.tell()
        try:
            stream.write(line)
            stream.flush()
            os.fsync(stream.fileno())
        except OSError:
            os.truncate(file, before)
            raise


def read(folder: Path) -> list[Entry]:
    """Return the trail of a folder, oldest first; none where there is no such file.

    Raises:
        InputError: a line of it is no entry.
    """
    file = folder / FILE
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        return []
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{file} cannot be read ({error})", "an audit trail") from error
    out = []
    for number, line in enumerate(lines, 1):
        try:
            out.append(Entry(**json.loads(line, object_pairs_hook=unique_keys)))
        except (TypeError, ValueError) as error:
            raise InputError(
                f"line {number} of {file} is no entry", "an audit trail as it was written", "Restore it from a copy"
            ) from error
    return out
