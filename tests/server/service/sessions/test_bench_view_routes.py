"""What a page is told of a bench: how it stands, what is wrong now, and the finger with the forces that may be seen."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema_rs import Draft202012Validator

from daq.signals.calibration import intrinsic_xyz
from server.service.sessions.blinding import HIDDEN
from tests.daq.bench_plays import LONG_BLOCK_S, REST, case, load, setup, tared, truth, wait, whole
from tests.server.service.recorded import upload
from tests.server.service.running import ServiceReceiver
from tests.server.service.sessions.test_bench_sessions import Played

AT = "/api/v1/sessions"
STEPS = ["weight_before", "c001", "c002", "c003", "c004", "weight_after"]
TO_C001: list[Any] = ["next", *tared()]


@pytest.fixture
def played(tmp_path: Path) -> Iterator[Played]:
    out = Played(tmp_path)
    yield out
    if out.bench.journal is not None:
        out.bench.journal.close()
    out.service.close()


def stands(played: Played, *script: Any) -> dict[str, Any]:
    """Play on, and ask how the bench stands; it says what the bench itself says."""
    played.bench.play(list(script))
    played.send()
    found: dict[str, Any] = played.get("/bench/state")
    status = played.bench.run.status()
    assert found["todo"].partition(" (")[0] == status.todo.partition(" (")[0]
    assert found["phase"] == status.phase
    now = next((step for step, _, state in status.checklist if state == "now"), None)
    assert status.closed or now in (None, found["now"])
    assert (found["tare"] is None) == (status.tare_age_s is None)
    return found


def test_a_bench_stands_at_the_service_as_it_does_at_its_terminal(played: Played) -> None:
    begun = stands(played)
    assert (begun["begun"], begun["now"], begun["todo"]) == (True, "weight_before", "take all weights off, then tare")
    assert [s["id"] for s in begun["steps"]] == STEPS
    assert begun["steps"][0]["text"] == "known weight on the cell (before): 500 g palmar"
    assert begun["steps"][1]["masses_g"] == {"FDP": 950.0}
    assert (begun["steps"][3]["role"], begun["steps"][3]["posture"]) == ("validation", "relaxed")
    assert begun["cell"]["range"] == [25.0, 25.0, 35.0, 250.0, 250.0, 250.0]
    skipped = stands(played, "next", load(np.zeros(6)), wait(0.3), "tare", wait(1.0))
    assert skipped["steps"][0]["state"] == "skipped"
    assert skipped["todo"] == "wait for the unloaded plateau"
    tared_ = stands(played, wait(4.5))
    assert tared_["tare"]["mean"] == pytest.approx(REST, abs=0.05)
    assert tared_["drift"] is None
    offered = stands(played, load(truth("tip", {"FDP": 950.0})), wait(0.3), "loaded", wait(5.0))
    assert (offered["offered"], offered["phase"]) == (True, "loaded")
    assert offered["todo"] == "confirm the loaded plateau, or change something"
    taken = stands(played, "confirm", wait(0.5))
    assert taken["steps"][1]["state"] == "done"
    again = stands(played, *tared())
    assert again["drift"]["force_N"] < 0.05
    assert again["drift"]["moment_Nmm"] < 1.0
    repeated = stands(played, "repeat")
    assert repeated["now"] == "c001r1"
    step = repeated["steps"][2]
    assert (step["id"], step["repeat_of"], step["masses_g"]) == ("c001r1", "c001", {"FDP": 950.0})
    skipped = stands(played, "next", "next")
    assert skipped["now"] == "c003"
    back = stands(played, "repeat c002")
    assert (back["now"], [s["id"] for s in back["steps"]]) == ("c002", [*STEPS[:2], "c001r1", *STEPS[2:]])
    assert back["steps"][3]["state"] == "open"
    moved = stands(played, "next", "posture_set", wait(0.1))
    assert (moved["tare"], moved["drift"]) == (None, None)
    assert moved["place"] == {"posture": "relaxed", "location": "tip"}
    assert stands(played, "close")["todo"] == "closed"


def test_a_warning_stands_until_its_cause_is_gone_and_says_what_to_do(played: Played) -> None:
    wrong = stands(played, *TO_C001, load(truth("tip", {"FDP": 300.0})), wait(0.3), "loaded", wait(5.0))
    (warning,) = wrong["warnings"]
    assert (warning["code"], warning["title"]) == ("doubtful_force", "The force can hardly be right")
    assert "wrong weight" in warning["text"]
    assert "Leave it on and look" in warning["to_do"]
    hard = stands(played, "loaded", load(truth("tip", {"FDP": 950.0}) * 15.0), wait(1.0))
    (over,) = hard["warnings"]
    assert (over["code"], over["title"]) == ("overload", "A channel is at its limit")
    assert "overload of Fy" in over["text"]
    assert "Take weight off" in over["to_do"]
    righted = stands(played, load(truth("tip", {"FDP": 950.0})), wait(0.3), "loaded", wait(5.0))
    assert righted["warnings"] == []
    moved = stands(played, "confirm", load(np.full(6, 0.4)), wait(0.3), "tare", wait(5.0))
    assert [w["code"] for w in moved["warnings"]] == ["zero_moved"]
    assert moved["drift"]["force_N"] == pytest.approx(0.4 * np.sqrt(3.0), abs=0.05)
    assert stands(played, "tare", wait(5.0))["warnings"] == []


def test_a_session_that_no_bench_began_has_its_cases_as_steps(played: Played) -> None:
    upload(played.client, "synek2019_H01")
    found = played.client.get(f"{AT}/synek2019_H01/bench/state").json()
    assert (found["begun"], found["tare"], found["stream"], found["now"]) == (False, None, None, None)
    assert found["steps"][0]["state"] == "done"
    assert found["steps"][0]["masses_g"]
    assert played.client.get(f"{AT}/nothing/bench/state").status_code == 404


def test_the_finger_is_drawn_before_anything_was_measured_with_what_will_hang(played: Played) -> None:
    played.send()
    found = played.get("/bench/finger?case=c001")
    assert (found["posture"], found["location"], found["masses_g"]) == ("hook", "tip", {"FDP": 950.0})
    assert found["weight_N"] == pytest.approx(0.95 * 9.81)
    assert found["measured_N"] is None
    assert np.linalg.norm(found["predicted_N"]) > 0.1
    side, above = found["views"]["side"], found["views"]["above"]
    assert {t["tendon"] for t in side["tendons"] if t["loaded"]} == {"FDP"}
    assert [j["joint"] for j in side["joints"]] == ["MCP", "PIP", "DIP"]
    # Both views show the same joints, and the load point lies on the most distal bone.
    assert [j["at_mm"][0] for j in side["joints"]] == [j["at_mm"][0] for j in above["joints"]]
    tip = np.array(side["paper"]) @ found["places"]["tip"]["at_mm"]
    outline = np.array(side["bones_mm"][-1])
    assert (outline.min(axis=0) < tip).all()
    assert (tip < outline.max(axis=0)).all()
    straight = played.get("/bench/finger?posture=relaxed")
    assert (straight["case"], straight["masses_g"], straight["predicted_N"]) == (None, {}, None)
    assert straight["angles_deg"]["MCP"] == pytest.approx(20.0)


def test_live_readings_are_laid_into_the_drawing_as_the_measured_force_is(tmp_path: Path) -> None:
    turned = {"tip": {"rotation_deg": [10.0, 20.0, 30.0]}, "bone": {}}
    service = ServiceReceiver(tmp_path)
    document = setup(load_cell=dict(setup().load_cell) | {"mounts": turned}).header()
    force = [1.0, -2.0, 0.5]
    given = {"id": "c1", "role": "identification", "posture": "hook", "location": "tip", "masses_g": {"FDP": 950.0}}
    document |= {"cases": [given | {"force_N": force}]}
    service.client().post(AT, json={"id": "S1", "document": document}).raise_for_status()
    found = service.client().get(f"{AT}/S1/bench/finger?case=c1").json()
    tip = found["places"]["tip"]
    # The cell's x, turned into the mount and mirrored as a left hand's is, lies in the drawing as that mount's axis.
    mounted = np.diag([1.0, 1.0, -1.0]) @ intrinsic_xyz([10.0, 20.0, 30.0])
    assert np.array(tip["from_cell"]) == pytest.approx(np.array(tip["from_mount"]) @ mounted)
    bent = np.deg2rad(115.0)
    assert np.array(tip["from_mount"])[:2, :2] == pytest.approx(
        np.array([[np.cos(bent), -np.sin(bent)], [np.sin(bent), np.cos(bent)]])
    )
    assert np.array(found["places"]["bone"]["from_cell"]) == pytest.approx(np.eye(3))
    service.close()


def test_a_validation_case_is_drawn_without_its_prediction_until_the_session_is_closed(played: Played) -> None:
    played.bench.play(whole()[:-1], block_s=LONG_BLOCK_S)
    played.send()
    hidden = played.get("/bench/finger?case=c003")
    assert hidden["measured_N"] is not None
    assert (hidden["predicted_N"], hidden["note"]) == (None, HIDDEN)
    played.bench.press("close")
    played.send()
    shown = played.get("/bench/finger?case=c003")
    assert shown["predicted_N"] is not None
    assert shown["note"] == ""


@pytest.mark.parametrize(
    ("asked", "status"),
    [("", 422), ("?case=c001&posture=relaxed", 422), ("?case=nothing", 404), ("?posture=nothing", 404)],
)
def test_what_cannot_be_drawn_is_refused_with_what_was_expected(played: Played, asked: str, status: int) -> None:
    played.send()
    answer = played.client.get(f"{AT}/S1/bench/finger{asked}")
    assert answer.status_code == status
    assert answer.json()["detail"]


def test_the_examples_are_answers_of_the_service(played: Played) -> None:
    played.bench.play([*TO_C001, *case("tip", FDP=950), *tared()])
    played.send()
    document = played.client.get("/api/v1/openapi.json").json()
    for path, asked in (("state", "/bench/state"), ("finger", "/bench/finger?case=c001")):
        answer = document["paths"][f"/api/v1/sessions/{{session}}/bench/{path}"]["get"]["responses"]["200"]
        schema = answer["content"]["application/json"]["schema"] | {"components": document["components"]}
        faults = list(Draft202012Validator(schema).iter_errors(played.get(asked)))
        assert not faults, faults[0].message


def test_a_cell_beyond_its_range_and_a_pulled_cable_are_told(played: Played) -> None:
    from daq.journal.rows import Event

    assert played.bench.journal is not None
    stream = played.bench.stream
    told: list[tuple[str, dict[str, Any]]] = [
        ("overload", {}),
        ("gap", {"lost_samples": 7}),
        ("disconnected", {"why": "no such device"}),
    ]
    played.bench.journal.event(*(Event(kind, 3.0, value, stream) for kind, value in told))
    played.send()
    found = played.get("/bench/state")["stream"]
    assert (found["state"], found["why"], found["overloaded"]) == ("lost", "no such device", True)
    assert (found["gaps"], found["lost_samples"], found["overloads"]) == (1, 7, 1)
    back = [Event("reconnected", 5.0, {}, stream), Event("overload_ended", 5.1, {}, stream)]
    played.bench.journal.event(*back)
    played.send()
    found = played.get("/bench/state")["stream"]
    assert (found["state"], found["overloaded"], found["since_s"]) == ("streaming", False, 5.0)
