from __future__ import annotations

import hashlib
import json
import re
import socket
import time
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from daq.errors import InputError
from daq.export.redaction import Redactor
from daq.export.supplement import versions, write_supplement
from daq.export.tables import case_columns
from daq.recordings.readings import ReadingBlock
from daq.sessions import Session as BenchSession
from daq.sessions import read_session
from daq.signals.corrections import measure
from fingermodel.api import refit
from fingermodel.comparing import compare
from fingermodel.revisions import save_revision
from fingermodel.session import Session
from server.commands.files import export_source
from tests.daq.benches import WRENCH, bench, record, recorded, save

ABOUT = {"software": "fingertwin 9"}
HOME = "/" + "home/"
PRIVATE = (
    "kschmidt", "gaitrig", "labpc-07", HOME, "C:\\", "bench data", "uni-example", "2024", "03-11", "14:05", "08:30",
    "1710151872", "march", "muster", "erika",
)  # fmt: skip
DATE = re.compile(r"(19|20)\d\d-\d\d-\d\d|\b\d\d:\d\d(:\d\d)?\b", re.IGNORECASE)


def private() -> dict[str, Any]:
    """A session in whose texts and keys a user, his computer, folders and dates stand."""
    data = recorded(cases=3, after=True)
    data["id"] = "S1_2024-03-11"
    data["load_cell"] |= {"serial": "20240119", "calibration": "FT20240 of 2024-01-19, C:\\bench data\\FT20240.cal"}
    data["load_cell"]["model"] = "ATI Nano17-E SI-25-0.25"
    data["cases"][0] |= {"note": "seated anew at 14:05, see " + HOME + "kschmidt/bench/photo.jpg"}
    data["cases"][1] |= {"excluded": "KSCHMIDT saw the suture slip", "logged": "2024-03-11T14:05:12+01:00"}
    data["events"] = [
        {
            "t_s": 3.0,
            "kind": "note",
            "text": "log moved from labpc-07 to gaitrig:8080 by kschmidt at 2024-03-11T14:05:12Z",
        },
        {"t_s": 4.0, "kind": "slip", "value": 0.25, "text": "mail kschmidt@gaitrig.uni-example.edu, 11 March 2024"},
        {"t_s": 5.0, "kind": "note", "value": 1710151872.5, "text": "clock"},
    ]
    data["checks"] = [
        {
            "when": "before", "mount": "tip", "mass_g": 100.0, "direction": "-y",
            "unloaded_s": data["cases"][0]["unloaded_s"], "loaded_s": data["cases"][0]["loaded_s"],
            "note": "by Muster, 08:30",
        },
    ]  # fmt: skip
    data["environment"] = {"room_C": 21.5, "thawed_utc": "2024-03-11T08:30:00Z"}
    data["operator"] = "Erika Muster"
    data["host"] = "gaitrig"
    data["provenance"] = {"doi": "10.7717/peerj.7470", "url": "https://doi.org/10.7717/peerj.7470"}
    return data


def recording() -> ReadingBlock:
    levels = [k * WRENCH for k in (0, 1, 0, 2, 0, 3, 0)]
    return record([np.asarray(level) for level in levels], noise=0.01)


def supplement(session: BenchSession, file: Path, **more: Any) -> dict[str, bytes]:
    """Write a supplement and return its members."""
    measured = measure(session)
    write_supplement(measured, case_columns(measured), file, about=ABOUT, **more)
    with zipfile.ZipFile(file) as archive:
        assert archive.testzip() is None
        return {name: archive.read(name) for name in archive.namelist()}


def without_dates(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: None if k.endswith("_utc") else without_dates(v) for k, v in value.items()}
    return [without_dates(v) for v in value] if isinstance(value, list) else value


