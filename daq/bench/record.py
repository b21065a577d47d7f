"""Record of a bench, folded from its events alone: the same live as from the journal of a bench that crashed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from daq.checks.description import session_findings
from daq.errors import SessionError
from daq.journal.rows import Event
from daq.sessions import FINGER_DOCUMENT, parse_session
from daq.sessions.models import FORMAT, Session
from daq.sessions.protocols import PlannedCase, Protocol, plan
from daq.vocabulary import EVENT_KINDS

STARTED, RESUMED = "bench_started", "bench_resumed"
# Kinds that a session knows too; "note" is made from several others.
_SAME_KIND = tuple(k for k in EVENT_KINDS if k != "tare")


@dataclass(frozen=True)
class BenchSetup:
    """Setup known before the first reading; plain data, as in session.yaml.

    Attributes:
        id: of the session.
        specimen: pseudonym, species, digit, side, and what else a specimen may have.
        finger: a parameter set, or a path; finger_document: what that file says, for whoever has the events alone.
        protocol: that is followed; protocol_name: as the user named it.
        load_cell: model, serial and calibration, which a log needs; rate_hz and mounts.
        tension_factor: friction correction c, or {estimate: force_balance}.
        known_weight: {mass_g, direction, mount} that the protocol begins and ends with, None where it is told later.
        unloaded_state: slack, hanger_on or preload, in all cases.
        environment, budget: as in a session.
    """

    id: str
    specimen: Mapping[str, Any]
    finger: str
    protocol: Protocol
    load_cell: Mapping[str, Any]
    tension_factor: float | Mapping[str, str]
    protocol_name: str = ""
    gravity_m_s2: float = 9.81
    known_weight: Mapping[str, Any] | None = None
    unloaded_state: str | None = None
    environment: Mapping[str, Any] | None = None
    budget: Any = None
    finger_document: Mapping[str, Any] | None = None

    def cases(self) -> tuple[PlannedCase, ...]:
        """Return the protocol's cases in order."""
        return plan(self.protocol)[0]

    def header(self) -> dict[str, Any]:
        """Return a session's plain data but for its cases, checks, events and readings."""
        out: dict[str, Any] = {
            "format": FORMAT,
            "id": self.id,
            "specimen": dict(self.specimen),
            "finger": self.finger,
            FINGER_DOCUMENT: self.finger_document,
            "load_cell": dict(self.load_cell),
            "gravity_m_s2": self.gravity_m_s2,
            "tension_factor": self.tension_factor,
            "postures_deg": {k: dict(v) for k, v in self.protocol.postures_deg.items()},
            "environment": self.environment and dict(self.environment),
            "budget": self.budget,
            "protocol": self.protocol_name or self.protocol.id,
        }
        return {k: v for k, v in out.items() if v is not None}

    def require_sound(self) -> Session:
        """Find now what would make the session unusable hours later; return it with its plan for cases.

        Raises:
            SessionError: something is wrong or lacks.
        """
        lacks = [k for k in ("model", "serial", "calibration") if not self.load_cell.get(k)]
        if lacks:
            raise SessionError(f"the load cell's {' and '.join(lacks)} lack", "what its certificate says", "Give them")
        cases = [_shown(c) | {"force_N": [0.0, 0.0, 0.0]} for c in self.cases()]
        if self.unloaded_state is not None:
            cases[0]["unloaded_state"] = self.unloaded_state
        checks = [] if self.known_weight is None else [self.check(self.known_weight)]
        document = self.header() | {"cases": cases, "checks": checks, "readings": "readings.csv"}
        session, faults = parse_session(document, None)
        if session is None:
            raise faults[0]
        for found in session_findings(session):
            if found.level == "error":
                raise SessionError(f"{found.where}: {found.text}")
        return session

    def check(self, weight: Mapping[str, Any]) -> dict[str, Any]:
        """Return a known weight as a session's check, its windows made up."""
        made_up = {"when": "during", "unloaded_s": [0.0, 1.0], "loaded_s": [2.0, 3.0]}
        return made_up | {"mount": self.cases()[0].location} | dict(weight)

    def as_value(self) -> dict[str, Any]:
        """Return plain data for an event."""
        same = {k: v for k, v in vars(self).items() if k != "protocol"}
        return same | {"protocol": self.protocol.model_dump(mode="json")}

    @classmethod
    def of_value(cls, value: Mapping[str, Any]) -> BenchSetup:
        """Make a setup of an event's value."""
        return cls(**{**value, "protocol": Protocol.model_validate(value["protocol"])})


