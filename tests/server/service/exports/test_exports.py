"""Exports, checks and reports of the service: those of the command line, blind where they must be, gone afterwards."""

from __future__ import annotations

import hashlib
import io
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import ezc3d
import numpy as np
import pandas as pd
import pytest

from daq.checks import check
from daq.sessions import FINGER_DOCUMENT, read_session
from fingermodel.api import refit
from fingermodel.comparing import compare
from fingermodel.fingers.files import read_finger
from fingermodel.revisions import save_revision
from fingermodel.session import Session
from server.application.checking import model_findings
from server.application.drawing import draw_comparison
from server.application.provenance import provenance
from server.commands.files import export_source
from server.figures.report import Section
from server.service.exports import exporting
from server.service.jobs.task_kinds import Tasks
from server.service.storage.database import now_utc
from tests.daq.bench_plays import LONG_BLOCK_S, case, tared, whole
from tests.server.diagnosis_answers import found as missing_effect
from tests.server.service.exported import OF_PREDICTIONS, cells, datasets, exported, from_csv, from_mat, members
from tests.server.service.recorded import STREAM, upload
from tests.server.service.running import ServiceReceiver
from tests.server.service.sessions.test_bench_sessions import Played

RECORDED, PUBLISHED, MEAN = "DEV-01", "synek2019_H01", "synek2019_HMEAN"
AT = "/api/v1/sessions"
ENDING = {
    "csv": "csv",
    "parquet": "parquet",
    "xlsx": "xlsx",
    "hdf5": "h5",
    "c3d": "c3d",
    "mat": "mat",
    "supplement": "zip",
}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceReceiver]:
    out = ServiceReceiver(tmp_path_factory.mktemp("service"))
    for name in (RECORDED, PUBLISHED, "synek2019_H02", "synek2019_H03", MEAN):
        upload(out.client(), name)
    yield out
    out.close()


@pytest.fixture
def played(tmp_path: Path) -> Iterator[Played]:
    out = Played(tmp_path)
    yield out
    assert out.bench.journal is not None
    out.bench.journal.close()
    out.service.close()


def by_command_line(session: str, file_format: str, folder: Path) -> bytes:
    file = folder / f"out.{ENDING[file_format]}"
    export_source(session, file_format, file, None, str(folder / "said.json"))
    return file.read_bytes()


@pytest.mark.parametrize("name", [RECORDED, PUBLISHED])
@pytest.mark.parametrize("file_format", ["csv", "parquet"])
def test_tables_are_those_of_the_command_line_to_the_last_byte(
    service: ServiceReceiver, name: str, file_format: str, tmp_path: Path
) -> None:
    assert exported(service, name, file_format) == by_command_line(name, file_format, tmp_path)


def test_an_excel_table_holds_what_the_others_hold(service: ServiceReceiver) -> None:
    sheet = pd.read_excel(io.BytesIO(exported(service, PUBLISHED, "xlsx")), engine="calamine")
    table = pd.read_parquet(io.BytesIO(exported(service, PUBLISHED, "parquet")))
    assert list(sheet["id"]) == list(table["id"])
    assert list(sheet["Fx_N"]) == list(table["Fx_N"])


def test_what_columns_are_is_told_of_this_very_table(service: ServiceReceiver) -> None:
    table, told = exported(service, RECORDED, "csv"), json.loads(exported(service, RECORDED, "columns"))
    assert told["table_sha256"] == hashlib.sha256(table).hexdigest()
    assert [c["name"] for c in told["columns"]] == table.decode().splitlines()[0].replace('"', "").split(",")
    assert told["provenance"]["readings"]["stream"] == STREAM
    assert len(told["sources"]["sha256_of_chunks"]) == 64


