"""Load cases that are proposed for the bench: on the checklist until they are measured, and taken back."""

from __future__ import annotations

from typing import Any

import pytest

from tests.server.service.recorded import small
from tests.server.service.running import ServiceReceiver

AT = "/api/v1/sessions"


def proposed(client: Any, name: str) -> list[dict[str, Any]]:
    """What stands on a session's checklist as proposed."""
    steps = client.get(f"{AT}/{name}/checklist").json()["steps"]
    return [s for s in steps if s["state"] == "proposed"]


def test_a_proposed_case_stands_on_the_checklist_until_it_is_measured(fresh: ServiceReceiver) -> None:
    client = fresh.client()
    client.post(AT, json={"id": "S1", "document": small()}).raise_for_status()
    posture = next(iter(small()["postures_deg"]))
    wanted = {"posture": posture, "location": "tip", "masses_g": {"FDS": 475}, "why": "parts two explanations"}
    made = client.post(f"{AT}/S1/planned", json=wanted)
    assert made.status_code == 201
    (step,) = proposed(client, "S1")
    assert step["text"] == f"FDS 475 g, {posture}, tip"
    assert (step["id"], step["edit"], step["why"]) == ("next-1", made.json()["edit"], "parts two explanations")
    assert client.get(f"{AT}/S1").json()["version"] == made.json()["version"] > 0
    heard = [m.body for m in fresh.parts.messages.after(0, "S1") if m.kind == "session"]
    assert {"change": "edited", "edit": step["edit"], "kind": "plan", "case": "next-1"} in heard
    # A proposal is no case: what is measured and compared stays as it was.
    assert {c["id"] for c in client.get(f"{AT}/S1/cases").json()["cases"]} == {c["id"] for c in small()["cases"]}
    case = small()["cases"][0] | {"id": "n1", "posture": posture, "location": "tip", "masses_g": {"FDS": 475.0}}
    client.post(f"{AT}/S1/cases", json={"case": case}).raise_for_status()
    assert proposed(client, "S1") == []
    # The same load once more is a proposal of its own.
    client.post(f"{AT}/S1/planned", json=wanted).raise_for_status()
    assert [s["id"] for s in proposed(client, "S1")] == ["next-2"]


def test_a_proposal_is_taken_back_and_put_back(fresh: ServiceReceiver) -> None:
    client = fresh.client()
    client.post(AT, json={"id": "S1", "document": small()}).raise_for_status()
    posture = next(iter(small()["postures_deg"]))
    for mass in (100, 200):
        body = {"posture": posture, "location": "bone", "masses_g": {"FDP": mass}}
        client.post(f"{AT}/S1/planned", json=body).raise_for_status()
    taken = client.delete(f"{AT}/S1/planned/next-1")
    assert taken.status_code == 200
    assert [s["id"] for s in proposed(client, "S1")] == ["next-2"]
    assert client.delete(f"{AT}/S1/planned/next-1").status_code == 404
    client.post(f"{AT}/S1/edits/{taken.json()['edit']}/undo", json={}).raise_for_status()
    fresh.restart()
    assert [s["id"] for s in proposed(fresh.client(), "S1")] == ["next-1", "next-2"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"posture": "fist"}, "posture 'fist'; expected one of"),
        ({"location": "toe"}, "location"),
        ({"masses_g": {"FDQ": 100}}, "tendon 'FDQ'"),
        ({"masses_g": {"FDP": -1}}, "greater than or equal to 0"),
        ({"masses_g": {"FDP": "950 g"}}, "valid number"),
        ({"extra": 1}, "extra"),
    ],
)
def test_what_cannot_be_measured_is_not_proposed(fresh: ServiceReceiver, change: dict[str, Any], said: str) -> None:
    client = fresh.client()
    client.post(AT, json={"id": "S1", "document": small()}).raise_for_status()
    posture = next(iter(small()["postures_deg"]))
    body = {"posture": posture, "location": "tip", "masses_g": {"FDP": 100}} | change
    answer = client.post(f"{AT}/S1/planned", json=body)
    assert answer.status_code == 422
    assert said in answer.json()["detail"]
    assert proposed(client, "S1") == []
