"""Sessions as they are kept: begun, edited with an undo, closed, and hidden instead of deleted."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, Literal

from sqlalchemy import case, delete, exists, func, insert, select, update

from daq.bench.record import STARTED
from daq.errors import OutsideError
from daq.sessions import FINGER_DOCUMENT, parse_session, plain_document
from daq.uplink.wire import require_session_id
from fingermodel.fingers.files import finger_from_dict
from server.service.ingest.stored import raise_version, require_own
from server.service.ingest.windows import Windows
from server.service.sessions.planned import PLAN, edit_of, proposal
from server.service.sessions.records import WINDOWS, EditKind, Record, is_closed, read_record, undone_edits
from server.service.sessions.sizes import MOST_CASES, require_case_id, require_sizes
from server.service.storage.audit import actor
from server.service.storage.checksums import fingerprint
from server.service.storage.database import Database, now_utc
from server.service.storage.messages import Messages, Telling
from server.service.storage.purge import erase
from server.service.storage.schema import edits, events, sessions, streams
from server.service.web.problems import ProblemError, not_found, shortened

# A session that is begun is new, there already, or deleted and brought back.
Begun = Literal["new", "there", "back"]


class Sessions:
    """Keeps sessions.

    Args:
        database: where they are kept.
        messages: are told of every change.
        fingers: names of the fingers that a session may name.
        windows: tells whether a window lies within its recording.

    Attributes:
        fingers: those names.
    """

    def __init__(self, database: Database, messages: Messages, fingers: frozenset[str], windows: Windows) -> None:
        self._database, self._messages, self.fingers, self._windows = database, messages, fingers, windows

    def create(
        self,
        name: str,
        document: Mapping[str, Any] | None,
        *,
        bench: Collection[str] | None = None,
        arriving: bool = False,
    ) -> Begun:
        """Begin a session; one that was deleted is brought back by its own document, with its edits and searches.

        Where readings alone came, and nothing tells what they are of, a document does from here on.

        Args:
            name: its id.
            document: a bench-session/1 that is known already; None where a bench will send its record.
            bench: streams of the journal of the bench that begins it; None where it is no bench.
            arriving: whether it is hidden until `arrive`, and gone where that never comes.

        Returns:
            whether it is new, there already, or back.

        Raises:
            ProblemError: 409 another session has the id, or had it.
            InputError: the id or the document cannot be used.
        """
        require_session_id(name)
        kept = None if document is None else self._sound(name, document)
        with self._messages.writing() as telling:
            connection = telling.connection
            row = connection.execute(select(sessions).where(sessions.c.id == name)).first()
            if row is not None:
                if row.arriving:
                    raise ProblemError(
                        409,
                        f"session {name} is being taken in",
                        "the end of that, or another id",
                        "Try again in a minute",
                    )
                if bench is not None and row.deleted_utc is None:
                    require_own(connection, name, bench)
                alone = row.deleted_utc is None and read_record(connection, name).source == "none"
                if kept is not None and alone and not arriving:
                    raise_version(connection, name, document=kept, specimen=kept["specimen"]["id"])
                    telling.record("session described", name, _fingerprint(kept))
                    telling.tell("session", name, {"change": "described"})
                    return "there"
                if row.document != kept or (row.deleted_utc is not None and kept is None):
                    what = "was deleted, and ids are not used twice" if row.deleted_utc else "is there, and differs"
                    # What a bench sent and what was purged have no document to tell the session by.
                    same = "" if row.document is None else "the same document, or "
                    raise ProblemError(
                        409,
                        f"session {name} {what}",
                        f"{same}another id",
                        "Change the id in session.yaml",
                    )
                if row.deleted_utc is None:
                    return "there"
                raise_version(connection, name, deleted_utc=None)
                telling.record("session restored", name, _fingerprint(kept))
                telling.tell("session", name, {"change": "restored"})
                return "back"
            specimen = None if kept is None else kept["specimen"]["id"]
            values = {"id": name, "created_utc": now_utc(), "document": kept, "specimen": specimen}
            if arriving:
                values |= {"arriving": True, "deleted_utc": now_utc()}
            else:
                telling.record("session created", name, _fingerprint(kept))
                telling.tell("session", name, {"change": "created"})
            connection.execute(insert(sessions).values(values))
        return "new"

    def arrive(self, name: str) -> None:
        """Show a session that was arriving, since all of it is there."""
        with self._messages.writing() as telling:
            here = (sessions.c.id == name) & sessions.c.arriving.is_(True)
            document = telling.connection.execute(select(sessions.c.document).where(here)).scalar()
            telling.record("session created", name, _fingerprint(document))
            telling.connection.execute(update(sessions).where(here).values(arriving=None, deleted_utc=None))
            telling.tell("session", name, {"change": "created"})

    def forget_arrivals(self, name: str | None = None) -> None:
        """Remove sessions that were arriving when their import ended, one of them or all, with what came of them."""
        query = select(sessions.c.id).where(sessions.c.arriving.is_(True))
        for left in self._database.rows(query if name is None else query.where(sessions.c.id == name)):
            erase(self._database, left.id)
            with self._database.writing() as connection:
                connection.execute(delete(sessions).where(sessions.c.id == left.id))

    def read(self, name: str) -> Record:
        """Return a session as it stands.

        Raises:
            ProblemError: 404 there is none.
        """
        with self._database.reading() as connection:
            return read_record(connection, name)

    def version(self, name: str) -> int:
        """Return the version of a session, which every change raises.

        Raises:
            ProblemError: 404 there is none.
        """
        query = select(sessions.c.version).where((sessions.c.id == name) & sessions.c.deleted_utc.is_(None))
        found = self._database.value(query)
        if found is None:
            raise not_found("session", name, "/api/v1/sessions")
        return int(found)

    def streams(self, name: str) -> int:
        """Return how many streams of readings a session has."""
        return int(self._database.value(select(func.count()).where(streams.c.session == name)))

    def listed(self, specimen: str | None = None, limit: int = 100, after: str = "") -> list[dict[str, Any]]:
        """Return sessions by id, after one of them."""
        kept = sessions.c
        # Documents may have megabytes, and are not read for this.
        began = exists().where((events.c.session == kept.id) & events.c.body.contains(f'"{STARTED}"'))
        source = case((kept.document.is_not(None), "document"), (began, "bench"), else_="none").label("source")
        count = select(func.count()).where(streams.c.session == kept.id).scalar_subquery().label("streams")
        query = select(kept.id, kept.specimen, source, kept.version, kept.created_utc, kept.closed_utc, count)
        query = query.where(kept.deleted_utc.is_(None), kept.id > after).order_by(kept.id).limit(limit)
        if specimen is not None:
            query = query.where(kept.specimen == specimen)
        rows = self._database.rows(query)
        return [{**row._mapping, "closed": is_closed(row.source, row.closed_utc)} for row in rows]

    def close(self, name: str) -> None:
        """Close a session: predictions of its validation cases may be seen from here on.

        Raises:
            ProblemError: 404 there is none, 409 a bench is the one to close it.
        """
        with self._messages.writing() as telling:
            record = read_record(telling.connection, name)
            if record.closed:
                return
            if record.source == "bench":
                raise ProblemError(
                    409,
                    f"session {name} is held by a bench",
                    "the bench to close it",
                    "Close it there (fingertwin log)",
                )
            raise_version(telling.connection, name, closed_utc=now_utc())
            telling.record("session closed", name, {})
            telling.tell("session", name, {"change": "closed"})

    def delete(self, name: str) -> None:
        """Hide a session; what it holds is kept until a purge, and its own document brings it back.

        Raises:
            ProblemError: 404 there is none.
        """
        with self._messages.writing() as telling:
            read_record(telling.connection, name)
            raise_version(telling.connection, name, deleted_utc=now_utc())
            telling.record("session deleted", name, {})
            telling.tell("session", name, {"change": "deleted"})

    def edit(
        self,
        name: str,
        kind: EditKind,
        case: str | None,
        body: Mapping[str, Any],
        *,
        undoes: int | None = None,
    ) -> int:
        """Add an edit, unless it would make the session unusable.

        Returns:
            its number.

        Raises:
            ProblemError: 404 no such session, case or edit; 409 it is undone already, or the bench is still running;
                422 the case is excluded, or included, already.
            InputError: the session could not be used with it.
        """
        require_sizes(body)
        if kind == "case":
            require_case_id(case)
        with self._messages.writing() as telling:
            connection = telling.connection
            record = read_record(connection, name)
            self._require_possible(record, kind, case, undoes)
            number = _keep(telling, name, kind, case, body, undoes)
            # Before it is kept: what the session would be.
            changed = read_record(connection, name)
            if changed.cases:
                self._require_within(record, changed)
        return number

    def propose(self, name: str, body: Mapping[str, Any]) -> int:
        """Propose a load case to be measured; it stands on the checklist until it is, or is taken back.

        Args:
            name: of the session.
            body: posture, location, masses_g [g] and why.

        Returns:
            the number of the edit.

        Raises:
            ProblemError: 404 no such session, 409 it has no record, 422 the case could not be measured with it.
        """
        require_sizes(body)
        with self._messages.writing() as telling:
            case, kept = proposal(read_record(telling.connection, name), body)
            return _keep(telling, name, PLAN, case, kept, None)

    def withdraw(self, name: str, case: str) -> int:
        """Take a proposed load case back.

        Returns:
            the number of the edit that does so, which can be undone.

        Raises:
            ProblemError: 404 no such session, or no such proposal.
        """
        with self._messages.writing() as telling:
            number = edit_of(read_record(telling.connection, name), case)
            return _keep(telling, name, "undo", case, {}, number)

    def _require_possible(self, record: Record, kind: str, case: str | None, undoes: int | None) -> None:
        where = f"/api/v1/sessions/{record.id}"
        record.require_document()
        names = {c["id"] for c in record.cases}
        if kind == "undo":
            known = {e.number for e in record.edits}
            if undoes not in known:
                raise not_found("edit", str(undoes), f"{where}/edits")
            if undoes in undone_edits(record.edits):
                raise ProblemError(
                    409, f"edit {undoes} is undone already", "one that is in force", "Look at the session's edits"
                )
        elif kind == "case":
            if case in names:
                raise ProblemError(409, f"case {case} is there already", "a new id", "A repeat is added, none replaced")
            if len(names) >= MOST_CASES:
                raise ProblemError(409, f"{len(names)} cases", f"at most {MOST_CASES}", "Begin another session")
        elif case not in names:
            raise not_found("case", str(case), f"{where}/cases")
        if kind == "exclude" and record.source == "bench" and not record.closed:
            raise ProblemError(
                409,
                f"session {record.id} is held by a bench",
                "an exclusion at the bench, before predictions are seen",
                "Exclude the case at the bench, or wait until the bench has closed the session",
            )
        if kind in ("exclude", "include"):
            _require_changed(record, kind, str(case))

    def _require_within(self, before: Record, after: Record) -> None:
        """Refuse windows that an edit brings and that lie outside the recording: no case could be compared then.

        Raises:
            InputError: one does, or the session cannot be used.
        """
        had = {tuple(c[k]) for c in before.cases if c.get("excluded") is None for k in WINDOWS if c.get(k)}
        new = {
            window: f"case {case.id}: {key}"
            for case in after.session().cases if case.excluded is None
            for key, window in case.windows() if window not in had
        }  # fmt: skip
        for fault in self._windows.reduce(after.id, after.stream, new).failed.values():
            if isinstance(fault, OutsideError):
                raise fault

    def _sound(self, name: str, document: Mapping[str, Any]) -> dict[str, Any]:
        """Return a document that can be used, with nothing that would reach a file."""
        given = dict(document)
        if given.get("id") != name:
            raise ProblemError(
                422,
                f"the document's id is {shortened(given.get('id'))!r}",
                repr(name),
                "Send it to the session of its own id, or change the id",
            )
        require_sizes(given)
        session, faults = parse_session(given, None)
        if session is None:
            more = [{"where": "document", "found": shortened(f)} for f in faults[:50]]
            raise ProblemError(422, faults[0].found, faults[0].expected, faults[0].remedy, errors=more)
        finger = given.get(FINGER_DOCUMENT)
        if finger is not None:
            finger_from_dict(finger, f"the finger of {name}")
        elif session.finger not in self.fingers:
            raise ProblemError(
                422,
                f"finger {shortened(session.finger)!r}",
                f"one of {', '.join(sorted(self.fingers))}, or its document as {FINGER_DOCUMENT}",
                "Add the finger's document, or name a finger of GET /api/v1/fingers",
            )
        return plain_document(session)


def _require_changed(record: Record, kind: str, case: str) -> None:
    """Refuse to leave out what is left out, and to take in what is not: its undo would seem without effect."""
    entry = next(c for c in record.cases if c["id"] == case)
    why = entry.get("excluded")
    if kind == "exclude" and why is not None:
        raise ProblemError(422, f"{case} is excluded already ({shortened(why)})", "another case", "Include it first")
    if kind == "include" and why is None:
        raise ProblemError(422, f"{case} is not excluded", "a case that is", "Undo its amendment if that leaves it out")


def _fingerprint(document: Mapping[str, Any] | None) -> dict[str, Any]:
    return {"document_sha256": None if document is None else fingerprint(document)}


def _keep(
    telling: Telling,
    session: str,
    kind: str,
    case: str | None,
    body: Mapping[str, Any],
    undoes: int | None,
) -> int:
    """Add an edit, raise the version and tell of it; return its number."""
    connection = telling.connection
    change = {"kind": kind, "case": case, "body": dict(body), "undoes": undoes}
    values = {"session": session, "created_utc": now_utc(), "author": actor().who} | change
    number = int(connection.execute(insert(edits).values(values).returning(edits.c.number)).scalar_one())
    raise_version(connection, session)
    telling.record("session edited", session, {"edit": number} | change)
    telling.tell("session", session, {"change": "edited", "edit": number, "kind": kind, "case": case})
    return number
