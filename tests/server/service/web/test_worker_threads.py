"""Whoever reads much slows readers only: benches and what watches the service have threads of their own."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from server.service.sessions.sessions import Sessions
from server.service.web.workers import AT_ONCE
from tests.contracts.ingest import made
from tests.server.service.recorded import describe, put
from tests.server.service.running import URL, ServiceReceiver
from tests.server.service.web.test_bad_input import send_event


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceReceiver]:
    out = ServiceReceiver(tmp_path_factory.mktemp("service"))
    yield out
    out.close()


def test_while_all_readers_are_busy_benches_and_watchers_are_answered(
    service: ServiceReceiver, monkeypatch: pytest.MonkeyPatch
) -> None:
    client, name = service.client(), service.new_session()
    describe(client, name)
    listed, free = Sessions.listed, threading.Event()
    busy = threading.Semaphore(0)

    def slowly(self: Sessions, *asked: Any) -> Any:
        busy.release()
        assert free.wait(60)
        return listed(self, *asked)

    monkeypatch.setattr(Sessions, "listed", slowly)
    with ThreadPoolExecutor(2 * AT_ONCE["readers"]) as pool:
        waiting = [pool.submit(client.get, "/api/v1/sessions") for _ in range(2 * AT_ONCE["readers"])]
        for _ in range(AT_ONCE["readers"]):
            assert busy.acquire(timeout=30)
        try:
            for address in ("/api/v1/health", "/api/v1/health/live", "/metrics"):
                assert client.get(address).status_code == 200
            assert put(client, name, made(0, 40)).status_code == 200
            assert send_event(service, name, 0, b'{"kind": "note"}').status_code == 200
            assert client.get(f"/api/v1/sessions/{name}/streams/{'a' * 32}/cursor").json()["next_seq"] == 40
            with client.websocket_connect(f"ws://{URL.removeprefix('http://')}/api/v1/live") as live:
                assert live.receive_json()
            assert client.get("/").status_code == 200
            # The others wait for a reader, and none was lent to them from elsewhere.
            time.sleep(0.05)
            assert not busy.acquire(blocking=False)
            assert not any(w.done() for w in waiting)
        finally:
            free.set()
        assert {w.result().status_code for w in waiting} == {200}


def test_a_hundred_readers_leave_the_database_to_a_bench(service: ServiceReceiver, tmp_path: Path) -> None:
    """As many connections are held as readers can ever hold, and there is one left for whoever writes."""
    database = service.parts.database
    held = [database.engine.connect() for _ in range(sum(AT_ONCE.values()))]
    try:
        client, name = service.client(), service.new_session()
        describe(client, name)
        assert put(client, name, made(0, 40)).status_code == 200
    finally:
        for connection in held:
            connection.close()
