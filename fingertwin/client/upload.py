"""A recorded session on its way to the service: its document, then its readings as chunks, each once in effect."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from daq.uplink.wire import COUNT, EPOCH, SHA256, Cursor, Range, stream_path
from fingertwin.client.errors import ServiceError
from fingertwin.client.exchange import Exchange, path_of, reading
from fingertwin.client.jobs import Progress

if TYPE_CHECKING:
    from daq.blocks import Chunk
    from daq.readings import ReadingBlock
    from daq.session_models import Session

# A session that was uploaded has one stream; its name is the same each time, so that nothing is there twice.
STREAM = "readings"
# Readings of a chunk: some hundred kilobytes.
CHUNK = 4096
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
    from daq.readings import open_readings

    source = open_readings(file)
    digest = _sha256(file)
    address = stream_path(session, STREAM)
    cell = None if recorded.load_cell is None else recorded.load_cell.model
    description = {
        "driver": "upload",
        "settings": {"file": file.name, "sha256": digest},
        "cell": {"model": cell},
        "clock": "file",
    }
    cursor = _described(exchange, address, description, session, file.name)
    for chunk in _chunks(source.blocks()):
        for part in _lacking(chunk, cursor):
            cursor = _put(exchange, address, part, digest)
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


def _chunks(blocks: Iterator[ReadingBlock]) -> Iterator[Chunk]:
    """Readings as chunks, and an empty one at the end."""
    from daq.blocks import Chunk

    def chunk(first: int, block: ReadingBlock | None, begin: int, end: int) -> Chunk:
        count = end - begin
        status = np.zeros(count, dtype=np.int64)
        if block is not None and block.status is not None:
            status = block.status[begin:end]
        t_s = np.zeros(0) if block is None else block.t_s[begin:end]
        wrench = np.zeros((0, 6)) if block is None else block.wrench[begin:end]
        # There is no wall clock in a file, and the same file must make the same chunks.
        return Chunk(first, t_s, wrench, status, np.zeros(count, dtype=np.bool_), b"", [], 0.0)

    first = 0
    for block in blocks:
        for begin in range(0, len(block), CHUNK):
            end = min(begin + CHUNK, len(block))
            yield chunk(first + begin, block, begin, end)
        first += len(block)
    yield chunk(first, None, 0, 0)


def _lacking(chunk: Chunk, cursor: Cursor) -> Iterator[Chunk]:
    """What of a chunk the service does not have, whatever pieces it was sent in before."""
    if not len(chunk):
        if not cursor.ended:
            yield chunk
        return
    from daq.uplink.parts import part

    ranges: list[Range] = [*cursor.missing, (cursor.next_seq, _ENDLESS)]
    for begin, end in ranges:
        a, b = max(begin, chunk.first_seq), min(end, chunk.next_seq)
        if a < b:
            yield part(chunk, a - chunk.first_seq, b - chunk.first_seq)


def _put(exchange: Exchange, address: str, chunk: Chunk, digest: str) -> Cursor:
    """Store a chunk, in pieces where it is too large for the service."""
    body = chunk.to_bytes()
    headers = {
        "Content-Type": "application/octet-stream",
        COUNT: str(len(chunk)),
        SHA256: hashlib.sha256(body).hexdigest(),
        # Readings of another file would be another history.
        EPOCH: digest[:32],
    }
    try:
        answer = exchange.put(f"{address}/chunks/{chunk.first_seq}", body, headers)
    except ServiceError as error:
        if error.status != 413 or len(chunk) < 2:
            raise
        from daq.uplink.parts import part

        half = len(chunk) // 2
        _put(exchange, address, part(chunk, 0, half), digest)
        return _put(exchange, address, part(chunk, half, len(chunk)), digest)
    with reading("a cursor"):
        return Cursor.of_answer(answer)


def _sha256(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
