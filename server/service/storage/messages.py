"""Messages of the service: each is kept with its cause, and sent to listeners once it is kept, in the same order."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import Connection, insert, select

from server.service.answers import plain
from server.service.storage.audit import record
from server.service.storage.database import Database, now_utc
from server.service.storage.schema import messages


@dataclass(frozen=True)
class Message:
    """Message to listeners."""

    kind: str  # session, event, case, job, revision, or one that is not kept: trace, estimate, bench
    session: str | None  # that it is about, None for what concerns none
    body: dict[str, Any]  # plain data
    id: int | None = None  # growing number of a message that is kept, None for others
    created_utc: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, as sent."""
        return dict(vars(self))


Listener = Callable[[Message], None]


@dataclass(eq=False)
class Telling:
    """Transaction whose messages are published when it is committed."""

    connection: Connection
    told: list[Message] = field(default_factory=list)

    def tell(self, kind: str, session: str | None, body: dict[str, Any]) -> None:
        """Keep a message in this transaction, and tell it afterwards."""
        self.tell_all(kind, session, [body])

    def tell_all(self, kind: str, session: str | None, bodies: Sequence[dict[str, Any]]) -> None:
        """Keep messages in this transaction, and tell them afterwards, in their order."""
        if not bodies:
            return
        at, told = now_utc(), [plain(body) for body in bodies]
        rows = [{"session": session, "kind": kind, "created_utc": at, "body": body} for body in told]
        numbered = insert(messages).returning(messages.c.id, sort_by_parameter_order=True)
        numbers = self.connection.execute(numbered, rows).scalars()
        self.told += [Message(kind, session, body, n, at) for body, n in zip(told, numbers, strict=True)]

    def record(self, what: str, about: str | None, details: Mapping[str, Any]) -> None:
        """Add a change to the audit trail, in this transaction."""
        record(self.connection, what, about, details)


class Messages:
    """Keeps messages and hands them on.

    Args:
        database: where they are kept.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self._listeners: list[Listener] = []
        self._lock = threading.Lock()
        # Held from a transaction's beginning until its messages are out, so that they go out as they are numbered.
        self._turn = threading.Lock()

    def listen(self, listener: Listener) -> None:
        """Call a function with every message from now on; it must not wait, nor raise."""
        with self._lock:
            self._listeners.append(listener)

    def publish(self, message: Message) -> None:
        """Hand on a message, from any thread."""
        with self._lock:
            listeners = list(self._listeners)
        for listener in listeners:
            listener(message)

    @contextmanager
    def writing(self) -> Iterator[Telling]:
        """Yield a transaction; its messages go out once it is kept, before the next one begins, and never otherwise."""
        with self._turn:
            with self._database.writing() as connection:
                telling = Telling(connection)
                yield telling
            for message in telling.told:
                self.publish(message)

    def after(self, number: int, session: str | None = None, limit: int = 1000) -> list[Message]:
        """Return messages that were kept after the one of a number, oldest first."""
        query = select(messages).where(messages.c.id > number).order_by(messages.c.id).limit(limit)
        if session is not None:
            query = query.where(messages.c.session == session)
        return [Message(r.kind, r.session, r.body, r.id, r.created_utc) for r in self._database.rows(query)]

    def latest(self) -> int:
        """Number of the last message that was kept, 0 where none was."""
        return self._database.value(select(messages.c.id).order_by(messages.c.id.desc()).limit(1)) or 0
