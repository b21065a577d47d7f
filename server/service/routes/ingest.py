"""Readings and events of benches: `PUT …/streams/{stream}/chunks/{first_seq}`, `PUT …/events/{epoch}/{number}`."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Header, Path, Request
from pydantic import Field

from daq.uplink.wire import COUNT, EPOCH, SHA256
from server.service.answers import JsonAnswer
from server.service.ingest.ingest import Sent
from server.service.schemas.common import Answered, SessionId, documented
from server.service.services import of
from server.service.web.strict_requests import IngestRoute
from server.service.web.workers import run

router = APIRouter(route_class=IngestRoute, prefix="/sessions/{session}", tags=["ingest"])

Stream = Annotated[str, Path(max_length=100, description="Id of the stream.", examples=["5f1c2a"])]
Epoch = Annotated[str, Path(max_length=100, description="One history of a journal, which its owner names.")]
Number = Annotated[int, Path(ge=0, le=1 << 53, description="Number of the event in its epoch, from 0.")]
FirstSeq = Annotated[int, Path(ge=0, le=1 << 53, description="Number of the chunk's first sample, from 0.")]
Digest = Annotated[str, Header(alias=SHA256, description="SHA-256 of the body, hexadecimal.", max_length=64)]
SentEpoch = Annotated[str, Header(alias=EPOCH, description="History of the journal it is of.", max_length=100)]
SentCount = Annotated[int, Header(alias=COUNT, ge=0, le=1 << 20, description="Samples in the chunk.")]


class StreamCursor(Answered):
    """Progress of a stream."""

    next_seq: int = Field(description="Number of the sample after the last that is stored; 0 where none is.")
    missing: list[list[int]] = Field(description="[from, to) of samples below it that are not stored, in order.")
    ended: bool = Field(description="Whether an empty chunk has ended the stream.")
    epoch: str | None = Field(description="History of the journal that wrote to it last.")


class EventCursor(Answered):
    """Stored events of an epoch."""

    next_seq: int = Field(description="Number of the event after the last that is stored.")
    missing: list[list[int]] = Field(description="[from, to) of events below it that are not stored.")


_NUMBER, _TEXT = {"type": ["number", "null"]}, {"type": ["string", "null"], "maxLength": 100}
_EVENT: dict[str, Any] = {
    "type": "object",
    "required": ["kind"],
    "properties": {
        "kind": {"type": "string", "minLength": 1, "maxLength": 60, "description": "What happened."},
        "at_s": _NUMBER | {"description": "Time of the stream [s]."},
        "utc_s": _NUMBER | {"description": "Wall clock of the bench [s since 1970]."},
        "stream": _TEXT | {"description": "Stream that it concerns."},
        "value": {"type": ["object", "null"], "description": "What belongs to its kind."},
    },
}


def _body(kind: str, text: str, example: Any = None, schema: dict[str, Any] | None = None) -> dict[str, Any]:
    if schema is None:
        schema = {"type": "string", "format": "binary"} if "octet" in kind else {"type": "object"}
    content: dict[str, Any] = {"schema": schema} | ({} if example is None else {"example": example})
    return {"requestBody": {"required": True, "description": text, "content": {kind: content}}}


@router.put(
    "/streams/{stream}",
    summary="Describe a stream",
    responses=documented(StreamCursor),
    openapi_extra=_body(
        "application/json",
        "Driver, its settings, the load cell, the clock. The same again is a success, another is a conflict.",
        {"driver": "ati-netft", "settings": {}, "cell": {"model": "ATI Nano17", "serial": "FT1"}, "clock": "device"},
    ),
)
async def describe(session: SessionId, stream: Stream, request: Request) -> JsonAnswer:
    """Say what a stream is, before its first chunk."""
    body = await request.body()
    return _cursor(await run("ingest", of(request).ingest.describe, session, stream, body))


@router.get("/streams/{stream}/cursor", responses=documented(StreamCursor))
def cursor(session: SessionId, stream: Stream, request: Request) -> JsonAnswer:
    """Return how far a stream is, and what is missing of it."""
    return _cursor(of(request).ingest.cursor(session, stream))


@router.put(
    "/streams/{stream}/chunks/{first_seq}",
    summary="Store a chunk",
    responses=documented(StreamCursor),
    openapi_extra=_body("application/octet-stream", "A chunk as `daq.acquisition.blocks.Chunk.to_bytes` packs it."),
)
async def put_chunk(
    session: SessionId,
    stream: Stream,
    first_seq: FirstSeq,
    request: Request,
    sha256: Digest,
    epoch: SentEpoch,
    count: SentCount,
) -> JsonAnswer:
    """Store some hundred milliseconds of readings.

    The answer comes once they are on the disk. The same chunk again is a success and changes nothing; one that would
    lie over other samples is a conflict that names what is stored.
    """
    sent = Sent(await request.body(), sha256, epoch)
    ingest = of(request).ingest
    return _cursor(await run("ingest", ingest.put_chunk, session, stream, first_seq, count, sent))


@router.get("/events/{epoch}/cursor", responses=documented(EventCursor))
def event_cursor(session: SessionId, epoch: Epoch, request: Request) -> JsonAnswer:
    """Return which events of an epoch are stored."""
    return _cursor(of(request).ingest.event_cursor(session, epoch))


@router.put(
    "/events/{epoch}/{number}",
    summary="Store an event",
    responses=documented(EventCursor),
    openapi_extra=_body(
        "application/json",
        "What happened at the bench.",
        {"stream": "5f1c2a", "at_s": 12.5, "utc_s": 1.79e9, "kind": "note", "value": {"text": "moistened"}},
        _EVENT,
    ),
)
async def put_event(
    session: SessionId, epoch: Epoch, number: Number, request: Request, sha256: Digest, sent_epoch: SentEpoch
) -> JsonAnswer:
    """Store an event under its number: gap, tare, case, note, and so on. The same again is a success."""
    sent = Sent(await request.body(), sha256, sent_epoch)
    return _cursor(await run("ingest", of(request).ingest.put_event, session, epoch, number, sent))


def _cursor(found: dict[str, Any]) -> JsonAnswer:
    return JsonAnswer({"schema": "fingertwin/cursor/1"} | found)
