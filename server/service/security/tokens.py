"""Tokens: who may read and who may write where the service can be reached from elsewhere.

A token is random and long, so that its SHA-256 alone is kept: there is nothing to guess, and a slow hash would only
slow each request.
"""

from __future__ import annotations

import datetime as dt
import hmac
import re
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Literal

from sqlalchemy import insert, select, update

from daq.errors import InputError
from server.service.storage.audit import record
from server.service.storage.checksums import digest_of
from server.service.storage.database import Database, now_utc
from server.service.storage.schema import tokens

Role = Literal["read", "write"]
ROLES: tuple[Role, ...] = ("read", "write")
PREFIX = "ft_"
_ID_BYTES, _SECRET_BYTES = 4, 32
PATTERN = re.compile(rf"{PREFIX}([0-9a-f]{{{2 * _ID_BYTES}}})_([0-9a-f]{{{2 * _SECRET_BYTES}}})")
# How soon a token that was revoked elsewhere counts as such here, and how soon one that was made [s].
FRESH_S, NEW_S = 1.0, 0.1
_MOST_DAYS = 3650
_MOST_NAME = 100
# Compared with where no such token is known.
_NONE = "0" * 64


@dataclass(frozen=True)
class Token:
    """A token as it is kept; its secret is not."""

    id: str  # in the token's own text
    name: str  # that its maker gave it
    role: Role  # read, or write, which may read too
    created_utc: str  # when it was made
    expires_utc: str | None  # when it ends; None for never
    revoked_utc: str | None  # when it was revoked; None where it was not

    def state(self, at: dt.datetime | None = None) -> Literal["valid", "expired", "revoked"]:
        """Return whether it can be used."""
        if self.revoked_utc is not None:
            return "revoked"
        ends = self.expires_utc and dt.datetime.fromisoformat(self.expires_utc)
        return "expired" if ends and ends <= (at or dt.datetime.now(dt.UTC)) else "valid"

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, with its state."""
        return asdict(self) | {"state": self.state()}


def create(database: Database, name: str, role: Role, days: float | None = None) -> tuple[Token, str]:
    """Make a token; return it and its text, which is kept nowhere.

    Args:
        database: where its SHA-256 is kept.
        name: of who or what uses it.
        role: read or write.
        days: after which it ends; None for never.

    Raises:
        InputError: the name or the days cannot be used.
    """
    if not name.strip() or len(name) > _MOST_NAME or not name.isprintable():
        raise InputError("the token's name", f"1 to {_MOST_NAME} printable characters")
    if days is not None and not 0 < days <= _MOST_DAYS:
        raise InputError(f"{days:g} days", f"more than 0 and at most {_MOST_DAYS}")
    number, secret = secrets.token_hex(_ID_BYTES), secrets.token_hex(_SECRET_BYTES)
    ends = None if days is None else dt.datetime.now(dt.UTC) + dt.timedelta(days=days)
    expires = ends.isoformat(timespec="milliseconds") if ends else None
    token = Token(number, name.strip(), role, now_utc(), expires, None)
    text = f"{PREFIX}{number}_{secret}"
    with database.writing() as connection:
        connection.execute(insert(tokens).values(asdict(token) | {"sha256": digest(text)}))
        record(connection, "token made", None, {"id": number, "name": token.name, "role": role, "expires_utc": expires})
    return token, text


def listed(database: Database) -> list[Token]:
    """Return all tokens, oldest first."""
    return [token for token, _ in _rows(database)]


def revoke(database: Database, number: str) -> Token:
    """Make a token useless; return it.

    Raises:
        InputError: there is none of this id.
    """
    with database.writing() as connection:
        mine = tokens.c.id == number
        change = update(tokens).where(mine, tokens.c.revoked_utc.is_(None)).values(revoked_utc=now_utc())
        if connection.execute(change).rowcount:
            record(connection, "token revoked", None, {"id": number})
    found = [token for token in listed(database) if token.id == number]
    if not found:
        raise InputError(f"there is no token {number[:_MOST_NAME]}", "an id of fingertwin token list")
    return found[0]


def digest(text: str) -> str:
    """Return the SHA-256 that is kept of a token."""
    return digest_of(text.encode("ascii", "replace"))


def _rows(database: Database) -> list[tuple[Token, str]]:
    rows = database.rows(select(tokens).order_by(tokens.c.created_utc, tokens.c.id))
    return [(Token(r.id, r.name, r.role, r.created_utc, r.expires_utc, r.revoked_utc), r.sha256) for r in rows]


class TokenBook:
    """The tokens as requests are checked against them, read again every second: so soon a revoked one ends.

    Args:
        database: gives where they are kept.
        clock: monotonic seconds.
    """

    def __init__(self, database: Callable[[], Database], clock: Callable[[], float] = time.monotonic) -> None:
        self._database, self._clock = database, clock
        self._lock = threading.Lock()
        self._read_s = -float("inf")
        self._tokens: dict[str, tuple[Token, str]] = {}

    def stale(self, *, known: bool) -> bool:
        """Return whether they are to be read again: soon where a token is not known, in case it is new."""
        return self._clock() - self._read_s >= (FRESH_S if known else NEW_S)

    def refresh(self, *, known: bool = False) -> None:
        """Read them again where they are stale; it waits for the database, so not on the event loop."""
        with self._lock:
            if self.stale(known=known):
                now = self._clock()
                self._tokens = {token.id: (token, kept) for token, kept in _rows(self._database())}
                self._read_s = now

    def find(self, text: str) -> Token | None:
        """Return the valid token of a text, None where there is none; how long it takes tells nothing of a secret."""
        parts = PATTERN.fullmatch(text)
        token, kept = self._tokens.get(parts[1] if parts else "", (None, _NONE))
        same = hmac.compare_digest(digest(text if parts else ""), kept)
        return token if same and token is not None and token.state() == "valid" else None

    def holds(self, token: Token) -> bool:
        """Return whether a token that was found is still valid."""
        now, _ = self._tokens.get(token.id, (None, _NONE))
        return now is not None and now.state() == "valid"
