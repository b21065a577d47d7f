"""Ways past the layers of ASGI: nothing is lost, overtaken or waited for, and a token is still looked at."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from starlette.applications import Starlette
from starlette.routing import WebSocketRoute
from starlette.websockets import WebSocket
from websockets.exceptions import ConnectionClosed
from websockets.frames import Frame, Opcode
from websockets.sync.client import connect

from server.service.web.wire import Wire, wire_of
from tests.server.service.guarded import Guarded
from tests.server.service.listening import PATIENCE_S, listening

Played = Callable[[WebSocket, Wire], Awaitable[None]]


def framed(text: str) -> bytes:
    return Frame(Opcode.TEXT, text.encode()).serialize(mask=False)


@contextmanager
def playing(play: Played) -> Iterator[str]:
    """An application that accepts a WebSocket and does something with it."""

    async def socket(socket: WebSocket) -> None:
        await socket.accept()
        wire = wire_of(socket.scope)
        assert wire is not None
        await play(socket, wire)

    with listening(Starlette(routes=[WebSocketRoute("/", socket)]), Wire) as address:
        yield f"ws://{address}/"


def test_frames_that_are_written_come_in_order_with_those_that_are_sent() -> None:
    async def play(socket: WebSocket, wire: Wire) -> None:
        for n in range(0, 300, 3):
            assert wire.write(framed(str(n)))
            await socket.send_text(str(n + 1))
            assert wire.write(framed(str(n + 2)))
        await socket.receive()

    with playing(play) as url, connect(url) as client:
        assert [client.recv(timeout=PATIENCE_S) for _ in range(300)] == [str(n) for n in range(300)]


def test_a_client_that_does_not_read_is_written_to_no_longer_until_it_does() -> None:
    written: list[int] = []
    full = asyncio.Event()

    async def play(socket: WebSocket, wire: Wire) -> None:
        while wire.write(framed(f"{len(written)}:" + "x" * 10_000)):
            written.append(len(written))
        full.set()
        # It waits for its turn, and comes after all that was written.
        await socket.send_text("last:")
        assert wire.write(framed("again:"))
        await socket.receive()

    with playing(play) as url, connect(url, max_queue=1) as client:
        heard: list[str] = []
        while not heard or heard[-1] != "again":
            heard.append(str(client.recv(timeout=PATIENCE_S)).partition(":")[0])
        assert full.is_set()
        assert heard == [*map(str, written), "last", "again"]


def test_nothing_is_written_to_who_has_hung_up() -> None:
    answers: list[bool] = []

    async def play(socket: WebSocket, wire: Wire) -> None:
        answers.append(wire.write(framed("hello")))
        await socket.receive()
        answers.append(wire.write(framed("too late")))

    with playing(play) as url:
        with connect(url) as client:
            assert client.recv(timeout=PATIENCE_S) == "hello"
        with connect(url) as client:
            assert client.recv(timeout=PATIENCE_S) == "hello"
    assert answers == [True, False, True, False]


def test_what_is_said_is_taken_at_once_or_waits_to_be_received() -> None:
    taken: list[str] = []

    def hear(text: str) -> bool:
        if text != "wait":
            taken.append(text)
        return text != "wait"

    async def play(socket: WebSocket, wire: Wire) -> None:
        wire.listen(hear)
        await socket.send_text("listening")
        assert await socket.receive_text() == "wait"
        assert taken == ["1", "2"]
        # What is no text is not offered, and waits to be received.
        await socket.send_text("now")
        assert (await socket.receive())["bytes"] == b"3"
        await socket.send_text(" ".join(taken))

    with playing(play) as url, connect(url) as client:
        assert client.recv(timeout=PATIENCE_S) == "listening"
        for said in ("1", "2", "wait"):
            client.send(said)
        assert client.recv(timeout=PATIENCE_S) == "now"
        client.send(b"3")
        assert client.recv(timeout=PATIENCE_S) == "1 2"


def test_what_is_no_text_ends_the_connection() -> None:
    async def play(socket: WebSocket, wire: Wire) -> None:
        wire.listen(lambda _: True)
        await socket.receive()

    with playing(play) as url, connect(url) as client:
        client.send(b"\xff\xfe", text=True)
        with pytest.raises(ConnectionClosed) as closed:
            client.recv(timeout=PATIENCE_S)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1007


@pytest.mark.parametrize("with_token", [False, True])
def test_where_a_token_is_to_be_looked_at_there_is_no_way_past(tmp_path: Path, with_token: bool) -> None:
    guarded = Guarded(tmp_path)
    headers = {"authorization": f"Bearer {guarded.token('read')}"} if with_token else None
    with listening(guarded.app, Wire) as address, connect(f"ws://{address}/live", additional_headers=headers) as client:
        client.send("a")
        assert client.recv(timeout=PATIENCE_S) == "a"
    assert [wire is None for wire in guarded.wires] == [with_token]
