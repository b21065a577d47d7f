"""Sessions at the service: what is measured, told, edited, hidden, and what a request may not do."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from typing import Any

import pytest

from daq.uplink.wire import EPOCH, SHA256, events_path
from fingermodel.comparing import compare
from fingermodel.fingers.files import read_finger
from fingermodel.session import Session
from server.service.storage.purge import purge
from tests.server.service.recorded import (
    EPOCH_1,
    PUBLISHED,
    STREAM,
    chunks_of,
    describe,
    document_of,
    holding,
    listed_as_answered,
    put,
    small,
    upload,
)
from tests.server.service.running import ServiceReceiver

RECORDED = "DEV-01"
AT = "/api/v1/sessions"


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceReceiver]:
    yield from holding(tmp_path_factory.mktemp("service"), RECORDED, PUBLISHED)


def plain(body: Any) -> Any:
    """As a reader of the JSON gets it."""
    return json.loads(json.dumps(body))


@pytest.mark.parametrize("name", [RECORDED, PUBLISHED])
def test_a_comparison_is_that_of_the_command_line_to_the_last_bit(service: ServiceReceiver, name: str) -> None:
    answer = service.client().get(f"{AT}/{name}/comparison").json()
    expected = plain(compare(Session.open(name, catalogue=False)).as_dict())
    assert {k: answer[k] for k in expected} == expected
    assert answer["blinded"] == []
    assert answer["waiting"] == answer["failed"] == {}
    assert answer["provenance"]["model"] == "an1979_middle" if name == RECORDED else "synek2019_initial"


@pytest.fixture
def with_its_finger(fresh: ServiceReceiver) -> ServiceReceiver:
    """A service with a session whose finger came along, as `Client.upload` sends it."""
    finger = read_finger("synek2019_optimised").document | {"id": "mine"}
    document = document_of(PUBLISHED) | {"id": "own", "finger": "mine.yaml", "finger_document": finger}
    fresh.client().post(AT, json={"id": "own", "document": document}).raise_for_status()
    return fresh


def test_a_finger_that_came_along_is_no_unknown_one(with_its_finger: ServiceReceiver) -> None:
    answer = with_its_finger.client().get(f"{AT}/own/comparison").json()
    assert answer["model"] == "mine"
    assert not {"unknown_key", "unknown_finger"} & {w["code"] for w in answer["warnings"]}


def test_a_finger_that_came_along_is_asked_for_by_the_name_that_answers_give_it(
    with_its_finger: ServiceReceiver,
) -> None:
    client = with_its_finger.client()
    own = client.get(f"{AT}/own/comparison").json()
    assert client.get(f"{AT}/own/comparison", params={"model": own["model"]}).json() == own
    # As a search's report asks for the model that was searched.
    assert client.get(f"{AT}/own/report", params={"model": own["model"]}).status_code == 200


def test_friction_carries_what_the_check_warns_of(fresh: ServiceReceiver) -> None:
    document = document_of(PUBLISHED) | {"id": "turned"}
    for case in document["cases"]:
        case["force_N"] = [-f for f in case["force_N"]]
    fresh.client().post(AT, json={"id": "turned", "document": document}).raise_for_status()
    answer = fresh.client().get("/api/v1/friction", params={"session": "turned"}).json()
    assert "wrong_sign" in {w["code"] for w in answer["warnings"]}


def test_a_comparison_that_the_client_has_is_not_sent_again(service: ServiceReceiver) -> None:
    path = f"{AT}/{RECORDED}/comparison"
    first = service.client().get(path)
    again = service.client().get(path, headers={"If-None-Match": first.headers["ETag"]})
    assert (again.status_code, again.content) == (304, b"")
    assert service.client().get(path, headers={"If-None-Match": '"x"'}).status_code == 200


def test_readings_in_any_order_give_the_same_forces_and_what_lacks_is_said(
    service: ServiceReceiver, fresh: ServiceReceiver
) -> None:
    client = fresh.client()
    document = document_of(RECORDED) | {"id": "any"}
    client.post(AT, json={"id": "any", "document": document}).raise_for_status()
    describe(client, "any")
    chunks = list(chunks_of(RECORDED))
    missing = chunks.pop(7)
    chunks = chunks[::-1]
    for chunk in chunks:
        put(client, "any", chunk).raise_for_status()
    states = {c["id"]: c for c in client.get(f"{AT}/any/cases").json()["cases"]}
    begin, end = missing.t_s[0], missing.t_s[-1]
    lacking = {
        c["id"] for c in document["cases"]
        if any(w[0] <= end and w[1] >= begin for w in (c["unloaded_s"], c["loaded_s"]))
    }  # fmt: skip
    assert lacking
    assert {i for i, c in states.items() if c["state"] == "waiting"} == lacking
    assert all("missing" in states[i]["why"] for i in lacking)
    put(client, "any", missing).raise_for_status()
    ours = client.get(f"{AT}/any/comparison").json()
    theirs = service.client().get(f"{AT}/{RECORDED}/comparison").json()
    assert ours["cases"] == theirs["cases"]


def test_each_case_is_told_as_soon_as_its_readings_are_there(fresh: ServiceReceiver) -> None:
    client = fresh.client()
    upload(client, PUBLISHED)
    assert fresh.parts.case_updates.settle(30.0)
    told = [m for m in fresh.parts.messages.after(0) if m.kind == "case"]
    assert {m.body["id"] for m in told} == {c["id"] for c in document_of(PUBLISHED)["cases"]}
    compared = {c["id"]: c for c in client.get(f"{AT}/{PUBLISHED}/comparison").json()["cases"]}
    for message in told:
        assert message.body["predicted_N"] == compared[message.body["id"]]["predicted_N"]
    # Nothing is told twice, not after a restart either.
    fresh.restart()
    fresh.parts.case_updates.touch(PUBLISHED)
    assert fresh.parts.case_updates.settle(30.0)
    assert [m.id for m in fresh.parts.messages.after(0) if m.kind == "case"] == [m.id for m in told]


def test_an_undone_edit_leaves_nothing_behind_and_an_undo_can_be_undone(fresh: ServiceReceiver) -> None:
    client = fresh.client()
    upload(client, RECORDED)
    path = f"{AT}/{RECORDED}"
    before = client.get(f"{path}/comparison").json()["cases"]
    moved = client.put(f"{path}/cases/c001/windows", json={"loaded_s": [6.5, 8.0]})
    assert moved.status_code == 200
    edit = moved.json()["edit"]
    after = client.get(f"{path}/comparison").json()["cases"]
    assert after[0]["measured_N"] != before[0]["measured_N"]
    assert after[1:] == before[1:]
    client.post(f"{path}/cases/c002/exclude", json={"reason": "the suture slipped"}).raise_for_status()
    assert client.get(f"{path}/comparison").json()["excluded"] == {"c002": "the suture slipped"}
    undo = client.post(f"{path}/edits/{edit}/undo", json={}).json()["edit"]
    assert client.get(f"{path}/cases/c001").json()["measured_N"] == before[0]["measured_N"]
    assert client.post(f"{path}/edits/{edit}/undo", json={}).status_code == 409
    client.post(f"{path}/edits/{undo}/undo", json={}).raise_for_status()
    assert client.get(f"{path}/cases/c001").json()["measured_N"] == after[0]["measured_N"]
    edits = client.get(f"{path}/edits").json()["edits"]
    assert [(e["kind"], e["in_force"]) for e in edits] == [
        ("windows", True), ("exclude", True), ("undo", False), ("undo", True),
    ]  # fmt: skip


def test_a_window_outside_a_finished_recording_is_an_error_until_it_is_mended(fresh: ServiceReceiver) -> None:
    client = fresh.client()
    document = document_of(RECORDED)
    sound, document["cases"][0]["loaded_s"] = document["cases"][0]["loaded_s"], [9000.0, 9003.0]
    client.post(AT, json={"id": RECORDED, "document": document}).raise_for_status()
    describe(client, RECORDED)
    chunks = list(chunks_of(RECORDED))
    for chunk in chunks:
        put(client, RECORDED, chunk).raise_for_status()
    path = f"{AT}/{RECORDED}"
    refused = client.get(f"{path}/comparison")
    assert refused.status_code == 422
    end_s = next(c.t_s[-1] for c in reversed(chunks) if len(c))
    runs = f"lies outside the recording, which runs from 0 to {end_s:g} s"
    assert f"case c001: loaded_s [9000, 9003] s {runs}" in refused.text
    mended = client.put(f"{path}/cases/c001/windows", json={"loaded_s": sound})
    assert mended.status_code == 200
    assert client.get(f"{path}/comparison").status_code == 200
    # No edit brings one back: all other cases could not be compared either.
    undone = client.post(f"{path}/edits/{mended.json()['edit']}/undo", json={})
    assert (undone.status_code, undone.json()["found"].split(" (")[0]) == (
        422,
        f"case c001: loaded_s [9000, 9003] s {runs}",
    )
    for case, window in (("c002", [9000, 9003]), ("c002", [-50, -40]), ("c001", [5, 900_000])):
        answer = client.put(f"{path}/cases/{case}/windows", json={"loaded_s": window})
        told = answer.json()
        assert answer.status_code == 422
        assert told["found"].startswith(f"case {case}: loaded_s [{window[0]:g}, {window[1]:g}] s {runs}")
        assert (told["expected"], told["remedy"].split(",")[0]) == ("windows inside it", "Correct the window")
    added = document["cases"][0] | {"id": "new"}
    assert client.post(f"{path}/cases", json={"case": added}).status_code == 422
    assert [e["number"] for e in client.get(f"{path}/edits").json()["edits"]] == [mended.json()["edit"]]
    assert client.get(f"{path}/comparison").status_code == 200


def test_once_a_log_has_ended_nothing_waits_for_readings_until_it_is_gone_on_with(fresh: ServiceReceiver) -> None:
    client = fresh.client()
    document, chunks = document_of(RECORDED), [c for c in chunks_of(RECORDED) if len(c)]
    document["cases"][0]["loaded_s"] = [9000.0, 9003.0]
    client.post(AT, json={"id": RECORDED, "document": document}).raise_for_status()
    describe(client, RECORDED)

    def tell(number: int, kind: str, stream: str = STREAM, **value: int) -> None:
        event = {"at_s": 1.0, "kind": kind, "stream": stream, "utc_s": 1.0, "value": value}
        body = json.dumps(event, sort_keys=True, separators=(",", ":")).encode()
        headers = {"Content-Type": "application/json", SHA256: hashlib.sha256(body).hexdigest(), EPOCH: EPOCH_1}
        client.put(f"{events_path(RECORDED, EPOCH_1)}/{number}", content=body, headers=headers).raise_for_status()

    def state() -> tuple[str, bool]:
        found = client.get(f"{AT}/{RECORDED}/cases/c001").json()
        return found["state"], "outside the recording" in found["why"]

    half = len(chunks) // 2
    for chunk in chunks[:half]:
        put(client, RECORDED, chunk).raise_for_status()
    assert state() == ("waiting", False)
    tell(0, "ended", samples=chunks[half].first_seq + 1)  # says of more than is there
    assert state() == ("waiting", False)
    tell(1, "ended", samples=chunks[half].first_seq)
    assert state() == ("failed", True)
    tell(2, "reconnected")
    assert state() == ("waiting", False)
    for chunk in chunks[half:]:
        put(client, RECORDED, chunk).raise_for_status()
    assert state() == ("waiting", False)
    tell(3, "ended", samples=chunks[-1].next_seq)
    assert state() == ("failed", True)
    tell(4, "started", "b" * 32)  # another replay of the session: its own recording has ended all the same
    tell(5, "ended", "b" * 32, samples=7)
    assert state() == ("failed", True)


def test_an_edit_that_would_make_the_session_unusable_changes_nothing(fresh: ServiceReceiver) -> None:
    client = fresh.client()
    upload(client, RECORDED)
    path = f"{AT}/{RECORDED}"
    before = client.get(path).json()["version"]
    refused = [
        client.put(f"{path}/cases/c001/windows", json={"loaded_s": [9.0, 5.0]}),
        client.put(f"{path}/cases/c001/windows", json={"loaded_s": None}),
        client.put(f"{path}/cases/c001/windows", json={}),
        client.post(f"{path}/cases", json={"case": {"id": "new", "posture": "nowhere"}}),
        client.post(f"{path}/cases/c001/exclude", json={"reason": ""}),
    ]
    assert [r.status_code for r in refused] == [422] * 5
    assert client.put(f"{path}/cases/c999/windows", json={"loaded_s": [1.0, 2.0]}).status_code == 404
    assert client.post(f"{path}/cases", json={"case": document_of(RECORDED)["cases"][0]}).status_code == 409
    assert client.get(path).json()["version"] == before
    assert client.get(f"{path}/edits").json()["edits"] == []


def test_a_session_is_begun_once_and_a_deleted_one_keeps_its_id(fresh: ServiceReceiver) -> None:
    client = fresh.client()
    assert client.post(AT, json={"id": "S1", "document": small()}).status_code == 201
    assert client.post(AT, json={"id": "S1", "document": small()}).status_code == 200
    assert client.post(AT, json={"id": "S1", "document": small(cases=2)}).status_code == 409
    assert client.post(AT, json={"id": "S1"}).status_code == 409
    assert client.delete(f"{AT}/S1").status_code == 204
    assert client.get(f"{AT}/S1").status_code == 404
    assert client.get(AT).json()["sessions"] == []
    gone = client.post(AT, json={"id": "S1", "document": small(cases=2)})
    assert gone.status_code == 409
    assert "deleted" in gone.json()["detail"]


def test_a_deleted_session_is_brought_back_by_its_own_document_until_it_is_purged(fresh: ServiceReceiver) -> None:
    client = fresh.client()
    sent: dict[str, Any] = {"id": "S1", "document": small()}
    case = sent["document"]["cases"][0]["id"]
    client.post(AT, json=sent).raise_for_status()
    client.post(f"{AT}/S1/cases/{case}/exclude", json={"reason": "slipped"}).raise_for_status()
    before = client.get(f"{AT}/S1").json()
    client.delete(f"{AT}/S1").raise_for_status()
    back = client.post(AT, json=sent)
    assert back.status_code == 200
    assert back.json() == before | {"version": before["version"] + 2}
    assert [e["kind"] for e in client.get(f"{AT}/S1/edits").json()["edits"]] == ["exclude"]
    trail = client.get("/api/v1/audit", params={"session": "S1"}).json()["entries"]
    assert [e["what"] for e in trail][-2:] == ["session deleted", "session restored"]
    client.delete(f"{AT}/S1").raise_for_status()
    purge(fresh.parts.database, "deleted", 0.0)
    for again in (sent, {"id": "S1"}):
        gone = client.post(AT, json=again)
        assert (gone.status_code, gone.json()["expected"]) == (409, "another id")


def test_what_a_bench_sent_is_not_brought_back_by_a_bench_that_goes_on(fresh: ServiceReceiver) -> None:
    client = fresh.client()
    client.post(AT, json={"id": "LOG"}).raise_for_status()
    describe(client, "LOG")
    client.delete(f"{AT}/LOG").raise_for_status()
    for again in ({"id": "LOG"}, {"id": "LOG", "document": small() | {"id": "LOG"}}):
        gone = client.post(AT, json=again)
        assert (gone.status_code, gone.json()["expected"]) == (409, "another id")
    assert client.get(f"{AT}/LOG").status_code == 404


def test_the_list_says_of_a_session_what_its_own_answer_says(fresh: ServiceReceiver) -> None:
    client = fresh.client()
    client.post(AT, json={"id": "S1", "document": small()}).raise_for_status()
    client.post(AT, json={"id": "LOG"}).raise_for_status()
    describe(client, "LOG")
    document, log = listed_as_answered(client, "S1"), listed_as_answered(client, "LOG")
    assert (document["source"], document["closed"]) == ("document", True)
    assert (log["source"], log["closed"], log["specimen"]) == ("none", False, None)


def test_lists_are_paged_without_loss(fresh: ServiceReceiver) -> None:
    client = fresh.client()
    names = sorted(f"S{i}" for i in range(7))
    for name in names:
        client.post(AT, json={"id": name, "document": small(name)}).raise_for_status()
    found, after = [], ""
    while True:
        page = client.get(AT, params={"limit": 3, "after": after}).json()
        found += [s["id"] for s in page["sessions"]]
        if page["next"] is None:
            break
        after = page["next"]
    assert found == names


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"finger": "../../etc/passwd"}, "finger"),
        ({"finger": "/etc/passwd"}, "finger"),
        ({"tension_factor": 7}, "0 < c"),
        ({"id": "another"}, "another"),
        ({"cases": []}, "load case"),
        ({"format": "bench-session/9"}, "bench-session/1"),
        ({"specimen": document_of(PUBLISHED)["specimen"] | {"name": "Doe"}}, "name"),
    ],
)
def test_a_document_that_cannot_be_used_is_refused_in_one_line(
    service: ServiceReceiver, change: dict[str, Any], said: str
) -> None:
    answer = service.client().post(AT, json={"id": "bad", "document": small("bad") | change})
    assert answer.status_code == 422
    assert answer.headers["Content-Type"] == "application/problem+json"
    assert said in answer.json()["detail"]
    assert "\n" not in answer.json()["detail"]
    assert service.client().get(f"{AT}/bad").status_code == 404


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"{",
        b"[]",
        b"null",
        b'{"id": "a\\u0000b"}',
        b'{"id": "\\ud800"}',
        b'{"id": NaN}',
        b'{"id": 3}',
        b"\xff\xfe",
    ],
)
def test_a_body_that_is_no_session_is_refused(service: ServiceReceiver, body: bytes) -> None:
    answer = service.client().post(AT, content=body, headers={"Content-Type": "application/json"})
    assert answer.status_code == 422
    assert answer.json()["status"] == 422


def test_a_session_without_a_measured_case_says_what_it_waits_for(fresh: ServiceReceiver) -> None:
    client = fresh.client()
    client.post(AT, json={"id": RECORDED, "document": document_of(RECORDED)}).raise_for_status()
    answer = client.get(f"{AT}/{RECORDED}/comparison")
    assert answer.status_code == 422
    assert "96 waiting" in answer.json()["detail"]
    assert client.get(f"{AT}/{RECORDED}").json()["cases"] == {"waiting": 96}
    client.post(AT, json={"id": "empty"}).raise_for_status()
    assert "no load case yet" in client.get(f"{AT}/empty/comparison").json()["detail"]
    assert client.get(f"{AT}/empty/cases").json()["cases"] == []
    assert client.post(f"{AT}/empty/diagnoses", json={}).status_code == 422


def test_a_model_that_is_none_is_refused(service: ServiceReceiver) -> None:
    for name in ("nothing", "../data/fingers/an1979_middle.yaml", "a.json"):
        answer = service.client().get(f"{AT}/{RECORDED}/comparison", params={"model": name})
        assert answer.status_code == 422
        assert "GET /api/v1/fingers" in answer.json()["detail"]
