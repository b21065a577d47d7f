"""Errors in the user's input.

    InputError            anything in a file or an argument that we cannot use (exit 2, HTTP 4xx)
    ├── SessionError      session.yaml: keys, roles, postures, windows
    ├── ReadingsError     the readings file: columns, units, numbers, time
    ├── ModelError        a finger, model revision or parameter set
    ├── DriverError       a load cell: its settings, port, answers, calibration
    ├── JournalError      a bench's journal: in use, damaged, of a newer version, disk full
    └── LaterError        what cannot be used now and may be later: a full disk, a server that is starting (exit 75)
    LinkLostError         the device has gone while it was read (a pulled cable); not the user's input, and recoverable

Every message is one line: what was found, what was expected, what to do.
"""

from __future__ import annotations

import errno
import os

# Of OSError: full disks, too many open files, too little memory, a device that does not answer now.
_LATER = ("ENOSPC", "EDQUOT", "EMFILE", "ENFILE", "ENOMEM", "EAGAIN", "EIO", "EBUSY", "ESTALE", "ETIMEDOUT")
LATER = frozenset(getattr(errno, name) for name in _LATER if hasattr(errno, name))


class InputError(ValueError):
    """Bad input, said in one line: found, expected, remedy."""

    def __init__(self, found: str, expected: str = "", remedy: str = "") -> None:
        self.found, self.expected, self.remedy = found, expected, remedy
        parts = [found.rstrip(".")]
        if expected:
            parts.append(f"expected {expected.rstrip('.')}")
        text = "; ".join(parts)
        text += "" if text.endswith("?") else "."
        if remedy:
            text += " " + remedy if remedy.endswith(("?", ".")) else f" {remedy}."
        super().__init__(" ".join(text.split()))


class SessionError(InputError):
    """A bench session's description cannot be used."""


class ReadingsError(InputError):
    """A readings file cannot be used."""


class OutsideError(ReadingsError):
    """A window lies outside a recording that is finished."""


class ModelError(InputError):
    """A finger, a model revision or a parameter set cannot be used."""


class DriverError(InputError):
    """A load cell cannot be used: its settings, its port, its answers or its calibration."""


class JournalError(InputError):
    """A bench's journal cannot be used."""


class LaterError(InputError):
    """Something cannot be used now; the same again may succeed later."""


class LinkLostError(Exception):
    """The device has gone while it was read or written."""


def require_list(given: object, what: str, expected: str) -> None:
    """Refuse one name or path where a list is expected: a text is a list of its letters.

    Args:
        given: the value.
        what: its name, such as "effects".
        expected: such as "a list of effects".

    Raises:
        InputError: it is one name or path.
    """
    if isinstance(given, str | os.PathLike):
        name = os.fspath(given)
        raise InputError(f"{what} is {name!r:.60}", expected, f"Give [{name!r:.60}]")
