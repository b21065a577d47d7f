"""What the service refuses, or nobody says, is one clear line; only what may come twice is sent twice."""

from __future__ import annotations

import socket
from collections.abc import Callable

import httpx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.errors import InputError
from fingertwin.client import Client, ServiceError, ServiceUnreachableError
from fingertwin.client.exchange import Exchange, path_of
from tests.client.services import URL, InProcess, said, scripted

PROBLEM = {
    "title": "Service Unavailable",
    "status": 503,
    "detail": "the disk is full; expected space.",
    "found": "the disk is full",
    "expected": "space",
    "remedy": "Delete something",
}


def one_line(error: BaseException) -> str:
    text = str(error)
    assert text.strip() == text
    assert len(text.splitlines()) == 1
    return text


def exchange(
    *answers: httpx.Response | Exception, retries: int = 3
) -> tuple[Exchange, list[httpx.Request], list[float]]:
    transport, asked = scripted(*answers)
    slept: list[float] = []
    return Exchange(URL, None, 1.0, retries, transport, slept.append), asked, slept


def test_an_unknown_session_is_a_404_in_one_line(twin: Client) -> None:
    with pytest.raises(ServiceError) as caught:
        twin.session("DEV-99")
    assert caught.value.status == 404
    assert caught.value.found == "there is no session DEV-99"
    remedy = "Look how it is spelt, and ask for one that is there"
    assert one_line(caught.value) == f"there is no session DEV-99; expected one of GET /api/v1/sessions. {remedy}."


def test_a_body_that_is_wrong_is_said_with_its_place(twin: Client) -> None:
    twin.upload("synek2019_H01")
    with pytest.raises(ServiceError, match="reason") as caught:
        twin.session("synek2019_H01").exclude("hook-FDP-950-tip", "")
    assert caught.value.status == 422
    assert caught.value.errors


def test_a_service_that_is_not_there_is_said_in_one_line() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{free.getsockname()[1]}"
        with Client(url, retries=1) as twin, pytest.raises(ServiceUnreachableError) as caught:
            twin.sessions()
    assert one_line(caught.value).startswith(f"no service answers at {url} (")
    assert "fingertwin serve" in str(caught.value)


def test_reading_is_repeated_and_waits_as_long_as_the_service_asks() -> None:
    asks, asked, slept = exchange(
        said(PROBLEM, 503, **{"Retry-After": "2"}), httpx.ConnectError("refused"), said({"sessions": []})
    )
    assert asks.get(path_of("sessions")) == {"sessions": []}
    assert len(asked) == 3
    assert 2.0 <= slept[0] <= 2.5
    assert 0.0 < slept[1] <= 0.5


@pytest.mark.parametrize("answer", [said(PROBLEM, 503), httpx.ReadTimeout("slow"), httpx.ConnectError("refused")])
def test_a_job_is_not_asked_for_twice(answer: httpx.Response | Exception) -> None:
    asks, asked, slept = exchange(answer)
    with pytest.raises((ServiceError, ServiceUnreachableError)) as caught:
        asks.post(path_of("sessions", "S", "fits"), {})
    one_line(caught.value)
    assert len(asked) == 1
    assert slept == []


def test_patience_ends() -> None:
    asks, asked, slept = exchange(said(PROBLEM, 503))
    with pytest.raises(ServiceError) as caught:
        asks.get(path_of("sessions"))
    assert one_line(caught.value) == "the disk is full; expected space. Delete something."
    assert (len(asked), len(slept)) == (4, 3)
    asks, asked, slept = exchange(said(PROBLEM, 429, **{"Retry-After": "3000"}))
    with pytest.raises(ServiceError):
        asks.get(path_of("sessions"))
    assert (len(asked), slept) == (1, [])


def test_a_refusal_is_not_repeated() -> None:
    asks, asked, _ = exchange(said(PROBLEM | {"status": 409}, 409))
    with pytest.raises(ServiceError):
        asks.put(path_of("sessions"), b"", {})
    assert len(asked) == 1


@given(
    st.integers(200, 599),
    st.binary(max_size=60) | st.sampled_from([b"{}", b"[]", b'{"detail":7}', b'{"found":"a\\nb"}']),
)
def test_whatever_answers_is_an_object_or_one_line(status: int, body: bytes) -> None:
    asks, *_ = exchange(httpx.Response(status, content=body), retries=0)
    found: object = None
    try:
        found = asks.get(path_of("health"))
    except ServiceError as error:
        found = error.status, one_line(error)[:0]
    assert isinstance(found, dict) or found == (status, "")


