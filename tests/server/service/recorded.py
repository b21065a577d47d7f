"""Recorded sessions, sent to a service as a bench sends them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from daq.acquisition.blocks import Chunk
from daq.recordings.readings import open_readings
from daq.sessions import find_session, read_session, read_yaml
from daq.uplink.wire import COUNT, EPOCH, SHA256, stream_path
from tests.server.service.running import ServiceReceiver

PUBLISHED = "synek2019_H01"
STREAM, EPOCH_1 = "a" * 32, "1" * 32
DESCRIPTION: dict[str, Any] = {"driver": "replay", "settings": {}, "cell": {}, "clock": "device"}


def document_of(name: str) -> dict[str, Any]:
    """Plain data of a shipped session."""
    found: dict[str, Any] = read_yaml(find_session(name))
    return found


def small(name: str = "S1", cases: int = 3) -> dict[str, Any]:
    """A published session with few cases."""
    document = document_of(PUBLISHED)
    return document | {"id": name, "cases": document["cases"][:cases]}


def chunks_of(name: str, size: int = 250) -> Iterator[Chunk]:
    """A shipped session's readings as chunks, an empty one at the end."""
    path = read_session(name).readings_path
    assert path is not None
    first = 0
    for block in open_readings(path).blocks():
        for a in range(0, len(block), size):
            t_s = block.t_s[a : a + size]
            none = np.zeros(len(t_s), dtype=np.int64)
            yield Chunk(first, t_s, block.wrench[a : a + size], none, none > 0, b"", [], 1e9)
            first += len(t_s)
    none = np.zeros(0, dtype=np.int64)
    yield Chunk(first, np.zeros(0), np.zeros((0, 6)), none, none > 0, b"", [], 1e9)


def put(client: Any, session: str, chunk: Chunk, stream: str = STREAM) -> httpx.Response:
    """Send one chunk."""
    body = chunk.to_bytes()
    headers = {COUNT: str(len(chunk)), SHA256: hashlib.sha256(body).hexdigest(), EPOCH: EPOCH_1}
    headers["Content-Type"] = "application/octet-stream"
    path = f"{stream_path(session, stream)}/chunks/{chunk.first_seq}"
    found: httpx.Response = client.put(path, content=body, headers=headers)
    return found


def describe(client: Any, session: str, stream: str = STREAM) -> None:
    """Begin a stream."""
    client.put(stream_path(session, stream), json=DESCRIPTION, headers={EPOCH: EPOCH_1}).raise_for_status()


def upload(client: Any, name: str) -> None:
    """Send a shipped session, whole."""
    client.post("/api/v1/sessions", json={"id": name, "document": document_of(name)}).raise_for_status()
    if document_of(name).get("readings"):
        describe(client, name)
        for chunk in chunks_of(name):
            put(client, name, chunk).raise_for_status()


def listed_as_answered(client: Any, name: str) -> dict[str, Any]:
    """A session in the list, which says what its own answer says."""
    row: dict[str, Any] = next(s for s in client.get("/api/v1/sessions").json()["sessions"] if s["id"] == name)
    answer = client.get(f"/api/v1/sessions/{name}").json()
    shared = ("specimen", "source", "closed", "version", "created_utc")
    assert {k: row[k] for k in shared} == {k: answer[k] for k in shared}
    assert row["streams"] == len(answer["streams"])
    return row


def holding(folder: Path, *names: str) -> Iterator[ServiceReceiver]:
    """A service that has received shipped sessions whole, until it is left."""
    service = ServiceReceiver(folder)
    for name in names:
        upload(service.client(), name)
    assert service.parts.case_updates.settle(60.0)
    yield service
    service.close()