@pytest.fixture(scope="module")
def members(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("bench")
    return supplement(bench(folder, private(), recording()), folder / "x.zip")


def test_no_member_tells_who_where_and_when(members: dict[str, bytes]) -> None:
    planted = json.dumps(private(), ensure_ascii=False).lower().replace("\\\\", "\\")
    assert [word for word in PRIVATE if word.lower() not in planted] == []
    for name, content in members.items():
        text = content.decode("utf-8")
        # Digits that only look like a date: the serial number, as stated, and its like; checksums; versions; readings.
        text = re.sub(r"20240119|FT20240|\b[0-9a-f]{64}\b|\"\d+(\.\d+)+\"", "", text)
        for word in PRIVATE:
            if name != "readings.csv" or not word.isdigit():
                assert word.lower() not in text.lower(), (name, word)
        assert DATE.search(text) is None, (name, DATE.search(text))


def test_what_is_not_private_stays(members: dict[str, bytes]) -> None:
    session = yaml.safe_load(members["session.yaml"])
    cell = json.loads(members["load_cell.json"])
    assert cell["serial"] == session["load_cell"]["serial"] == "20240119"
    assert cell["model"] == "ATI Nano17-E SI-25-0.25"
    assert re.fullmatch(r"FT20240 of \[date-\d+\], \[path-\d+\]", cell["calibration"])
    assert session["provenance"] == {"doi": "10.7717/peerj.7470", "url": "https://doi.org/10.7717/peerj.7470"}
    assert session["environment"] == {"room_C": 21.5}
    events = json.loads(members["events.json"])
    assert events == session["events"]
    assert [(e["t_s"], e["kind"]) for e in events] == [(3.0, "note"), (4.0, "slip"), (5.0, "note")]
    assert events[1]["value"] == 0.25
    user = re.search(r"by (\[user-\d+\]) at \[date-\d+\]", events[0]["text"])
    assert user is not None
    # The same one everywhere.
    assert json.loads(members["exclusions.json"]) == [{"id": "c002", "reason": f"{user[1]} saw the suture slip"}]
    assert json.loads(members["manifest.json"])["replaced"]["user"] >= 2


def test_the_archive_gives_the_same_measurements(members: dict[str, bytes], tmp_path: Path) -> None:
    original = measure(bench(tmp_path / "bench", private(), recording()))
    for name in ("session.yaml", "readings.csv"):
        (tmp_path / name).write_bytes(members[name])
    again = measure(read_session(tmp_path))
    assert [m.case.id for m in again.cases] == [m.case.id for m in original.cases] == ["c001", "c003"]
    for ours, theirs in zip(again.cases, original.cases, strict=True):
        np.testing.assert_array_equal(ours.wrench, theirs.wrench)
    np.testing.assert_array_equal(again.covariance(), original.covariance())
    assert again.checks[0].mass_g == 100.0
    header, *rows = members["cases.csv"].decode().splitlines()
    column = header.split(",").index("Fy_N")
    assert [float(r.split(",")[column]) for r in rows] == [m.wrench[1] for m in original.cases]
    told = {c["name"]: c["unit"] for c in json.loads(members["cases.csv.json"])["columns"]}
    assert list(told) == header.split(",")
    assert told["Fy_sd_N"] == "N"


def test_every_member_has_its_checksum(members: dict[str, bytes]) -> None:
    lines = members["SHA256SUMS"].decode().splitlines()
    sums = {line.split("  ")[1]: line.split("  ")[0] for line in lines}
    assert sums == {n: hashlib.sha256(c).hexdigest() for n, c in members.items() if n != "SHA256SUMS"}
    assert set(sums) == {
        "README.txt", "session.yaml", "readings.csv", "cases.csv", "cases.csv.json", "load_cell.json", "checks.json",
        "events.json", "exclusions.json", "commands.json", "versions.json", "manifest.json",
    }  # fmt: skip


def test_checks_and_versions_are_told(members: dict[str, bytes]) -> None:
    checks = json.loads(members["checks.json"])
    assert checks["cases"] == 3
    assert checks["excluded"] == 1
    weight = checks["known_weights_measured"][0]
    np.testing.assert_allclose(weight["true_N"], [0.0, -0.981, 0.0], atol=1e-12)
    np.testing.assert_allclose(weight["measured_N"], WRENCH[:3], atol=0.01)
    found = json.loads(members["versions.json"])
    assert found == versions()
    assert {"numpy", "scipy", "pyarrow", "ml_dtypes"} <= set(found["packages"])
    assert "pytest" not in found["packages"]
    assert found["packages"]["numpy"] == np.__version__


def test_the_same_input_gives_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = save(tmp_path / "a", private(), recording())
    second = save(tmp_path / "b" / "c", private(), recording())
    supplement(read_session(first), tmp_path / "first.zip")
    monkeypatch.setattr(time, "time", lambda: 2e9)
    supplement(read_session(second), tmp_path / "second.zip")
    assert (tmp_path / "first.zip").read_bytes() == (tmp_path / "second.zip").read_bytes()
    with zipfile.ZipFile(tmp_path / "first.zip") as archive:
        entries = archive.infolist()
    assert {(e.date_time, e.create_system, e.external_attr) for e in entries} == {
        ((1980, 1, 1, 0, 0, 0), 3, 0o100644 << 16)
    }
    names = [e.filename for e in entries]
    assert names == [*sorted(names[:-1]), "SHA256SUMS"]


def test_the_names_of_this_user_and_computer_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket, "gethostname", lambda: "Quokka.fritz.box")
    monkeypatch.setattr("getpass.getuser", lambda: "jdoe")
    data = recorded()
    data["events"] = [{"t_s": 1.0, "kind": "note", "text": "JDoe restarted quokka; quokkas and jdoes stay"}]
    found = supplement(bench(tmp_path, data, record([0 * WRENCH, WRENCH])), tmp_path / "x.zip")
    text = json.loads(found["events.json"])[0]["text"]
    assert re.fullmatch(r"\[user-1\] restarted \[host-\d\]; quokkas and jdoes stay", text)


