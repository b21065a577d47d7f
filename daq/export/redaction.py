"""Removes from texts what would tell who measured where and when: hosts, users, paths, addresses, dates.

Names show themselves by what stands around them; one that stands in a note like any other word cannot be recognised.
"""

from __future__ import annotations

import getpass
import re
import socket
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from daq import vocabulary
from daq.sessions import models as session_models

READINGS = "readings.csv"

# Of publications, which a supplement may cite.
PUBLIC = ("doi.org", "dx.doi.org", "creativecommons.org", "spdx.org", "orcid.org")
_MONTH = r"(?:jan|feb|mar|apr|may|june?|july?|aug|sept?|oct|nov|dec)[a-z]*\.?"
# Without a year only the full names are dates; `may` is a verb too.
_FULL = "january|february|march|april|june|july|august|september|october|november|december"
_ZONE = r"(?:\s?(?:Z|UTC|GMT|CES?T|h)\b)?(?:[+-]\d\d:?\d\d)?"
_CLOCK = r"(?:[01]?\d|2[0-4]):[0-5]\d(?::[0-6]\d(?:[.,]\d+)?)?(?:\s?[ap]m\b)?" + _ZONE
_PUBLIC_URL = r"https?://(?:www\.)?(?:" + "|".join(map(re.escape, PUBLIC)) + ")/"
_YEAR = r"(?:19|20)\d\d"
# Of domains, in small letters: no ending of a file is among them, and no tendon's name (point.DIP.ES).
_TOP = "edu|org|com|net|gov|eu|io|at|au|be|br|ca|ch|cn|cz|de|dk|es|fi|fr|ie|il|it|jp|kr|nl|no|nz|pl|pt|se|sg|tw|uk|us"
_MACHINE = "pc|laptop|desktop|workstation|notebook|server|host|macbook|raspberrypi"
_NAME = r"[A-Za-z][\w.-]*"
# What is replaced, in this order: (kind, pattern).
PATTERNS: tuple[tuple[str, re.Pattern[str]], ...] = tuple(
    (kind, re.compile(pattern, re.IGNORECASE))
    for kind, pattern in (
        ("address", rf"\b(?!{_PUBLIC_URL})[a-z][a-z0-9+.-]*://[^\s\"'<>|]*"),
        ("address", rf"\b{_NAME}(?:\+[\w.-]+)?@[A-Za-z][\w-]*(?:\.[\w-]+)*"),
        ("path", r"\\\\[\w.$-]+(?:\\[^\\/:*?\"<>|\s]*)*"),
        ("path", r"(?<![A-Za-z0-9])[a-z]:\\(?:[^\\/:*?\"<>|\r\n]+\\)*[^\\/:*?\"<>|\s]*"),
        ("path", r"(?<![A-Za-z0-9])[a-z]:/[^\s\"'<>|]+"),
        ("path", r"(?:%\w+%|\$\{?\w+\}?|~(?:[a-z][\w-]*)?)[\\/][^\s\"'<>|]*"),
        ("path", r"(?<![\w.:/)\]}])(?:[A-Za-z][\w.-]*:)?/(?:[^\s/\"'<>|]+/)+[^\s/\"'<>|]*"),
        ("path", r"(?<![\w.:/)\]}])/(?:home|root|users|tmp|var|mnt|media|opt|srv|data|volumes|scratch|etc|usr)\b"),
        ("date", rf"(?<![\d.]){_YEAR}-?[01]\d-?[0-3]\d[T ]?[0-2]\d:?[0-5]\d(?::?[0-6]\d(?:[.,]\d+)?)?{_ZONE}(?!\d)"),
        ("date", rf"(?<![\d.]){_YEAR}([-/._])[01]?\d\1[0-3]?\d(?![\d.]?\d)(?:[T ]+{_CLOCK})?"),
        ("date", rf"(?<![\d.])[0-3]?\d([-/.])[01]?\d\1{_YEAR}(?!\d)(?:[T, ]+{_CLOCK})?"),
        ("date", r"(?<![\d./])[0-3]?\d/[0-3]?\d/\d\d(?![\d/])"),
        ("date", rf"\b[0-3]?\d(?:st|nd|rd|th)?\.?\s+{_MONTH},?\s+{_YEAR}\b"),
        ("date", rf"\b{_MONTH}\s+[0-3]?\d(?:st|nd|rd|th)?,?\s+{_YEAR}\b"),
        ("date", rf"\b{_MONTH}\s+[0-3]?\d\s+{_CLOCK}(?:\s+{_YEAR})?"),
        ("date", rf"\b(?:[0-3]?\d(?:st|nd|rd|th)?\.?\s+(?:{_FULL})|(?:{_FULL})\s+[0-3]?\d(?:st|nd|rd|th)?)\b"),
        ("date", rf"\b{_YEAR}-?W[0-5]\d(?:-?[1-7])?\b"),
        ("date", rf"(?<![A-Za-z0-9.]){_YEAR}(?:0[1-9]|1[0-2])(?:0[1-9]|[12]\d|3[01])(?![A-Za-z0-9]|\.\d)"),
        ("date", r"(?<![A-Za-z0-9.])1[0-9]{9}(?:[0-9]{3}){0,3}(?:\.\d+)?\b"),
        ("time", rf"(?<![\w:.]){_CLOCK}(?![\w:])"),
        ("host", r"(?<![\w:-])(?:[0-9a-f]{2}[:-]){5}[0-9a-f]{2}(?![\w:-])"),
        ("host", r"(?<![\d.])(?:\d{1,3}\.){3}\d{1,3}(?![\d.])"),
        ("host", r"\b[\w-]+(?:\.[\w-]+)*\.(?:local|localdomain|lan|internal|intranet|intra|corp|home)\b"),
        ("host", rf"(?<![/@.\w])(?:[a-z0-9][\w-]*\.){{2,}}(?-i:{_TOP})(?!\.?\w)"),
        ("host", r"\b(?-i:(?:DESKTOP|LAPTOP|WIN)-[A-Z0-9]{3,})\b"),
        ("host", rf"(?<![\[\w-])[\w-]*(?:{_MACHINE})-?\d+\b"),
    )
)  # fmt: skip
# Names that show themselves once are removed everywhere: (kind, pattern with the name as its group).
TELLTALES: tuple[tuple[str, re.Pattern[str]], ...] = tuple(
    (kind, re.compile(pattern, re.IGNORECASE))
    for kind, pattern in (
        ("user", r"/(?:home|users)/([^\s/\"'<>|:]+)"),
        ("user", r"[a-z]:[\\/](?:users|documents and settings)[\\/]([^\\/:*?\"<>|\r\n]+)"),
        ("user", rf"\b({_NAME})@[A-Za-z]"),
        ("user", r"\b(?:user|user ?name|login|operator|logged by|recorded by)\s*[:=]\s*([\w.-]+)"),
        ("host", rf"\b{_NAME}@([A-Za-z][\w.-]*)"),
        ("host", r"\\\\([\w-]+)(?:\.[\w.-]+)?\\"),
        ("host", r"\b[a-z][a-z0-9+.-]*://(?:[^\s/@]+@)?([a-z][\w-]*)(?![\w.-]*\.(?:org|com|net|edu))"),
        ("host", r"(?<![\w.:/])([a-z][a-z]*(?:\d|-)[\w-]*):/(?!/)"),
        ("host", r"\b(?:host|host ?name|computer|machine name|node)\s*[:=]\s*([\w.-]+)"),
    )
)
USER_KEYS = {"user", "username", "user_name", "login", "operator", "logged_by", "recorded_by"}
HOST_KEYS = {"host", "hostname", "host_name", "computer", "computer_name"}
# Names of accounts and machines that many have, and that are words of their own.
COMMON = {
    "root", "admin", "administrator", "user", "users", "guest", "public", "default", "runner", "build", "home", "lab",
    "localhost", "local", "host", "server", "main", "date", "time", "path", "address", "the", "and", "cell", "finger",
    "hand", "human", "bench", "session", "data",
}  # fmt: skip


