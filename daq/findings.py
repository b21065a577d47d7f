"""Findings of a session's check: each names what was found, what was expected, and the remedy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from daq.errors import InputError

SCHEMA = "fingertwin/check/1"
Level = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """One finding.

    Attributes:
        level: error (do not use what it concerns), warning (look at it) or note.
        code: short name for scripts.
        where: place in the session, such as `case c004: loaded_s`.
        text: one line.
    """

    level: Level
    code: str
    where: str
    text: str

    @property
    def line(self) -> str:
        """The place, where there is one, and the text."""
        return f"{self.where}: {self.text}" if self.where else self.text

    def as_warning(self) -> dict[str, str]:
        """Return plain data, as every answer that judges a session carries it."""
        return {"level": self.level, "code": self.code, "place": self.where, "words": self.text}


def finding(level: Level, code: str, where: str, found: str, expected: str = "", remedy: str = "") -> Finding:
    """Make a finding whose text is built like that of an error."""
    return Finding(level, code, where, str(InputError(found, expected, remedy)))


def warnings_by_session(found: Sequence[tuple[str, Sequence[Finding]]]) -> list[dict[str, str]]:
    """Return the warnings of sessions by their id; of several, each place begins with it."""
    several = len(found) > 1
    warned = [(name, finding.as_warning()) for name, findings in found for finding in findings]
    return [w | {"place": f"{name}: {w['place']}"} if several else w for name, w in warned]


def warning_line(warning: Mapping[str, Any]) -> str:
    """Return a warning of an answer as a line that says whether it is an error; older answers do not know."""
    level = "Error found by the check" if warning.get("level") == "error" else "Warning"
    return f"{level}: {warning['place']}: {warning['words']}"


@dataclass(frozen=True)
class CheckReport:
    """Everything that a check found.

    Attributes:
        session: its id, or the path that was asked for.
        findings: errors first, then warnings, then notes.
        facts: numbers of the recording, tares and known weights, units in the keys; None for what is unknown.
    """

    session: str
    findings: tuple[Finding, ...]
    facts: Mapping[str, Any] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """True if there is no error."""
        return not self.errors

    @property
    def errors(self) -> tuple[Finding, ...]:
        """The errors."""
        return self.at("error")

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """The warnings."""
        return self.at("warning")

    @property
    def notes(self) -> tuple[Finding, ...]:
        """The notes."""
        return self.at("note")

    def at(self, level: Level) -> tuple[Finding, ...]:
        """Return the findings of one level."""
        return tuple(f for f in self.findings if f.level == level)

    def as_dict(self) -> dict[str, Any]:
        """Return the answer as plain data."""
        return {
            "schema": SCHEMA,
            "session": self.session,
            "ok": self.ok,
            "errors": len(self.errors),
            "warnings": len(self.warnings),
            "findings": [asdict(f) for f in self.findings],
            **self.facts,
        }


def report(session: str, findings: list[Finding], facts: Mapping[str, Any]) -> CheckReport:
    """Put findings in order: errors, warnings, notes, each as they were found."""
    order = {"error": 0, "warning": 1, "note": 2}
    return CheckReport(session, tuple(sorted(findings, key=lambda f: order[f.level])), facts)
