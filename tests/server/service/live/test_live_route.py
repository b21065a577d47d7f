"""The WebSocket `/live`: who may connect, what is asked for, and that a real connection carries it."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Iterator
from contextlib import ExitStack, asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient, WebSocketDenialResponse
from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from server.service.live.bench_socket import take
from server.service.live.hub import LiveHub
from server.service.live.route import Allow, anyone, live_router
from server.service.storage.messages import Messages
from server.service.web.problems import ProblemError
from server.service.web.wire import Wire
from tests.server.service.listening import listening
from tests.server.service.live_sockets import PATIENCE_S, keep, messages_in, posted

HOST = "127.0.0.1:8765"


def app_of(messages: Messages, allow: Allow = anyone) -> FastAPI:
    hub = LiveHub(messages)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        hub.start(asyncio.get_running_loop())
        yield
        await hub.close()

    app = FastAPI(lifespan=lifespan)
    app.state.hub = hub
    app.include_router(live_router(lambda w: w.app.state.hub, allow, exists))

    @app.websocket("/benches/{session}")
    async def bench(websocket: WebSocket, session: str) -> None:
        await websocket.accept()
        await take(hub, websocket, session, exists)

    return app


def exists(_: WebSocket, session: str) -> bool:
    return session in ("S", "T")


@pytest.fixture
def messages(tmp_path: Path) -> Messages:
    return messages_in(tmp_path)


@pytest.fixture
def client(messages: Messages) -> Iterator[TestClient]:
    with TestClient(app_of(messages), base_url=f"http://{HOST}") as client:
        yield client


def first(client: TestClient, query: str = "", **headers: str) -> Any:
    with client.websocket_connect(f"/live{query}", headers={"Host": HOST, **headers}) as socket:
        (hello,) = socket.receive_json()
        return hello


def test_it_begins_with_what_was_asked_for_and_where_it_goes_on(client: TestClient, messages: Messages) -> None:
    for _ in range(3):
        keep(messages, "case")
    hello = first(client, "?session=S&session=T&rate_hz=10")
    assert (hello["kind"], hello["latest"], hello["after"]) == ("hello", 3, 3)
    assert (hello["sessions"], hello["traces"], hello["rate_hz"]) == (["S", "T"], True, 10.0)
    assert hello["version"]
    everything = first(client)
    assert (everything["sessions"], everything["traces"], everything["rate_hz"]) == (None, False, 30.0)
    assert first(client, "?traces=all")["traces"] is True
    assert first(client, "?session=S&traces=none")["traces"] is False


def test_what_was_missed_comes_first_and_only_of_what_is_watched(client: TestClient, messages: Messages) -> None:
    for session in ("S", "T", None, "S", "U"):
        keep(messages, "case", session)
    with client.websocket_connect("/live?session=S&after=0") as socket:
        assert socket.receive_json()[0]["another_database"] is False
        assert [(m["id"], m["session"], m["kind"]) for m in socket.receive_json()] == [
            (1, "S", "case"),
            (4, "S", "case"),
        ]
        keep(messages, "job", "T")
        keep(messages, "job", "S", state="done")
        (last,) = socket.receive_json()
        assert (last["id"], last["body"]) == (7, {"state": "done"})
        assert last["created_utc"]
    with client.websocket_connect("/live?session=S&session=T&after=1") as socket:
        socket.receive_json()
        assert [m["id"] for m in socket.receive_json()] == [2, 4, 6, 7]
    assert first(client, "?after=99")["another_database"] is True


@pytest.mark.parametrize(
    ("query", "named"),
    [
        ("after=-1", "after=-1"), ("after=1.5", "after=1.5"), ("after=" + "9" * 30, "after="), ("after=٣", "after="),
        ("after=1&after=2", "after is given twice"), ("rate_hz=0", "rate_hz=0"), ("rate_hz=61", "rate_hz=61"),
        ("rate_hz=nan", "rate_hz=nan"), ("rate_hz=inf", "rate_hz"), ("rate_hz=fast", "rate_hz=fast"),
        ("traces=some", "traces=some"), ("rate=5", "parameter 'rate'"), ("session=", "1 sessions"),
        ("session=" + "x" * 101, "sessions"), ("&".join(f"session=S{n}" for n in range(51)), "51 sessions"),
    ],
)  # fmt: skip
def test_what_cannot_be_asked_for_is_closed_with_a_reason(client: TestClient, query: str, named: str) -> None:
    with client.websocket_connect(f"/live?{query}") as socket, pytest.raises(WebSocketDisconnect) as closed:
        socket.receive_json()
    assert closed.value.code == 4422
    assert named in closed.value.reason
    assert "expected" in closed.value.reason
    assert len(closed.value.reason.encode()) <= 123


def test_a_session_that_is_not_there_is_closed_with_a_reason(client: TestClient) -> None:
    with client.websocket_connect("/live?session=S&session=U") as socket, pytest.raises(WebSocketDisconnect) as closed:
        socket.receive_json()
    assert (closed.value.code, closed.value.reason) == (4404, "there is no session U")


def test_the_services_own_page_and_programs_are_let_in(client: TestClient) -> None:
    assert first(client, Origin=f"http://{HOST}")["kind"] == "hello"
    assert first(client)["kind"] == "hello"
    # Behind what speaks TLS.
    assert first(client, Origin="https://lab.example", Host="lab.example")["kind"] == "hello"


def test_who_may_not_read_is_refused_before_anything_is_told(messages: Messages) -> None:
    async def nobody(socket: WebSocket) -> None:
        raise ProblemError(401, "no token", "one", headers={"WWW-Authenticate": "Bearer"})

    with (
        TestClient(app_of(messages, nobody), base_url=f"http://{HOST}") as client,
        pytest.raises(WebSocketDenialResponse) as refused,
        client.websocket_connect("/live"),
    ):
        pass
    assert refused.value.status_code == 401
    assert refused.value.headers["WWW-Authenticate"] == "Bearer"


# ----- over a real connection


@contextmanager
def running(messages: Messages, ws: Any = Wire) -> Iterator[tuple[str, FastAPI]]:
    """A service on loopback."""
    app = app_of(messages)
    with listening(app, ws) as address:
        yield f"ws://{address}/live", app


def heard(socket: ClientConnection, kind: str) -> Any:
    """The next message of a kind."""
    while True:
        for message in json.loads(socket.recv(timeout=PATIENCE_S)):
            if message["kind"] == kind:
                return message


@pytest.mark.parametrize("ws", [Wire, "auto"])
def test_a_client_that_reads_nothing_delays_no_other(messages: Messages, ws: Any) -> None:
    with running(messages, ws) as (url, app):
        hub: LiveHub = app.state.hub
        asked = f"{url}?session=S&rate_hz=60"
        with connect(asked, max_queue=1) as silent, connect(asked) as one:
            for socket in (silent, one):
                heard(socket, "hello")
            # Much at once, so that what lies between the service and the silent client is soon full.
            many = [posted(0.0, stream=f"{n}" * 20)["envelopes"][0] for n in range(100)]
            told = 0
            while hub.counters.dropped == 0:
                for envelope in many:
                    envelope["from_s"], envelope["to_s"] = told + 0.0, told + 1.0
                hub.trace("S", {"dropped": 0, "envelopes": many})
                keep(messages, "event", n=told)
                assert heard(one, "event")["body"] == {"n": told}
                told += 1
            # The silent one reads again: of kept messages it has missed none.
            seen: list[int] = []
            while len(seen) < told:
                frame = json.loads(silent.recv(timeout=PATIENCE_S))
                seen += [m["body"]["n"] for m in frame if m["kind"] == "event"]
            assert seen == list(range(told))
            assert hub.clients == 2


def test_a_stop_hangs_up_with_a_code_that_says_so(messages: Messages) -> None:
    with ExitStack() as open_ones:
        with running(messages) as (url, _):
            socket = open_ones.enter_context(connect(f"{url}?session=S"))
            heard(socket, "hello")
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=PATIENCE_S)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1012


@pytest.mark.parametrize("ws", [Wire, "auto"])
@pytest.mark.parametrize(
    ("session", "said", "code", "reason"),
    [
        ("S", '{"dropped": 0, "envelopes": [{}]}', 4422, "faults"),
        ("S", '{"nonsense', 4422, "faults"),
        ("S", b"\x00\x01", 4422, "no text"),
        ("nobody", json.dumps(posted(1.0)), 4404, "no session nobody"),
    ],
)
def test_a_bench_that_cannot_be_understood_is_told_so_and_may_come_again(
    messages: Messages, ws: Any, session: str, said: str | bytes, code: int, reason: str
) -> None:
    with running(messages, ws) as (url, _), connect(f"{url}?session=S") as watching:
        heard(watching, "hello")
        bench = url.replace("/live", "/benches")
        with connect(f"{bench}/{session}") as socket:
            if session == "S":
                # Once it is trusted, what it says is taken as it comes.
                for k in range(3):
                    socket.send(json.dumps(posted(float(k))))
                    assert heard(watching, "trace")["body"]["from_s"] == [float(k)]
            socket.send(said)
            with pytest.raises(ConnectionClosed) as closed:
                socket.recv(timeout=PATIENCE_S)
        assert closed.value.rcvd is not None
        assert (closed.value.rcvd.code, reason in closed.value.rcvd.reason) == (code, True)
        with connect(f"{bench}/S") as socket:
            socket.send(json.dumps(posted(50.0)))
            assert heard(watching, "trace")["body"]["from_s"] == [50.0]
