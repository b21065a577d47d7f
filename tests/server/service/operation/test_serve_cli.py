"""`fingertwin serve` as a process: started, refused, stopped, killed."""

from __future__ import annotations

import asyncio
import json
import signal
import socket
import sqlite3
import subprocess
import sys
import threading
from contextlib import closing, suppress
from pathlib import Path

import httpx
import pytest
import uvicorn
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from daq.errors import InputError
from server import cli
from server.service import serve
from server.service.operation.folder import alone, held, made
from server.service.operation.migrate import upgrade
from server.service.security.tokens import Role, create
from server.service.serve import bound
from server.service.settings import DATABASE_FILE
from server.service.storage.database import Database
from tests.server.service.guarded import MOST_BYTES
from tests.server.service.postgres import postgres_url
from tests.server.service.processes import Process, running, small, whole

ELSEWHERE = "0.0.0.0"  # noqa: S104
THINGS = "/api/v1/things"
NO_SIGTERM = pytest.mark.skipif(sys.platform == "win32", reason="on Windows SIGTERM ends a process at once")


def token(folder: Path, role: Role = "write") -> str:
    database = Database(f"sqlite:///{folder / DATABASE_FILE}")
    upgrade(database)
    text = create(database, "test", role)[1]
    database.close()
    return text


def sent_whole(process: Process, client: httpx.Client) -> None:
    """Ask for nothing, so that the service is known to answer."""
    assert client.get(THINGS).status_code == 200, process.log


@pytest.mark.parametrize("host", ["127.0.0.1", ELSEWHERE])
def test_over_a_real_connection_refusals_are_read_by_who_still_sends(tmp_path: Path, host: str) -> None:
    text = token(tmp_path)
    with running(small(data=tmp_path, host=host)) as process, process.client(text) as client:
        sent_whole(process, client)
        assert client.post(THINGS, content=bytes(MOST_BYTES)).json() == MOST_BYTES
        for body in (bytes(50 * MOST_BYTES), (bytes(1000) for _ in range(5000))):
            answer = client.post(THINGS, content=body)
            assert answer.status_code == 413
            assert answer.json()["remedy"] == "Send it in parts"
        wrong = client.post(THINGS, content=bytes(MOST_BYTES), headers={"Authorization": "Bearer ft_1"})
        assert wrong.status_code == 401
        sent_whole(process, client)
        assert client.get(THINGS, headers={"Authorization": ""}).status_code == 401
        address = str(client.base_url).replace("http", "ws").rstrip("/") + "/live"
        protocols = ["fingertwin", f"fingertwin.bearer.{text}"]
        with connect(address, subprotocols=protocols, proxy=None) as live:  # type: ignore[arg-type]
            assert live.subprotocol == "fingertwin"
            assert answered(live, "a") == "a"
            # It may be cut off before all of it is sent.
            with pytest.raises(ConnectionClosed):
                answered(live, "x" * (1 << 20))
        with pytest.raises(InvalidStatus, match="401"):
            connect(address, additional_headers={"Authorization": "Bearer ft_1"}, proxy=None)
        with pytest.raises(InvalidStatus, match="403"):
            connect(address, additional_headers={"Origin": "http://attacker.example"}, proxy=None)
        assert text not in process.log
        assert "Traceback" not in process.log
        assert "ERROR" not in process.log


def answered(live: ClientConnection, message: str) -> str | bytes:
    """Send a message and wait for the answer."""
    live.send(message)
    return live.recv(30)


def test_beyond_loopback_endless_headers_are_cut_off(tmp_path: Path) -> None:
    token(tmp_path)
    with running(small(data=tmp_path, host=ELSEWHERE)) as process:
        port = int(process.address().rsplit(":", 1)[1])
        with socket.create_connection(("127.0.0.1", port), 30) as connection:
            connection.sendall(b"GET / HTTP/1.1\r\nHost: a\r\n")
            sent = 0
            with suppress(ConnectionError):
                while sent < 100 << 20:
                    sent += connection.send(b"X: " + b"a" * 60_000 + b"\r\n")
    assert sent < 100 << 20


def test_beyond_loopback_it_does_not_start_without_a_valid_token(tmp_path: Path) -> None:
    with running(whole(tmp_path, "--host", ELSEWHERE)) as process:
        assert process.ended() == 2
        assert "no valid token" in process.log
        assert "fingertwin token create" in process.log
        assert "Traceback" not in process.log


def test_what_cannot_be_had_is_one_line_and_exit_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "newer").mkdir()
    token(tmp_path / "newer")
    with closing(sqlite3.connect(tmp_path / "newer" / DATABASE_FILE)) as connection, connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
    monkeypatch.setattr("server.service.web.logs.configure", lambda settings: None)
    data = str(tmp_path / "data")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        for words, said in [
            (["--data", data, "--port", port], "is in use"),
            (["--data", data, "--host", "192.0.2.1"], "none of this machine's addresses|no valid token"),
            (["--data", data, "--host", "no.such.host.invalid"], "not known|no valid token"),
            (["--data", data, "--port", "70000"], "less than or equal to 65535"),
            (["--data", str(tmp_path / "file")], "cannot be written"),
            (["--data", str(tmp_path / "newer")], "newer version"),
            (["--data", data, "--database-url", "sqlite://"], "in memory"),
            (["--data", data, "--database-url", "nonsense"], "URL cannot be read"),
        ]:
            monkeypatch.setattr("sys.argv", ["fingertwin", "serve", *words])
            with pytest.raises(SystemExit) as caught:
                cli.main()
            output = capsys.readouterr()
            assert caught.value.code == 2, output.err
            assert output.err.count("\n") == 1
            assert any(part in output.err for part in said.split("|")), output.err


