"""The service's database: SQLite in one file by default, PostgreSQL by its URL."""

from __future__ import annotations

import datetime as dt
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Generic, TypeVar

from sqlalchemy import Connection, Engine, Executable, create_engine, event, make_url, text
from sqlalchemy.engine import URL
from sqlalchemy.exc import ArgumentError, DatabaseError, OperationalError, SQLAlchemyError

from daq.errors import InputError

# How long a writer waits for another process, such as a backup, to let go of the file [ms].
_BUSY_MS = 10_000
# As many connections as there are threads that may want one: nobody waits for what a slow reader holds.
_POOL: dict[str, Any] = {"pool_size": 10, "max_overflow": 40}
_WRITES = "fingertwin_writes"
T = TypeVar("T")


def now_utc() -> str:
    """Return the time in UTC, as kept."""
    return dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds")


class _Share(Generic[T]):
    """Somebody's part of a transaction that is shared.

    Attributes:
        error: that is raised in place of an answer.
        ended: whether its transaction is over.
    """

    def __init__(self, work: Callable[[Connection], T]) -> None:
        self._work, self._results = work, list[T]()
        self.error: Exception | None = None
        self.ended = False

    def within(self, connection: Connection, *, alone: bool) -> None:
        """Do the work in a transaction, alone or beside others'; of what is refused beside others nothing is left.

        Raises:
            SQLAlchemyError: the database failed; the whole transaction may be gone.
            Exception: of work that is alone.
        """
        self._results, self.error = [], None
        if alone:
            self._results = [self._work(connection)]
            return
        try:
            with connection.begin_nested():
                self._results = [self._work(connection)]
        except SQLAlchemyError:
            raise
        except Exception as error:
            self.error = error

    def answer(self) -> T:
        """Return what the work returned, or raise what it raised."""
        if self.error is not None:
            raise self.error
        return self._results[0]


class Database:
    """A database that is reached from several threads.

    Args:
        url: of SQLAlchemy: `sqlite:///FILE`, or `postgresql+psycopg://…`.

    Raises:
        InputError: it is no such URL, or the database cannot be opened.
    """

    def __init__(self, url: str) -> None:
        try:
            parsed = make_url(url)
        except ArgumentError as error:
            raise InputError("the database's URL cannot be read", "sqlite:///FILE or postgresql+psycopg://…") from error
        self.dialect = parsed.get_backend_name()
        if self.dialect not in ("sqlite", "postgresql"):
            raise InputError(f"a database of {self.dialect}", "sqlite or postgresql")
        self.url = parsed
        self.engine = _engine(parsed)
        # One writer at a time: SQLite has no more, and the numbers of messages are to grow with the commits.
        self._writer = threading.Lock()
        # Shares of the next transaction, and whether somebody is committing one.
        self._turn = threading.Condition()
        self._waiting: list[_Share[Any]] = []
        self._leading = False

    @property
    def file(self) -> Path | None:
        """The file of SQLite; None elsewhere."""
        return Path(self.url.database) if self.dialect == "sqlite" and self.url.database else None

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """Yield a connection that sees one state of the database, and changes nothing."""
        with self.engine.connect() as connection:
            try:
                yield connection
            finally:
                connection.rollback()

    def rows(self, query: Executable) -> Sequence[Any]:
        """Return all rows of a query."""
        with self.reading() as connection:
            return connection.execute(query).all()

    def value(self, query: Executable) -> Any:
        """Return the first column of a query's first row; None where there is none."""
        with self.reading() as connection:
            return connection.execute(query).scalar()

    @contextmanager
    def writing(self) -> Iterator[Connection]:
        """Yield a connection in a transaction of its own, one after the other: all of it is kept, or nothing."""
        with (
            self._writer,
            self.engine.connect().execution_options(**{_WRITES: True}) as connection,
            connection.begin(),
        ):
            yield connection

    def together(self, work: Callable[[Connection], T]) -> T:
        """Do work in one transaction with that of others who wait: the disk is synced once for all of them.

        Nobody is answered before the commit. What one raises leaves nothing of it, and all of the others'.

        Args:
            work: may be done in another's thread, and again where the database failed.
        """
        mine = _Share(work)
        with self._turn:
            self._waiting.append(mine)
            self._turn.wait_for(lambda: mine.ended or not self._leading)
            batch = [] if mine.ended else self._waiting
            if batch:
                self._leading, self._waiting = True, []
        if batch:
            try:
                self._commit(batch)
            finally:
                with self._turn:
                    for share in batch:
                        share.ended = True
                    self._leading = False
                    self._turn.notify_all()
        return mine.answer()

    def _commit(self, batch: Sequence[_Share[Any]]) -> None:
        try:
            with self.writing() as connection:
                for share in batch:
                    share.within(connection, alone=len(batch) == 1)
        except Exception as error:
            if len(batch) == 1:
                batch[0].error = error
                return
            # Nothing is kept; alone, each is told what is wrong.
            for share in batch:
                self._commit([share])

    def alive(self) -> bool:
        """Return whether it answers."""
        try:
            return bool(self.value(text("SELECT 1")) == 1)
        except (OperationalError, DatabaseError):
            return False

    def close(self) -> None:
        """Close all connections."""
        self.engine.dispose()


def _engine(url: URL) -> Engine:
    if url.get_backend_name() != "sqlite":
        try:
            return create_engine(url, pool_pre_ping=True, hide_parameters=True, **_POOL)
        except ImportError as error:
            raise InputError(
                f"PostgreSQL needs the package {error.name}", "fingertwin[postgres]", "Install it"
            ) from error
    # The driver must not begin transactions by itself: a write begins at once, or not at all.
    driver = {"check_same_thread": False, "isolation_level": None}
    # A database in memory, which is refused later, has one connection for each thread and takes no size.
    pool = {} if url.database in (None, "", ":memory:") else _POOL
    engine = create_engine(url, connect_args=driver, hide_parameters=True, **pool)

    @event.listens_for(engine, "connect")
    def prepare(connection: Any, _: Any) -> None:
        for pragma in ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON", f"busy_timeout={_BUSY_MS}"):
            connection.execute(f"PRAGMA {pragma}")
        # A text with a damaged byte is told by its checksum, as every other damage is.
        connection.text_factory = _text

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        writes = connection.get_execution_options().get(_WRITES, False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")

    return engine


def _text(stored: bytes) -> str:
    return stored.decode(errors="replace")
