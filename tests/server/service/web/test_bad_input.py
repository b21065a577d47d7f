"""Bad input, on SQLite and PostgreSQL: refused with a problem that says what to do, nothing kept, nothing failed."""

from __future__ import annotations

import hashlib
import json
import struct
import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sqlalchemy import event

from daq.acquisition.blocks import Chunk
from daq.errors import JournalError
from daq.uplink.wire import EPOCH, SHA256
from server.service.schemas.sessions import CASE, DOCUMENT
from server.service.web.problems import PROBLEM
from tests.contracts.ingest import made
from tests.server.service.postgres import postgres_url
from tests.server.service.recorded import EPOCH_1, describe, put
from tests.server.service.running import ServiceReceiver

LARGE = "x" * 10_000_000
JSON = {"Content-Type": "application/json"}
ASKED = b'{"postures_deg": {"MCP": [%s], "PIP": [60], "DIP": [40]}, "masses_g": {"FDP": [%s]}}'


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def service(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceReceiver]:
    settings = {"database_url": postgres_url()} if request.param == "postgresql" else {}
    receiver = ServiceReceiver(tmp_path_factory.mktemp("data"), **settings)
    receiver.client().post("/api/v1/sessions", json={"id": "H01", "document": DOCUMENT}).raise_for_status()
    receiver.client().post("/api/v1/sessions", json={"id": "EMPTY"}).raise_for_status()
    yield receiver
    receiver.close()


def refused(answer: Any, status: int, said: str = "") -> dict[str, Any]:
    """The problem that an answer is, which is no longer than what can be read."""
    assert (answer.status_code, answer.headers["content-type"]) == (status, PROBLEM), answer.text[:500]
    problem: dict[str, Any] = answer.json()
    assert problem["status"] == status
    assert said in problem["detail"]
    assert status != 404 or all(problem[part] for part in ("found", "expected", "remedy"))
    assert len(answer.content) < 10_000
    return problem


def changed(change: Callable[[dict[str, Any]], Any]) -> bytes:
    document: dict[str, Any] = deepcopy(DOCUMENT) | {"id": "BAD"}
    change(document)
    return json.dumps({"id": "BAD", "document": document}).encode()