@dataclass
class Redactor:
    """Replaces what would tell who measured where and when; equal things get equal marks.

    Attributes:
        private: further words to remove, by kind (`user` or `host`).
        marks: (kind, word in lower case) -> mark, of everything that was replaced so far.
    """

    private: dict[str, str] = field(default_factory=dict)
    marks: dict[tuple[str, str], str] = field(default_factory=dict)
    _cleaned: dict[str, str] = field(default_factory=dict, repr=False)

    def learn(self, value: Any) -> None:
        """Note the names of users and hosts that plain data give away."""
        for key, text in _texts(value):
            if key.lower() in USER_KEYS | HOST_KEYS:
                kind = "user" if key.lower() in USER_KEYS else "host"
                for word in (text, *(w for w in text.split() if w[:1].isupper())):
                    self._note(kind, word)
            for kind, pattern in TELLTALES:
                for match in pattern.finditer(text):
                    self._note(kind, match[1])

    def __call__(self, value: Any, key: str = "", numbers: bool = False) -> Any:
        """Return plain data without anything private; a date in a key of its own (`…_utc`) becomes None.

        Args:
            value: texts, numbers, lists and mappings.
            key: that it stands under.
            numbers: whether numbers that count from 1970 are dates.
        """
        if isinstance(value, Mapping):
            return {self.text(str(k)): self(v, str(k), numbers) for k, v in value.items()}
        if isinstance(value, (list, tuple)):
            # Most of a table is numbers that count nothing from 1970.
            dated = key.endswith("_utc")
            return [v if type(v) is float and v < _OF_1990 and not dated else self(v, key, numbers) for v in value]
        if key.endswith("_utc"):
            return None
        if isinstance(value, str):
            # A serial number may be digits that look like a date.
            return value if key == "serial" and value.isalnum() else self.text(value)
        if numbers and isinstance(value, (int, float)) and not isinstance(value, bool) and _since_1970(value):
            return self._mark("date", str(value))
        return value

    def text(self, text: str) -> str:
        """Return a text without anything private."""
        if text in _RESERVED:
            return text
        if text not in self._cleaned:  # a session of many cases says the same words over and over
            self._cleaned[text] = self._without_private(text)
        return self._cleaned[text]

    def _without_private(self, text: str) -> str:
        for kind, pattern in PATTERNS:
            text = pattern.sub(lambda m, kind=kind: self._mark(kind, m[0]), text)  # type: ignore[misc]
        for word, kind in sorted(self.private.items(), key=lambda item: (-len(item[0]), item[0])):
            text = re.sub(
                rf"(?<![A-Za-z0-9]){re.escape(word)}(?![A-Za-z0-9])",
                lambda m, kind=kind: self._mark(kind, m[0]),  # type: ignore[misc]
                text,
                flags=re.IGNORECASE,
            )
        return text

    def counts(self) -> dict[str, int]:
        """Number of different things replaced, by kind."""
        kinds = [kind for kind, _ in self.marks]
        return {kind: kinds.count(kind) for kind in sorted(set(kinds))}

    def _note(self, kind: str, word: str) -> None:
        name = word.strip(" .,;:-_").lower()
        if len(name) > 2 and name not in COMMON and name not in _RESERVED and not name.isdigit():
            self.private.setdefault(name, kind)
            self._cleaned.clear()

    def _mark(self, kind: str, found: str) -> str:
        number = sum(k == kind for k, _ in self.marks) + 1
        return self.marks.setdefault((kind, found.lower()), f"[{kind}-{number}]")


