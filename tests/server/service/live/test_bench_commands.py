"""A bench that is asked from elsewhere: through its own connection, once, and with an answer."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import httpx
import numpy as np
import pytest
from websockets.sync.client import connect

from daq.acquisition.acquire import Acquisition
from daq.acquisition.records import Record
from daq.journal.reader import JournalReader
from daq.uplink.live_tail import LiveTail
from server.bench.keys import Pressed
from server.bench.loop import BenchLoop
from server.bench.meter import StreamMeter
from server.bench.remote import Remote, joined
from tests.daq.bench_plays import journalled
from tests.server.service.processes import Process

PATIENCE_S = 30.0
AT = "/api/v1/sessions/S1"


class SilentCell:
    """A load cell that says nothing until it is stopped."""

    def __init__(self) -> None:
        self._end = threading.Event()

    def records(self) -> Iterator[Record]:
        self._end.wait()
        yield from ()

    def stop(self) -> None:
        self._end.set()


class Here:
    """The view at the bench itself."""

    def __init__(self) -> None:
        self.refused: list[str] = []

    def tell(self, events: Any) -> None:
        """Take what the run did."""

    def refuse(self, error: Exception) -> None:
        self.refused.append(str(error))

    def draw(self, space_left: int | None = None) -> None:
        """Show nothing."""


class Running:
    """A bench whose loop runs, connected to a service."""

    def __init__(self, folder: Path, url: str, token: str | None = None) -> None:
        self.bench = journalled(folder)
        assert self.bench.journal is not None
        self.tail = LiveTail(url, "S1", token=token)
        self.here = Here()
        view, pressed = joined(Remote(self.tail, self.bench.run), self.here, list[Pressed])
        meter = StreamMeter(self.bench.run.full_scale)
        self._cell = SilentCell()
        cell = cast("Acquisition", self._cell)
        self._loop = BenchLoop(cell, self.bench.journal, self.bench.stream, self.bench.run, meter, view, pressed)
        self._thread = threading.Thread(target=self._go_on, daemon=True)
        self.tail.start()
        self._thread.start()

    def _go_on(self) -> None:
        # As `fingertwin log` does: it hangs up as soon as the bench has ended.
        self._loop.go_on()
        self.tail.stop()

    def ended(self) -> bool:
        self._thread.join(PATIENCE_S)
        return not self._thread.is_alive()

    def close(self) -> None:
        # The loop ends with its cell, before the journal is closed under it.
        self._cell.stop()
        assert self.ended()
        if self.bench.journal is not None:
            self.bench.journal.close()


def until(met: Callable[[], object]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not met():
        assert time.monotonic() < end_s
        time.sleep(0.02)


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Process]:
    process = Process(["-m", "server.cli", "serve", "--port", "0", "--data", str(tmp_path_factory.mktemp("service"))])
    with process.client() as client:
        client.post("/api/v1/sessions", json={"id": "S1"}).raise_for_status()
    yield process
    process.close()


def asked(client: httpx.Client, command: str, text: str = "") -> httpx.Response:
    return client.post(f"{AT}/bench/commands", json={"command": command, "text": text})


def connected(client: httpx.Client) -> bool:
    return "no bench" not in asked(client, "note", "").text


def test_a_bench_does_what_it_is_asked_elsewhere_and_says_what_it_refuses(served: Process, tmp_path: Path) -> None:
    with served.client() as client:
        nobody = asked(client, "tare")
        assert nobody.status_code == 409
        assert "no bench of session S1 is connected" in nobody.json()["detail"]
        running = Running(tmp_path, served.address())
        until(lambda: connected(client))
        held = client.delete(AT)
        assert (held.status_code, held.json()["found"]) == (409, "session S1 is held by a bench")
        refused = asked(client, "confirm")
        assert refused.status_code == 409
        assert "plateau" in refused.json()["detail"]
        assert any("plateau" in text for text in running.here.refused)
        assert asked(client, "note", "moist again").json() == {
            "schema": "fingertwin/bench-command/1", "session": "S1", "command": "note"
        }  # fmt: skip
        unknown = asked(client, "dance")
        assert unknown.status_code == 409
        assert "tare" in unknown.json()["detail"]
        assert asked(client, "quit").status_code == 200
        assert running.ended()
        running.close()
        until(lambda: not connected(client))
    with JournalReader.open(tmp_path / "bench.ftj") as journal:
        notes = [e.value for e in journal.events() if e.kind == "note"]
    assert notes == [{"text": "moist again"}]


def test_everybody_sees_what_the_bench_waits_for(served: Process, tmp_path: Path) -> None:
    import json

    url = served.address()
    running = Running(tmp_path, url)
    with served.client() as client:
        until(lambda: connected(client))
        with connect(f"{url.replace('http', 'ws', 1)}/api/v1/live?session=S1", compression=None) as socket:

            def next_bench() -> dict[str, Any]:
                while True:
                    for message in json.loads(socket.recv(timeout=PATIENCE_S)):
                        if message["kind"] == "bench":
                            return dict(message["body"])

            first = next_bench()
            assert (first["connected"], first["closed"], first["phase"]) == (True, False, "idle")
            assert {"tare", "confirm", "close", "quit"} <= {k["command"] for k in first["keys"]}
            assert next(k["asks"] for k in first["keys"] if k["command"] == "note")
            assert asked(client, "next").status_code == 200
            second = next_bench()
            assert (second["step"], second["todo"]) != (first["step"], first["todo"])
            assert second["suggested"] in {k["command"] for k in second["keys"]}
            running.close()
            assert next_bench() == {"connected": False}


def test_a_silent_bench_connects_again_after_a_restart_of_the_service(tmp_path: Path) -> None:
    data = str(tmp_path / "service")
    first = Process(["-m", "server.cli", "serve", "--port", "0", "--data", data])
    url = first.address()
    with first.client() as client:
        client.post("/api/v1/sessions", json={"id": "S1"}).raise_for_status()
        (tmp_path / "bench").mkdir()
        running = Running(tmp_path / "bench", url)
        until(lambda: connected(client))
    first.close()
    again = Process(["-m", "server.cli", "serve", "--port", url.rpartition(":")[2], "--data", data])
    again.address()
    with again.client() as client:
        until(lambda: connected(client))
    running.close()
    again.close()


def test_what_a_bench_shows_is_no_older_than_what_it_reads(served: Process, tmp_path: Path) -> None:
    running = Running(tmp_path, served.address())
    with served.client() as client:
        until(lambda: connected(client))
        for k in range(20):
            running.tail.offer("s", np.array([0.02 * k]), np.full((1, 6), float(k)), np.zeros(1, bool))
            time.sleep(0.02)
        until(lambda: running.tail.sent > 3)
        assert running.tail.dropped == 0
    running.close()
