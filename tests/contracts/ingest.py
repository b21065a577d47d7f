"""What the service must do with a bench's chunks and events, as a small service that does it.

Chunk and cursor go into one transaction, and only then comes an answer. The tests of `test_ingest` take any receiver.
"""

from __future__ import annotations

import hashlib
import json
import re
import sqlite3
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import unquote

import httpx
import numpy as np

from daq.acquisition.blocks import Chunk
from daq.errors import JournalError
from daq.uplink.wire import API, COUNT, EPOCH, SHA256, events_path, stream_path

URL = "http://service"
CURSOR = "fingertwin/cursor/1"
DESCRIPTION = b'{"driver": "made"}'
EPOCH_1, EPOCH_2 = "1" * 32, "2" * 32
SCHEMA = """
CREATE TABLE IF NOT EXISTS sessions (id TEXT PRIMARY KEY);
CREATE TABLE IF NOT EXISTS streams (
    session TEXT, id TEXT, description TEXT NOT NULL, next_seq INTEGER NOT NULL DEFAULT 0,
    ended INTEGER NOT NULL DEFAULT 0, epoch TEXT, PRIMARY KEY (session, id));
CREATE TABLE IF NOT EXISTS chunks (
    session TEXT, stream TEXT, first_seq INTEGER, n INTEGER, sha256 TEXT, payload BLOB,
    PRIMARY KEY (session, stream, first_seq));
CREATE TABLE IF NOT EXISTS events (
    session TEXT, epoch TEXT, number INTEGER, sha256 TEXT, body TEXT, PRIMARY KEY (session, epoch, number));
"""


class Receiver(Protocol):
    """A service under test."""

    def client(self) -> httpx.Client:
        """Return a client whose base address is the service's."""

    def new_session(self) -> str:
        """Return the id of a new session."""

    def stored(self, session: str, stream: str) -> list[bytes]:
        """Payloads that are stored of a stream, in the order of their samples."""

    def events(self, session: str) -> list[dict[str, Any]]:
        """Events that are stored, by epoch in the order in which they came, and by number."""

    def restart(self) -> None:
        """Stop as if killed, and start again on what is on the disk."""

    def close(self) -> None:
        """Stop."""


