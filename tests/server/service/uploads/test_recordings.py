"""Recordings and a notebook that are sent: looked at with nothing kept, then kept as `fingertwin new` makes it."""

from __future__ import annotations

import base64
import gzip
import io
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from daq.lab.drafts import posture_of
from daq.sessions import plain_document, read_session, read_yaml
from daq.vocabulary import LARGEST_FACTOR
from server.service.uploads import new_sessions
from tests.daq.lab_bombs import BOMBS
from tests.server.lab import POSTURE, SOURCE, lab_files
from tests.server.service.running import ServiceReceiver
from tests.server.test_exchange_cli import answered

AT = "/api/v1/recordings"


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceReceiver]:
    out = ServiceReceiver(tmp_path_factory.mktemp("service"))
    yield out
    out.close()


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lab_files(tmp_path_factory.mktemp("lab"))


def sent(*files: tuple[str, bytes]) -> list[dict[str, str]]:
    return [{"name": name, "base64": base64.b64encode(content).decode()} for name, content in files]


def ask(service: ServiceReceiver, at: str, status: int = 200, **body: Any) -> Any:
    answer = service.client().post(at, json=body)
    assert answer.status_code == status, answer.text[:500]
    return answer.json()


@pytest.fixture(scope="module")
def run(lab: Path) -> list[dict[str, str]]:
    return sent(("run.csv", gzip.compress((lab / "rig.csv").read_bytes())))


@pytest.fixture(scope="module")
def confirmed(service: ServiceReceiver, run: Any) -> dict[str, Any]:
    mapping: dict[str, Any] = ask(service, f"{AT}/look", files=run)["proposal"]["mapping"]
    return mapping | {"confirmed": True}


@pytest.fixture(scope="module")
def laid(service: ServiceReceiver, lab: Path, run: Any, confirmed: Any) -> dict[str, Any]:
    notes = (lab / "notes.txt").read_text("utf-8")
    out: dict[str, Any] = ask(service, f"{AT}/lay", files=run, mapping=confirmed, notes=notes)
    return out


@pytest.fixture(scope="module")
def whole(lab: Path, run: Any, confirmed: Any, laid: Any) -> dict[str, Any]:
    """What the last step sends."""
    rig = read_yaml(lab / "setup.yaml")
    specimen = {k: v for k, v in rig["specimen"].items() if k in ("id", "species", "digit", "side")}
    header = {"specimen": specimen, "finger": rig["finger"], "tension_factor": rig["tension_factor"]}
    header |= {"load_cell": {"mounts": {"tip": {"frame": "distal_phalanx"}, "bone": {"frame": "metacarpal"}}}}
    keys = ("masses_g", "posture", "location", "role", "repeats")
    lines = [None if p["line"] is None else laid["lines"][p["line"]] for p in laid["plateaus"]]
    choices = [
        {"kind": p["kind"]} | ({k: line[k] for k in keys} if line else {})
        for p, line in zip(laid["plateaus"], lines, strict=True)
    ]
    name, angles = posture_of(POSTURE)
    return {"files": run, "mapping": confirmed, "header": header, "postures_deg": {name: angles}, "choices": choices}


def test_columns_are_proposed_with_how_sure_each_is(service: ServiceReceiver, run: Any) -> None:
    body = ask(service, f"{AT}/look", files=run)
    lines = {line["is"]: line for line in body["proposal"]["lines"]}
    assert [lines[k]["channel"] for k in ("t", "Fx", "Tz")] == ["Zeit [ms]", "Kraft x [N]", "Moment z [N-m]"]
    assert [lines[k]["unit"] for k in ("t", "Fx", "Tz")] == ["ms", "N", "N-m"]
    assert all(line["sure"] > 0.9 for line in lines.values())
    assert body["proposal"]["mapping"]["confirmed"] is False
    assert body["recordings"][0]["plateaus"] > 10
    assert body["recordings"][0]["figure"]["figure"]["data"]


