"""Checksums of what is stored: made when it is written, and held against it whenever it is read."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from sqlalchemy import Text
from sqlalchemy.engine import Dialect
from sqlalchemy.types import TypeDecorator

_DIGITS = 64


class DamagedError(Exception):
    """Stored data that differ from the data that were written.

    Args:
        what: that is damaged, with its place as far as it is known.
    """

    def __init__(self, what: str) -> None:
        self.what = what
        super().__init__(f"{what} is damaged: its checksum does not hold")


class Sealed(TypeDecorator[Any]):
    """JSON in a column of text, after its SHA-256; a value whose checksum does not hold is never handed out.

    Args:
        what: the column holds, for messages.
    """

    impl = Text
    cache_ok = True

    def __init__(self, what: str) -> None:
        super().__init__()
        self.what = what

    def process_bind_param(self, value: Any, dialect: Dialect) -> str | None:
        """Return what is stored."""
        return None if value is None else sealed(json.dumps(value, ensure_ascii=False, separators=(",", ":")))

    def process_result_value(self, value: str | None, dialect: Dialect) -> Any:
        """Return what was stored.

        Raises:
            DamagedError: it is something else by now.
        """
        return None if value is None else json.loads(opened(value, self.what))


def sealed(text: str) -> str:
    """Return a text with its SHA-256 before it."""
    return f"{digest_of(text.encode())} {text}"


def opened(stored: str, what: str) -> str:
    """Return a text without its SHA-256.

    Raises:
        DamagedError: they do not fit each other.
    """
    text = stored[_DIGITS + 1 :]
    if stored[: _DIGITS + 1] != f"{digest_of(text.encode(errors='replace'))} ":
        raise DamagedError(what)
    return text


def sound(body: bytes, sha256: str, what: str) -> bytes:
    """Return stored bytes.

    Raises:
        DamagedError: their SHA-256 is another.
    """
    if digest_of(body) != sha256:
        raise DamagedError(what)
    return body


def digest_of(body: bytes) -> str:
    """Return the SHA-256 in hexadecimal."""
    return hashlib.sha256(body).hexdigest()


def fingerprint(document: Any) -> str:
    """Return the SHA-256 of plain data, whatever the order of its keys."""
    return digest_of(json.dumps(document, sort_keys=True, separators=(",", ":")).encode())