@pytest.mark.parametrize(
    ("text", "left"),
    [
        ("at 2024-03-11", "at [date-1]"),
        ("run_20240311T101112Z", "run_[date-1]"),
        ("11.03.2024 10:15", "[date-1]"),
        ("3/11/24", "[date-1]"),
        ("Mon Mar 11 10:11:12 2024", "Mon [date-1]"),
        ("on March 11 at 9:30 pm", "on [date-1] at [time-1]"),
        ("12:30:15.5 and 12:30:15.5", "[time-1] and [time-1]"),
        (r"C:\Users\Jane Doe\x.csv by Jane Doe", "[path-1] by [user-1]"),
        (r"\\gaitsrv\share\x on gaitsrv", "[path-1] on [host-1]"),
        ("~/bench, /mnt/nas/x", "[path-1] [path-2]"),
        ("http://gaitsrv:8000/live on gaitsrv", "[address-1] on [host-1]"),
        ("192.168.0.12 aa:bb:cc:dd:ee:ff anna.local rig.uni-x.edu.", "[host-2] [host-1] [host-3] [host-4]."),
        ("user: kim; then kim", "user: [user-1]; then [user-1]"),
        # And nothing of the physics.
        ("3 N/mm, k*t/(a/b)/c, 1/320, ~5/6", "3 N/mm, k*t/(a/b)/c, 1/320, ~5/6"),
        ("PeerJ 7:e7470, 2019, https://doi.org/10.7717/x", "PeerJ 7:e7470, 2019, https://doi.org/10.7717/x"),
        ("readings.csv.gz, data/x.yaml, v3.11.2", "readings.csv.gz, data/x.yaml, v3.11.2"),
        ("-1.27200796702257 0.20191107", "-1.27200796702257 0.20191107"),
        ("hand loaded at tip", "hand loaded at tip"),
        ("point.DIP.ES, point.DIP.ES.proximal.x", "point.DIP.ES, point.DIP.ES.proximal.x"),
    ],
)
def test_what_is_private_in_a_text(text: str, left: str) -> None:
    clean = Redactor()
    clean.learn(text)
    assert clean(text) == left
    assert clean(left) == left


def test_different_things_stay_different() -> None:
    clean = Redactor()
    assert clean({"2024-03-11": ["2024-03-12", "2024-03-11"]}) == {"[date-1]": ["[date-2]", "[date-1]"]}
    assert clean.counts() == {"date": 2}


def test_a_word_of_the_format_is_never_taken_for_a_name(tmp_path: Path) -> None:
    data = recorded()
    data["note"] = "loaded@tip, user: readings, mail session@bone.org"
    found = supplement(bench(tmp_path, data, record([0 * WRENCH, WRENCH])), tmp_path / "x.zip")
    assert yaml.safe_load(found["session.yaml"])["cases"][0]["location"] == "tip"


def test_readings_that_tell_the_date_are_refused(tmp_path: Path) -> None:
    start_s = 1_710_151_872.0
    data = recorded()
    for key in ("unloaded_s", "loaded_s"):
        data["cases"][0][key] = [t + start_s for t in data["cases"][0][key]]
    block = record([0 * WRENCH, WRENCH])
    session = bench(tmp_path / "bench", data, ReadingBlock(block.t_s + start_s, block.wrench))
    with pytest.raises(InputError, match=r"tells a date.*expected seconds since the start"):
        supplement(session, tmp_path / "x.zip")
    assert [p.name for p in tmp_path.iterdir()] == ["bench"]


