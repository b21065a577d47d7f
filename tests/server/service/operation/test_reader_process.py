"""Readers are answered by a process of their own: the same answers, benches never wait for it, and it may die."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import psutil
import pytest
from starlette.requests import Request

from server.service.operation.reader_process import ReaderProcess, _unless_gone
from server.service.web.workers import GoneError
from tests.contracts.ingest import made
from tests.server.service.recorded import describe, put, upload
from tests.server.service.running import ServiceReceiver

SESSION, PATIENCE_S = "synek2019_H01", 300.0
OF = f"/api/v1/sessions/{SESSION}"
READ = (
    "/api/v1/sessions", "/api/v1/effects", "/api/v1/effects/hanger_mass", "/api/v1/fingers", "/api/v1/figures",
    OF, f"{OF}/cases", f"{OF}/comparison", f"{OF}/check", f"{OF}/export?format=csv", f"{OF}/export?format=none",
    f"/api/v1/figures/comparison/scatter?session={SESSION}", "/api/v1/sessions/nope", "/api/v1/effects/%C3%A4%20",
    f"{OF}/readings",
)  # fmt: skip
# Too long for an address, but nothing is kept of them: the last two are refused.
ASKED: dict[str, Any] = {
    "/api/v1/predictions": {"postures_deg": {"MCP": [0], "PIP": [65], "DIP": [50]}, "masses_g": {"FDP": [950]}},
    "/api/v1/fingers/an1979_middle/scalings": {"bones_mm": {"PP": 40.1, "MP": 25.2}, "name": "H07"},
    "/api/v1/activations": {"finger": "nope"},
    "/api/v1/predictions?": {"postures_deg": {"PIP": [65]}, "masses_g": {"FDP": ["heavy"]}},
}
# Of an answer, another each time.
OWN = {"x-request-id", "date"}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceReceiver]:
    out = ServiceReceiver(tmp_path_factory.mktemp("service"), reader_process=True, warm_workers=False)
    upload(out.client(), SESSION)
    yield out
    pid = process_of(out).pid
    out.close()
    assert pid is not None
    assert not psutil.pid_exists(pid)


def process_of(service: ServiceReceiver) -> ReaderProcess:
    found: ReaderProcess = service.client().app.state.reader_process
    assert found.wait(PATIENCE_S)
    return found


def asked(client: Any, address: str, body: Any = None, **headers: str) -> tuple[Any, ...]:
    answer = client.get(address, headers=headers) if body is None else client.post(address, json=body)
    return answer.status_code, {n: v for n, v in answer.headers.items() if n not in OWN}, answer.content


def test_answers_are_those_of_the_service_itself(service: ServiceReceiver, monkeypatch: pytest.MonkeyPatch) -> None:
    client, process, passed = service.client(), process_of(service), list[int]()
    answer = process.answer

    async def counted(request: Request) -> Any:
        found = await answer(request)
        passed.append(0 if found is None else found.status_code)
        return found

    monkeypatch.setattr(process, "answer", counted)
    there = [asked(client, a, ASKED.get(a)) for a in (*READ, *ASKED)]
    assert passed == [status for status, *_ in there]
    tag = there[READ.index(f"{OF}/comparison")][1]["etag"]
    assert asked(client, f"{OF}/comparison", **{"If-None-Match": tag})[0] == passed[-1] == 304
    monkeypatch.setattr(process, "_url", "")
    assert there == [asked(client, a, ASKED.get(a)) for a in (*READ, *ASKED)]
    assert {status for status, *_ in there} >= {200, 404, 422}


def test_what_was_written_is_read_at_once(service: ServiceReceiver) -> None:
    client = service.client()
    process_of(service)
    case = client.get(f"{OF}/cases").json()["cases"][0]["id"]
    for change, state in (("exclude", "excluded"), ("include", "measured")):
        client.post(f"{OF}/cases/{case}/{change}", json={"reason": "trial"} if change == "exclude" else {})
        assert client.get(f"{OF}/cases").json()["cases"][0]["state"] == state


def test_benches_wait_for_no_reader(service: ServiceReceiver) -> None:
    client, name = service.client(), service.new_session()
    describe(client, name)
    stopped = psutil.Process(process_of(service).pid)
    with ThreadPoolExecutor(20) as pool:
        stopped.suspend()
        try:
            waiting = [pool.submit(client.get, "/api/v1/sessions") for _ in range(20)]
            for k in range(10):
                assert put(client, name, made(40 * k, 40)).status_code == 200
            for address in ("/api/v1/health", "/api/v1/health/live", "/metrics"):
                assert client.get(address).status_code == 200
            assert not any(w.done() for w in waiting)
        finally:
            stopped.resume()
        assert {w.result().status_code for w in waiting} == {200}


def test_it_gives_way_and_answers_the_service_alone(service: ServiceReceiver) -> None:
    process = process_of(service)
    assert psutil.Process(process.pid).nice() != psutil.Process().nice()
    answer = httpx.get(f"{process._url}/api/v1/sessions", trust_env=False)
    assert (answer.status_code, answer.text) == (403, "for the service alone")


def test_a_process_that_dies_is_replaced_and_meanwhile_the_service_answers(service: ServiceReceiver) -> None:
    client, process = service.client(), process_of(service)
    before = process.pid
    assert before is not None
    killed = psutil.Process(before)
    killed.kill()
    killed.wait(30)
    assert client.get("/api/v1/sessions").status_code == 200
    assert process.wait(PATIENCE_S)
    while process.pid in (before, None):
        assert process.wait(PATIENCE_S)
    assert "fingertwin_reader_process 1.0" in client.get("/metrics").text
    assert client.get("/api/v1/sessions").status_code == 200


def test_what_it_fails_in_is_answered_by_the_service(service: ServiceReceiver, monkeypatch: pytest.MonkeyPatch) -> None:
    client, process = service.client(), process_of(service)
    failing = httpx.AsyncClient(transport=httpx.MockTransport(lambda _: httpx.Response(500)))
    monkeypatch.setattr(process, "_client", failing)
    assert client.get("/api/v1/sessions").status_code == 200


def test_nothing_goes_on_for_a_client_that_has_gone() -> None:
    async def receive() -> dict[str, Any]:
        return {"type": "http.disconnect"}

    async def main() -> None:
        sending: asyncio.Future[httpx.Response] = asyncio.get_running_loop().create_future()
        with pytest.raises(GoneError):
            await _unless_gone(Request({"type": "http"}, receive), sending)
        assert sending.cancelled()

    asyncio.run(main())
