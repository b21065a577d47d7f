"""Readings and events of benches, taken in: once, whole, and never another in their place.

Chunk and cursor go into one transaction, and only then comes an answer. What is sent again is a success and changes
nothing; what would lie over something else is a conflict that names what is stored.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from sqlalchemy import Connection, Row, case, func, insert, select, update

from daq.acquisition.blocks import Chunk
from daq.bench.record import STARTED
from daq.errors import JournalError, ReadingsError
from daq.journal.rows import Event
from daq.recordings.columns import HEADERS
from daq.recordings.windows import require_increasing
from daq.vocabulary import LARGEST, TELLABLE
from server.service.ingest.stored import (
    canonical_object,
    event_of,
    gaps,
    in_stream,
    known_stream,
    raise_version,
    require_own,
    stream_row,
    streams_of,
)
from server.service.storage.audit import record
from server.service.storage.checksums import digest_of
from server.service.storage.database import Database, now_utc
from server.service.storage.messages import Messages
from server.service.storage.schema import chunks, events, sessions, streams
from server.service.web.problems import ProblemError, not_found, shortened
from server.service.web.strict_requests import read_json

# A name of a stream or an epoch goes into keys and addresses.
_NAME = re.compile(r"[A-Za-z0-9._:-]{1,100}")
_MOST_COUNT, _MOST_NAME = 1 << 53, 100
# A chunk is some hundred milliseconds; beyond a minute at 10 kHz it is none.
MOST_SAMPLES = 1 << 20


@dataclass(frozen=True)
class Sent:
    """Body sent by a bench, with the digest and epoch that it states."""

    body: bytes  # the bytes
    sha256: str  # of the bytes, in hexadecimal
    epoch: str  # history of the journal that they come from

    def require_sound(self) -> None:
        """Refuse a body that differs from its stated digest or epoch.

        Raises:
            ProblemError: its SHA-256 differs, or it has no epoch.
        """
        if not _NAME.fullmatch(self.epoch):
            raise ProblemError(
                422,
                f"epoch {shortened(self.epoch)!r}",
                "the X-Fingertwin-Epoch of the journal",
                "Send the epoch that the journal states",
            )
        if digest_of(self.body) != self.sha256:
            raise ProblemError(
                422, "the body is not what its SHA-256 says", "X-Fingertwin-SHA256 of these very bytes", "Send it again"
            )


class Ingest:
    """Takes in what benches send.

    Args:
        database: where it is kept.
        messages: are told of events.
        on_chunk: is called with session, stream and chunk once it is kept, from the thread of the request.
    """

    def __init__(
        self, database: Database, messages: Messages, on_chunk: Callable[[str, str, Chunk], None] | None = None
    ) -> None:
        self._database, self._messages = database, messages
        self._on_chunk = on_chunk or (lambda *_: None)
        # Is told of each new chunk: samples and bytes.
        self.stored: Callable[[int, int], None] = lambda *_: None

    def describe(self, session: str, stream: str, body: bytes, *, hidden: bool = False) -> dict[str, Any]:
        """Say what a stream is; the same again is a success.

        Args:
            session: that it belongs to.
            stream: its id.
            body: its description.
            hidden: whether the session is one that is arriving.

        Returns:
            its cursor.

        Raises:
            ProblemError: 404 no such session, 409 it is described otherwise, 422 no JSON object.
        """
        if not _NAME.fullmatch(stream):
            raise ProblemError(
                422, f"stream {shortened(stream)!r}", "letters, digits, and . _ : -, at most 100", "Rename the stream"
            )
        description = canonical_object(body, "a stream's description")
        digest = digest_of(description.encode())
        with self._database.writing() as connection:
            _require_session(connection, session, hidden=hidden)
            found = stream_row(connection, session, stream)
            if found is not None and found.sha256 != digest:
                raise ProblemError(
                    409, f"stream {stream} is described otherwise", "the description it has", "Begin another stream"
                )
            if found is None:
                highest = select(func.coalesce(func.max(streams.c.number), -1)).where(streams.c.session == session)
                number = connection.execute(highest).scalar_one() + 1
                row = {"session": session, "id": stream, "number": number, "description": description, "sha256": digest}
                connection.execute(insert(streams).values(row))
                record(connection, "stream begun", session, {"stream": stream, "description_sha256": digest})
                raise_version(connection, session)
            return _cursor(connection, known_stream(connection, session, stream))

    def cursor(self, session: str, stream: str) -> dict[str, Any]:
        """Return how far a stream is, and what is missing of it.

        Raises:
            ProblemError: 404 no such session or stream.
        """
        with self._database.reading() as connection:
            _require_session(connection, session)
            return _cursor(connection, known_stream(connection, session, stream))

    def put_chunk(
        self, session: str, stream: str, first_seq: int, count: int, sent: Sent, *, hidden: bool = False
    ) -> dict[str, Any]:
        """Keep a chunk.

        Args:
            session: that it belongs to.
            stream: of the session.
            first_seq: number of its first sample, as the address says.
            count: of its samples, as its header says.
            sent: the packed chunk.
            hidden: whether the session is one that is arriving, of which nobody is told yet.

        Returns:
            the cursor of the stream.

        Raises:
            ProblemError: 404 no such session or stream, 409 it would lie over others, 422 it is not as said or damaged.
        """
        sent.require_sound()
        try:
            chunk = Chunk.from_bytes(sent.body)
        except JournalError as error:
            raise ProblemError(422, error.found, error.expected, "Send what was read") from error
        if (chunk.first_seq, len(chunk)) != (first_seq, count):
            found = f"{len(chunk)} samples from {chunk.first_seq} on"
            raise ProblemError(
                422,
                found,
                f"{count} from {first_seq} on, as its address and header say",
                "Send the chunk with its own address and header",
            )
        if len(chunk) > MOST_SAMPLES or chunk.next_seq >= _MOST_COUNT:
            raise ProblemError(
                422, f"{len(chunk)} samples to number {chunk.next_seq}", f"at most {MOST_SAMPLES}", "Begin a new stream"
            )
        _require_rising(chunk)
        answer, fresh = self._database.together(
            lambda connection: _keep(connection, session, stream, chunk, sent, hidden)
        )
        if fresh:
            self.stored(count, len(sent.body))
        if fresh and not hidden:
            self._on_chunk(session, stream, chunk)
        return answer

    def event_cursor(self, session: str, epoch: str) -> dict[str, Any]:
        """Return which events of an epoch are there.

        Raises:
            ProblemError: 404 no such session.
        """
        with self._database.reading() as connection:
            _require_session(connection, session)
            return _event_cursor(connection, session, epoch)

    def put_event(self, session: str, epoch: str, number: int, sent: Sent) -> dict[str, Any]:
        """Keep an event of a journal.

        Returns:
            which events of the epoch are there.

        Raises:
            ProblemError: 404 no such session, 409 another has this number, or another bench the session, 422 it is not
                as said, or no event.
        """
        sent.require_sound()
        event = event_of(sent.body)
        if number >= _MOST_COUNT or sent.epoch != epoch:
            raise ProblemError(
                422,
                f"event {number} of epoch {shortened(sent.epoch)}",
                f"one of epoch {epoch}",
                "Send the events of each epoch by themselves",
            )
        with self._messages.writing() as telling:
            connection = telling.connection
            _require_session(connection, session)
            here = (events.c.session == session) & (events.c.epoch == epoch) & (events.c.number == number)
            found = connection.execute(select(events.c.sha256).where(here)).scalar()
            if found is not None and found != sent.sha256:
                raise ProblemError(409, f"event {number} is another", "the one that is stored", "Begin another epoch")
            if found is None:
                if event.kind == STARTED:
                    require_own(connection, session, {event.stream}, epoch)
                last = select(func.coalesce(func.max(events.c.arrival), 0)).where(events.c.session == session)
                arrival = connection.execute(last).scalar_one() + 1
                row = {"session": session, "epoch": epoch, "number": number, "arrival": arrival}
                row |= {"sha256": sent.sha256, "body": sent.body.decode()}
                connection.execute(insert(events).values(row))
                raise_version(connection, session, **_known_by(event))
                told = read_json(sent.body) | {"epoch": epoch, "number": number}
                telling.tell("event", session, told)
            return _event_cursor(connection, session, epoch)


def _keep(
    connection: Connection, session: str, stream: str, chunk: Chunk, sent: Sent, hidden: bool
) -> tuple[dict[str, Any], bool]:
    """Keep a chunk in a transaction; return the cursor, and whether it is new."""
    _require_session(connection, session, hidden=hidden)
    row = known_stream(connection, session, stream)
    over = _overlapping(connection, session, stream, chunk)
    fresh = not over
    if over and over != [(chunk.first_seq, len(chunk), sent.sha256)]:
        raise ProblemError(
            409,
            f"other samples are stored from {over[0][0]} on",
            "samples that are not there yet, or the very same chunk",
            "Send to a new session, or compare the journal with what the service holds",
            stored=[{"first_seq": f, "count": n, "sha256": s} for f, n, s in over],
        )
    if fresh:
        _require_between(connection, session, stream, chunk)
        connection.execute(insert(chunks).values(_chunk_row(session, stream, chunk, sent)))
    change: dict[str, Any] = {
        "next_seq": max(row.next_seq, chunk.next_seq),
        "held": row.held + (len(chunk) if fresh else 0),
        "ended": bool(row.ended) or len(chunk) == 0,
        "epoch": sent.epoch,
    }
    here = (streams.c.session == session) & (streams.c.id == stream)
    leads = streams_of(connection, session)[0] == stream
    changed = connection.execute(update(streams).where(here).values(change).returning(streams)).one()
    whole = fresh and changed.ended and changed.held == changed.next_seq
    if whole or (not leads and streams_of(connection, session)[0] == stream):
        raise_version(connection, session)  # the recording is judged as a whole, or windows are read in another now
    return _cursor(connection, changed), fresh


def _cursor(connection: Connection, row: Row[Any]) -> dict[str, Any]:
    """Return how far a stream is, by its row."""
    missing: list[list[int]] = []
    if row.held != row.next_seq:
        query = select(chunks.c.first_seq, chunks.c.n).where(in_stream(row.session, row.id))
        missing = gaps((r.first_seq, r.n) for r in connection.execute(query.order_by(chunks.c.first_seq)))
    return {"next_seq": row.next_seq, "missing": missing, "ended": row.ended, "epoch": row.epoch}


def _known_by(event: Event) -> dict[str, Any]:
    """Return what an event tells that the session's row keeps."""
    if event.kind == "closed":
        return {"closed_utc": now_utc()}
    specimen = event.value.get("specimen") if event.kind == STARTED else None
    name = specimen.get("id") if isinstance(specimen, dict) else None
    if not isinstance(name, str) or len(name) > _MOST_NAME:
        return {}
    return {"specimen": case((sessions.c.document.is_(None), name), else_=sessions.c.specimen)}