def test_a_unit_that_no_file_states_is_never_assumed(service: ServiceReceiver, lab: Path) -> None:
    plain = (lab / "rig.csv").read_text("cp1252").replace(" [N]", "").replace(" [ms]", "").encode("cp1252")
    body = ask(service, f"{AT}/look", files=sent(("plain.csv", plain)))
    lines = {line["is"]: line for line in body["proposal"]["lines"]}
    assert [(lines[k]["unit"], lines[k]["sure"]) for k in ("t", "Fx", "Fy", "Fz")] == [(None, 0.0)] * 4
    assert lines["Tx"]["sure"] > 0.9
    mapping = body["proposal"]["mapping"]
    files = sent(("plain.csv", plain))
    said = ask(service, f"{AT}/lay", 422, files=files, mapping=mapping | {"confirmed": True})["detail"]
    assert "no unit" in said
    assert "was not confirmed" in ask(service, f"{AT}/lay", 422, files=files, mapping=mapping)["detail"]


@pytest.mark.parametrize("start", [b"\x89HDF\r\n\x1a\n", b"MATLAB 7.3 MAT-file", b"\x02\x50"])
def test_files_whose_readers_a_hostile_one_may_crash_are_not_opened(start: bytes, service: ServiceReceiver) -> None:
    said = ask(service, f"{AT}/look", 422, files=sent(("run.bin", start.ljust(2000, b"\0"))))
    assert "is an HDF5 or C3D file, which a service does not open" in said["detail"]
    assert "fingertwin new" in said["remedy"]


@pytest.mark.parametrize("name", BOMBS)
def test_a_file_that_claims_far_more_than_it_holds_is_refused(
    name: str, service: ServiceReceiver, tmp_path: Path
) -> None:
    content = BOMBS[name](tmp_path / name).read_bytes()
    answer = service.client().post(f"{AT}/look", json={"files": sent((name, content))})
    # What the service itself sees before it opens a file is too large; the rest is no recording.
    assert answer.status_code in (413, 422), answer.text
    assert name in answer.json()["detail"] or "25165824 rows" in answer.json()["detail"]
    assert "\n" not in answer.json()["detail"]


def test_an_xls_file_is_not_opened(service: ServiceReceiver) -> None:
    content = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1".ljust(2000, b"\0")
    said = ask(service, f"{AT}/look", 422, files=sent(("run.xls", content)))
    assert "run.xls is an .xls file, which a service does not open" in said["detail"]


def test_without_a_time_the_other_lines_are_proposed_all_the_same(service: ServiceReceiver, lab: Path) -> None:
    rows = (lab / "rig.csv").read_text("cp1252").splitlines()[1:]
    plain = "\n".join(row.split(";", 1)[1] for row in rows) + "\n"
    body = ask(service, f"{AT}/look", files=sent(("plain.csv", plain.encode())))
    lines = {line["is"]: line for line in body["proposal"]["lines"]}
    assert [lines[k]["channel"] for k in ("t", "Fx")] == [None, "Kraft x [N]"]
    assert (lines["t"]["increment_s"], lines["Fx"]["unit"], body["proposal"]["mapping"]) == (None, "N", None)
    assert "no channel of time" in body["proposal"]["doubts"][0]