def deep(levels: int) -> Any:
    value: Any = 1
    for _ in range(levels):
        value = [value]
    return value


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: d["specimen"].update(id=LARGE), "a specimen's id of 10000000 characters"),
        (lambda d: d["specimen"].update(id="y" * 101), "a specimen's id of 101 characters; expected at most 100"),
        (lambda d: d.update({LARGE: 1}), "a key: a text of 10000000 characters"),
        (lambda d: d["cases"][0].update(id=LARGE), "a case with the id"),
        (lambda d: d["cases"][0].update(id="a/b"), "a case with the id 'a/b'"),
        (lambda d: d["cases"][0].update(posture="z" * 9000), "posture is 'zzz"),
        (lambda d: d["cases"][0].update(force_N=[1e300, 0.0, 0.0]), "cases[0].force_N[0] is 1e+300"),
        (lambda d: d["cases"][0]["masses_g"].update(FDP=float("nan")), "cannot be read as JSON"),
        (lambda d: d["cases"][0]["masses_g"].update(FDP=-5), "masses_g.FDP is -5"),
        (lambda d: d["cases"][0]["masses_g"].update(FDP="950 g"), "masses_g.FDP is '950 g'"),
        (lambda d: d.update(gravity_m_s2=9810), "gravity_m_s2 is 9810; expected gravity in m/s²"),
        (lambda d: d["postures_deg"]["hook"].update(PIP=1e9), "expected an angle within ±180 degrees"),
        (lambda d: d["specimen"].update(species="human\0"), "a zero character, which cannot be kept"),
        (lambda d: d["specimen"].update(species="\ud800"), "cannot be read as JSON: no low surrogate"),
        (lambda d: d.update(notes=deep(300)), "more than 32 levels"),
    ],
    ids=lambda value: value[:50] if isinstance(value, str) else "",
)
def test_a_document_with_something_absurd_is_refused(
    service: ServiceReceiver, change: Callable[[dict[str, Any]], Any], said: str
) -> None:
    refused(service.client().post("/api/v1/sessions", content=changed(change), headers=JSON), 422, said)
    refused(service.client().get("/api/v1/sessions/BAD"), 404)


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (ASKED % (b"NaN", b"950"), "cannot be read as JSON"),
        (ASKED % (b"1e999", b"950"), "cannot be read as JSON"),
        (ASKED % (b"40", b"1e300"), "body.masses_g.FDP.0: Input should be less than or equal to 1000000"),
        (ASKED % (b'"40"', b"950"), "body.postures_deg.MCP.0: Input should be a valid number"),
        (ASKED % (b"true", b"950"), "body.postures_deg.MCP.0: Input should be a valid number"),
        (ASKED % (b"40", b"-1"), "below zero"),
        (ASKED % (b"4000", b"950"), "body.postures_deg.MCP.0: Input should be less than or equal to 180"),
        (b'{"masses_g": {"FDP": [950]}, "postures_deg": {"MCP": [0], "PIP": [65]}}', "postures_deg lacks DIP"),
        (
            b'{"masses_g": {"FDP": [1]}, "postures_deg": {"%s": [1]}}' % LARGE[:9_000_000].encode(),
            "at most 60 characters",
        ),
        (b"[", "cannot be read as JSON"),
        (b"null", "body: Input should be a valid dictionary"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_a_prediction_of_nonsense_is_refused(service: ServiceReceiver, body: bytes, said: str) -> None:
    refused(service.client().post("/api/v1/predictions", content=body, headers=JSON), 422, said)


def test_every_fault_of_a_body_is_told_with_what_is_expected(service: ServiceReceiver) -> None:
    body = ASKED % (b'"40"', b'"950"')
    told = refused(service.client().post("/api/v1/predictions", content=body, headers=JSON), 422)
    assert "body.postures_deg.MCP.0: Input should be a valid number; body.masses_g.FDP.0: Input" in told["found"]
    assert told["detail"].startswith(told["found"])
    assert "openapi.json" in told["expected"]
    assert len(told["errors"]) == 2


def test_a_reason_of_blanks_is_no_reason(service: ServiceReceiver) -> None:
    answer = service.client().post("/api/v1/sessions/H01/cases/c001/exclude", json={"reason": "   "})
    assert refused(answer, 422, "excluded is ' '")["expected"] == "a reason in words"


@pytest.mark.parametrize("text", ["torque[PIP] -= k", "torque[PIP]  += k * sine(q_PIP)"])
def test_a_formula_that_cannot_be_used_is_named_once(service: ServiceReceiver, text: str) -> None:
    answer = service.client().post("/api/v1/effects/check", json={"formula": text})
    line = " ".join(text.split())
    assert refused(answer, 422)["detail"].count(f"formula '{line}'") == 1


@pytest.mark.parametrize("kind", ["text/plain", "application/x-www-form-urlencoded", "application/jsonp", None])
def test_a_body_that_is_not_said_to_be_json_is_refused(service: ServiceReceiver, kind: str | None) -> None:
    headers = {} if kind is None else {"Content-Type": kind}
    answer = service.client().post("/api/v1/predictions", content=b"{}", headers=headers)
    refused(answer, 415, "expected Content-Type: application/json")


@pytest.mark.parametrize(
    "value",
    [b'"\\ud800"', b'"\\u0000"', b"1e999", b"NaN", b"[" * 500 + b"]" * 500, b'"\xff"'],
    ids=lambda value: str(value)[:20],
)
def test_an_event_that_cannot_be_kept_or_told_is_refused(service: ServiceReceiver, value: bytes) -> None:
    refused(send_event(service, "EMPTY", 0, b'{"kind": "note", "value": {"x": %s}}' % value), 422, "no JSON object")
    assert service.events("EMPTY") == []


def test_an_event_with_a_number_of_any_length_is_kept_as_a_number_of_its_size(service: ServiceReceiver) -> None:
    name = service.new_session()
    assert (
        send_event(service, name, 0, b'{"kind": "note", "at_s": 1, "value": {"x": %s}}' % (b"1" * 40)).status_code
        == 200
    )
    assert service.events(name)[0]["value"]["x"] == pytest.approx(1.11e39, rel=0.01)


def send_event(service: ServiceReceiver, session: str, number: int, body: bytes) -> Any:
    headers = JSON | {SHA256: hashlib.sha256(body).hexdigest(), EPOCH: EPOCH_1}
    path = f"/api/v1/sessions/{session}/events/{EPOCH_1}/{number}"
    return service.client().put(path, content=body, headers=headers)


def test_a_chunk_with_a_wrong_hash_is_refused_and_the_true_one_is_taken(service: ServiceReceiver) -> None:
    name, client = service.new_session(), service.client()
    describe(client, name)
    chunk = made(0, 40)
    headers = {"X-Fingertwin-Count": "40", SHA256: "0" * 64, EPOCH: EPOCH_1}
    path = f"/api/v1/sessions/{name}/streams/{'a' * 32}/chunks/0"
    problem = refused(client.put(path, content=chunk.to_bytes(), headers=headers), 422, "not what its SHA-256 says")
    assert problem["remedy"] == "Send it again"
    assert put(client, name, chunk).json()["next_seq"] == 40


@pytest.mark.parametrize("value", [1e200, -2e12, float("nan"), float("inf")])
def test_a_chunk_with_what_no_cell_can_tell_is_refused_and_the_true_one_is_taken(
    service: ServiceReceiver, value: float
) -> None:
    name, client = service.new_session(), service.client()
    describe(client, name)
    wrench = made(0, 40).wrench.copy()
    wrench[7, 4] = value
    problem = refused(put(client, name, replace(made(0, 40), wrench=wrench)), 422, f"sample 7: Ty_Nmm is {value:g}")
    assert problem["expected"] == "a number that a load cell can tell, within ±1e+12"
    assert put(client, name, made(0, 40)).json()["next_seq"] == 40


def at_times(first: int, *t_s: float) -> Chunk:
    return replace(made(first, len(t_s)), t_s=np.array(t_s))


def test_time_must_rise_within_a_stream(service: ServiceReceiver) -> None:
    name, client = service.new_session(), service.client()
    describe(client, name)
    put(client, name, at_times(10, 10.0, 11.0)).raise_for_status()
    for first, times in [
        (20, (12.0, 12.0)), (20, (13.0, 12.0)), (20, (12.0, float("nan"))), (20, (12.0, float("inf"))),
        (20, (11.0, 12.0)), (0, (9.0, 10.0)), (12, (10.5, 12.0)),
    ]:  # fmt: skip
        refused(put(client, name, at_times(first, *times)), 422, "time")
    assert put(client, name, at_times(12, 11.5, 12.0)).status_code == 200
    assert put(client, name, at_times(8, 8.0, 9.0)).status_code == 200
    assert len(service.stored(name, "a" * 32)) == 3


@pytest.mark.parametrize(("at", "count"), [(16, -1), (16, 1 << 40), (24, -1), (24, 1 << 40), (16, 3)])
def test_a_chunk_that_says_it_holds_more_or_less_than_it_does_is_refused(at: int, count: int) -> None:
    """Its numbers of samples and reads, with a checksum that holds."""
    body = made(0, 2).to_bytes()[:-4]
    assert struct.unpack_from("<q", body, 16) == (2,)
    body = body[:at] + struct.pack("<q", count) + body[at + 8 :]
    with pytest.raises(JournalError, match="a chunk that says it has"):
        Chunk.from_bytes(body + struct.pack("<I", zlib.crc32(body)))


@pytest.mark.parametrize("what", ["diagnoses", "fits", "next"])
def test_work_on_an_empty_session_is_refused_at_once(service: ServiceReceiver, what: str) -> None:
    answer = service.client().post(f"/api/v1/sessions/EMPTY/{what}", json={})
    refused(answer, 422, "session EMPTY has no load case yet; expected a case")


@pytest.mark.parametrize("what", ["diagnoses", "populations"])
def test_work_on_a_session_twice_is_refused(service: ServiceReceiver, what: str) -> None:
    answer = service.client().post(f"/api/v1/{what}", json={"sessions": ["H01", "H01"]})
    refused(answer, 422, "a session twice; expected each session once")


@pytest.mark.parametrize("what", ["diagnoses", "populations"])
def test_work_on_one_recording_under_two_names_is_refused_at_once(service: ServiceReceiver, what: str) -> None:
    client = service.client()
    again = DOCUMENT | {"id": "AGAIN"}
    client.post("/api/v1/sessions", json={"id": "AGAIN", "document": again}).raise_for_status()
    answer = client.post(f"/api/v1/{what}", json={"sessions": ["H01", "AGAIN"]})
    refused(answer, 422, "H01 and AGAIN hold the same forces; expected each recording once")


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("/api/v1/sessions/none", 404),
        ("/api/v1/sessions/" + "x" * 101, 422),
        ("/api/v1/sessions/" + "x" * 9000, 414),
        ("/api/v1/sessions/a%2F..%2Fb", 404),
        ("/api/v1/sessions/H01/cases/%F0%9F%98%80", 404),
        ("/api/v1/friction?session=%ED%A0%80", 404),
        ("/api/v1/friction?session=%00", 400),
        ("/api/v1/friction?session=H01&session=H01", 422),
        ("/api/v1/fingers/..%2F..%2Fpyproject", 404),
        ("/api/v1/effects/hanger_mass.m0", 404),
        ("/api/v1/revisions/none/document", 404),
        ("/api/v1/jobs/none", 404),
        ("/api/v1/figures/nope", 404),
        ("/api/v1/nope", 404),
    ],
    ids=lambda value: str(value)[:60],
)
def test_what_is_not_there_is_said(service: ServiceReceiver, path: str, status: int) -> None:
    refused(service.client().get(path), status)


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("/api/v1/sessions/H01/comparison?modle=x", "'modle'; expected one of model. Did you mean model?"),
        ("/api/v1/sessions/H01?model=x", "'model'; expected none at this address"),
    ],
)
def test_a_query_parameter_that_is_not_known_is_refused(service: ServiceReceiver, path: str, said: str) -> None:
    refused(service.client().get(path), 422, said)


