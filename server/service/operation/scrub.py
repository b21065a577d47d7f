"""Everything that is stored, held against its checksums: before a copy counts, and slowly while the service runs."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Column, LargeBinary, Row, Table, Text, select, tuple_, type_coerce
from sqlalchemy.exc import SQLAlchemyError

from daq.acquisition.blocks import Chunk
from daq.errors import JournalError
from server.service.storage.checksums import DamagedError, Sealed, digest_of, opened
from server.service.storage.database import Database, now_utc
from server.service.storage.purge import purge
from server.service.storage.schema import chunks, events, metadata, streams

# What has its SHA-256 in a column of its own, since whoever sent it said it.
_SENT: dict[Table, Column[Any]] = {chunks: chunks.c.payload, events: events.c.body, streams: streams.c.description}
# Rows that are read at once; a chunk may have megabytes.
_FEW, _ROWS = 8, 200
_PLACE = ("n", "first_s", "last_s")
_LOG = logging.getLogger(__name__)
# A pass begins so long after the start, and after the pass before [s]; it reads so much a second [B].
FIRST_S, EVERY_S, RATE = 30.0, 86_400.0, 8e6
# Damaged rows that are named; more are counted.
_NAMED = 20


@dataclass(frozen=True)
class Read:
    """Rows that were read."""

    size_bytes: int  # of what was held against its checksum
    damaged: tuple[str, ...]  # place of each row that is not as it was written


def read_all(database: Database) -> Iterator[Read]:
    """Read every row that has a checksum, some at a time, each time in a transaction of its own."""
    for table in metadata.sorted_tables:
        checked = [c for c in table.columns if isinstance(c.type, Sealed)]
        if not checked and table not in _SENT:
            continue
        key = list(table.primary_key.columns)
        query = select(*key, *(type_coerce(c, Text).label(c.name) for c in checked))
        if table is chunks:
            query = query.add_columns(*(chunks.c[name] for name in _PLACE))
        if table in _SENT:
            kind = LargeBinary() if table is chunks else Text()
            query = query.add_columns(type_coerce(_SENT[table], kind).label("sent"), table.c.sha256)
        query = query.order_by(*key).limit(_FEW if table is chunks else _ROWS)
        more = query
        while rows := database.rows(more):
            yield _looked(table, len(key), [c.name for c in checked], rows)
            more = query.where(tuple_(*key) > tuple_(*rows[-1][: len(key)]))


def damage_of(database: Database) -> list[str]:
    """Return the place of every damaged row."""
    return [place for read in read_all(database) for place in read.damaged]


def _looked(table: Table, keys: int, checked: list[str], rows: Sequence[Row[Any]]) -> Read:
    size, damaged = 0, []
    for row in rows:
        stored = [row._mapping[name] for name in checked if row._mapping[name] is not None]
        size += sum(map(len, stored))
        if table in _SENT:
            size += len(row.sent)
        if not _is_sound(table, stored, row):
            damaged.append(f"{table.name} {' '.join(str(v) for v in row[:keys])}")
    return Read(size, tuple(damaged))


def _is_sound(table: Table, stored: list[str], row: Row[Any]) -> bool:
    try:
        for text in stored:
            opened(text, table.name)
        if table in _SENT and digest_of(row.sent if table is chunks else row.sent.encode()) != row.sha256:
            return False
        if table is chunks:
            chunk = Chunk.from_bytes(row.sent)
            ends = (chunk.t_s[0], chunk.t_s[-1]) if len(chunk) else (None, None)
            return (chunk.first_seq, len(chunk), *ends) == (row.first_seq, row.n, row.first_s, row.last_s)
    except (DamagedError, JournalError, ValueError):
        return False
    return True


class Scrub:
    """Reads everything again and again while the service runs, too slowly to be felt.

    Args:
        database: that is read.
        before: is called before each pass: it removes what is kept no longer.

    Attributes:
        checked_utc: end of the last whole pass; None before it.
        deleted_bytes: of readings of deleted sessions, as of then.
    """

    def __init__(self, database: Database, before: Callable[[], None] = lambda: None) -> None:
        self._database, self._before = database, before
        self.checked_utc: str | None = None
        self.deleted_bytes: int | None = None
        self._known: dict[str, None] = {}
        self._lock, self._halt = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="scrub", daemon=True)

    @property
    def damaged(self) -> tuple[str, ...]:
        """Place of each row that was found damaged, also by a request, and that the last pass did not find sound."""
        with self._lock:
            return tuple(self._known)

    def start(self) -> None:
        """Read from now on."""
        self._thread.start()

    def close(self) -> None:
        """Stop."""
        self._halt.set()
        if self._thread.is_alive():
            self._thread.join()

    def note(self, places: Iterable[str]) -> None:
        """Take note of damage that was found."""
        with self._lock:
            for place in places:
                if place not in self._known:
                    _LOG.error("stored data are damaged: %s", place)
                self._known[place] = None

    def look(self, rate: float = float("inf")) -> bool:
        """Read everything once, so many bytes a second; return whether all of it was read."""
        found: list[str] = []
        for read in read_all(self._database):
            self.note(read.damaged)
            found += read.damaged
            if self._halt.wait(read.size_bytes / rate):
                return False
        with self._lock:
            self._known = dict.fromkeys(found)
        self.deleted_bytes = purge(self._database, "deleted", 0.0, dry_run=True).chunk_bytes
        self.checked_utc = now_utc()
        return True

    def _run(self) -> None:
        wait_s = FIRST_S
        while not self._halt.wait(wait_s):
            wait_s = EVERY_S
            try:
                self._before()
                self.look(RATE)
            except (SQLAlchemyError, OSError) as error:
                # What cannot be read for now is tried again; what can never be read shows in every pass.
                _LOG.exception("the stored data could not be read again")
                self.note((f"a part that cannot be read ({type(error).__name__})",))
                wait_s = 10 * FIRST_S


def named(places: Sequence[str]) -> str:
    """Say which rows are damaged, in one line."""
    more = f" and {len(places) - _NAMED} more" if len(places) > _NAMED else ""
    return f"{len(places)} stored rows are damaged: {', '.join(places[:_NAMED])}{more}"