def test_the_session_is_the_one_of_the_command_line(
    service: ServiceReceiver, lab: Path, tmp_path: Path, laid: Any, whole: Any
) -> None:
    assert [p["kind"] for p in laid["plateaus"]] == ["tare"] + ["load"] * 16
    assert (laid["lost"], [line["line"] for line in laid["lines"]]) == ([], list(range(1, 17)))
    drafted = ask(service, f"{AT}/draft", **whole, id="new")
    assert drafted["cases"] == 16
    assert [f for f in drafted["findings"] if f["level"] == "error"] == []
    assert (drafted["suspects"], drafted["looked_at"]) == ([], None)
    assert any("no known weight" in line for line in drafted["missing"])
    # Nothing was kept until now.
    assert service.client().get("/api/v1/sessions/new").status_code == 404
    made = ask(service, "/api/v1/imports/recordings", 201, **whole, id="new")
    assert (made["cases"], made["already_there"]) == ({"measured": 16}, False)
    assert ask(service, "/api/v1/imports/recordings", 200, **whole, id="new")["already_there"]
    out = tmp_path / "new"
    given = ["--notes", lab / "notes.txt", "--setup", lab / "setup.yaml", "--posture", POSTURE, "--yes"]
    answered("new", lab / "rig.csv", "--out", out, *given)
    ours = service.client().get("/api/v1/sessions/new/document").json()
    theirs = plain_document(read_session(out))
    assert ours["cases"] == theirs["cases"]
    assert ours["postures_deg"] == theirs["postures_deg"]
    assert ours["provenance"]["mapping"] == whole["mapping"]
    # A mapping that is among the files serves as well as one in the request.
    saved = (out / "map.yaml").read_bytes()
    again = ask(service, f"{AT}/look", files=[*whole["files"], *sent(("rig.map.yaml", saved))])
    assert again["proposal"]["saved"]
    assert {line["sure"] for line in again["proposal"]["lines"]} == {1.0}


def test_a_case_that_looks_like_another_is_named(service: ServiceReceiver, whole: Any) -> None:
    """Two lines of the notebook are exchanged, of which one had the other tendon."""
    loads = [i for i, c in enumerate(whole["choices"]) if c["kind"] == "load"]
    choices = [dict(c) for c in whole["choices"]]
    masses = [choices[i]["masses_g"] for i in loads]
    first = next(k for k in range(len(masses) - 1) if masses[k].keys() != masses[k + 1].keys())
    a, b = loads[first], loads[first + 1]
    choices[a]["masses_g"], choices[b]["masses_g"] = choices[b]["masses_g"], choices[a]["masses_g"]
    found = ask(service, f"{AT}/draft", **(whole | {"choices": choices}), id="swapped")["suspects"]
    assert {s["case"] for s in found} == {f"c{first + 1:03d}", f"c{first + 2:03d}"}
    assert all(s["own"] > 2 * s["other"] for s in found)


def test_what_does_not_fit_the_recording_is_said(service: ServiceReceiver, whole: Any, run: Any) -> None:
    few = whole | {"choices": whole["choices"][:-1]}
    assert "16 choices for 17 plateaus" in ask(service, f"{AT}/draft", 422, **few, id="few")["detail"]
    none = [{"kind": "skip"}] * 17
    assert "no plateau is a load" in ask(service, f"{AT}/draft", 422, **(whole | {"choices": none}), id="no")["detail"]
    untared = [{"kind": "skip"}, *whole["choices"][1:]]
    assert "no tare before it" in ask(service, f"{AT}/draft", 422, **(whole | {"choices": untared}), id="no")["detail"]
    bare = whole | {"postures_deg": {}}
    assert "angles of minor_flexion are not known" in ask(service, f"{AT}/draft", 422, **bare, id="no")["detail"]
    sideless = whole | {"header": whole["header"] | {"specimen": {"id": "S1"}}}
    assert "side" in ask(service, f"{AT}/draft", 422, **sideless, id="no")["detail"]
    slipped = whole | {"header": whole["header"] | {"tension_factor": 83.5}}
    assert "tension_factor" in ask(service, f"{AT}/draft", 422, **slipped, id="no")["detail"]
    said = ask(service, f"{AT}/lay", 422, files=run, mapping=whole["mapping"], notes="FDX 1, hook, tip")["detail"]
    assert "line 1 of the notebook names 'FDX'" in said