def test_readings_and_cases_are_those_of_the_command_line(service: ServiceReceiver, tmp_path: Path) -> None:
    ours = datasets(exported(service, RECORDED, "hdf5"))
    theirs = datasets(by_command_line(RECORDED, "hdf5", tmp_path))
    assert set(ours) - {"readings/status"} == set(theirs)
    for name, values in theirs.items():
        np.testing.assert_array_equal(ours[name], values)
    mat = from_mat(exported(service, RECORDED, "mat"))
    assert mat["readings"]["Fx_N"] == pytest.approx(ours["readings/Fx_N"])
    assert mat["cases"]["predicted_Fx_N"] == pytest.approx(ours["cases/predicted_Fx_N"])


def test_channels_are_those_of_the_command_line(service: ServiceReceiver, tmp_path: Path) -> None:
    both = []
    for k, content in enumerate((exported(service, RECORDED, "c3d"), by_command_line(RECORDED, "c3d", tmp_path))):
        file = tmp_path / f"{k}.c3d"
        file.write_bytes(content)
        both.append(ezc3d.c3d(str(file)))
    np.testing.assert_array_equal(both[0]["data"]["analogs"], both[1]["data"]["analogs"])
    assert both[0]["parameters"]["EVENT"]["LABELS"]["value"] == both[1]["parameters"]["EVENT"]["LABELS"]["value"]


def test_a_supplement_differs_only_in_what_it_came_from(service: ServiceReceiver, tmp_path: Path) -> None:
    ours = members(exported(service, RECORDED, "supplement"))
    theirs = members(by_command_line(RECORDED, "supplement", tmp_path))
    assert set(ours) == set(theirs)
    # The readings come from the stored chunks, which know a status.
    of_origin = {"manifest.json", "cases.csv.json", "readings.csv", "SHA256SUMS"}
    assert {n: v for n, v in ours.items() if n not in of_origin} == {
        n: v for n, v in theirs.items() if n not in of_origin
    }
    assert len(ours["readings.csv"].splitlines()) == len(theirs["readings.csv"].splitlines())
    assert not [n for n, v in ours.items() if b"fingertwin-" in v.replace(b"fingertwin-table/", b"")
                .replace(b"fingertwin-supplement/", b"")]  # fmt: skip


def test_a_folder_is_a_session_that_the_command_line_takes(service: ServiceReceiver, tmp_path: Path) -> None:
    for name in (RECORDED, PUBLISHED):
        for member, content in members(exported(service, name, "folder")).items():
            (tmp_path / member).parent.mkdir(exist_ok=True)
            (tmp_path / member).write_bytes(content)
        compared = compare(Session.open(tmp_path / name, catalogue=False)).as_dict()
        assert json.dumps(compared) == json.dumps(compare(Session.open(name, catalogue=False)).as_dict())


def test_a_supplement_with_a_model_holds_its_revisions_back_to_the_finger(
    service: ServiceReceiver, tmp_path: Path
) -> None:
    bench = Session.open(PUBLISHED, catalogue=False)
    summary = compare(bench).summary()
    first = save_revision(bench, refit(bench, starts=1), tmp_path / "r1.json", summary, summary)
    later = first | {"id": "later", "parent": first["id"], "created_utc": now_utc()}
    with service.parts.messages.writing() as telling:
        for document in (first, later):
            service.parts.revisions.keep(telling, document, "P9", {}, "fitted")
    found = members(exported(service, PUBLISHED, "supplement", model="later"))
    assert json.loads(found["models/model.json"])["id"] == "later"
    assert json.loads(found["models/before-1.json"])["id"] == first["id"]
    # A revision alone: its document and its parameters, as the command line writes them.
    at = f"/api/v1/revisions/{first['id']}/export"
    assert service.client().get(at).json() == json.loads(json.dumps(first))
    export_source(str(tmp_path / "r1.json"), "csv", tmp_path / "r1.csv", None, str(tmp_path / "said.json"))
    table = service.client().get(at, params={"format": "csv"}).content
    assert table == (tmp_path / "r1.csv").read_bytes()
    told = service.client().get(at, params={"format": "columns"}).json()
    assert told["sources"][f"{first['id']}.json"] == hashlib.sha256((tmp_path / "r1.json").read_bytes()).hexdigest()


