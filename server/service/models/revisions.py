"""Revisions of specimens' models: each kept for good with what it came from, and one of them in force."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sqlalchemy import Connection, Row, insert, select

from fingermodel.model_files import Revision, revision_of
from server.service.storage.checksums import fingerprint
from server.service.storage.database import Database, now_utc
from server.service.storage.messages import Messages, Telling
from server.service.storage.schema import heads, revisions
from server.service.web.problems import ProblemError, not_found


class Revisions:
    """Keeps revisions.

    Args:
        database: where they are kept.
        messages: are told of each.
    """

    def __init__(self, database: Database, messages: Messages) -> None:
        self._database, self._messages = database, messages

    def keep(
        self, telling: Telling, document: Mapping[str, Any], specimen: str, provenance: Mapping[str, Any], why: str
    ) -> None:
        """Keep a revision and put it in force, in a transaction; the very same one again changes nothing."""
        connection, name = telling.connection, str(document["id"])
        if connection.execute(select(revisions.c.id).where(revisions.c.id == name)).first() is None:
            row = {
                "id": name,
                "specimen": specimen,
                "session": document["session"]["id"],
                "parent": document["parent"],
                "created_utc": document["created_utc"],
                "document": dict(document),
                "provenance": dict(provenance),
            }
            connection.execute(insert(revisions).values(row))
            told = {"revision": name, "specimen": specimen, "job": provenance.get("job"), "why": why}
            telling.record("revision kept", document["session"]["id"], told | {"sha256": fingerprint(document)})
        _put_in_force(connection, specimen, name, why)
        telling.tell("revision", document["session"]["id"], {"id": name, "specimen": specimen, "why": why})

    def restore(self, name: str, why: str) -> dict[str, Any]:
        """Put an older revision in force again; nothing is lost by it.

        Raises:
            ProblemError: 404 there is none, 409 it is in force.
        """
        with self._messages.writing() as telling:
            row = _row(telling.connection, name)
            if in_force(telling.connection, row.specimen) == name:
                raise ProblemError(409, f"revision {name} is in force already", "another one")
            _put_in_force(telling.connection, row.specimen, name, why)
            body = {"id": name, "specimen": row.specimen, "why": why}
            telling.record("revision restored", row.session, body)
            telling.tell("revision", row.session, body)
            return _shown(row) | {"in_force": True}

    def read(self, name: str) -> dict[str, Any]:
        """Return a revision with its document and what it came from.

        Raises:
            ProblemError: 404 there is none.
        """
        with self._database.reading() as connection:
            row = _row(connection, name)
            shown = _shown(row) | {"in_force": in_force(connection, row.specimen) == name}
            return shown | {"document": row.document, "provenance": row.provenance}

    def loaded(self, name: str) -> Revision:
        """Return a revision as a model.

        Raises:
            ProblemError: 404 there is none.
            ModelError: it is of a newer version of the software.
        """
        with self._database.reading() as connection:
            return revision_of(_row(connection, name).document, name)

    def listed(
        self, specimen: str | None = None, session: str | None = None, limit: int = 100, after: str = ""
    ) -> list[dict[str, Any]]:
        """Return revisions, oldest first, after one of them."""
        query = select(revisions).order_by(revisions.c.created_utc, revisions.c.id)
        if specimen is not None:
            query = query.where(revisions.c.specimen == specimen)
        if session is not None:
            query = query.where(revisions.c.session == session)
        with self._database.reading() as connection:
            if after:
                last = _row(connection, after)
                later = (revisions.c.created_utc > last.created_utc) | (
                    (revisions.c.created_utc == last.created_utc) & (revisions.c.id > last.id)
                )
                query = query.where(later)
            rows = connection.execute(query.limit(limit)).all()
            now = {s: in_force(connection, s) for s in {r.specimen for r in rows}}
        return [_shown(r) | {"in_force": now[r.specimen] == r.id} for r in rows]

    def specimens(self) -> list[dict[str, Any]]:
        """Return every specimen that has a revision, with the one in force and how it came to be."""
        out: dict[str, list[dict[str, Any]]] = {}
        for row in self._database.rows(select(heads).order_by(heads.c.number)):
            step = {"revision": row.revision, "created_utc": row.created_utc, "why": row.why}
            out.setdefault(row.specimen, []).append(step)
        return [{"id": name, "revision": steps[-1]["revision"], "steps": steps} for name, steps in out.items()]

    def in_force(self, specimen: str) -> str | None:
        """Return the id of the revision that stands for a specimen; None where there is none."""
        with self._database.reading() as connection:
            return in_force(connection, specimen)


def in_force(connection: Connection, specimen: str) -> str | None:
    """Return the id of the revision that stands for a specimen."""
    query = select(heads.c.revision).where(heads.c.specimen == specimen).order_by(heads.c.number.desc()).limit(1)
    return connection.execute(query).scalar()


def _put_in_force(connection: Connection, specimen: str, name: str, why: str) -> None:
    if in_force(connection, specimen) != name:
        row = {"specimen": specimen, "revision": name, "created_utc": now_utc(), "why": why}
        connection.execute(insert(heads).values(row))


def _row(connection: Connection, name: str) -> Row[Any]:
    row = connection.execute(select(revisions).where(revisions.c.id == name)).first()
    if row is None:
        raise not_found("revision", name, "/api/v1/revisions")
    return row


def _shown(row: Row[Any]) -> dict[str, Any]:
    document = row.document
    shown = {name: getattr(row, name) for name in ("id", "specimen", "session", "parent", "created_utc")}
    shown |= {name: document.get(name) for name in ("method", "outcome", "evidence", "before", "after")}
    shown |= {name: document.get(name, []) for name in ("added", "removed", "history")}
    return shown | {"effects": [e["name"] for e in document.get("effects") or []]}