@pytest.mark.parametrize(
    ("ask", "line"),
    [
        (lambda twin: twin.diagnose("DEV-02"), "sessions is 'DEV-02'; expected a list of sessions. Give ['DEV-02']."),
        (
            lambda twin: twin.diagnose(["DEV-02"], effects="own"),
            "effects is 'own'; expected a list of names. Give ['own'].",
        ),
        (
            lambda twin: twin.population(["DEV-02"], ["hanger_mass"]),
            "a set of effects is 'hanger_mass'; expected a list of names. Give ['hanger_mass'].",
        ),
        (
            lambda twin: twin.sessions()[0].add(without="hanger_mass"),
            "without is 'hanger_mass'; expected a list of names. Give ['hanger_mass'].",
        ),
    ],
)
def test_one_name_is_no_list_of_names(ask: Callable[[Client], object], line: str) -> None:
    transport, asked = scripted(said({"sessions": [{"id": "DEV-02"}]}))
    with Client(URL, transport=transport) as twin, pytest.raises(InputError) as caught:
        ask(twin)
    assert one_line(caught.value) == line
    assert [r.method for r in asked if r.method != "GET"] == []


def test_pages_are_put_together() -> None:
    rows = [{"id": f"s{n:03d}"} for n in range(450)]

    def page(request: httpx.Request) -> httpx.Response:
        after, limit = request.url.params.get("after", ""), int(request.url.params["limit"])
        found = [row for row in rows if row["id"] > after][:limit]
        return said({"sessions": found, "next": found[-1]["id"] if len(found) == limit else None})

    with Client(URL, transport=httpx.MockTransport(page)) as twin:
        assert [session.id for session in twin.sessions()] == [row["id"] for row in rows]


def test_an_answer_of_another_version_is_said_in_one_line() -> None:
    with Client(URL, transport=scripted(said({"session": "S"}))[0]) as twin, pytest.raises(ServiceError) as caught:
        twin.session("S").compare()
    assert "one version" in one_line(caught.value)


def test_a_figure_is_what_the_service_draws_or_why_there_is_none() -> None:
    drawn = {"data": [{"type": "scatter", "x": [1.0], "y": [2.0]}], "layout": {"width": 960}}
    transport, asked = scripted(
        said({"figure": drawn, "text": "…"}), said({"figure": None, "text": "No figure: no validation case."})
    )
    with Client(URL, transport=transport) as twin:
        shown = twin.figure("comparison/scatter", session="S")
        assert (shown.data[0].x, shown.layout.width) == ((1.0,), 960)
        with pytest.raises(InputError, match="No figure: no validation case") as caught:
            twin.figure("comparison/scatter_validation", session="S")
    one_line(caught.value)
    assert asked[0].url.path == "/api/v1/figures/comparison/scatter"
    assert dict(asked[0].url.params) == {"session": "S"}


@pytest.mark.parametrize(
    "make",
    [
        lambda: Client("127.0.0.1:8765"),
        lambda: Client("ftp://bench"),
        lambda: Client("http://"),
        lambda: Client("http://bench:port"),
        lambda: Client(URL, "geheim\nX-Other: 1"),
        lambda: Client(URL, ""),
        lambda: Client().session(""),
        lambda: Client().session(".."),
    ],
)
def test_an_address_a_token_or_a_name_that_is_none_is_refused_before_it_is_sent(make: Callable[[], object]) -> None:
    with pytest.raises(InputError) as caught:
        make()
    assert "geheim" not in one_line(caught.value)


def test_a_token_that_is_not_valid_is_a_401_in_one_line(line: InProcess) -> None:
    with Client(URL, "ft_wrong", transport=line) as twin, pytest.raises(ServiceError) as caught:
        twin.sessions()
    assert caught.value.status == 401
    assert "ft_wrong" not in one_line(caught.value)
    assert len(line.asked) == 1


def test_the_health_of_the_service_can_be_asked_for(twin: Client) -> None:
    health = twin.health()
    assert health.status in ("ok", "degraded")
    assert health.database["ok"] is True
    assert (health.status == "ok") == (not health.problems)


def test_a_token_is_sent_with_every_request(monkeypatch: pytest.MonkeyPatch) -> None:
    transport, asked = scripted(said({"sessions": [], "next": None}))
    monkeypatch.setenv("FINGERTWIN_TOKEN", "ft_of_the_machine")
    for token in (" ft_abc\n", None):
        with Client(URL, token, transport=transport) as twin:
            twin.sessions()
    assert [request.headers["Authorization"] for request in asked] == ["Bearer ft_abc", "Bearer ft_of_the_machine"]