def as_made(page: str) -> str:
    """A report without when it was made, and without the digest of its readings, which the service has in chunks."""
    return re.sub(r"<td>(made|readings sha256)</td><td>[^<]*</td>", "", page)


@pytest.mark.parametrize("name", [RECORDED, MEAN])
def test_a_report_is_the_page_of_the_command_line(service: ServiceReceiver, name: str, tmp_path: Path) -> None:
    answer = service.client().get(f"{AT}/{name}/report")
    bench = Session.open(name, catalogue=False)
    page = draw_comparison(bench, compare(bench), tmp_path, static=False)
    assert as_made(answer.text) == as_made(page.read_text(encoding="utf-8"))
    assert answer.headers["Content-Disposition"] == f'attachment; filename="{name}-report.html"'
    policy = answer.headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "sandbox allow-scripts" in policy
    assert not {"connect-src", "allow-same-origin"} & set(policy.replace(";", " ").split())


@pytest.mark.parametrize("name", [RECORDED, PUBLISHED])
def test_a_check_finds_what_the_command_line_finds(service: ServiceReceiver, name: str) -> None:
    body = service.client().get(f"{AT}/{name}/check").json()
    expected = check(name).as_dict()
    assert model_findings(name) == []
    assert (body["schema"], body["ok"]) == ("fingertwin/check/1", expected["ok"])
    assert [f["code"] for f in body["findings"]] == [f["code"] for f in expected["findings"]]
    assert body["tares"] == pytest.approx(expected["tares"])
    assert body["known_weights"] == expected["known_weights"]


def predictions(columns: Mapping[str, Any], case_id: str) -> list[Any]:
    """What a table says of a case's prediction, as far as it says anything."""
    ids = [i.decode() if isinstance(i, bytes) else i for i in columns["id"]]
    row = ids.index(case_id)
    found = [v[row] for k, v in columns.items() if k.startswith(OF_PREDICTIONS) or k == "z"]
    assert len(found) == 10
    return [v for v in found if v is not None and not np.isnan(v)]


def tables(service: ServiceReceiver) -> dict[str, Mapping[str, Any]]:
    """The cases of session S1 in every format that holds predictions."""
    hdf5 = datasets(exported(service, "S1", "hdf5"))
    archive = members(exported(service, "S1", "supplement", model="an1979_middle"))
    return {
        "csv": from_csv(exported(service, "S1", "csv")),
        "parquet": cells(exported(service, "S1", "parquet")),
        "hdf5": {k.removeprefix("cases/"): v for k, v in hdf5.items() if "cases" in k},
        "mat": from_mat(exported(service, "S1", "mat"))["cases"],
        "supplement": from_csv(archive["cases.csv"]),
    }


def test_while_a_bench_runs_no_export_holds_a_prediction_of_its_validation_cases(played: Played) -> None:
    played.bench.play(whole()[:-1], block_s=LONG_BLOCK_S)
    played.send()
    for kind, columns in tables(played.service).items():
        assert predictions(columns, "c003") == [], kind
        assert len(predictions(columns, "c001")) >= 7, kind
        row = [i.decode() if isinstance(i, bytes) else i for i in columns["id"]].index("c003")
        assert float(columns["Fy_N"][row]) < -1.0, kind
    told = json.loads(exported(played.service, "S1", "columns"))
    assert any("hidden until the session is closed" in n for n in told["notes"])
    page = played.client.get(f"{AT}/S1/report").text
    assert "c001" in page
    assert "c003" not in page
    assert "Validation cases are left out until the session is closed." in page
    assert b"predicted" not in members(exported(played.service, "S1", "folder"))["S1/session.yaml"]
    played.bench.press("close")
    played.send()
    for kind, columns in tables(played.service).items():
        assert len(predictions(columns, "c003")) >= 7, kind
    assert "c003" in played.client.get(f"{AT}/S1/report").text