def test_an_address_of_another_machine_or_a_wrong_name_is_refused() -> None:
    with pytest.raises(InputError, match="none of this machine's addresses"):
        bound("192.0.2.1", 0)
    with pytest.raises(InputError, match="not known"):
        bound("no.such.host.invalid", 0)
    with closing(bound("localhost", 0)) as found:
        assert found.getsockname()[0] == "127.0.0.1"


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(Path, "touch", refuse)
    with pytest.raises(InputError, match=r"cannot be written \(Read-only file system\)"):
        made(tmp_path)


def test_two_services_never_share_data(tmp_path: Path) -> None:
    with running(small(data=tmp_path)) as first:
        first.address()
        with running(small(data=tmp_path)) as second:
            assert second.ended() != 0
            assert "a service runs on the data in" in second.log
        with pytest.raises(InputError), held(tmp_path):
            pytest.fail("both hold it")
    with held(tmp_path):
        pass


def test_two_services_never_share_a_database_of_postgresql() -> None:
    url = postgres_url()
    one, other = Database(url), Database(url)
    with alone(one), pytest.raises(InputError, match="a service runs on the database"), alone(other):
        pytest.fail("both hold it")
    with alone(other):
        pass
    one.close()
    other.close()


def test_the_signal_to_stop_wakes_a_server_that_does_not_look(monkeypatch: pytest.MonkeyPatch) -> None:
    # It looks once a day: what ends it is the signal, and its test would not.
    monkeypatch.setattr(serve, "LOOK_S", 86_400.0)

    async def stopped() -> None:
        server = serve.Server(uvicorn.Config(small), lambda: None)
        serving = asyncio.create_task(server.main_loop())
        await asyncio.sleep(0.05)
        assert not serving.done()
        server.handle_exit(signal.SIGINT, None)
        await serving

    asyncio.run(asyncio.wait_for(stopped(), 30.0))


@NO_SIGTERM
def test_a_request_that_is_under_way_is_answered_before_it_stops(tmp_path: Path) -> None:
    body, asked = threading.Event(), threading.Event()

    def parts() -> object:
        yield b"first"
        asked.set()
        body.wait(60)
        yield b"second"

    with running(small(data=tmp_path)) as process, process.client() as client:
        sent_whole(process, client)
        answers: list[httpx.Response] = []
        request = threading.Thread(target=lambda: answers.append(client.post(THINGS, content=parts())))  # type: ignore[arg-type]
        request.start()
        assert asked.wait(60)
        process.process.send_signal(signal.SIGTERM)
        # The body's end is sent once the service is known to be stopping.
        process.wait_for("stopping")
        body.set()
        request.join(60)
        assert [a.json() for a in answers] == [len(b"firstsecond")]
        assert process.ended() == 0
        assert "stopped" in process.log


@NO_SIGTERM
def test_the_service_keeps_what_it_answered_when_it_is_stopped_or_killed(tmp_path: Path) -> None:
    data, ids = tmp_path / "data", ["S1", "S2", "S3"]
    for name, number in zip(ids, (signal.SIGKILL, signal.SIGTERM, signal.SIGINT), strict=True):
        with running(whole(data, "--log-format", "json")) as process, process.client() as client:
            assert client.post("/api/v1/sessions", json={"id": name}).is_success
            known = [s["id"] for s in client.get("/api/v1/sessions").json()["sessions"]]
            assert known == ids[: ids.index(name) + 1]
            process.process.send_signal(number)
            assert process.ended() == (-number if number == signal.SIGKILL else 0), process.log
            assert {json.loads(line)["level"] for line in process.log.splitlines()} <= {"INFO"}
        if number != signal.SIGKILL:
            # What was in the database's log is in its file.
            assert not [f.name for f in data.iterdir() if f.name.endswith(("-wal", "-shm"))]


def test_the_service_asks_for_tokens_beyond_loopback_and_tells_its_health(tmp_path: Path) -> None:
    text, reader = token(tmp_path), token(tmp_path, "read")
    with running(whole(tmp_path, "--host", ELSEWHERE)) as process, process.client(text) as client:
        assert client.post("/api/v1/sessions", json={"id": "S1"}).is_success
        assert client.get("/api/v1/health").json()["schema"] == "fingertwin/health/1"
        assert 'route="/api/v1/sessions"' in client.get("/metrics").text
        with httpx.Client(base_url=client.base_url, trust_env=False) as bare:
            assert bare.get("/api/v1/health/live").is_success
            for path in ("/api/v1/sessions", "/api/v1/openapi.json", "/metrics", "/api/v1/health"):
                assert bare.get(path).status_code == 401
        with process.client(reader) as reading:
            assert reading.get("/api/v1/sessions").is_success
            assert reading.post("/api/v1/sessions", json={"id": "S2"}).status_code == 403
        live = str(client.base_url).replace("http", "ws").rstrip("/") + "/api/v1/live"
        with pytest.raises(InvalidStatus, match="401"):
            connect(live, proxy=None)
        protocols = ["fingertwin", f"fingertwin.bearer.{reader}"]
        with connect(live, subprotocols=protocols, proxy=None) as stream:  # type: ignore[arg-type]
            assert "hello" in str(stream.recv(30))
            assert client.post("/api/v1/sessions", json={"id": "S3"}).is_success
            assert '"S3"' in str(stream.recv(30))
        words = ["-m", "server.cli", "token", "list", "--data", str(tmp_path), "--json", "-"]
        listed = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=True)  # noqa: S603
        assert len(json.loads(listed.stdout)["tokens"]) == 2
