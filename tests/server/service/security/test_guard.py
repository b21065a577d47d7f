"""The guard: who is let in, from which page, how much and how often; everything refused says why."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.service.security import guard
from server.service.security.origins import authority, is_loopback, is_ours, is_same, scheme_of
from server.service.security.tokens import FRESH_S, listed, revoke
from server.service.web.edge import HEADERS
from tests.server.service.asks import Answer, ask, open_socket
from tests.server.service.guarded import MOST_BYTES, Guarded

WRITING = ("POST", "PUT", "PATCH", "DELETE")


@pytest.fixture
def here(tmp_path: Path) -> Guarded:
    """Bound to loopback."""
    return Guarded(tmp_path)


@pytest.fixture
def elsewhere(tmp_path: Path) -> Guarded:
    """Bound to all of the machine's addresses."""
    return Guarded(tmp_path, host="0.0.0.0")  # noqa: S104


def bearer(token: str) -> dict[str, str]:
    return {"authorization": f"Bearer {token}"}


def test_on_loopback_no_token_is_needed(here: Guarded) -> None:
    assert ask(here.app).json() == {"token": None}
    for method in WRITING:
        assert ask(here.app, method, body=[b"abc"]).json() == 3


def test_on_loopback_a_token_that_is_given_must_be_valid(here: Guarded) -> None:
    read, write = here.token("read"), here.token("write")
    assert ask(here.app, headers=bearer(read)).json() == {"token": listed(here.database)[0].id}
    assert ask(here.app, "POST", headers=bearer(write)).status == 200
    assert ask(here.app, "POST", headers=bearer(read)).status == 403
    for wrong in (bearer("ft_1"), bearer(""), {"authorization": "Basic YTpi"}, {"authorization": write}):
        assert ask(here.app, headers=wrong).status == 401


def test_a_request_that_says_it_was_forwarded_counts_as_from_elsewhere(here: Guarded) -> None:
    token = bearer(here.token("read"))
    for name in ("x-forwarded-for", "forwarded", "x-forwarded-host", "via"):
        assert ask(here.app, headers={name: "10.0.0.9"}).status == 401
        assert ask(here.app, headers={name: "10.0.0.9"} | token).status == 200


def test_elsewhere_every_request_needs_a_token(elsewhere: Guarded) -> None:
    for method in ("GET", "HEAD", "OPTIONS", *WRITING):
        for path in ("/api/v1/things", "/metrics", "/api/v1/openapi.json", "/pages", "/nothing"):
            answer = ask(elsewhere.app, method, path)
            assert answer.status == 401
            assert answer.headers["www-authenticate"] == 'Bearer realm="fingertwin"'
    assert elsewhere.seen == []
    assert "Authorization: Bearer" in ask(elsewhere.app).problem["detail"]
    answer = ask(elsewhere.app, headers=bearer("ft_00000000_" + "0" * 64))
    assert answer.headers["www-authenticate"].endswith('error="invalid_token"')
    assert ask(elsewhere.app, path="/api/v1/health/live").status == 200


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/", 404), ("HEAD", "/", 404), ("GET", "/pages/main.js", 404), ("GET", "/favicon.ico", 404),
        ("POST", "/pages/main.js", 401), ("GET", "/pages", 401), ("GET", "/api/v1/things", 401),
        ("GET", "/metrics", 401), ("GET", "/pages/../api/v1/things", 404),
    ],
)  # fmt: skip
def test_elsewhere_the_pages_come_without_a_token_and_nothing_else_does(
    elsewhere: Guarded, method: str, path: str, status: int
) -> None:
    # This application has no pages: past the guard there is nothing.
    assert ask(elsewhere.app, method, path).status == status
    assert elsewhere.seen == []


@pytest.mark.parametrize(
    ("role", "method", "path", "status"),
    [
        ("read", "GET", "/api/v1/things", 200),
        ("read", "HEAD", "/api/v1/things", 200),
        ("read", "POST", "/api/v1/predictions", 200),
        *(("read", method, "/api/v1/things", 403) for method in WRITING),
        *(("write", method, "/api/v1/things", 200) for method in ("GET", *WRITING)),
    ],
)
def test_a_token_may_do_what_its_role_says(elsewhere: Guarded, role: Any, method: str, path: str, status: int) -> None:
    answer = ask(elsewhere.app, method, path, bearer(elsewhere.token(role)))
    assert answer.status == status
    if status == 403:
        assert answer.problem["remedy"] == "fingertwin token create NAME --role write makes one"
        assert elsewhere.seen == []


