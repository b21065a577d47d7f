"""Record of a session, from the posted document or a bench's events, and from edits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

from sqlalchemy import Connection, select

from daq.bench.record import STARTED, BenchRecord
from daq.bench.steps import Steps
from daq.errors import InputError, SessionError
from daq.journal.rows import Event
from daq.sessions import parse_session
from daq.sessions.models import AMENDABLE, Session
from server.service.ingest.stored import stored_events, streams_of
from server.service.storage.schema import edits, sessions
from server.service.web.problems import ProblemError, not_found

# What an edit may do to a session.
EditKind = Literal["case", "windows", "exclude", "include", "amend", "undo"]
WINDOWS = ("unloaded_s", "loaded_s", "unloaded_after_s")


@dataclass(frozen=True)
class Edit:
    """A change that somebody made after the bench."""

    number: int  # grows with each edit of any session
    created_utc: str
    author: str | None
    kind: str  # an EditKind, or `plan`
    case: str | None  # that it is about
    body: Mapping[str, Any]  # the case, its windows, or the reason
    undoes: int | None  # number of the edit that it takes back

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return dict(vars(self)) | {"body": dict(self.body)}


@dataclass(frozen=True, eq=False)
class Record:
    """A session as it stands."""

    id: str  # of the session
    version: int  # raised by every change
    source: str  # document, bench, or nothing yet
    # Plain data of a bench-session/1, its cases possibly none; None where nothing is known.
    document: dict[str, Any] | None
    bench: BenchRecord | None  # the fold of the bench's events, where they are the source
    closed: bool  # whether predictions of validation cases may be seen
    edits: tuple[Edit, ...]  # all, in order
    stream: str | None  # that windows are told in; None where the session has none
    created_utc: str  # when the service first heard of it
    problem: InputError | None = None  # why the document cannot be used

    def require_document(self) -> dict[str, Any]:
        """Return the document.

        Raises:
            ProblemError: 409 nothing is known of the session yet.
        """
        if self.document is None:
            raise ProblemError(
                409, f"session {self.id} has no record yet", "a document, or a bench's events", "Send one of them first"
            )
        return self.document

    @property
    def postures_deg(self) -> dict[str, Mapping[str, Any]]:
        """Postures of the session and of the protocol that it follows, by name [deg]."""
        planned = {} if self.bench is None else self.bench.setup.protocol.postures_deg
        return {**planned, **(self.document or {}).get("postures_deg", {})}

    @property
    def cases(self) -> list[dict[str, Any]]:
        """Plain data of each case."""
        return [] if self.document is None else self.document["cases"]

    @cached_property
    def amendments(self) -> dict[str, list[dict[str, Any]]]:
        """Plain data of the amendments, by case."""
        out: dict[str, list[dict[str, Any]]] = {}
        for one in (self.document or {}).get("amendments", ()):
            out.setdefault(one["case"], []).append(one)
        return out

    @cached_property
    def amended_cases(self) -> list[dict[str, Any]]:
        """Plain data of each case as it really was: what is shown, drawn and counted; `cases` are the entries."""
        out = []
        for entry in self.cases:
            case = entry
            for one in self.amendments.get(entry["id"], ()):
                case = case | {k: one[k] for k in AMENDABLE if k in one}
            out.append(case)
        return out

    def session(self) -> Session:
        """Return the session, checked.

        Raises:
            SessionError: it has no case, or cannot be used.
        """
        return self._parsed

    @cached_property
    def _parsed(self) -> Session:
        if self.problem is not None:
            raise self.problem
        if not self.cases:
            raise SessionError(f"session {self.id} has no load case yet", "a case with its windows or its force")
        session, faults = parse_session(self.document, None)
        if session is None:
            raise faults[0]
        return session


def read_record(connection: Connection, name: str) -> Record:
    """Put a session together.

    Raises:
        ProblemError: 404 there is none.
    """
    row = connection.execute(select(sessions).where(sessions.c.id == name)).first()
    if row is None or row.deleted_utc is not None:
        raise not_found("session", name, "/api/v1/sessions")
    happened = [] if row.document is not None else stored_events(connection, name)
    changes = tuple(_edits(connection, name))
    source, document, bench, problem = _base(row.document, happened)
    if document is not None:
        document = apply_edits(document, changes)
    known = streams_of(connection, name)
    return Record(
        id=name,
        version=row.version,
        source=source,
        document=document,
        bench=bench,
        closed=is_closed(source, row.closed_utc),
        edits=changes,
        stream=_stream(happened, known),
        created_utc=row.created_utc,
        problem=problem,
    )


def is_closed(source: str, closed_utc: str | None) -> bool:
    """Return whether predictions of a session's validation cases may be seen: a document is no running bench's."""
    return source == "document" or closed_utc is not None


def apply_edits(document: Mapping[str, Any], changes: Sequence[Edit]) -> dict[str, Any]:
    """Return a document with those edits that nobody took back; what no edit changes is shared with the given one."""
    out = dict(document)
    cases: dict[str, dict[str, Any]] = {c["id"]: c for c in out["cases"]}
    amended: list[dict[str, Any]] = list(out.get("amendments", ()))
    for edit in live_edits(changes):
        name = edit.case or ""
        if edit.kind == "case":
            cases[name] = dict(edit.body)
        elif name not in cases:
            continue
        elif edit.kind == "windows":
            # A window of null is taken away.
            merged = cases[name] | {k: edit.body[k] for k in WINDOWS if k in edit.body}
            cases[name] = {k: v for k, v in merged.items() if v is not None}
        elif edit.kind == "exclude":
            cases[name] = cases[name] | {"excluded": edit.body["reason"]}
        elif edit.kind == "include":
            cases[name] = {k: v for k, v in cases[name].items() if k != "excluded"}
        elif edit.kind == "amend":
            said = {"at": edit.created_utc, **({"by": edit.author} if edit.author else {})}
            amended += [dict(a) | said for a in edit.body["amendments"]]
    return out | {"cases": list(cases.values())} | ({"amendments": amended} if amended else {})


def steps_of(record: Record) -> list[dict[str, str]]:
    """Return each step with what is hung where, and whether it is done."""
    cases = {c["id"]: c for c in record.amended_cases}
    planned = Steps.of(record.bench.setup.cases()).all if record.bench is not None else []
    weighed = {str(c.get("when")) for c in (record.document or {}).get("checks", [])}
    out = []
    for step in planned:
        done = step.when in weighed if step.case is None else step.id in cases
        excluded = "excluded" in cases.get(step.id, {})
        out.append({"id": step.id, "text": step.text, "state": "excluded" if excluded else "done" if done else "open"})
    known = {s["id"] for s in out}
    for name, case in cases.items():
        if name not in known:
            masses = " ".join(f"{tendon} {mass:g} g" for tendon, mass in (case.get("masses_g") or {}).items())
            again = f", repeat of {case['repeat_of']}" if case.get("repeat_of") else ""
            text = f"{masses or 'no weight'}, {case.get('posture')}, {case.get('location')}{again}"
            out.append({"id": name, "text": text, "state": "excluded" if "excluded" in case else "done"})
    return out


def undone_edits(changes: Sequence[Edit]) -> set[int]:
    """Return numbers of the edits that are taken back; an undo may be undone too."""
    undone: set[int] = set()
    for edit in reversed(changes):
        if edit.kind == "undo" and edit.number not in undone and edit.undoes is not None:
            undone.add(edit.undoes)
    return undone


def changed_since(changes: Sequence[Edit], at_utc: str) -> bool:
    """Return whether other edits are in force than were at a time; what is proposed to measure changes nothing."""
    then = live_edits([e for e in changes if e.created_utc <= at_utc])
    return [e.number for e in then if e.kind != "plan"] != [e.number for e in live_edits(changes) if e.kind != "plan"]


def live_edits(changes: Sequence[Edit]) -> list[Edit]:
    """Return the edits that are in force."""
    undone = undone_edits(changes)
    return [e for e in changes if e.kind != "undo" and e.number not in undone]


def _base(
    posted: dict[str, Any] | None, happened: Sequence[Event]
) -> tuple[str, dict[str, Any] | None, BenchRecord | None, InputError | None]:
    if posted is not None:
        return "document", posted, None, None
    if not any(e.kind == STARTED for e in happened):
        return "none", None, None, None
    try:
        bench = BenchRecord.of(happened)
        document = bench.document() if bench.cases else bench.setup.header() | {"cases": []}
    except InputError as error:
        return "bench", None, None, error
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        # Events of another software, or of a newer one.
        problem = SessionError(f"the bench's events cannot be read ({error!r:.200})", "events of fingertwin log")
        return "bench", None, None, problem
    # Readings are streams here; a file that the document names stays with whoever has it.
    return "bench", document | {"readings": "readings.parquet"}, bench, None


def _stream(happened: Sequence[Event], known: Sequence[str]) -> str | None:
    told = [e.stream for e in happened if e.kind == STARTED and e.stream in known]
    return told[-1] if told else (known[0] if known else None)


def _edits(connection: Connection, name: str) -> list[Edit]:
    rows = connection.execute(select(edits).where(edits.c.session == name).order_by(edits.c.number)).all()
    return [Edit(r.number, r.created_utc, r.author, r.kind, r.case, r.body or {}, r.undoes) for r in rows]
