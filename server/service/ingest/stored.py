"""Readings and events as they are stored, read back and held against their checksums."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Column, ColumnElement, Connection, Row, func, select, update

from daq.acquisition.blocks import Chunk
from daq.bench.record import STARTED
from daq.journal.rows import Event
from daq.recordings.windows import Span
from server.service.storage.checksums import sound
from server.service.storage.schema import chunks, events, sessions, streams
from server.service.web.problems import ProblemError, not_found, shortened
from server.service.web.strict_requests import read_json

# What a chunk is read from.
STORED: tuple[Column[Any], ...] = (
    chunks.c.session,
    chunks.c.stream,
    chunks.c.first_seq,
    chunks.c.sha256,
    chunks.c.payload,
)
_MOST_EVENT_BYTES = 1 << 18


@dataclass(frozen=True)
class Place:
    """Position of a chunk in its stream."""

    first_seq: int
    n: int
    first_s: float
    last_s: float


def stream_row(connection: Connection, session: str, stream: str) -> Row[Any] | None:
    """Return the row of a stream; None where there is none."""
    return connection.execute(select(streams).where((streams.c.session == session) & (streams.c.id == stream))).first()


def known_stream(connection: Connection, session: str, stream: str) -> Row[Any]:
    """Return the row of a stream.

    Raises:
        ProblemError: 404 there is none.
    """
    row = stream_row(connection, session, stream)
    if row is None:
        raise not_found("stream", stream, f"/api/v1/sessions/{session}")
    return row


def in_stream(session: str, stream: str) -> ColumnElement[bool]:
    """Select the chunks of a stream."""
    return (chunks.c.session == session) & (chunks.c.stream == stream)


def ends_of(connection: Connection, mine: ColumnElement[bool], window: Span) -> tuple[int, int]:
    """Return numbers of the chunks in which the last reading before a window and the first one after it lie."""
    before = select(chunks.c.first_seq).where(mine & (chunks.c.first_s <= window[0]))
    after = select(chunks.c.first_seq).where(mine & (chunks.c.last_s > window[1]))
    low = connection.execute(before.order_by(chunks.c.first_s.desc()).limit(1)).scalar()
    high = connection.execute(after.order_by(chunks.c.last_s).limit(1)).scalar()
    first, last = connection.execute(
        select(func.min(chunks.c.first_seq), func.max(chunks.c.first_seq)).where(mine)
    ).one()
    return (first or 0) if low is None else low, (last or 0) if high is None else high


def places_of(connection: Connection, mine: ColumnElement[bool], ends: tuple[int, int]) -> list[Place]:
    """Return where the chunks between two numbers lie, in order."""
    query = select(chunks.c.first_seq, chunks.c.n, chunks.c.first_s, chunks.c.last_s)
    rows = connection.execute(query.where(mine & chunks.c.first_seq.between(*ends)).order_by(chunks.c.first_seq))
    # An empty chunk ends a stream, and has no time.
    return [Place(r.first_seq, r.n, math.nan if r.first_s is None else r.first_s, r.last_s or math.nan) for r in rows]


def chunk_of(row: Row[Any]) -> Chunk:
    """Return a stored chunk of a row with the columns STORED.

    Raises:
        DamagedError: it is not what was sent.
    """
    place = f"chunk {row.first_seq} of stream {row.stream} of session {row.session}"
    return Chunk.from_bytes(sound(row.payload, row.sha256, place))


def streams_of(connection: Connection, session: str) -> list[str]:
    """Return ids of a session's streams, most readings first: a replay that broke off comes after its repeat."""
    mine = select(streams.c.id).where(streams.c.session == session)
    return list(connection.execute(mine.order_by(streams.c.held.desc(), streams.c.number)).scalars())


def raise_version(connection: Connection, session: str, **values: Any) -> None:
    """Raise a session's version, by which everybody sees that what was computed of it is old; set other columns too."""
    raised = {"version": sessions.c.version + 1} | values
    connection.execute(update(sessions).where(sessions.c.id == session).values(raised))


def gaps(ranges: Iterable[tuple[int, int]]) -> list[list[int]]:
    """Return [from, to) between ranges (first, count) that are in order, from 0 on."""
    out, at = [], 0
    for first, count in ranges:
        if first > at:
            out.append([at, first])
        at = first + count
    return out


def stored_events(connection: Connection, session: str) -> list[Event]:
    """Return a session's events in order: epoch by epoch as they came, each as far as it has no gap."""
    rows = connection.execute(select(events).where(events.c.session == session).order_by(events.c.arrival)).all()
    first: dict[str, int] = {}
    for row in rows:
        first.setdefault(row.epoch, row.arrival)
    out, expected = [], dict.fromkeys(first, 0)
    for row in sorted(rows, key=lambda r: (first[r.epoch], r.number)):
        if row.number == expected[row.epoch]:
            expected[row.epoch] += 1
            out.append(event_of(body_of_event(row)))
    return out


def require_own(connection: Connection, session: str, bench: Collection[str | None], epoch: str = "") -> None:
    """Refuse a bench in a session that another bench began, or that has a document.

    Args:
        connection: of a transaction.
        session: that is there.
        bench: streams of the bench's journal, which keeps them also under another epoch.
        epoch: of the journal.

    Raises:
        ProblemError: 409 it is another's.
    """
    described = connection.execute(select(sessions.c.document.is_not(None)).where(sessions.c.id == session)).scalar()
    told = select(events).where((events.c.session == session) & events.c.body.contains(f'"{STARTED}"'))
    happened = [(row.epoch, event_of(body_of_event(row))) for row in connection.execute(told)]
    begun = [event.stream in bench or at == epoch for at, event in happened if event.kind == STARTED]
    if described or (begun and not any(begun)):
        raise ProblemError(409, f"session {session} is not this bench's", "a name of its own", "Give --session NAME")


def body_of_event(row: Row[Any]) -> bytes:
    """Return a stored event as it was sent.

    Raises:
        DamagedError: it is no longer that.
    """
    return sound(row.body.encode(), row.sha256, f"event {row.number} of epoch {row.epoch} of session {row.session}")


def event_of(body: bytes) -> Event:
    """Return an event as a bench sends it.

    Raises:
        ProblemError: it is none.
    """
    value = json.loads(canonical_object(body, "an event", _MOST_EVENT_BYTES))
    kind, at_s, more, stream = (value.get(k) for k in ("kind", "at_s", "value", "stream"))
    utc_s = value.get("utc_s")
    sound = (
        isinstance(kind, str)
        and 0 < len(kind) <= 60
        and isinstance(more if more is not None else {}, dict)
        and (stream is None or (isinstance(stream, str) and len(stream) <= 100))
        and all(n is None or (isinstance(n, int | float) and not isinstance(n, bool)) for n in (at_s, utc_s))
    )
    if not sound:
        raise ProblemError(422, "no event", "an object with kind, at_s, value, and stream or null")
    return Event(str(kind), float(at_s or 0.0), more or {}, stream, float(utc_s or 0.0))


def canonical_object(body: bytes, what: str, most: int = 1 << 20) -> str:
    """Return the canonical JSON of an object."""
    if len(body) > most:
        raise ProblemError(413, f"{what} of {len(body)} bytes", f"at most {most}")
    try:
        value = read_json(body)
        if not isinstance(value, dict):
            raise ValueError("no object")
        return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    except ValueError as error:
        raise ProblemError(422, f"{what} that is no JSON object ({shortened(error)})", "a JSON object") from error