def test_a_revoked_token_is_refused_within_a_second(elsewhere: Guarded, monkeypatch: pytest.MonkeyPatch) -> None:
    text = elsewhere.token("read")
    assert ask(elsewhere.app, headers=bearer(text)).status == 200
    revoke(elsewhere.database, listed(elsewhere.database)[0].id)
    monkeypatch.setattr(elsewhere.book, "_read_s", elsewhere.book._read_s - FRESH_S)
    assert ask(elsewhere.app, headers=bearer(text)).status == 401


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.1:8765", "localhost:9000", "LOCALHOST.", "[::1]:8765"])
def test_a_service_on_loopback_answers_to_this_machines_names(here: Guarded, host: str) -> None:
    assert ask(here.app, headers={"host": host}).status == 200


@pytest.mark.parametrize(
    "host",
    ["attacker.example", "127.0.0.1.attacker.example", "10.0.0.7", "", "localhost@attacker.example", "a b", "[::1"],
)
def test_a_name_that_was_pointed_at_this_machine_is_refused(here: Guarded, host: str) -> None:
    answer = ask(here.app, headers={"host": host})
    assert answer.status == 421
    assert "localhost or 127.0.0.1" in answer.problem["detail"]
    assert here.seen == []


@pytest.mark.parametrize(
    ("origin", "host", "allowed"),
    [
        ("http://127.0.0.1:8765", "127.0.0.1:8765", True),
        ("https://localhost", "localhost", False),
        ("https://127.0.0.1:8765", "127.0.0.1:8765", False),
        ("http://localhost", "localhost:80", True),
        ("http://localhost:8765", "127.0.0.1:8765", False),
        ("http://localhost:3000", "localhost:8765", False),
        ("https://attacker.example", "127.0.0.1:8765", False),
        ("null", "127.0.0.1:8765", False),
        ("file://", "127.0.0.1:8765", False),
        ("", "127.0.0.1:8765", False),
        ("http://127.0.0.1", "127.0.0.1:8765", False),
        ("http://127.0.0.1:8765.evil.example", "127.0.0.1:8765", False),
        ("http://evil.example/127.0.0.1:8765", "127.0.0.1:8765", False),
        ("http://127.0.0.1:8765@evil.example", "127.0.0.1:8765", False),
    ],
)
def test_only_the_services_own_pages_may_write_or_listen(here: Guarded, origin: str, host: str, allowed: bool) -> None:
    headers = {"host": host, "origin": origin}
    for method in WRITING:
        assert ask(here.app, method, headers=headers).status == (200 if allowed else 403)
    assert open_socket(here.app, headers)[0]["type"] == (
        "websocket.accept" if allowed else "websocket.http.response.start"
    )
    assert len(here.seen) == (5 if allowed else 0)


def test_another_sites_page_loads_nothing_but_a_link_may_be_followed(here: Guarded) -> None:
    assert ask(here.app, headers={"sec-fetch-site": "cross-site", "sec-fetch-mode": "no-cors"}).status == 403
    assert ask(here.app, headers={"sec-fetch-site": "same-site", "sec-fetch-mode": "cors"}).status == 403
    assert ask(here.app, headers={"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate"}).status == 200
    assert ask(here.app, headers={"sec-fetch-site": "same-origin", "sec-fetch-mode": "cors"}).status == 200


@given(st.text(max_size=40), st.text(max_size=40))
def test_no_host_or_origin_breaks_the_check_and_none_is_local_by_chance(host: str, origin: str) -> None:
    found = authority(host)
    assert is_ours(host, "127.0.0.1") == (found is not None and is_loopback(found[0]))
    assert not is_same(origin, host, "http") or origin.lower().startswith("http://")


@pytest.mark.parametrize(
    ("own", "proto", "forwarded", "spoken"),
    [
        ("http", None, False, "http"),
        ("ws", None, False, "http"),
        ("wss", None, False, "https"),
        ("http", None, True, "https"),
        ("http", "http", True, "http"),
        ("http", "HTTPS", True, "https"),
    ],
)
def test_a_page_of_the_other_scheme_is_somebody_elses(
    own: str, proto: str | None, forwarded: bool, spoken: str
) -> None:
    assert scheme_of(own, proto, forwarded=forwarded) == spoken
    for scheme in ("http", "https"):
        assert is_same(f"{scheme}://twin.lab", "twin.lab", spoken) == (scheme == spoken)