@dataclass
class BenchRecord:
    """The fold of a bench's events.

    Attributes:
        setup: of the bench.
        cases: taken, as in session.yaml, by id in order; repeats beside what they repeat.
        checks: known weights, as in session.yaml.
        events: as in session.yaml.
        closed: whether the bench was closed, and predictions shown.
    """

    setup: BenchSetup
    cases: dict[str, dict[str, Any]] = field(default_factory=dict)
    checks: list[dict[str, Any]] = field(default_factory=list)
    events: list[dict[str, Any]] = field(default_factory=list)
    closed: bool = False

    @property
    def excluded(self) -> tuple[str, ...]:
        """Ids of the cases that are left out."""
        return tuple(name for name, case in self.cases.items() if "excluded" in case)

    @classmethod
    def of(cls, events: Iterable[Event]) -> BenchRecord:
        """Fold a bench's events, the first of which says how it was set up.

        Raises:
            SessionError: none does.
        """
        record: BenchRecord | None = None
        for event in events:
            if event.kind == STARTED:
                record = cls(BenchSetup.of_value(event.value))
            elif record is not None:
                record.apply(event)
        if record is None:
            raise SessionError("the journal holds readings, but no bench session was begun", "a bench's events")
        return record

    def apply(self, event: Event) -> None:
        """Take one more event; kinds that a session has no place for are passed over."""
        value = dict(event.value)
        if event.kind == "case_taken":
            self.cases[value["id"]] = value
        elif event.kind == "tare":
            for name in value["brackets"]:
                self.cases[name]["unloaded_after_s"] = value["window_s"]
            self._note("tare", event.at_s, value["window_s"])
        elif event.kind == "known_weight":
            self.checks.append(value)
        elif event.kind == "excluded":
            self.cases[value["case"]]["excluded"] = value["reason"]
        elif event.kind == "included":
            del self.cases[value["case"]]["excluded"]
        elif event.kind == "closed":
            self.closed = True
        elif event.kind in _SAME_KIND:
            text = value.pop("text", None)
            self._note(event.kind, event.at_s, value or None, text)
        if told := _in_words(event):
            self._note("note", event.at_s, text=told)

    def document(self) -> dict[str, Any]:
        """Return the session's plain data, without the name of its readings.

        Raises:
            SessionError: no case was completed.
        """
        if not self.cases:
            raise SessionError(
                f"session {self.setup.id} has no complete case",
                "a tare and a loaded plateau that were confirmed",
                "The journal keeps the readings",
            )
        out = self.setup.header()
        used = {c["posture"] for c in self.cases.values()}
        out["postures_deg"] = {k: v for k, v in out["postures_deg"].items() if k in used}
        out["cases"] = [dict(c) for c in self.cases.values()]
        out |= {"checks": [dict(c) for c in self.checks]} if self.checks else {}
        return out | ({"events": [dict(e) for e in self.events]} if self.events else {})

    def session(self) -> Session:
        """Return the session as it stands, for its measured forces: no tension is estimated.

        Raises:
            SessionError: no case was completed.
        """
        document = self.document() | {"readings": "readings.csv", "tension_factor": 1.0}
        session, faults = parse_session(document, None)
        if session is None:
            raise faults[0]
        return session

    def _note(self, kind: str, at_s: float, value: Any = None, text: str | None = None) -> None:
        note = {"t_s": round(at_s, 3), "kind": kind, "value": value, "text": text}
        self.events.append({k: v for k, v in note.items() if v is not None})


def _in_words(event: Event) -> str:
    """Return what a session notes of an event that it has no kind for, or nothing."""
    value = event.value
    if event.kind == "known_weight_skipped":
        return f"the known weight {value['when']} the cases was skipped"
    if event.kind == "case_skipped":
        return f"case {value['id']} was skipped"
    if event.kind == "included":
        return f"case {value['case']} was excluded ({value['reason']}), and is taken in again"
    if event.kind == "loaded" and value.get("done"):
        return f"{value['step']}: {value['done']}"
    if event.kind == RESUMED:
        gone = f"the log broke off at {value['broke_off_s']:.1f} s and went on at {event.at_s:.1f} s"
        return f"{gone}; tares before it are not used after it"
    if event.kind == "closed" and value["undone"]:
        return f"closed without cases {' '.join(value['undone'])}"
    return ""


def _shown(case: PlannedCase) -> dict[str, Any]:
    return {k: getattr(case, k) for k in ("id", "role", "posture", "location", "masses_g")} | case.told()
