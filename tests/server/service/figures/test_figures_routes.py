"""Figures of the service: those of the command line, in words too, on dark pages too, and blind where they must be."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sqlalchemy import insert

from fingermodel import comparing
from fingermodel.session import Session
from server.application.diagnosis_report import FIGURES as DIAGNOSIS
from server.application.diagnosis_report import diagnosis_sections
from server.figures.compared import Compared
from server.figures.comparison import comparison_sections
from server.figures.dark import for_dark, turned
from server.figures.diagnosis_revisions import revisions_figure
from server.figures.report import figures_of
from server.figures.style import BAND, INK, MUTED, TENDONS
from server.service.routes.figures import COMPARISON
from server.service.sessions.blinding import HIDDEN
from server.service.storage.database import now_utc
from server.service.storage.schema import jobs
from tests.daq.bench_plays import LONG_BLOCK_S, PROTOCOL, case, tared, whole
from tests.server.diagnosis_answers import found as missing_effect
from tests.server.service.figures_asked import AT, shown, traces
from tests.server.service.recorded import holding
from tests.server.service.running import ServiceReceiver
from tests.server.service.sessions.test_bench_sessions import Played

RECORDED, PUBLISHED, MEAN = "DEV-01", "synek2019_H01", "synek2019_HMEAN"
NUMBERS = count(1000)
PAGES = ("paper_bgcolor", "plot_bgcolor")


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceReceiver]:
    yield from holding(tmp_path_factory.mktemp("service"), RECORDED, PUBLISHED, "synek2019_H02", "synek2019_H03", MEAN)


@pytest.fixture
def played(tmp_path: Path) -> Iterator[Played]:
    out = Played(tmp_path)
    yield out
    assert out.bench.journal is not None
    out.bench.journal.close()
    out.service.close()


def drawn(figure: Any) -> dict[str, Any]:
    """A figure of the command line, on the colour of the page."""
    out: dict[str, Any] = json.loads(figure.to_json())
    out["layout"] |= dict.fromkeys(PAGES, "rgba(0,0,0,0)")
    return out


def kept_job(service: ServiceReceiver, name: str, **instead: Any) -> None:
    """A job that is finished."""
    row = {
        "id": name, "number": next(NUMBERS), "kind": "diagnose", "session": RECORDED, "request": {},
        "state": "done", "timeout_s": 1.0, "created_utc": now_utc(), "result": missing_effect(),
    }  # fmt: skip
    with service.parts.database.writing() as connection:
        connection.execute(insert(jobs).values(row | instead))


@pytest.mark.parametrize("name", [RECORDED, PUBLISHED])
def test_comparisons_are_drawn_as_by_the_command_line(service: ServiceReceiver, name: str) -> None:
    bench = Session.open(name, catalogue=False)
    expected = figures_of(comparison_sections(Compared.of(bench, comparing.compare(bench))))
    for figure in COMPARISON:
        body = shown(service, f"/comparison/{figure}", session=name)
        assert body["figure"] == (drawn(expected[figure]) if figure in expected else None)
        assert body["text"].startswith(body["title"] if body["figure"] else "No figure: none of these load cases ")
    assert len(expected) >= 4


def test_an_average_is_drawn_with_the_spread_of_the_specimens_that_are_here(service: ServiceReceiver) -> None:
    body = shown(service, "/comparison/vectors", session=MEAN)
    assert {t["meta"]["meaning"] for t in traces(body, "area")} == {"measured mean ± 1 SD between specimens"}


def points(body: dict[str, Any]) -> list[str]:
    """Every case that a click on the figure can lead to."""

    def flat(found: Any) -> Iterator[str]:
        if isinstance(found, str):
            yield found
        for one in found if isinstance(found, list) else ():
            yield from flat(one)

    return sorted(set(flat(body["cases"])))


@pytest.mark.parametrize("name", COMPARISON)
def test_every_point_says_which_cases_it_stands_for(service: ServiceReceiver, name: str) -> None:
    compared = comparing.compare(Session.open(RECORDED, catalogue=False))
    body = shown(service, f"/comparison/{name}", session=RECORDED)
    place = {"scatter": ("identification", "tip"), "scatter_validation": ("validation", "tip")}.get(name, (None, None))
    known = {c.id: c for c in compared.select(*place).cases}
    found = points(body)
    assert len(body["cases"]) == len(body["figure"]["data"])
    if name in ("vectors", "bone"):
        assert {known[c].location for c in found} == {"tip" if name == "vectors" else "bone"}
    else:
        assert found == sorted(known)
    for trace, cases in zip(body["figure"]["data"], body["cases"], strict=True):
        labels = trace.get("hovertext") or trace.get("text")
        if isinstance(cases, list) and name != "errors":
            assert all(f"<b>{c}</b>" in text for c, text in zip(cases, labels, strict=True))
        elif isinstance(cases, list):
            assert len(cases) == len(trace["y"])
            assert [f"{len(c)} cases" in text for c, text in zip(cases, labels, strict=True)] == [True] * len(cases)


def test_some_cases_are_drawn_in_either_plane(service: ServiceReceiver) -> None:
    compared = comparing.compare(Session.open(RECORDED, catalogue=False))
    bone = shown(service, "/comparison/scatter", session=RECORDED, location="bone", plane="sagittal", muscles="FDP")
    wanted = compared.select("identification", "bone", "FDP")
    assert points(bone) == sorted(c.id for c in wanted.cases)
    assert f"RMSE {wanted.errors('sagittal').rmse_N:.2f} N" in bone["text"]
    assert "bone force components" in bone["title"]
    assert "measured Fz" not in bone["text"]
    assert "measured Fz" in shown(service, "/comparison/scatter", session=PUBLISHED, plane="space")["text"]
    chosen = {"session": RECORDED, "role": "validation", "location": "bone"}
    known = {
        c.id for c in comparing.compare(Session.open(RECORDED, catalogue=False)).select("validation", "bone").cases
    }
    assert set(points(shown(service, "/comparison/scatter", **chosen))) == known
    none = shown(service, "/comparison/scatter_validation", **chosen | {"role": "identification"})
    assert none["text"] == "No figure: none of these load cases is a validation case at the bone."
    hook = shown(service, "/comparison/z", session=RECORDED, posture="hook", role="validation")
    assert points(hook) == sorted(c.id for c in compared.select("validation", posture="hook").cases)
    nobody = shown(service, "/comparison/z", session=RECORDED, posture="fist")
    assert (nobody["figure"], nobody["cases"]) == (None, None)


def test_what_an_earlier_model_predicted_is_drawn_beside(service: ServiceReceiver) -> None:
    body = shown(service, "/comparison/vectors", session=PUBLISHED, before="an1979_middle")
    alone = shown(service, "/comparison/vectors", session=PUBLISHED, model="an1979_middle")
    here = {t["meta"]["case"]: t["meta"]["force_N"] for t in traces(body, "predicted")}
    there = {t["meta"]["case"]: t["meta"]["force_N"] for t in traces(alone, "predicted")}
    before = {t["meta"]["case"]: t for t in traces(body, "before_predicted_head")}
    assert set(here) == set(before) == set(there)
    assert here != there
    scale = traces(body, "predicted")[0]["meta"]["mm_per_N"]
    starts = {t["meta"]["case"]: (t["x"][0], t["y"][0]) for t in traces(body, "predicted")}
    for case_id, head in before.items():
        tip = np.array([head["x"][0] - starts[case_id][0], head["y"][0] - starts[case_id][1]])
        assert tip == pytest.approx(scale * np.array(there[case_id]), abs=1e-6)
        assert "predicted before: an1979_middle" in head["text"]


def test_cells_and_bars_of_a_diagnosis_lead_to_cases_of_the_session(service: ServiceReceiver) -> None:
    cases = comparing.compare(Session.open(RECORDED, catalogue=False)).select("identification").cases
    answer = missing_effect()
    first = cases[0]
    answer["where"]["cells"] = [{"muscles": first.muscles, "posture": first.posture, "location": first.location,
                                 "cases": 1, "rmse_N": 0.1, "z_rms": 3.0}]  # fmt: skip
    kept_job(service, "cells", result=answer)
    found = points(shown(service, "/diagnosis/residual_map", job="cells"))
    alike = {
        c.id for c in cases if (c.muscles, c.posture, c.location) == (first.muscles, first.posture, first.location)
    }
    assert set(found) == alike


def test_the_words_hold_the_numbers_of_the_comparison(service: ServiceReceiver) -> None:
    summary = comparing.compare(Session.open(RECORDED, catalogue=False)).select("identification", "tip").errors("space")
    text = shown(service, "/comparison/scatter", session=RECORDED)["text"]
    assert f"RMSE {summary.rmse_N:.2f} N ({summary.rmse_rel_pct:.1f} %) in space" in text
    assert "56 identification cases" in text
    assert "measured Fx [N], proximal +" in text


def test_two_models_are_drawn_side_by_side(service: ServiceReceiver) -> None:
    body = shown(service, "/comparison/scatter", session=PUBLISHED, before="an1979_middle")
    assert (body["before"], body["model"]) == ("an1979_middle", "synek2019_initial")
    assert {a["xaxis"] for a in body["figure"]["data"] if "xaxis" in a} >= {"x", "x2", "x3", "x4"}


def test_a_figure_that_the_client_has_is_not_sent_again_until_a_case_changes(service: ServiceReceiver) -> None:
    client, asked = service.client(), {"session": PUBLISHED}
    first = client.get(f"{AT}/comparison/errors", params=asked)
    again = client.get(f"{AT}/comparison/errors", params=asked, headers={"If-None-Match": first.headers["ETag"]})
    assert (again.status_code, again.content) == (304, b"")
    case_id = client.get(f"/api/v1/sessions/{PUBLISHED}/cases").json()["cases"][0]["id"]
    body = {"reason": "the suture slipped"}
    client.post(f"/api/v1/sessions/{PUBLISHED}/cases/{case_id}/exclude", json=body).raise_for_status()
    later = client.get(f"{AT}/comparison/errors", params=asked, headers={"If-None-Match": first.headers["ETag"]})
    assert later.status_code == 200
    assert later.headers["ETag"] != first.headers["ETag"]
    client.post(f"/api/v1/sessions/{PUBLISHED}/cases/{case_id}/include", json={}).raise_for_status()
    assert client.get(f"{AT}/comparison/errors", params=asked).json()["figure"] == first.json()["figure"]


def luminance(color: str) -> float:
    channels = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(a: str, b: str) -> float:
    low, high = sorted((luminance(a), luminance(b)))
    return (high + 0.05) / (low + 0.05)


def test_on_a_dark_page_words_and_data_stand_out_and_pale_stays_pale(service: ServiceReceiver) -> None:
    page = turned("#ffffff")
    assert luminance(page) < 0.01
    assert all(contrast(turned(c), page) > 4.5 for c in (INK, MUTED))
    assert all(contrast(turned(t.color), page) > 3.0 for t in TENDONS.values())
    # Pale bars and bands are seen, too: a page's panel is a little lighter than its paper.
    assert all(contrast(turned(c), turned("#e4e4e4")) > 1.25 for c in (BAND, "#d5dee7", "#cdeae1"))
    greys = [f"#{v:02x}{v:02x}{v:02x}" for v in range(0, 256, 5)]
    lights = [luminance(turned(g)) for g in greys]
    assert lights == sorted(lights, reverse=True)
    assert turned("rgba(0,114,178,0.22)") == turned("rgba(0, 114, 178, 0.22)")
    assert turned("rgba(0,114,178,0.22)").endswith(",0.22)")
    assert turned("nonsense") == "nonsense"
    light, dark = (shown(service, "/comparison/vectors", session=RECORDED, theme=t) for t in ("light", "dark"))
    assert dark["figure"] == for_dark(light["figure"])
    assert dark["figure"]["data"][0]["x"] == light["figure"]["data"][0]["x"]
    assert dark["figure"]["layout"]["font"]["color"] == turned(INK)
    assert dark["text"] == light["text"]


def test_a_diagnosis_is_drawn_as_by_the_command_line(service: ServiceReceiver) -> None:
    kept_job(service, "d1")
    answer = missing_effect()
    kept_job(service, "p1", kind="pooled", session=None, result={"each": {RECORDED: answer}})
    expected = figures_of(diagnosis_sections(answer, None))
    # Where an effect explains the readings, no smooth curve is left.
    assert set(expected) == set(DIAGNOSIS) - {"own_curve"}
    assert shown(service, "/diagnosis/own_curve", job="d1")["figure"] is None
    for name in expected:
        body = shown(service, f"/diagnosis/{name}", job="d1")
        assert body["figure"] == drawn(expected[name])
        assert body["caption"]
        assert shown(service, f"/diagnosis/{name}", job="p1", session=RECORDED)["figure"] == body["figure"]


def test_the_fall_of_the_error_is_that_of_the_revision(service: ServiceReceiver) -> None:
    rmse = {"identification/tip": 0.2, "validation/tip": 0.3}
    history: list[dict[str, Any]] = [
        {"id": "an1979_middle", "added": [], "removed": [], "log_evidence_gain": None, "rmse_N": rmse},
        {"id": "r1", "added": ["worn_pulley.FDP"], "removed": [], "log_evidence_gain": 9.0,
         "rmse_N": dict.fromkeys(rmse, 0.1)},
    ]  # fmt: skip
    document = {
        "id": "r1", "session": {"id": RECORDED}, "parent": "an1979_middle", "created_utc": now_utc(),
        "history": history,
    }  # fmt: skip
    with service.parts.messages.writing() as telling:
        service.parts.revisions.keep(telling, document, "P-r1", {}, "fitted")
    for asked in ({"revision": "r1"}, {"specimen": "P-r1"}):
        body = shown(service, "/revisions/waterfall", **asked)
        assert body["figure"] == drawn(revisions_figure({}, history))
        assert "ln evidence" in json.dumps(body["figure"]["layout"])


def test_a_refit_of_a_search_is_a_model_whose_residuals_every_answer_shares(service: ServiceReceiver) -> None:
    moved = {"zero.bone.x": 0.1, "cell_gain.Fy": 0.05}
    row = {"candidates": [], "parameters": [], "fit": moved}
    kept_job(service, "fits", result=missing_effect() | {"model": "an1979_middle", "ranking": [row]})
    expected = comparing.compare(Session.open(RECORDED, catalogue=False).at_values(moved)).cases
    asked = {"model": "fits/nothing"}
    body = service.client().get(f"/api/v1/sessions/{RECORDED}/comparison", params=asked).json()
    found = [c["predicted_N"] for c in body["cases"]]
    np.testing.assert_allclose(found, [c.predicted_N for c in expected], atol=1e-9)
    assert "with nothing added (search fits), fitted to these readings" in body["residuals_after"]
    figure = shown(service, "/comparison/z", session=RECORDED, **asked)
    assert body["residuals_after"] in figure["caption"]
    refused = service.client().get(f"{AT}/comparison/z", params={"session": RECORDED, "model": "fits/worn_pulley"})
    assert (refused.status_code, "JOB/EFFECT" in refused.json()["detail"]) == (422, True)
    # A search keeps what it was of; once the session is another, every answer with its fits says so.
    kept_job(service, "before", result=missing_effect() | {"ranking": [row], "measured_sha256": "0" * 64})
    old = service.client().get(f"/api/v1/sessions/{RECORDED}/comparison", params={"model": "before/nothing"}).json()
    figure = shown(service, "/comparison/z", session=RECORDED, model="before/nothing")
    assert [b["outdated"] for b in (body, old)] == [False, True]
    assert old["residuals_after"].endswith("(search before), fitted to this session before it was changed")
    assert old["residuals_after"] in figure["caption"]
    assert any("before it was changed" in n for n in old["notes"])


def test_on_the_finger_all_roles_means_all(service: ServiceReceiver) -> None:
    for role, roles in (("all", "identification and validation"), (None, "validation")):
        asked = {} if role is None else {"role": role}
        body = shown(service, "/comparison/vectors", session=RECORDED, **asked)
        assert f"; {roles} cases" in body["figure"]["layout"]["title"]["subtitle"]["text"]


def test_while_a_bench_runs_no_figure_says_anything_of_its_validation_cases(played: Played) -> None:
    played.bench.play(whole()[:-1], block_s=LONG_BLOCK_S)
    played.send()
    hidden = "c003"
    service = played.service
    paths = [f"/comparison/{n}" for n in COMPARISON] + ["/effect/worn_pulley", "/effect/hanger_mass"]

    def everything() -> dict[str, str]:
        return {p: json.dumps(without_blinded(shown(service, p, session="S1"))) for p in paths}

    def without_blinded(body: dict[str, Any]) -> dict[str, Any]:
        assert body.pop("blinded") == ([] if played.bench.run.record.closed else [hidden])
        return body

    running = everything()
    assert [p for p, text in running.items() if hidden in text] == []
    assert [p for p, text in running.items() if "c001" in text or "c004" in text] == [
        p for p in paths if p != "/comparison/scatter_validation"
    ]
    assert "validation, tip" not in running["/comparison/errors"]
    before = shown(service, "/comparison/scatter", session="S1", before="an1979_middle")
    assert hidden not in json.dumps({k: v for k, v in before.items() if k != "blinded"})
    body = shown(service, "/finger", session="S1", case=hidden)
    assert HIDDEN in body["text"]
    assert traces(body, "measured")
    assert not traces(body, "predicted")
    assert "predicted" not in body["text"].replace("prediction", "")
    played.bench.press("close")
    played.send()
    closed = everything()
    assert [p for p, text in closed.items() if hidden in text] == [
        p for p in paths if p not in ("/comparison/scatter", "/comparison/bone")
    ]
    assert "validation, tip" in closed["/comparison/errors"]
    assert traces(shown(service, "/finger", session="S1", case=hidden), "predicted")


def test_a_planned_case_is_drawn_before_it_is_taken(played: Played) -> None:
    played.bench.play(["next", *tared(), *case("tip", FDP=950)])
    played.send()
    planned = shown(played.service, "/finger", session="S1", case="c002")
    assert not traces(planned, "measured")
    assert [t["meta"]["mass_g"] for t in traces(planned, "weight")] == [950.0]
    asked = {"postures_deg": {k: [v] for k, v in PROTOCOL["postures_deg"]["hook"].items()}, "masses_g": {"FDS": [950]}}  # type: ignore[index]
    answer = played.client.post("/api/v1/predictions", json=asked | {"tension_factor": 0.835}).json()
    rotation = np.array(planned["figure"]["layout"]["meta"]["tip"]["rotation"])
    (arrow,) = traces(planned, "predicted")
    assert arrow["meta"]["force_N"] == pytest.approx((rotation @ answer["tip_force_N"][0])[:2])
    assert not traces(shown(played.service, "/finger", session="S1", case="c003"), "predicted")
    assert shown(played.service, "/finger", session="S1", posture="relaxed")["figure"]


def test_every_figure_is_listed_with_what_it_needs(service: ServiceReceiver) -> None:
    rows = service.client().get(AT).json()["figures"]
    paths = {r["path"] for r in rows}
    assert {f"{AT}/comparison/{n}" for n in COMPARISON} | {f"{AT}/diagnosis/{n}" for n in DIAGNOSIS} < paths
    documented = service.client().get("/api/v1/openapi.json").json()["paths"]
    for row in rows:
        template = row["path"] if row["path"] in documented else f"{row['path'].rpartition('/')[0]}/{{name}}"
        parameters = {p["name"]: p["required"] for p in documented[template]["get"]["parameters"] if p["in"] == "query"}
        assert {p["name"]: p["required"] for p in row["parameters"]} == parameters, row["path"]


@pytest.mark.parametrize(
    ("path", "asked", "status", "words"),
    [
        ("/comparison/pie", {"session": RECORDED}, 404, "scatter_validation"),
        ("/comparison/z", {}, 422, "session"),
        ("/comparison/z", {"session": "nobody"}, 404, "nobody"),
        ("/comparison/z", {"session": RECORDED, "model": "../../etc/passwd"}, 422, "/api/v1/fingers"),
        ("/comparison/z", {"session": RECORDED, "before": "nothing"}, 422, "nothing"),
        ("/comparison/z", {"session": RECORDED, "theme": "pink"}, 422, "light"),
        ("/comparison/z", {"session": "x" * 5000}, 422, "100"),
        ("/finger", {"session": RECORDED}, 422, "posture"),
        ("/finger", {"session": RECORDED, "posture": "fist"}, 404, "fist"),
        ("/finger", {"session": RECORDED, "case": "c999"}, 404, "c999"),
        ("/finger", {"session": RECORDED, "case": "c001", "posture": "hook"}, 422, "minor_flexion"),
        ("/finger", {"session": RECORDED, "posture": "hook", "model": "nothing"}, 422, "nothing"),
        ("/effect/gremlins", {"session": RECORDED}, 404, "gremlins"),
        ("/effect/worn_pulley.toe", {"session": RECORDED}, 404, "worn_pulley.FDP"),
        ("/diagnosis/ranking", {"job": "nowhere"}, 404, "nowhere"),
        ("/diagnosis/ranking", {"job": "waits"}, 409, "failed"),
        ("/diagnosis/ranking", {"job": "refitted"}, 409, "refit"),
        ("/diagnosis/ranking", {"job": "together"}, 404, RECORDED),
        ("/diagnosis/pie", {"job": "waits"}, 404, "ranking"),
        ("/revisions/waterfall", {}, 422, "one of the two"),
        ("/revisions/waterfall", {"revision": "r9", "specimen": "P9"}, 422, "one of the two"),
        ("/revisions/waterfall", {"revision": "r9"}, 404, "r9"),
        ("/revisions/waterfall", {"specimen": "P9"}, 404, "P9"),
    ],
)
def test_what_cannot_be_drawn_is_refused_in_one_line(
    service: ServiceReceiver, path: str, asked: dict[str, str], status: int, words: str
) -> None:
    if "job" in asked and asked["job"] != "nowhere" and service.client().get("/api/v1/jobs/waits").status_code == 404:
        kept_job(service, "waits", state="failed", result=None)
        kept_job(service, "refitted", kind="refit")
        kept_job(service, "together", kind="pooled", session=None, result={"each": {RECORDED: missing_effect()}})
    answer = service.client().get(f"{AT}{path}", params=asked)
    assert answer.status_code == status
    assert answer.headers["Content-Type"].startswith("application/problem+json")
    assert words in answer.json()["detail"]
    assert "\n" not in answer.json()["detail"]
