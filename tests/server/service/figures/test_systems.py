"""Fingers, forces inside them, movements and published studies over REST."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from sqlalchemy import insert

from daq.locations import data_dir
from fingermodel.fingers.files import finger_from_dict, finger_names, read_finger
from fingermodel.session import Session
from fingermodel.studies.activation import activate
from fingermodel.studies.inversion import invert_bench
from fingermodel.studies.movement import move
from server.reproduce.study import STUDIES
from server.service.jobs import inputs, tasks
from server.service.jobs.worker import Tell
from server.service.storage.database import now_utc
from server.service.storage.schema import jobs
from tests.server.service.recorded import PUBLISHED, document_of, holding
from tests.server.service.running import ServiceReceiver

API = "/api/v1"
RECORDED, FINGER, TAPPING = "DEV-01", "synek2019_optimised", "wu2008_index"
NUMBERS = count(5000)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceReceiver]:
    yield from holding(tmp_path_factory.mktemp("service"), RECORDED)


def found(service: ServiceReceiver, path: str, status: int = 200, **asked: Any) -> dict[str, Any]:
    answer = service.client().get(f"{API}{path}", params=asked)
    assert answer.status_code == status, answer.text
    body: dict[str, Any] = answer.json()
    return body


def told(service: ServiceReceiver, path: str, body: Any, status: int = 200) -> dict[str, Any]:
    answer = service.client().post(f"{API}{path}", json=body)
    assert answer.status_code == status, answer.text
    out: dict[str, Any] = answer.json()
    return out


def drawn(body: dict[str, Any], theme: str) -> None:
    """Figures go along, in words too and in the page's colours."""
    assert body["figures"]
    for figure in body["figures"]:
        assert (figure["schema"], figure["theme"]) == ("fingertwin/figure/1", theme)
        assert figure["figure"]["data"]
        assert figure["heading"]
        assert len(figure["text"]) > 20
        assert not re.search(r"</?[a-z]", figure["text"])


def test_every_finger_is_listed_and_brings_its_numbers(service: ServiceReceiver) -> None:
    rows = found(service, "/fingers")["fingers"]
    assert [r["name"] for r in rows] == finger_names()
    one = found(service, f"/fingers/{FINGER}")
    assert finger_from_dict(one["document"], FINGER).topology == read_finger(FINGER).topology
    assert [r["name"] for r in rows if r["moves"]] == found(service, "/movements")["fingers"]
    assert "one of GET" in found(service, "/fingers/none", 404)["detail"]


def test_a_finger_goes_to_other_software_and_comes_back(service: ServiceReceiver) -> None:
    offered = found(service, f"/fingers/{FINGER}/formats")["formats"]
    assert [f["format"] for f in offered] == ["finger", "osim", "mjcf"]
    for name, ending in (("osim", ".osim"), ("mjcf", ".xml")):
        answer = service.client().get(f"{API}/fingers/{FINGER}/export", params={"format": name})
        assert f'filename="{FINGER}{ending}"' in answer.headers["content-disposition"]
        back = told(service, "/fingers/imports", {"name": f"theirs{ending}", "text": answer.text})
        for given in (back["document"], yaml.safe_load(back["file"])):
            assert finger_from_dict(given, "theirs").topology == read_finger(FINGER).topology
        assert len(back["segments"]) == len(read_finger(FINGER).topology.segments)
        assert back["bones"] == list(read_finger(FINGER).topology.bones)
    assert any("FunctionBasedPath" in note for note in offered[1]["notes"])
    file = service.client().get(f"{API}/fingers/{FINGER}/export", params={"format": "finger"})
    assert file.text == (data_dir() / "fingers" / f"{FINGER}.yaml").read_text(encoding="utf-8")
    paths = service.client().get(f"{API}/openapi.json").json()["paths"]
    documented = paths[f"{API}/fingers/{{finger}}/export"]["get"]["responses"]["200"]["content"]
    # Clients read YAML and JSON as what they hold, other files as bytes.
    assert documented[file.headers["content-type"]]["schema"] == {"type": "object"}
    assert found(service, f"/fingers/{FINGER}/export", 422, format="vrml")["errors"]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"name": "theirs.osim", "text": "not XML"}, "is not XML"),
        ({"name": "theirs.xml", "text": "<!DOCTYPE a [<!ENTITY b 'c'>]><mujoco/>"}, "declares its own markup"),
        ({"name": "theirs.xml", "text": "<mujoco/>"}, "theirs.xml"),
        ({"name": "theirs.stl", "text": "solid"}, "name"),
        ({"name": "../theirs.osim", "text": "<a/>"}, "name"),
        ({"name": "theirs.osim", "text": "<a/>", "load_point_mm": [1.0]}, "load_point_mm"),
    ],
    ids=["no-xml", "doctype", "no-chain", "ending", "path", "point"],
)
def test_what_is_no_finger_is_refused_in_one_line(service: ServiceReceiver, given: Any, said: str) -> None:
    refused = told(service, "/fingers/imports", given, 422)
    assert said in refused["detail"]
    assert "\n" not in refused["detail"]