def test_an_edit_with_something_absurd_changes_nothing(service: ServiceReceiver) -> None:
    client, place = service.client(), "/api/v1/sessions/H01/cases"
    version = client.get("/api/v1/sessions/H01").json()["version"]
    refused(client.post(place, json={"case": CASE | {"id": "x" * 101}}), 422, "a case with the id")
    refused(client.post(place, json={"case": CASE | {"note": LARGE}}), 422, "note: a text of 10000000 characters")
    refused(client.put(f"{place}/c001/windows", json={"loaded_s": [-1e308, 1e308]}), 422, "loaded_s[0] is -1e+308")
    refused(client.put(f"{place}/c001/windows", json={"loaded_s": ["1", "2"]}), 422)
    assert client.get("/api/v1/sessions/H01").json()["version"] == version


def test_another_method_is_told_which_there_are(service: ServiceReceiver) -> None:
    answer = service.client().patch("/api/v1/sessions")
    refused(answer, 405, "the method PATCH; expected GET or POST")
    assert answer.headers["Allow"] == "GET, POST"


def test_what_comes_at_once_is_kept_once_and_in_order(service: ServiceReceiver) -> None:
    """Chunks of one stream, the same session, the same event, from threads; numbers of messages follow the commits."""
    name, client = service.new_session(), service.client()
    heard: list[int] = []
    describe(client, name)
    service.parts.messages.listen(lambda message: heard.append(message.id or 0))
    with ThreadPoolExecutor(8) as pool:
        chunks = [pool.submit(put, client, name, made(40 * k, 40)) for k in [*range(12), *range(12)]]
        begun = [pool.submit(client.post, "/api/v1/sessions", json={"id": f"{name}-at-once"}) for _ in range(6)]
        events = [pool.submit(send_event, service, name, k // 2, b'{"kind": "note"}') for k in range(12)]
        assert {f.result().status_code for f in [*chunks, *events]} == {200}
        assert sorted(f.result().status_code for f in begun) == [200] * 5 + [201]
    cursor = client.get(f"/api/v1/sessions/{name}/streams/{'a' * 32}/cursor").json()
    assert (cursor["next_seq"], cursor["missing"]) == (480, [])
    assert service.stored(name, "a" * 32) == [made(40 * k, 40).to_bytes() for k in range(12)]
    assert len(service.events(name)) == 6
    told = [m.id for m in service.parts.messages.after(0)]
    assert sorted(heard) == told[-len(heard) :]


@contextmanager
def limited(service: ServiceReceiver, pragma: str) -> Iterator[None]:
    """The database's disk is full, or cannot be written, while the block runs."""
    engine = service.parts.database.engine

    def limit(connection: Any, _: Any) -> None:
        connection.execute(pragma)

    event.listen(engine, "connect", limit)
    engine.dispose()
    try:
        yield
    finally:
        event.remove(engine, "connect", limit)
        engine.dispose()


@pytest.mark.parametrize("pragma", ["PRAGMA max_page_count=1", "PRAGMA query_only=ON"], ids=["full", "read-only"])
def test_on_a_full_or_read_only_disk_nothing_is_half_kept_and_reading_goes_on(tmp_path: Path, pragma: str) -> None:
    service = ServiceReceiver(tmp_path)
    client, name = service.client(), service.new_session()
    describe(client, name)
    put(client, name, made(0, 40)).raise_for_status()
    with limited(service, pragma):
        kept = 1
        # A page that is begun is filled before another is wanted.
        while (answer := put(client, name, made(40 * kept, 40))).status_code == 200:
            kept += 1
        refused(answer, 503, "expected one that answers, on a disk with space that may be written")
        assert answer.headers["Retry-After"] == "2"
        assert client.get(f"/api/v1/sessions/{name}").json()["streams"][0]["held"] == 40 * kept
        assert len(service.stored(name, "a" * 32)) == kept
    cursor = put(client, name, made(40 * kept, 40)).json()
    assert (cursor["next_seq"], cursor["missing"]) == (40 * (kept + 1), [])
    service.close()
