"""Amendments at the service: what truly hung, in one case, in two exchanged ones, in a block of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tests.server.service.recorded import PUBLISHED, holding, small, upload
from tests.server.service.running import ServiceReceiver

RECORDED = "DEV-01"
AT = "/api/v1/sessions"


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceReceiver]:
    yield from holding(tmp_path_factory.mktemp("service"), PUBLISHED)


def test_an_amendment_is_heeded_kept_beside_the_entry_and_undone(fresh: ServiceReceiver) -> None:
    client = fresh.client()
    upload(client, RECORDED)
    path = f"{AT}/{RECORDED}"
    before = client.get(f"{path}/comparison").json()
    case = before["cases"][0]
    made = client.post(f"{path}/cases/{case['id']}/amend", json={"masses_g": {"FDS": 950.0}, "why": "a photo"})
    assert made.status_code == 200
    assert made.json()["case"]["masses_g"] == {"FDS": 950.0}
    assert made.json()["case"]["entered"] == case["masses_g"]
    # The finger is drawn with what hung, and the checklist says it.
    drawn = client.get("/api/v1/figures/finger", params={"session": RECORDED, "case": case["id"]})
    assert "FDS 950 g" in drawn.text
    steps = {s["id"]: s["text"] for s in client.get(f"{path}/checklist").json()["steps"]}
    assert steps[case["id"]].startswith("FDS 950 g,")
    after = client.get(f"{path}/comparison").json()
    assert after["cases"][0]["predicted_N"] != case["predicted_N"]
    assert after["cases"][0]["measured_N"] == case["measured_N"]
    assert after["cases"][1:] == before["cases"][1:]
    assert after["amendments"][0]["entered"] == {"masses_g": case["masses_g"]}
    kept = client.get(f"{path}/document").json()
    assert kept["cases"][0]["masses_g"] == case["masses_g"]
    assert (kept["amendments"][0]["why"], kept["amendments"][0]["by"]) == ("a photo", "local")
    client.post(f"{path}/edits/{made.json()['edit']}/undo", json={}).raise_for_status()
    assert client.get(f"{path}/comparison").json()["cases"] == before["cases"]


def test_two_cases_are_exchanged_in_one_edit(fresh: ServiceReceiver) -> None:
    client = fresh.client()
    client.post(AT, json={"id": "S1", "document": small(cases=4)}).raise_for_status()
    path = f"{AT}/S1"
    cases = client.get(f"{path}/cases").json()["cases"]
    a, b = cases[0], next(c for c in cases if c["masses_g"] != cases[0]["masses_g"])
    done = client.post(f"{path}/cases/{a['id']}/amend", json={"exchanged_with": b["id"], "why": "the sheet"})
    done.raise_for_status()
    now = {c["id"]: c["masses_g"] for c in client.get(f"{path}/comparison").json()["cases"]}
    assert (now[a["id"]], now[b["id"]]) == (b["masses_g"], a["masses_g"])
    client.post(f"{path}/edits/{done.json()['edit']}/undo", json={}).raise_for_status()
    now = {c["id"]: c["masses_g"] for c in client.get(f"{path}/comparison").json()["cases"]}
    assert (now[a["id"]], now[b["id"]]) == (a["masses_g"], b["masses_g"])


def test_a_block_of_cases_is_amended_in_one_edit(fresh: ServiceReceiver) -> None:
    client = fresh.client()
    client.post(AT, json={"id": "S1", "document": small(cases=6)}).raise_for_status()
    path = f"{AT}/S1"
    before = client.get(f"{path}/cases").json()["cases"]
    loaded = next(iter(before[0]["masses_g"]))
    other = "FDS" if loaded != "FDS" else "FDP"
    swap = {loaded: other, other: loaded}
    body = {"amend": [{"cases": "all", "tendons": swap}], "why": "the cables were led to the other pulley"}
    done = client.post(f"{path}/amend", json=body)
    done.raise_for_status()
    now = {c["id"]: c["masses_g"] for c in client.get(f"{path}/cases").json()["cases"]}
    assert now == {c["id"]: {swap.get(t, t): g for t, g in c["masses_g"].items()} for c in before}
    client.post(f"{path}/edits/{done.json()['edit']}/undo", json={}).raise_for_status()
    assert [c["masses_g"] for c in client.get(f"{path}/cases").json()["cases"]] == [c["masses_g"] for c in before]
    (heavy, *_) = sorted({grams for c in before for grams in c["masses_g"].values()}, reverse=True)
    weighed = {"amend": [{"cases": "all", "weights_g": {str(heavy): 2.0 * heavy}}], "why": "weighed again"}
    done = client.post(f"{path}/amend", json=weighed)
    assert done.status_code == 200, done.text
    after = [c["masses_g"] for c in client.get(f"{path}/cases").json()["cases"]]
    assert after == [{t: 2.0 * g if g == heavy else g for t, g in c["masses_g"].items()} for c in before]
    client.post(f"{path}/edits/{done.json()['edit']}/undo", json={}).raise_for_status()
    hung = [{"cases": c["id"], "masses_g": {loaded: 0.0, other: 77.0 + i}} for i, c in enumerate(before)]
    done = client.post(f"{path}/amend", json={"amend": hung, "why": "one row too low"})
    assert done.status_code == 200, done.text
    after = [c["masses_g"] for c in client.get(f"{path}/cases").json()["cases"]]
    kept = [{t: g for t, g in c["masses_g"].items() if t not in (loaded, other)} for c in before]
    assert after == [masses | {other: 77.0 + i} for i, masses in enumerate(kept)]
    client.post(f"{path}/edits/{done.json()['edit']}/undo", json={}).raise_for_status()
    place = before[0]["location"]
    other = "bone" if place == "tip" else "tip"
    moved = {"amend": [{"cases": place, "location": other}], "why": "seen on the photo"}
    client.post(f"{path}/amend", json=moved).raise_for_status()
    assert {c["location"] for c in client.get(f"{path}/comparison").json()["cases"]} == {other}
    back = client.post(f"{path}/cases/{before[0]['id']}/amend", json={"location": place, "why": "it was not"})
    assert back.status_code == 200, back.text
    assert [c["location"] for c in client.get(f"{path}/comparison").json()["cases"]].count(place) == 1
    for weights in ({"1.5": 2.0}, {"heavy": 2.0}, {str(heavy): 0.0}):
        refused = client.post(f"{path}/amend", json={"amend": [{"cases": "all", "weights_g": weights}], "why": "x"})
        assert refused.status_code == 422, weights
    for cases in ("nowhere", "tip,bone,c001..", ""):
        refused = client.post(f"{path}/amend", json={"amend": [{"cases": cases, "posture": "hook"}], "why": "x"})
        assert refused.status_code == 422, cases
    assert len(client.get(f"{path}/edits").json()["edits"]) == 8


@pytest.mark.parametrize(
    ("body", "status"),
    [
        ({"why": "x"}, 422),
        ({"masses_g": {"FDS": 5.0}}, 422),
        ({"posture": "fist", "why": "x"}, 422),
        ({"location": "palm", "why": "x"}, 422),
        ({"masses_g": {"FDS": 0.5}, "why": "x"}, 422),
        ({"masses_g": {"ABC": 50.0}, "why": "x"}, 422),
        ({"exchanged_with": "c9", "why": "x"}, 422),
        ({"exchanged_with": "c002", "posture": "hook", "why": "x"}, 422),
    ],
)
def test_an_amendment_that_cannot_be_changes_nothing(
    service: ServiceReceiver, body: dict[str, Any], status: int
) -> None:
    path = f"{AT}/{PUBLISHED}"
    case = service.client().get(f"{path}/cases").json()["cases"][0]["id"]
    answer = service.client().post(f"{path}/cases/{case}/amend", json=body)
    assert answer.status_code == status
    assert service.client().get(f"{path}/edits").json()["edits"] == []


def test_a_case_is_left_out_and_taken_in_once(fresh: ServiceReceiver) -> None:
    client = fresh.client()
    client.post(AT, json={"id": "S1", "document": small()}).raise_for_status()
    case = f"{AT}/S1/cases/{small()['cases'][0]['id']}"
    steps = [("include", {}), ("exclude", {"reason": "slipped"}), ("exclude", {"reason": "slipped"}), ("include", {})]
    answers = [client.post(f"{case}/{change}", json=body) for change, body in steps]
    assert [a.status_code for a in answers] == [422, 200, 422, 200]
    assert answers[0].json()["found"].endswith("is not excluded")
    assert answers[2].json()["found"].endswith("is excluded already (slipped)")
    assert [e["kind"] for e in client.get(f"{AT}/S1/edits").json()["edits"]] == ["exclude", "include"]
