"""Live messages come each once and in order, whatever becomes of the connection between."""

from __future__ import annotations

import http
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from websockets.datastructures import Headers
from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection, serve

from fingertwin.client import Client, ServiceError, ServiceUnreachableError
from fingertwin.client import live as listening
from tests.client.services import running

Play = Callable[[ServerConnection, int], None]
Told = dict[str, Any]


class Scripted:
    """A service that plays a part for each connection, and notes what each asked for."""

    def __init__(self, *parts: Play) -> None:
        self._parts = parts
        self.paths: list[str] = []
        self.tokens: list[str | None] = []

    def handle(self, socket: ServerConnection) -> None:
        assert socket.request is not None
        self.paths.append(socket.request.path)
        self.tokens.append(socket.request.headers.get("Authorization"))
        number = len(self.paths) - 1
        self._parts[min(number, len(self._parts) - 1)](socket, number)


@contextmanager
def playing(*parts: Play, **options: Any) -> Iterator[tuple[Scripted, str]]:
    script = Scripted(*parts)
    with serve(script.handle, "127.0.0.1", 0, **options) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield script, f"http://127.0.0.1:{server.socket.getsockname()[1]}"
        finally:
            server.shutdown()
            thread.join()


def hello(after: int) -> Told:
    return {"kind": "hello", "latest": 9, "after": after, "heartbeat_s": 5.0, "version": "0", "another_database": False}


def kept(number: int) -> Told:
    return {"kind": "job", "session": "S", "id": number, "created_utc": "2026", "body": {"state": "running"}}


def tell(socket: ServerConnection, *messages: Told) -> None:
    socket.send(json.dumps(messages))


def wait_until_gone(socket: ServerConnection) -> None:
    for _ in socket:
        pass


def test_after_an_interruption_they_go_on_where_they_were() -> None:
    def cut(socket: ServerConnection, number: int) -> None:
        tell(socket, hello(4))
        tell(socket, kept(5), kept(6))
        tell(socket, {"kind": "heartbeat", "latest": 6})
        tell(socket, {"kind": "resume", "after": 6})
        socket.close(1013, "too slow")

    def dead(socket: ServerConnection, number: int) -> None:
        tell(socket, hello(6), kept(7))
        socket.socket.close()

    def rest(socket: ServerConnection, number: int) -> None:
        tell(socket, hello(7), kept(8), {"kind": "trace", "session": "S", "body": {"stream": "a"}})
        wait_until_gone(socket)

    with playing(cut, dead, rest) as (script, url), Client(url, "ft_x") as twin:
        found = list(islice(twin.live("S"), 8))
    assert [m.id for m in found if m.id is not None] == [5, 6, 7, 8]
    assert [m.kind for m in found] == ["hello", "job", "job", "hello", "job", "hello", "job", "trace"]
    assert found[0].body["latest"] == 9
    assert (found[1].session, found[1].body) == ("S", {"state": "running"})
    base = "/api/v1/live?session=S"
    assert script.paths == [base, f"{base}&after=6", f"{base}&after=7"]
    assert set(script.tokens) == {"Bearer ft_x"}


def test_what_came_before_anything_was_kept_is_not_lost() -> None:
    def brief(socket: ServerConnection, number: int) -> None:
        tell(socket, hello(4))
        if number:
            tell(socket, kept(5))
            wait_until_gone(socket)

    with playing(brief) as (script, url), Client(url) as twin:
        found = list(islice(twin.live(), 3))
    assert [m.id for m in found] == [None, None, 5]
    assert script.paths == ["/api/v1/live", "/api/v1/live?after=4"]


@pytest.mark.parametrize(("code", "status"), [(4404, 404), (4422, 422), (1008, 403)])
def test_a_refusal_is_one_line_and_is_not_asked_for_again(code: int, status: int) -> None:
    with (
        playing(lambda socket, _: socket.close(code, "there is no session S")) as (script, url),
        Client(url) as twin,
        pytest.raises(ServiceError, match=r"^there is no session S\.$") as caught,
    ):
        next(twin.live("S"))
    assert caught.value.status == status
    assert len(script.paths) == 1


def test_a_token_that_is_not_valid_is_said_as_the_service_says_it() -> None:
    problem = {"status": 401, "detail": "…", "found": "a token that is not valid", "expected": "one that is"}

    def refuse(_: ServerConnection, __: Request) -> Response:
        body = json.dumps(problem).encode()
        return Response(401, http.HTTPStatus(401).phrase, Headers({"Content-Length": str(len(body))}), body)

    with (
        playing(lambda socket, _: None, process_request=refuse) as (_, url),
        Client(url, "ft_x") as twin,
        pytest.raises(ServiceError, match="a token that is not valid; expected one that is") as caught,
    ):
        next(twin.live())
    assert caught.value.status == 401


def test_a_service_that_stays_away_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listening, "_PATIENCE_S", 0.0)
    with playing(lambda socket, _: None) as (_, url):
        pass
    with Client(url) as twin, pytest.raises(ServiceUnreachableError, match=f"no service answers at {url}"):
        next(twin.live())


def test_a_service_that_only_hangs_up_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listening, "_PATIENCE_S", 0.4)
    with (
        playing(lambda socket, _: socket.close(1013, "100 clients are connected")) as (script, url),
        Client(url) as twin,
        pytest.raises(ServiceUnreachableError, match="100 clients are connected"),
    ):
        next(twin.live())
    assert len(script.paths) > 1


@pytest.mark.parametrize("frame", ["<html>", "{}", "[{}]", '[{"kind":"hello"}]', "[7]"])
def test_a_frame_that_is_none_is_one_line(frame: str) -> None:
    with (
        playing(lambda socket, _: socket.send(frame)) as (_, url),
        Client(url) as twin,
        pytest.raises(ServiceError, match="a live frame"),
    ):
        next(twin.live())


def changes(told: Iterator[listening.Message], change: str) -> listening.Message:
    """Return the next message that says that a session has changed so."""
    return next(m for m in told if m.kind == "session" and m.body["change"] == change)


def test_a_service_that_restarts_is_heard_again(tmp_path: Path) -> None:
    with running(tmp_path, workers=1) as url, Client(url) as twin:
        told = twin.live()
        assert next(told).kind == "hello"
        session = twin.upload("synek2019_H01")
        created = changes(told, "created")
        assert created.session == session.id
        case = session.cases()[0].id
        session.exclude(case, "slipped")
    # Nobody listens while this happens.
    with running(tmp_path, urlsplit(url).port or 0, workers=1), Client(url) as twin:
        session = twin.session("synek2019_H01")
        session.include(case)
        edited, again = changes(told, "edited"), changes(told, "edited")
        assert [m.body["kind"] for m in (edited, again)] == ["exclude", "include"]
        assert created.id is not None
        assert edited.id is not None
        assert again.id is not None
        assert created.id < edited.id < again.id
        with pytest.raises(ServiceError, match="there is no session DEV-99") as caught:
            next(twin.live("DEV-99"))
        assert caught.value.status == 404
    told.close()