def made(first_seq: int, count: int, salt: int = 0) -> Chunk:
    """A chunk of several reads that its numbers and salt decide."""
    rng = np.random.default_rng([first_seq, count, salt])
    sizes = [int(n) for n in rng.integers(1, 30, count // 3 + 1)]
    status = rng.integers(0, 2, count)
    return Chunk(
        first_seq,
        (first_seq + np.arange(count)) / 1000.0,
        rng.normal(size=(count, 6)),
        status,
        status == 1,
        rng.bytes(sum(sizes)),
        [(size, first_seq / 1000.0 + 0.001 * i) for i, size in enumerate(sizes)],
        1e9,
        rejected=count % 3,
        skipped=count % 5,
    )


class Put:
    """Talks to a receiver as a bench does."""

    def __init__(self, receiver: Receiver) -> None:
        self.receiver = receiver
        self.client = receiver.client()
        self.session, self.stream = receiver.new_session(), "a" * 32
        assert self.describe(DESCRIPTION).is_success

    @property
    def path(self) -> str:
        return stream_path(self.session, self.stream)

    def describe(self, body: bytes) -> httpx.Response:
        headers = {"Content-Type": "application/json", EPOCH: EPOCH_1}
        return self.client.put(self.path, content=body, headers=headers)

    def chunk(self, chunk: Chunk, epoch: str = EPOCH_1, **instead: str | bytes) -> httpx.Response:
        """Put a chunk; `instead` of what is right may stand another body, sha256, count or first_seq."""
        body = instead.get("body", chunk.to_bytes())
        assert isinstance(body, bytes)
        headers = {
            "Content-Type": "application/octet-stream",
            COUNT: str(instead.get("count", len(chunk))),
            SHA256: str(instead.get("sha256", hashlib.sha256(body).hexdigest())),
            EPOCH: epoch,
        }
        path = f"{self.path}/chunks/{instead.get('first_seq', chunk.first_seq)}"
        return self.client.put(path, content=body, headers={k: v for k, v in headers.items() if v})

    def cursor(self) -> Any:
        answer = self.client.get(f"{self.path}/cursor")
        assert answer.status_code == 200
        return answer.json()

    def event(self, number: int, body: bytes, epoch: str = EPOCH_1, digest: str = "") -> httpx.Response:
        headers = {"Content-Type": "application/json", SHA256: digest or hashlib.sha256(body).hexdigest(), EPOCH: epoch}
        return self.client.put(f"{events_path(self.session, epoch)}/{number}", content=body, headers=headers)

    def event_cursor(self, epoch: str = EPOCH_1) -> Any:
        return self.client.get(f"{events_path(self.session, epoch)}/cursor").json()

    def stored(self) -> list[bytes]:
        return self.receiver.stored(self.session, self.stream)


class ProblemError(Exception):
    """An answer that says no."""

    def __init__(self, status: int, detail: str, **more: Any) -> None:
        super().__init__(detail)
        self.status, self.value = status, {"title": detail, "status": status, "detail": detail, **more}


class SmallReceiver:
    """Keeps all in one SQLite file.

    Args:
        path: of the file.
        most_bytes: of a body; larger ones are refused with 413.
    """

    def __init__(self, path: Path, most_bytes: int = 1 << 24) -> None:
        self.path, self.most_bytes = path, most_bytes
        self._lock = threading.Lock()
        self._sessions = 0
        self.lives: list[dict[str, Any]] = []
        self._open()

    def _open(self) -> None:
        self._connection = sqlite3.connect(self.path, isolation_level=None, check_same_thread=False)
        # What a killed process wrote is kept by the system; only a pulled plug asks for more.
        self._connection.execute("PRAGMA synchronous=OFF")
        self._connection.executescript(SCHEMA)

    def client(self) -> httpx.Client:
        return httpx.Client(base_url=URL, transport=httpx.MockTransport(self.handle))

    def new_session(self, name: str = "") -> str:
        self._sessions += 1
        name = name or f"S {self._sessions}/ä"
        self._connection.execute("INSERT INTO sessions VALUES (?)", (name,))
        return name

    def stored(self, session: str, stream: str) -> list[bytes]:
        query = "SELECT payload FROM chunks WHERE session = ? AND stream = ? ORDER BY first_seq, n"
        return [row[0] for row in self._connection.execute(query, (session, stream))]

    def events(self, session: str) -> list[dict[str, Any]]:
        query = (
            "SELECT body FROM events AS e WHERE session = ? ORDER BY "
            "(SELECT min(rowid) FROM events WHERE session = e.session AND epoch = e.epoch), number"
        )
        return [json.loads(row[0]) for row in self._connection.execute(query, (session,))]

    def restart(self) -> None:
        self._connection.close()
        self._open()

    def close(self) -> None:
        self._connection.close()

    def handle(self, request: httpx.Request) -> httpx.Response:
        """Answer one request."""
        parts = request.url.raw_path.decode().split("?")[0].removeprefix(f"{API}/sessions/").split("/")
        with self._lock:
            try:
                return httpx.Response(200, json=self._routed(request, [unquote(p) for p in parts]))
            except ProblemError as error:
                content = json.dumps(error.value).encode()
                return httpx.Response(
                    error.status, content=content, headers={"Content-Type": "application/problem+json"}
                )

    def _routed(self, request: httpx.Request, path: list[str]) -> Any:
        body, session = request.read(), path[0]
        if len(body) > self.most_bytes:
            raise ProblemError(413, f"{len(body)} bytes; at most {self.most_bytes}")
        if not self._rows("SELECT 1 FROM sessions WHERE id = ?", session):
            raise ProblemError(404, f"there is no session {session}")
        match request.method, *path[1:]:
            case "PUT", "streams", stream:
                return self._described(session, stream, body)
            case "GET", "streams", stream, "cursor":
                return self._cursor(session, stream)
            case "PUT", "streams", stream, "chunks", first_seq:
                return self._chunk(session, stream, first_seq, body, request.headers)
            case "GET", "events", epoch, "cursor":
                return self._event_cursor(session, epoch)
            case "PUT", "events", epoch, number:
                return self._event(session, epoch, number, body, request.headers)
            case "POST", "live":
                self.lives.append(json.loads(body))
                return {}
        raise ProblemError(404, "nothing is here")

    def _described(self, session: str, stream: str, body: bytes) -> Any:
        rows = self._rows("SELECT description FROM streams WHERE session = ? AND id = ?", session, stream)
        if rows and rows[0][0] != body.decode():
            raise ProblemError(409, f"stream {stream} is described otherwise")
        if not rows:
            insert = "INSERT INTO streams (session, id, description) VALUES (?, ?, ?)"
            self._connection.execute(insert, (session, stream, body.decode()))
        return self._cursor(session, stream)

    def _cursor(self, session: str, stream: str) -> dict[str, Any]:
        query = "SELECT next_seq, ended, epoch FROM streams WHERE session = ? AND id = ?"
        rows = self._rows(query, session, stream)
        if not rows:
            raise ProblemError(404, f"there is no stream {stream}")
        next_seq, ended, epoch = rows[0]
        query = "SELECT first_seq, n FROM chunks WHERE session = ? AND stream = ? ORDER BY first_seq"
        missing = _gaps(self._rows(query, session, stream))
        return {"schema": CURSOR, "next_seq": next_seq, "missing": missing, "ended": bool(ended), "epoch": epoch}

    def _chunk(self, session: str, stream: str, number: str, body: bytes, headers: httpx.Headers) -> Any:
        first, digest = _number(number), _sound(body, headers)
        try:
            chunk = Chunk.from_bytes(body)
        except JournalError as error:
            raise ProblemError(422, str(error)) from error
        stated = (first, _number(headers.get(COUNT, "")))
        if (chunk.first_seq, len(chunk)) != stated:
            raise ProblemError(422, f"{len(chunk)} samples from {chunk.first_seq} on; said to be {stated}")
        epoch = headers.get(EPOCH, "")
        self._cursor(session, stream)
        with self._transaction() as connection:
            # What it would lie over; an empty chunk ends its stream, and has a place as if it held one sample.
            query = (
                "SELECT first_seq, n, sha256 FROM chunks WHERE session = ? AND stream = ? "
                "AND first_seq < ? AND first_seq + max(n, 1) > ? ORDER BY first_seq"
            )
            end = first + max(len(chunk), 1)
            over = connection.execute(query, (session, stream, end, first)).fetchall()
            if over != [] and over != [(first, len(chunk), digest)]:
                stored = [{"first_seq": f, "count": n, "sha256": s} for f, n, s in over]
                raise ProblemError(409, f"other samples are stored from {over[0][0]} on", stored=stored)
            if not over:
                row = (session, stream, first, len(chunk), digest, body)
                connection.execute("INSERT INTO chunks VALUES (?, ?, ?, ?, ?, ?)", row)
            connection.execute(
                "UPDATE streams SET next_seq = max(next_seq, ?), ended = max(ended, ?), epoch = ? "
                "WHERE session = ? AND id = ?",
                (chunk.next_seq, len(chunk) == 0, epoch, session, stream),
            )
        return self._cursor(session, stream)

    def _event_cursor(self, session: str, epoch: str) -> Any:
        query = "SELECT number, 1 FROM events WHERE session = ? AND epoch = ? ORDER BY number"
        rows = self._rows(query, session, epoch)
        return {"schema": CURSOR, "next_seq": rows[-1][0] + 1 if rows else 0, "missing": _gaps(rows)}

    def _event(self, session: str, epoch: str, number: str, body: bytes, headers: httpx.Headers) -> Any:
        digest = _sound(body, headers)
        key = (session, epoch, _number(number))
        rows = self._rows("SELECT sha256 FROM events WHERE session = ? AND epoch = ? AND number = ?", *key)
        if rows and rows[0][0] != digest:
            raise ProblemError(409, f"event {number} is another")
        if not rows:
            self._connection.execute("INSERT INTO events VALUES (?, ?, ?, ?, ?)", (*key, digest, body.decode()))
        return self._event_cursor(session, epoch)

    def _rows(self, query: str, *values: Any) -> list[Any]:
        return self._connection.execute(query, values).fetchall()

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            yield self._connection
        except BaseException:
            self._connection.execute("ROLLBACK")
            raise
        self._connection.execute("COMMIT")


def _gaps(rows: list[tuple[int, int]]) -> list[list[int]]:
    out, at = [], 0
    for first, count in rows:
        if first > at:
            out.append([at, first])
        at = first + count
    return out


def _sound(body: bytes, headers: httpx.Headers) -> str:
    digest = hashlib.sha256(body).hexdigest()
    if headers.get(SHA256) != digest:
        raise ProblemError(422, "the body is not what its SHA-256 says")
    if not headers.get(EPOCH):
        raise ProblemError(422, f"no {EPOCH}")
    return digest


def _number(text: str) -> int:
    if not re.fullmatch(r"[0-9]{1,18}", text):
        raise ProblemError(422, f"{text!r} is no number")
    return int(text)


@contextmanager
def serving(handle: Callable[[httpx.Request], httpx.Response], port: int = 0) -> Iterator[str]:
    """Answer on the loopback; yield the address."""

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"
        # Header and body of an answer are two small writes; the second must not wait for the first to be acknowledged.
        disable_nagle_algorithm = True

        def answer(self) -> None:
            body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
            request = httpx.Request(self.command, URL + self.path, headers=dict(self.headers), content=body)
            try:
                response = handle(request)
            except httpx.TransportError:
                self.close_connection = True  # as a lost connection
                return
            self.send_response(response.status_code)
            for name in ("Content-Type", "Retry-After"):
                if name in response.headers:
                    self.send_header(name, response.headers[name])
            self.send_header("Content-Length", str(len(response.content)))
            self.end_headers()
            self.wfile.write(response.content)

        do_GET = do_PUT = do_POST = answer

        def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
            pass

    class Server(ThreadingHTTPServer):
        daemon_threads = True

        def handle_error(self, request: Any, client_address: Any) -> None:
            pass

    server = Server(("127.0.0.1", port), Handler)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
