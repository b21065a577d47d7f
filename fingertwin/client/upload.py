"""A recorded session on its way to the service: its document, then its readings as chunks, each once in effect."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.uplink.parts import part
from daq.uplink.recording import CHUNK, STREAM, chunks_of, description_of, epoch_of
from daq.uplink.wire import COUNT, EPOCH, SHA256, Cursor, Range, stream_path
from fingertwin.client.errors import ServiceError
from fingertwin.client.exchange import Exchange, path_of, reading
from fingertwin.client.jobs import Progress

if TYPE_CHECKING:
    from daq.acquisition.blocks import Chunk
    from daq.sessions.models import Session

# The address of a request has no room for more.
_ENDLESS = 1 << 62


def upload(exchange: Exchange, path: str | Path, name: str | None, progress: Progress | None) -> str:
    """Send a session; what the service has already is not sent again.

    Args:
        exchange: with the service.
        path: folder, `session.yaml`, or the name of a shipped session.
        name: its id in the service; by default its own.
        progress: called with the share that is done.

    Returns:
        its id.

    Raises:
        InputError: the session or its readings cannot be used, or the service refused.
    """
    from daq.sessions import read_session, whole_document

    tell = progress or (lambda share, what: None)
    session = read_session(path)
    document = whole_document(session, name)
    tell(0.0, "document")
    exchange.post(path_of("sessions"), {"id": document["id"], "document": document}, again=True)
    if session.readings_path is not None:
        last_s = max((end for case in session.cases for _, (_, end) in case.windows()), default=0.0)
        _send_readings(exchange, document["id"], session, session.readings_path, last_s, tell)
    tell(1.0, "done")
    return str(document["id"])


def _send_readings(
    exchange: Exchange, session: str, recorded: Session, file: Path, last_s: float, tell: Progress
) -> None:
    from daq.export.tables import sha256_of
    from daq.recordings.readings import open_readings

    source, digest = open_readings(file), sha256_of(file)
    address = stream_path(session, STREAM)
    description = description_of(recorded, file, digest)
    cursor = _described(exchange, address, description, session, file.name)
    for chunk in chunks_of(source.blocks(), CHUNK):
        for lacking in _lacking(chunk, cursor):
            cursor = _put(exchange, address, lacking, epoch_of(digest))
        if last_s > 0.0 and len(chunk):
            tell(min(max(float(chunk.t_s[-1]) / last_s, 0.0), 1.0), "readings")


def _described(exchange: Exchange, address: str, description: dict[str, Any], session: str, file: str) -> Cursor:
    from json import dumps

    body = dumps(description, sort_keys=True).encode()
    try:
        answer = exchange.put(address, body, {"Content-Type": "application/json"})
    except ServiceError as error:
        if error.status != 409:
            raise
        raise ServiceError(
            409,
            f"session {session} has other readings than {file}",
            "the very file that was uploaded first",
            "Upload it under another name",
            problem=error.problem,
        ) from error
    with reading("a cursor"):
        return Cursor.of_answer(answer)


def _lacking(chunk: Chunk, cursor: Cursor) -> Iterator[Chunk]:
    """What of a chunk the service does not have, whatever pieces it was sent in before."""
    if not len(chunk):
        if not cursor.ended:
            yield chunk
        return
    ranges: list[Range] = [*cursor.missing, (cursor.next_seq, _ENDLESS)]
    for begin, end in ranges:
        a, b = max(begin, chunk.first_seq), min(end, chunk.next_seq)
        if a < b:
            yield part(chunk, a - chunk.first_seq, b - chunk.first_seq)


def _put(exchange: Exchange, address: str, chunk: Chunk, epoch: str) -> Cursor:
    """Store a chunk, in pieces where it is too large for the service."""
    body = chunk.to_bytes()
    headers = {
        "Content-Type": "application/octet-stream",
        COUNT: str(len(chunk)),
        SHA256: hashlib.sha256(body).hexdigest(),
        EPOCH: epoch,
    }
    try:
        answer = exchange.put(f"{address}/chunks/{chunk.first_seq}", body, headers)
    except ServiceError as error:
        if error.status != 413 or len(chunk) < 2:
            raise
        half = len(chunk) // 2
        _put(exchange, address, part(chunk, 0, half), epoch)
        return _put(exchange, address, part(chunk, half, len(chunk)), epoch)
    with reading("a cursor"):
        return Cursor.of_answer(answer)