def test_a_bench_that_has_only_begun_exports_what_is_there(played: Played) -> None:
    played.bench.play(["next", *tared(), *case("tip", FDP=950)])
    played.send()
    assert cells(exported(played.service, "S1", "parquet"))["id"] == ["c001"]
    played.bench.play([*tared(), "next", *case("tip", FDS=950)])
    played.send()
    for file_format in ("csv", "hdf5", "supplement", "folder", "c3d"):
        assert exported(played.service, "S1", file_format)


def test_a_full_disk_is_said_and_leaves_nothing(service: ServiceReceiver, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(exporting, "write_table_file", full)
    answer = service.client().get(f"{AT}/{RECORDED}/export", params={"format": "csv"})
    assert answer.status_code == 503
    assert "No space left on device" in answer.json()["detail"]
    assert "fingertwin-" not in answer.text


def test_a_diagnosis_comes_before_the_comparison_in_one_page(service: ServiceReceiver) -> None:
    from tests.server.service.figures.test_figures_routes import kept_job

    kept_job(service, "d9", session=RECORDED)
    page = service.client().get(f"{AT}/{RECORDED}/report", params={"job": "d9", "model": "an1979_middle"}).text
    headings = (
        "Verdict",
        "What to do",
        "Which explanation",
        "Load cases to run next",
        "Summary",
        "Load cases",
        "Glossary",
    )
    places = [page.index(f"<h2>{Section(h, []).heading}</h2>") for h in headings]
    assert places == sorted(places)
    assert page.count("<!DOCTYPE html>") == 1
    sheet = service.client().get(f"{AT}/{RECORDED}/report/sheet", params={"job": "d9", "model": "an1979_middle"}).json()
    body = page[page.index("<main>") + 6 : page.index("</main>")]
    assert as_made(body).strip() in as_made(sheet["html"])
    assert len(sheet["figures"]) == page.count('class="plot"')
    wrong = service.client().get(f"{AT}/{PUBLISHED}/report", params={"job": "d9"})
    assert wrong.status_code == 404
    assert RECORDED in wrong.json()["detail"]


def test_a_saved_report_says_that_the_session_was_changed_since_its_search(service: ServiceReceiver) -> None:
    from tests.server.service.figures.test_figures_routes import kept_job

    client, changed = service.client(), "The session was changed since this search: search again."
    kept_job(service, "d10", session=RECORDED, started_utc=now_utc())
    params = {"job": "d10", "model": "an1979_middle"}
    where = f"{AT}/{RECORDED}/report"
    assert changed not in client.get(where, params=params).text
    cause = {"reason": "the suture slipped"}
    edit = client.post(f"{AT}/{RECORDED}/cases/c003/exclude", json=cause).json()["edit"]
    page = client.get(where, params=params).text
    assert page.count(changed) == 1
    assert page.index("<h2>Before you read on</h2>") < page.index(changed) < page.index("<h2>Verdict</h2>")
    # Once it is taken back, the search is of the session as it is.
    assert client.post(f"{AT}/{RECORDED}/edits/{edit}/undo", json={}).is_success
    assert changed not in client.get(where, params=params).text


def test_a_session_with_a_finger_of_its_own_is_as_any_other(service: ServiceReceiver) -> None:
    from tests.server.service.figures.test_figures_routes import kept_job

    client, finger = service.client(), read_finger("an1979_middle").document
    brought = {"finger": "mine.yaml", FINGER_DOCUMENT: finger | {"id": "mine"}}
    document = client.get(f"{AT}/{PUBLISHED}/document").json() | {"id": "OWN"} | brought
    client.post(AT, json={"id": "OWN", "document": document}).raise_for_status()
    warned = client.get(f"{AT}/OWN/comparison").json()["warnings"]
    assert [w for w in warned if w["code"] in ("unknown_finger", "unknown_key")] == []
    # An answer names the finger that was searched, and the report asks for it by that name.
    assert client.get(f"{AT}/OWN/comparison", params={"model": "mine"}).json()["model"] == "mine"
    kept_job(service, "d12", session="OWN", result=missing_effect() | {"session": "OWN", "model": "mine"})
    assert client.get(f"{AT}/OWN/report", params={"job": "d12"}).status_code == 200
    assert client.get(f"{AT}/{PUBLISHED}/comparison", params={"model": "mine"}).status_code == 422


def test_a_report_says_before_all_else_what_was_amended_and_left_out(service: ServiceReceiver) -> None:
    from tests.server.service.figures.test_figures_routes import kept_job

    client, parts, at = service.client(), service.parts, f"{AT}/{RECORDED}"
    plain = client.get(f"{at}/report").text
    assert "Before you read on" not in plain
    out = client.post(f"{at}/cases/c003/exclude", json={"reason": "the suture <slipped>"}).json()["edit"]
    entry = next(c for c in client.get(f"{at}/document").json()["cases"] if c["id"] == "c004")
    tendon, grams = next(iter(entry["masses_g"].items()))
    told = {"masses_g": {tendon: grams + 30.0}, "why": "weighed again"}
    amended = client.post(f"{at}/cases/c004/amend", json=told).raise_for_status().json()
    kept_job(service, "d11", session=RECORDED, started_utc=now_utc())
    for params in ({}, {"job": "d11", "model": "an1979_middle"}):
        page = client.get(f"{at}/report", params=params).text
        assert "Left out c003: the suture &lt;slipped&gt;" in page
        assert f"Amended c004: {tendon} {grams + 30:g} g hung (entered: {tendon} {grams:g} g); weighed again" in page
        assert page.index("<h2>Before you read on</h2>") < page.index("Left out c003") < page.index("Load cases</h2>")
    # A worker is told of what is left out, too, so that every answer says it.
    tasks = Tasks(parts.settings, parts.database, parts.measuring, parts.models, parts.revisions, parts.effects)
    given = provenance(tasks.bench({"session": RECORDED, "model": None}).open())
    assert given["excluded"] == {"c003": "the suture <slipped>"}
    assert [row["case"] for row in given["amendments"]] == ["c004"]
    for edit in (amended["edit"], out):
        client.post(f"{at}/edits/{edit}/undo", json={}).raise_for_status()
    assert as_made(client.get(f"{at}/report").text) == as_made(plain)


@pytest.mark.parametrize(
    ("path", "params", "status", "words"),
    [
        ("/nobody/export", {"format": "csv"}, 404, "nobody"),
        (f"/{RECORDED}/export", {}, 422, "format"),
        (f"/{RECORDED}/export", {"format": "docx"}, 422, "'csv'"),
        (f"/{RECORDED}/export", {"format": "csv", "model": "../secret"}, 422, "../secret"),
        (f"/{RECORDED}/export", {"format": "c3d", "model": "an1979_middle"}, 422, "no model"),
        (f"/{PUBLISHED}/export", {"format": "c3d"}, 422, "format=hdf5"),
        (f"/{RECORDED}/report", {"job": "nowhere"}, 404, "nowhere"),
        (f"/{RECORDED}/report", {"model": "nothing"}, 422, "nothing"),
        ("/nobody/report", {}, 404, "nobody"),
        ("/nobody/check", {}, 404, "nobody"),
    ],
)
def test_what_cannot_be_written_is_refused_in_one_line(
    service: ServiceReceiver, path: str, params: dict[str, str], status: int, words: str
) -> None:
    answer = service.client().get(f"{AT}{path}", params=params)
    assert answer.status_code == status
    assert answer.headers["Content-Type"].startswith("application/problem+json")
    assert words in answer.json()["detail"]


def test_a_session_without_a_record_has_nothing_to_export(service: ServiceReceiver) -> None:
    service.client().post(AT, json={"id": "EMPTY"}).raise_for_status()
    for path in ("export?format=csv", "export?format=folder", "check", "report"):
        answer = service.client().get(f"{AT}/EMPTY/{path}")
        assert answer.status_code == 422, path
        assert "no load case" in answer.json()["detail"] or "no measured load case" in answer.json()["detail"]
    missing = service.client().get("/api/v1/revisions/none/export", params={"format": "parquet"})
    assert missing.status_code == 404
    assert read_session(RECORDED).id == RECORDED
