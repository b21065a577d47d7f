"""A service for tests: in this process, on a folder of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sqlalchemy import select
from starlette.testclient import TestClient

from server.service.app import create_app
from server.service.ingest.stored import stored_events
from server.service.services import Services
from server.service.settings import Settings
from server.service.storage.schema import chunks

URL = "http://127.0.0.1"


class ServiceReceiver:
    """The service as a receiver of benches' chunks and events.

    Args:
        folder: of its data.
        settings: other than the defaults.
    """

    def __init__(self, folder: Path, **settings: Any) -> None:
        self._settings = Settings(data=folder, **({"reader_process": False} | settings))
        self._sessions = 0
        self._client = self._started()

    @property
    def parts(self) -> Services:
        """The running service's parts."""
        found: Services = self._client.app.state.services  # type: ignore[attr-defined]
        return found

    def client(self) -> Any:
        """Return a client of it."""
        return self._client

    def another(self) -> Any:
        """Return one more client of it, which may be closed."""
        return TestClient(self._client.app, base_url=URL, raise_server_exceptions=False)

    def new_session(self) -> str:
        """Begin a session, and return its id."""
        self._sessions += 1
        name = f"S{self._sessions}"
        self._client.post("/api/v1/sessions", json={"id": name}).raise_for_status()
        return name

    def stored(self, session: str, stream: str) -> list[bytes]:
        """Payloads that are stored of a stream, in the order of their samples."""
        query = select(chunks.c.payload).where((chunks.c.session == session) & (chunks.c.stream == stream))
        with self.parts.database.reading() as connection:
            return list(connection.execute(query.order_by(chunks.c.first_seq)).scalars())

    def events(self, session: str) -> list[dict[str, Any]]:
        """Events that are stored."""
        with self.parts.database.reading() as connection:
            return [{"kind": e.kind, "value": dict(e.value)} for e in stored_events(connection, session)]

    def restart(self) -> None:
        """Stop, and start again on what is on the disk."""
        self._client.__exit__()
        self._client = self._started()

    def close(self) -> None:
        """Stop."""
        self._client.__exit__()

    def _started(self) -> TestClient:
        client = TestClient(create_app(self._settings), base_url=URL, raise_server_exceptions=False)
        client.__enter__()
        return client