def test_a_friction_factor_is_limited_as_in_a_session(service: ServiceReceiver, whole: Any) -> None:
    stated = whole["header"] | {"tension_factor": LARGEST_FACTOR}
    draft = ask(service, f"{AT}/draft", **(whole | {"header": stated}), id="friction")
    assert draft["cases"] > 0
    page = service.client().get("/pages/views/new_rig.js").text
    assert f"Number(factor) <= {LARGEST_FACTOR})" in page


def bad() -> dict[str, tuple[bytes, str]]:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/worksheets/sheet1.xml", bytes(4 << 20))
    return {
        "empty.csv": (b"", "empty"),
        "words.csv": (b"nothing\nbut words\n", "words.csv"),
        "photo.png": (b"\x89PNG\r\n\x1a\n" + bytes(200), "photo.png"),
        "short.csv": (b"t [s];Fx [N];Fy [N];Fz [N];Tx [Nmm];Ty [Nmm];Tz [Nmm]\n", "short.csv"),
        "journal.db": (b"SQLite format 3\x00" + bytes(100), "fingertwin journal export"),
        "cut.tdms": (b"TDSm" + bytes(10), "cut.tdms"),
        "torn.csv": (gzip.compress(b"t,Fx\n" + b"0.1,2\n" * 5000)[:12], "torn.csv"),
        "bomb.csv": (gzip.compress(bytes(4 << 20)), "bytes unpacked"),
        "bomb.xlsx": (packed.getvalue(), "bytes unpacked"),
        "latin.yaml": (b"mapping: gr\xf6\xdfe\n", "latin.yaml is not UTF-8"),
        "bomb.yaml": (b"a: &a [1,2]\nb: [*a, *a]\nc: &c {d: *c}\n", "levels"),
    }


@pytest.mark.parametrize("name", list(bad()))
def test_a_file_that_cannot_be_used_is_refused_in_one_line(
    service: ServiceReceiver, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(new_sessions, "MOST_UNPACKED", 1 << 20)
    content, said = bad()[name]
    files = sent((name, content)) + (sent(("run.csv", b"t,x\n")) if name.endswith("yaml") else [])
    answer = service.client().post(f"{AT}/look", json={"files": files})
    assert answer.status_code == (413 if said == "bytes unpacked" else 422), answer.text
    assert said in answer.json()["detail"]
    assert "\n" not in answer.json()["detail"]
    assert "fingertwin-" not in answer.json()["detail"]  # the service's own folder


def test_every_prefix_of_a_recording_is_read_or_refused(service: ServiceReceiver, lab: Path) -> None:
    text = (lab / "rig.csv").read_bytes()[:900]
    for cut in range(0, len(text), 45):
        answer = service.client().post(f"{AT}/look", json={"files": sent(("cut.csv", text[:cut]))})
        assert answer.status_code in (200, 422), answer.text
        if answer.status_code == 200:
            lines = text[:cut].count(b"\n") - 2
            assert answer.json()["recordings"][0]["readings"] <= lines


@pytest.mark.parametrize("path", ["../../secret.cal", "/etc/passwd", "secret.cal"])
def test_a_calibration_is_looked_for_among_the_files_alone(
    service: ServiceReceiver, run: Any, confirmed: Any, path: str
) -> None:
    mapping = confirmed | {"calibration": path}
    said = ask(service, f"{AT}/lay", 422, files=run, mapping=mapping)["detail"]
    assert "not among the files" in said


def test_who_may_only_read_can_look_and_not_keep(service: ServiceReceiver, run: Any, whole: Any) -> None:
    from server.service.security.tokens import create

    text = create(service.parts.database, "reader", "read")[1]
    away = {"Authorization": f"Bearer {text}"}
    assert service.client().post(f"{AT}/look", json={"files": run}, headers=away).status_code == 200
    kept = service.client().post("/api/v1/imports/recordings", json=whole | {"id": "no"}, headers=away)
    assert kept.status_code == 403
    assert SOURCE not in kept.text