def test_a_finger_is_scaled_to_a_specimen(service: ServiceReceiver) -> None:
    body = told(service, f"/fingers/{FINGER}/scalings", {"bones_mm": {"PP": 50.0}, "name": "H07"})
    (factor,) = {round(b["factor"], 9) for b in body["bones"]}
    finger = finger_from_dict(yaml.safe_load(body["file"]), "H07")
    assert finger.id == "H07"
    ratio = np.asarray(finger.values.distal_point) / np.asarray(read_finger(FINGER).values.distal_point)
    assert np.nanmedian(ratio) == pytest.approx(factor)
    assert body["assumptions"]
    for wrong in ({"PP": 0.05}, {"XX": 40.0}, {}):
        told(service, f"/fingers/{FINGER}/scalings", {"bones_mm": wrong}, 422)
    told(service, "/fingers/none/scalings", {"bones_mm": {"PP": 40.0}}, 404)


def test_two_fingers_are_compared(service: ServiceReceiver) -> None:
    body = found(service, f"/fingers/{FINGER}/comparison", other="synek2019_bonobo", figures="dark")
    drawn(body, "dark")
    bones = {b["bone"]: b["ratio"] for b in body["bones"]}
    assert bones["PP"] == pytest.approx(57.8 / 47.0237, rel=1e-3)
    found(service, f"/fingers/{FINGER}/comparison", 404, other="none")


def test_forces_inside_are_those_of_the_command_line(service: ServiceReceiver) -> None:
    expected = invert_bench(Session.open(RECORDED, catalogue=False), "minimal")
    body = found(service, f"/sessions/{RECORDED}/inversion", closure="minimal", figures="light")
    drawn(body, "light")
    assert (body["schema"], body["closure"]) == ("fingertwin/invert/1", "minimal")
    assert body["sentences"] == expected.verdicts()
    assert (body["warnings"], body["amendments"], body["excluded"]) == ([], [], {})
    for ours, theirs in zip(body["cases"], expected.as_dict()["cases"], strict=True):
        assert ours["id"] == theirs["id"]
        for name, force in theirs["muscles"].items():
            assert ours["muscles"][name]["force_N"] == pytest.approx(force["force_N"], rel=1e-6, abs=1e-6)
    assert found(service, f"/sessions/{RECORDED}/inversion", closure="minimal")["figures"] == []


def test_forces_inside_carry_what_the_check_warns_of(service: ServiceReceiver) -> None:
    document = document_of(PUBLISHED) | {"id": "turned"}
    for case in document["cases"]:
        case["force_N"] = [-f for f in case["force_N"]]
    document["cases"][0]["excluded"] = "the suture slipped"
    told(service, "/sessions", {"id": "turned", "document": document}, 201)
    body = found(service, "/sessions/turned/inversion", closure="least_squares")
    assert "wrong_sign" in {w["code"] for w in body["warnings"]}
    assert body["warnings"] == found(service, "/sessions/turned/comparison")["warnings"]
    assert body["excluded"] == {document["cases"][0]["id"]: "the suture slipped"}


def test_a_running_bench_keeps_its_validation_cases_to_itself(service: ServiceReceiver) -> None:
    told(service, "/sessions", {"id": "RUNNING"}, 201)
    assert "still running" in found(service, "/sessions/RUNNING/inversion", 409)["detail"]


def test_a_movement_is_that_of_the_command_line(service: ServiceReceiver) -> None:
    body = told(service, "/movements?figures=light", {"steps": 60})
    drawn(body, "light")
    expected = move("wu2008_tap", TAPPING, "wu2008", 60)
    assert body["times_s"] == pytest.approx(expected.times_s.tolist())
    for name, force in zip(expected.muscles, expected.force.T, strict=True):
        assert body["force_N"][name] == pytest.approx(force.tolist(), abs=1e-9)
    # A movement of one's own comes as the file's contents.
    document = yaml.safe_load((data_dir() / "motions" / "wu2008_tap.yaml").read_text(encoding="utf-8"))
    own = told(service, "/movements", {"document": json.loads(json.dumps(document)) | {"id": "mine"}, "steps": 60})
    assert own["motion"] == "mine"
    assert own["peaks"] == body["peaks"]