def this_computer() -> Redactor:
    """Return a redactor that knows the names of this user and of this computer."""
    out = Redactor()
    found = [("host", socket.gethostname()), ("host", socket.gethostname().split(".")[0])]
    with suppress(OSError, KeyError, ImportError, RuntimeError):  # where there are no such names
        found += [("user", getpass.getuser()), ("user", Path.home().name)]
    for kind, word in found:
        out._note(kind, word)
    return out


def _texts(value: Any) -> Collection[tuple[str, str]]:
    """Return every text in plain data with the key that it stands under, and every key, each once and in order."""
    found: dict[tuple[str, str], None] = {}
    keys: set[Any] = set()

    def look(value: Any, key: str) -> None:
        if isinstance(value, str):
            found[key, value] = None
        elif isinstance(value, Mapping):
            for k, v in value.items():
                if k not in keys:
                    keys.add(k)
                    found["", str(k)] = None
                if type(v) is not float:
                    look(v, str(k))
        elif isinstance(value, (list, tuple)):
            for v in value:
                if type(v) is not float:
                    look(v, key)

    look(value, "")
    return found.keys()


# Seconds from 1970.
_OF_1990 = 6.3e8


def _since_1970(number: float) -> bool:
    """Return whether a number may count seconds, ms, us or ns from 1970 to a day between 1990 and 2100."""
    return number > _OF_1990 and any(_OF_1990 < number / unit < 4.2e9 for unit in (1.0, 1e3, 1e6, 1e9))


def _reserved() -> frozenset[str]:
    """Return words that a session's description is made of, and their parts."""
    records = [r for r in vars(session_models).values() if isinstance(r, type) and hasattr(r, "model_fields")]
    names = {name for record in records for name in record.model_fields}
    names |= {*vocabulary.TENDONS, *vocabulary.JOINT_ANGLES, *vocabulary.ROLES, *vocabulary.LOCATIONS}
    names |= {*vocabulary.EVENT_KINDS, "loading", "unloading", "slack", "hanger_on", "preload", "left", "right"}
    names |= {"estimate", "force_balance", session_models.FORMAT, READINGS, "finger.yaml"}
    return frozenset(n.lower() for n in {part for name in names for part in (name, *name.split("_"))}) | names


_RESERVED = _reserved()