def _require_session(connection: Connection, session: str, *, hidden: bool = False) -> None:
    query = select(sessions.c.deleted_utc, sessions.c.arriving).where(sessions.c.id == session)
    row = connection.execute(query).first()
    if row is None or (row.deleted_utc is not None and not (hidden and row.arriving)):
        raise not_found("session", session, "/api/v1/sessions")


def _overlapping(connection: Connection, session: str, stream: str, chunk: Chunk) -> list[tuple[int, int, str]]:
    """Return the stored chunks that a chunk would overlap, in order; an empty one counts as one sample."""
    first, end = chunk.first_seq, chunk.first_seq + max(len(chunk), 1)
    mine = select(chunks.c.first_seq, chunks.c.n, chunks.c.sha256).where(in_stream(session, stream))
    # Stored chunks never lie over each other, so of those before only the last can reach into this one.
    before = mine.where(chunks.c.first_seq <= first).order_by(chunks.c.first_seq.desc()).limit(1)
    within = mine.where((chunks.c.first_seq > first) & (chunks.c.first_seq < end)).order_by(chunks.c.first_seq)
    rows = [*connection.execute(before).all(), *connection.execute(within).all()]
    return [(r.first_seq, r.n, r.sha256) for r in rows if r.first_seq + max(r.n, 1) > first]


