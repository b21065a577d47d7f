"""The service's audit trail: every change, by whom it was asked for, in the transaction that makes it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import asdict, dataclass
from typing import Any

from sqlalchemy import Connection, insert, select

from daq.audit import Entry, faults, following
from server.service.storage.database import Database
from server.service.storage.schema import audit

# Entries that are read at once.
_ROWS = 1000


@dataclass(frozen=True)
class Actor:
    """Author of a request."""

    who: str  # the token's name; `local` for whoever needs none; the user of the machine on the command line
    origin: str  # address, with the token's id


# What no request asks for, the service does by itself.
_ITSELF = Actor("service", "")
_ACTOR: ContextVar[Actor | None] = ContextVar("actor", default=None)


@contextmanager
def acting(who: str, origin: str) -> Iterator[None]:
    """Let the changes within be those of somebody."""
    before = _ACTOR.set(Actor(who, origin))
    try:
        yield
    finally:
        _ACTOR.reset(before)


def actor() -> Actor:
    """Return the author of the present request."""
    return _ACTOR.get() or _ITSELF


def record(connection: Connection, what: str, about: str | None, details: Mapping[str, Any]) -> None:
    """Add a change to the trail, in the transaction that makes it."""
    last = connection.execute(select(audit.c.number, audit.c.sha256).order_by(audit.c.number.desc()).limit(1)).first()
    who = actor()
    entry = following(None if last is None else (last[0], last[1]), who.who, who.origin, what, about, details)
    connection.execute(insert(audit).values(asdict(entry)))


def entries(database: Database, about: str | None = None, after: int = 0, limit: int | None = None) -> Iterator[Entry]:
    """Yield the trail, oldest first.

    Args:
        database: that holds it.
        about: a session's id, to leave the others out.
        after: number of an entry; those that are younger follow.
        limit: at most so many.
    """
    query = select(audit).order_by(audit.c.number)
    if about is not None:
        query = query.where(audit.c.about == about)
    left = limit
    while left is None or left > 0:
        rows = database.rows(query.where(audit.c.number > after).limit(min(_ROWS, left or _ROWS)))
        yield from (Entry(**row._mapping) for row in rows)
        if not rows:
            return
        after, left = rows[-1].number, None if left is None else left - len(rows)


def faults_of(database: Database) -> list[str]:
    """Say where the trail is not as it was written; empty where it is sound."""
    return faults(entries(database))