def upload(guarded: Guarded, parts: list[bytes], headers: dict[str, str] | None = None) -> Answer:
    return ask(guarded.app, "POST", headers=headers or {}, body=parts)


def test_a_body_up_to_the_limit_is_taken_however_it_comes(here: Guarded) -> None:
    for parts in ([bytes(MOST_BYTES)], [bytes(1000)] * (MOST_BYTES // 1000), [b""] * 50 + [b"a"]):
        assert upload(here, parts).json() == sum(map(len, parts))


def test_a_body_that_says_it_is_too_large_is_refused_before_it_is_read(here: Guarded) -> None:
    answer = upload(here, [bytes(MOST_BYTES)] * 2, {"content-length": str(2 * MOST_BYTES), "expect": "100-continue"})
    assert answer.status == 413
    assert answer.taken == 0
    assert answer.headers["connection"] == "close"
    assert f"at most {MOST_BYTES} bytes" in answer.problem["detail"]
    assert upload(here, [b""], {"content-length": "9" * 5000}).status == 413
    for wrong in ("-1", "1e3", "²", ""):
        assert upload(here, [b""], {"content-length": wrong}).status == 400
    assert here.seen == []


def test_a_body_that_grows_too_large_is_refused_once_and_its_rest_is_thrown_away(here: Guarded) -> None:
    answer = upload(here, [bytes(1000)] * 100)
    assert answer.problem["title"] == "Request Entity Too Large"
    assert answer.taken == 100
    assert [m["type"] for m in answer.messages].count("http.response.start") == 1
    assert here.seen == []


def test_of_an_endless_body_only_so_much_is_thrown_away(here: Guarded, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("server.service.security.body_limit._DRAINED_BYTES", 10_000)
    answer = upload(here, [bytes(MOST_BYTES + 1)] + [bytes(1000)] * 1000)
    assert answer.status == 413
    assert answer.taken == 1 + 10
    assert not answer.messages[-1]["more_body"]


def test_an_answer_in_parts_stays_in_parts(here: Guarded) -> None:
    answer = ask(here.app, path="/api/v1/slow")
    assert [m["body"] for m in answer.messages[1:]] == [b"one", b"two", b"three", b""]


def test_beyond_loopback_a_client_that_asks_too_often_is_told_when_to_come_back(tmp_path: Path) -> None:
    guarded = Guarded(tmp_path, host="0.0.0.0", requests_per_s=0.5)  # noqa: S104
    token, other = bearer(guarded.token("read")), bearer(guarded.token("read"))
    assert [ask(guarded.app, headers=token).status for _ in range(7)] == [200] * 5 + [429] * 2
    answer = ask(guarded.app, headers=token)
    assert 1 <= int(answer.headers["retry-after"]) <= 10
    assert "Wait" in answer.problem["detail"]
    # Others are not kept waiting by it: not another token, not another machine, not whoever has none.
    assert ask(guarded.app, headers=other).status == 200
    assert ask(guarded.app, headers=token, client="10.0.0.8").status == 200
    assert [ask(guarded.app).status for _ in range(7)] == [401] * 5 + [429] * 2


def test_on_loopback_nobody_is_slowed_down(tmp_path: Path) -> None:
    guarded = Guarded(tmp_path, requests_per_s=0.5)
    assert {ask(guarded.app).status for _ in range(20)} == {200}


def test_odd_addresses_and_headers_are_refused(here: Guarded) -> None:
    assert ask(here.app, path="/api/v1/things/" + "x" * 10_000_000).problem["status"] == 414
    assert ask(here.app, query=b"a=" + b"x" * 10_000).problem["status"] == 414
    assert ask(here.app, path="/api/v1/things/a\0b").problem["status"] == 404
    assert ask(here.app, path="/api/v1/things/a\x1b[31m").problem["status"] == 404
    assert ask(here.app, query=b"a=%00").problem["status"] == 400
    assert ask(here.app, headers={"x-a": "x" * 40_000}).problem["status"] == 400
    assert ask(here.app, headers=[("host", "localhost"), ("host", "attacker.example")]).problem["status"] == 400
    assert ask(here.app, path="/api/v1/things/ü").json() == "ü"


def test_every_answer_carries_the_security_headers_and_none_of_cors(here: Guarded) -> None:
    answers = [
        ask(here.app), ask(here.app, headers={"host": "attacker.example"}), ask(here.app, path="/api/v1/broken"),
        ask(here.app, path="/nothing"), upload(here, [bytes(MOST_BYTES + 1)]), ask(here.app, path="/api/v1/slow"),
        ask(here.app, "OPTIONS", headers={"origin": "https://a.example", "access-control-request-method": "PUT"}),
    ]  # fmt: skip
    for answer in answers:
        assert {name.decode() for name, _ in HEADERS} <= set(answer.headers)
        assert not any(name.startswith("access-control-") for name in answer.headers)
        assert "unsafe" not in answer.headers["content-security-policy"]
        assert "strict-transport-security" not in answer.headers
        assert answer.headers["x-request-id"]


def test_a_websocket_takes_its_token_as_a_header_or_as_a_protocol(elsewhere: Guarded) -> None:
    token = elsewhere.token("read")
    offered = {"sec-websocket-protocol": f"fingertwin, fingertwin.bearer.{token}"}
    by_header, by_protocol = (
        open_socket(elsewhere.app, bearer(token), ["a"]),
        open_socket(elsewhere.app, offered, ["a"]),
    )
    assert by_header[1] == by_protocol[1]
    assert by_header[1]["text"] == "a"
    assert (by_header[0]["subprotocol"], by_protocol[0]["subprotocol"]) == (None, "fingertwin")
    assert len(elsewhere.seen) == 2
    assert not any(token in headers for _, headers in elsewhere.seen)
    for wrong in ({}, bearer("ft_1"), {"sec-websocket-protocol": "fingertwin, fingertwin.bearer.ft_1"}):
        assert open_socket(elsewhere.app, wrong)[0]["status"] == 401
        closed = open_socket(elsewhere.app, wrong, extended=False)
        assert [(m["type"], m["code"]) for m in closed] == [("websocket.close", 1008)]
    assert len(elsewhere.seen) == 2


def test_a_websocket_ends_with_its_token(elsewhere: Guarded, monkeypatch: pytest.MonkeyPatch) -> None:
    token = elsewhere.token("read")
    monkeypatch.setattr("server.service.security.tokens.FRESH_S", 0.0)
    send = guard._Socket.send
    sent: list[str] = []

    async def revoking(self: Any, message: Any) -> None:
        sent.append(message["type"])
        if sent.count("websocket.send") == 2:
            revoke(elsewhere.database, listed(elsewhere.database)[0].id)
        await send(self, message)

    monkeypatch.setattr(guard._Socket, "send", revoking)
    messages = open_socket(elsewhere.app, bearer(token), ["a", "b", "c"])
    assert [m.get("text") or m.get("reason") for m in messages[1:]] == ["a", "the token is no longer valid"]


def test_a_failure_of_ours_is_a_problem_without_its_details(here: Guarded, caplog: pytest.LogCaptureFixture) -> None:
    answer = ask(here.app, path="/api/v1/broken")
    assert answer.status == 500
    assert "secret" not in answer.problem["detail"]
    assert "ZeroDivisionError" in caplog.text


def test_a_database_that_cannot_be_written_is_a_503_with_what_to_do(here: Guarded) -> None:
    answer = ask(here.app, path="/api/v1/readonly")
    assert answer.status == 503
    assert answer.headers["retry-after"]
    assert "readonly" in answer.problem["found"]
    assert "health" in answer.problem["remedy"]
    assert "somebody" not in answer.body.decode()


def test_tokens_that_cannot_be_read_let_nobody_in(elsewhere: Guarded, monkeypatch: pytest.MonkeyPatch) -> None:
    token = elsewhere.token("write")
    elsewhere.database.close()
    broken: Callable[[], Any] = lambda: (_ for _ in ()).throw(ConnectionError("gone"))  # noqa: E731
    monkeypatch.setattr(elsewhere.book, "_database", broken)
    assert ask(elsewhere.app, headers=bearer(token)).status == 500
    assert elsewhere.seen == []