def _require_rising(chunk: Chunk) -> None:
    if not np.isfinite(chunk.t_s).all():
        raise ProblemError(422, "a time that is no number", "times in s", "Send finite numbers")
    unsound = np.argwhere(~(np.abs(chunk.wrench) <= LARGEST))
    if len(unsound):
        row, axis = unsound[0]
        found = f"sample {chunk.first_seq + int(row)}: {HEADERS[1 + axis]} is {chunk.wrench[row, axis]:g}"
        raise ProblemError(422, found, TELLABLE, "Leave it out: the other readings of the chunk can be sent")
    try:
        if len(chunk):
            require_increasing(chunk.t_s, -math.inf, chunk.first_seq, "the stream")
    except ReadingsError as error:
        raise ProblemError(422, error.found, error.expected, "Send what was read") from error


def _require_between(connection: Connection, session: str, stream: str, chunk: Chunk) -> None:
    """Refuse a chunk whose times do not lie between those of its neighbours."""
    if not len(chunk):
        return
    mine = in_stream(session, stream) & (chunks.c.n > 0)
    last = select(chunks.c.last_s).where(mine & (chunks.c.first_seq < chunk.first_seq))
    first = select(chunks.c.first_s).where(mine & (chunks.c.first_seq > chunk.first_seq))
    before = connection.execute(last.order_by(chunks.c.first_seq.desc()).limit(1)).scalar()
    after = connection.execute(first.order_by(chunks.c.first_seq).limit(1)).scalar()
    if (before is not None and before >= chunk.t_s[0]) or (after is not None and after <= chunk.t_s[-1]):
        raise ProblemError(
            422,
            f"samples from {chunk.first_seq} on at {chunk.t_s[0]:.6g} to {chunk.t_s[-1]:.6g} s, "
            f"between others at {before} and {after} s",
            "time that increases from sample to sample",
            "Begin another stream",
        )


def _chunk_row(session: str, stream: str, chunk: Chunk, sent: Sent) -> dict[str, Any]:
    times = chunk.t_s
    return {
        "session": session,
        "stream": stream,
        "first_seq": chunk.first_seq,
        "n": len(chunk),
        "first_s": float(times[0]) if len(times) else None,
        "last_s": float(times[-1]) if len(times) else None,
        "sha256": sent.sha256,
        "payload": sent.body,
    }


def _event_cursor(connection: Connection, session: str, epoch: str) -> dict[str, Any]:
    here = (events.c.session == session) & (events.c.epoch == epoch)
    last, count = connection.execute(select(func.max(events.c.number), func.count()).where(here)).one()
    if last is not None and count == last + 1:
        return {"next_seq": count, "missing": []}
    numbers = connection.execute(select(events.c.number).where(here).order_by(events.c.number)).scalars().all()
    return {"next_seq": numbers[-1] + 1 if numbers else 0, "missing": gaps([(n, 1) for n in numbers])}