@pytest.mark.parametrize(
    ("given", "status", "said"),
    [
        ({"motion": "none"}, 404, "no movement none"),
        ({"muscles": "none"}, 404, "no muscle set none"),
        ({"finger": "none"}, 404, "no finger none"),
        ({"finger": FINGER}, 422, ""),
        ({"document": {"format": "motion/1"}}, 422, "document"),
        ({"steps": 1}, 422, "steps"),
        ({"motion": "../wu2008_tap"}, 404, "no movement"),
    ],
    ids=["motion", "muscles", "finger", "without-inertia", "document", "steps", "path"],
)
def test_what_cannot_move_is_refused(service: ServiceReceiver, given: Any, status: int, said: str) -> None:
    refused = told(service, "/movements", given, status)
    assert said in refused["detail"]
    assert "\n" not in refused["detail"]


def test_muscles_of_a_held_finger_are_those_of_the_command_line(service: ServiceReceiver) -> None:
    assert {f["name"] for f in found(service, "/fingers")["fingers"] if f["activates"]} >= {"barry2018_index"}
    body = told(service, "/activations?figures=dark", {"lost": {"FDI": 0.5}})
    drawn(body, "dark")
    expected = activate("barry2018_index", lost={"FDI": 0.5})
    assert body["force_N"] == pytest.approx(expected.force_N.tolist(), rel=1e-9)
    assert body["together"]["lost_pct"] == {"FDI": 50.0}
    assert [d["muscle"] for d in body["deficits"]] == [d.muscle for d in expected.deficits]
    for given, status in (
        ({"finger": "none"}, 404), ({"muscles": "none"}, 404), ({"finger": FINGER}, 422), ({"lost": {"XYZ": 0.5}}, 422),
        ({"lost": {"FDI": 2.0}}, 422), ({"posture_deg": {"XYZ": 1.0}}, 422), ({"force_N": {"palmar": 999.0}}, 422),
    ):  # fmt: skip
        assert "\n" not in told(service, "/activations", given, status)["detail"]


def test_a_study_is_computed_as_a_job_and_shown_with_its_figures(service: ServiceReceiver) -> None:
    listed = found(service, "/studies")["studies"]
    assert [s["name"] for s in listed] == [s.name for s in STUDIES]
    assert {s["state"] for s in listed} == {None}
    bare = found(service, "/studies/wu2008")
    assert (bare["rows"], bare["figures"], bare["version"]) == ([], [], None)
    assert "was not computed yet" in found(service, "/figures/study/wu2008/muscles", 409)["detail"]
    found(service, "/studies/none", 404)
    told(service, "/studies/none/reproductions", {}, 404)
    asked = told(service, "/studies/wu2008/reproductions", {}, 202)
    assert (asked["kind"], asked["request"]) == ("reproduce", {"study": "wu2008"})
    told(service, f"/jobs/{asked['id']}/cancel", {})
    result = tasks.reproduce(inputs.ReproduceInput("wu2008"), Tell(lambda said: None))["body"]
    row = {
        "id": "computed", "number": next(NUMBERS), "kind": "reproduce", "session": None,
        "request": {"study": "wu2008"}, "state": "done", "timeout_s": 1.0, "created_utc": now_utc(), "result": result,
    }  # fmt: skip
    with service.parts.database.writing() as connection:
        connection.execute(insert(jobs).values(row))
    study = found(service, "/studies/wu2008")
    assert (study["job"], study["state"]) == ("computed", "done")
    assert any(r["agrees"] for r in study["rows"])
    assert study["figures"]
    for figure in study["figures"]:
        for theme in ("light", "dark"):
            body = found(service, f"/figures/study/wu2008/{figure['name']}", theme=theme)
            assert body["figure"]["data"]
    found(service, "/figures/study/wu2008/none", 404)


def test_the_figures_of_studies_are_listed(service: ServiceReceiver) -> None:
    assert "study" in {row["kind"] for row in found(service, "/figures")["figures"]}


def test_pages_name_no_finger_that_is_not_there() -> None:
    """Names that a page proposes are those of shipped fingers."""
    text = (Path(__file__).parents[4] / "server" / "pages" / "views" / "fingers.js").read_text(encoding="utf-8")
    named = set(re.findall(r'"(synek2019_\w+|an1979_\w+)"', text))
    assert named
    assert named <= set(finger_names())
