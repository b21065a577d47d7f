"""Transactions that several share: one commit, each told its own, and no answer before the disk has it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Connection, event, text
from sqlalchemy.exc import OperationalError, SQLAlchemyError

from server.service.storage.database import Database

Work = Callable[[Connection], int]


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    out = Database(f"sqlite:///{tmp_path / 'trial.db'}")
    with out.writing() as connection:
        connection.execute(text("CREATE TABLE kept (number INTEGER PRIMARY KEY)"))
    yield out
    out.close()


def keeps(number: int) -> Work:
    def work(connection: Connection) -> int:
        connection.execute(text("INSERT INTO kept VALUES (:number)"), {"number": number})
        return number

    return work


def kept(database: Database) -> list[int]:
    with database.reading() as connection:
        return list(connection.execute(text("SELECT number FROM kept ORDER BY number")).scalars())


def at_once(database: Database, works: list[Work]) -> list[Future[int]]:
    """Have all but the first wait while the first is in its transaction; return them all once they have ended."""
    inside, free = threading.Event(), threading.Event()

    def first(connection: Connection) -> int:
        inside.set()
        assert free.wait(30)
        return works[0](connection)

    with ThreadPoolExecutor(len(works)) as pool:
        out = [pool.submit(database.together, first)]
        assert inside.wait(30)
        for count, work in enumerate(works[1:], 1):
            out.append(pool.submit(database.together, work))
            while len(database._waiting) < count:
                time.sleep(0.001)
        free.set()
    return out


def test_who_waits_shares_one_commit(database: Database) -> None:
    commits: list[Any] = []
    event.listen(database.engine, "commit", commits.append)
    done = at_once(database, [keeps(k) for k in range(8)])
    assert [d.result() for d in done] == kept(database) == list(range(8))
    assert len(commits) == 2


def test_what_one_is_refused_is_nothing_to_the_others(database: Database) -> None:
    def refused(connection: Connection) -> int:
        keeps(100)(connection)
        raise ValueError("not this")

    done = at_once(database, [keeps(0), keeps(1), refused, keeps(2)])
    assert [d.result() for k, d in enumerate(done) if k != 2] == kept(database) == [0, 1, 2]
    with pytest.raises(ValueError, match="not this"):
        done[2].result()


def test_where_the_database_fails_in_one_the_others_are_kept_without_it(database: Database) -> None:
    """As with a full disk, SQLite may give the whole transaction up; nobody in it may be told that it is kept."""

    def fails(connection: Connection) -> int:
        connection.exec_driver_sql("ROLLBACK")
        raise OperationalError("INSERT", {}, Exception("database or disk is full"))

    done = at_once(database, [keeps(0), keeps(1), fails, keeps(2)])
    assert [d.result() for k, d in enumerate(done) if k != 2] == kept(database) == [0, 1, 2]
    with pytest.raises(SQLAlchemyError, match="disk is full"):
        done[2].result()


def test_a_commit_that_fails_answers_nobody(database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: Connection) -> None:
        raise OperationalError("COMMIT", {}, Exception("database or disk is full"))

    event.listen(database.engine, "commit", full)
    done = at_once(database, [keeps(k) for k in range(4)])
    event.remove(database.engine, "commit", full)
    for one in done:
        with pytest.raises(OperationalError, match="disk is full"):
            one.result()
    assert kept(database) == []
    assert database.together(keeps(7)) == 7
    assert kept(database) == [7]