def test_a_session_of_averaged_forces(tmp_path: Path) -> None:
    found = supplement(read_session("synek2019_H01"), tmp_path / "x.zip")
    assert "readings.csv" not in found
    assert "readings" not in yaml.safe_load(found["session.yaml"])
    assert "predicted_Fx_N" not in found["cases.csv"].decode()


def test_the_command_adds_model_revisions_seeds_and_commands(tmp_path: Path) -> None:
    first, second = tmp_path / "models" / "H01-r1.json", tmp_path / "models" / "H01-r2.json"
    opened = Session.open("synek2019_H01", catalogue=False)
    fit, summary = refit(opened), compare(opened).summary()
    save_revision(opened, fit, first, summary, summary)
    save_revision(Session.open("synek2019_H01", str(first), catalogue=False), fit, second, summary, summary)
    made = json.loads(second.read_text(encoding="utf-8"))
    export_source("synek2019_H01", "supplement", tmp_path / "x.zip", str(second), str(tmp_path / "answer.json"))
    with zipfile.ZipFile(tmp_path / "x.zip") as archive:
        archive.extractall(tmp_path / "unpacked")
    folder = tmp_path / "unpacked"
    for file in folder.rglob("*"):
        assert not file.is_file() or made["created_utc"] not in file.read_text(encoding="utf-8")
    used = json.loads((folder / "models" / "model.json").read_text(encoding="utf-8"))
    # No other word of a model looks like something private.
    assert used == without_dates(made)
    assert made["created_utc"] is not None
    before = json.loads((folder / "models" / "before-1.json").read_text(encoding="utf-8"))
    assert before["id"] == made["parent"]
    commands = json.loads((folder / "commands.json").read_text(encoding="utf-8"))
    assert set(commands["seeds"].values()) == {20191107}
    assert [c["command"] for c in commands["figures"]] == [
        "fingertwin compare session.yaml --model models/model.json --figures figures",
        "fingertwin diagnose session.yaml --model models/model.json --figures figures",
    ]
    assert [c["command"] for c in commands["revisions"]] == [
        "fingertwin refit session.yaml --model models/before-1.json --out again-0.json --method map",
        "fingertwin refit session.yaml --model synek2019_initial --out again-1.json --method map",
    ]
    # What lies in the archive predicts what the table says.
    again = compare(Session.open(folder / "session.yaml", str(folder / "models" / "model.json"), catalogue=False))
    header, *rows = (folder / "cases.csv").read_text(encoding="utf-8").splitlines()
    column = header.split(",").index("predicted_Fy_N")
    assert [float(r.split(",")[column]) for r in rows] == [float(c.predicted_N[1]) for c in again.cases]
    assert json.loads((tmp_path / "answer.json").read_text(encoding="utf-8"))["rows"] == len(rows)


def test_a_finger_of_ones_own_comes_along(tmp_path: Path) -> None:
    from daq.locations import data_dir

    data = recorded() | {"finger": "mine.yaml"}
    folder = save(tmp_path / "bench", data, record([0 * WRENCH, WRENCH]))
    shipped = data_dir() / "fingers" / "an1979_middle.yaml"
    (folder / "mine.yaml").write_bytes(shipped.read_bytes())
    export_source(str(folder), "supplement", tmp_path / "x.zip", None, None)
    with zipfile.ZipFile(tmp_path / "x.zip") as archive:
        archive.extractall(tmp_path / "unpacked")
    assert read_session(tmp_path / "unpacked").finger == "finger.yaml"
    again, original = (compare(Session.open(f, catalogue=False)) for f in (tmp_path / "unpacked", folder))
    np.testing.assert_array_equal(again.cases[0].predicted_N, original.cases[0].predicted_N)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("synek2019_H01", "c3d", None, None), "no readings"),
        (("DEV-01", "c3d", None, "an1979_middle"), "--model an1979_middle with --format c3d"),
        (("DEV-01", "mat", Path("x.h5"), None), "--format mat and x.h5"),
    ],
)
def test_what_cannot_be_exported_is_one_line(
    arguments: tuple[str, str, Path | None, str | None], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=said) as error:
        export_source(*arguments, None)
    assert "\n" not in str(error.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("file_format", ["csv", "hdf5", "c3d", "mat", "supplement"])
def test_a_place_that_cannot_be_written_to_is_named(file_format: str, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    out = tmp_path / "file" / "x"
    with pytest.raises(InputError, match=f"{re.escape(str(out))} cannot be written .*Choose another --out"):
        export_source("DEV-01", file_format, out, None, None)
