"""Files of exports: none of the service's own is read, and none is left behind."""

from __future__ import annotations

import hashlib
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import anyio
import pytest

from daq.bench.run import BenchRun
from server.service.web.downloads import FileAnswer, attachment
from tests.daq.bench_plays import Bench, case, predicted, setup, tared
from tests.server.service.exported import exported
from tests.server.service.recorded import STREAM
from tests.server.service.running import ServiceReceiver

AT = "/api/v1/sessions"


class _Sent:
    """Keeps a bench's chunks and events, as a journal would."""

    def __init__(self) -> None:
        self.chunks: list[Any] = []

    def append(self, _: str, chunk: Any) -> None:
        self.chunks.append(chunk)

    def event(self, *_: Any) -> None:
        pass


def test_a_finger_that_names_a_file_is_never_looked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from daq.uplink.events import encoded
    from tests.server.service.recorded import EPOCH_1, describe, put

    secret = tmp_path / "secret.yaml"
    secret.write_text("password: swordfish\n")
    kept = _Sent()
    bench = Bench(BenchRun(setup(finger=str(secret)), predicted, STREAM), kept, STREAM)  # type: ignore[arg-type]
    bench.play(["next", *tared(), *case("tip", FDP=950)])
    service = ServiceReceiver(tmp_path / "service")
    client = service.client()
    client.post(AT, json={"id": "S1"}).raise_for_status()
    describe(client, "S1")
    for chunk in kept.chunks:
        put(client, "S1", chunk).raise_for_status()
    for number, event in enumerate(bench.said):
        body = encoded(event)
        headers = {"X-Fingertwin-SHA256": hashlib.sha256(body).hexdigest(), "X-Fingertwin-Epoch": EPOCH_1}
        path = f"{AT}/S1/events/{EPOCH_1}/{number}"
        client.put(path, content=body, headers=headers | {"Content-Type": "application/json"}).raise_for_status()
    monkeypatch.setattr(Path, "open", _no_opening(secret, Path.open))
    for path in ("check", "report", "export?format=csv", "export?format=supplement", "export?format=hdf5"):
        answer = client.get(f"{AT}/S1/{path}")
        assert "swordfish" not in answer.text
        assert (answer.status_code == 200) == (path == "check"), answer.text
    assert client.get(f"{AT}/S1/check").json()["findings"][0]["code"] == "not_predictable"
    assert exported(service, "S1", "csv", model="an1979_middle")
    service.close()


def _no_opening(file: Path, opened: Any) -> Any:
    def open_(self: Path, *args: Any, **more: Any) -> Any:
        assert self != file
        return opened(self, *args, **more)

    return open_


def test_the_temporary_file_goes_also_when_the_client_does(emptied: Path) -> None:
    def answer() -> FileAnswer:
        folder = tempfile.TemporaryDirectory()
        file = Path(folder.name) / "S1.csv"
        file.write_bytes(b"x" * 3_000_000)
        return FileAnswer(file, folder, "text/csv")

    async def receive() -> Any:
        await anyio.sleep_forever()

    sent: list[Any] = []

    async def send(message: Any) -> None:
        sent.append(message)
        if message["type"] == "http.response.body":
            raise OSError("the client has gone")

    async def cancelled() -> None:
        with anyio.CancelScope() as scope:

            async def hang(message: Any) -> None:
                if message["type"] == "http.response.body":
                    scope.cancel()
                    await anyio.sleep_forever()

            await answer()({"type": "http", "asgi": {"spec_version": "2.4"}}, receive, hang)
        assert scope.cancelled_caught

    for version in ("2.3", "2.4"):
        with suppress(Exception):
            asgi = {"type": "http", "asgi": {"spec_version": version}}
            anyio.run(answer(), asgi, receive, send)
        assert list(emptied.iterdir()) == []
    assert len([m for m in sent if m["type"] == "http.response.body"]) == 2
    anyio.run(cancelled)


def test_a_name_in_a_header_is_harmless() -> None:
    assert attachment('a"; b\r\nX: y/../..\\c€.csv') == 'attachment; filename="a_b_X_y_.._.._c_.csv"'
    assert attachment("...") == 'attachment; filename="download"'
