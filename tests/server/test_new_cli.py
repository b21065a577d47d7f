"""`fingertwin new`: from a lab's recording and notebook to a session that `check` accepts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from daq.checks import check
from daq.locations import data_dir
from daq.recordings.readings import open_readings, write_readings
from daq.sessions import read_session, read_yaml
from daq.signals.corrections import measure
from tests.server.lab import POSTURE, SOURCE, lab_files
from tests.server.test_exchange_cli import answered, refused


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lab_files(tmp_path_factory.mktemp("lab"))


def test_a_session_comes_of_a_recording_and_a_notebook(lab: Path, tmp_path: Path) -> None:
    given = ["--notes", lab / "notes.txt", "--yes"]
    first = tmp_path / "first"
    rig = ["--setup", lab / "setup.yaml", "--posture", POSTURE]
    body = answered("new", lab / "rig.csv", "--out", first, *given, *rig)
    assert (body["cases"], body["plateaus"], body["unsure"], body["sound"]) == (16, 17, 0, True)
    assert body["suspects"] == []
    assert any("no known weight" in line for line in body["missing"])
    assert not any("kept from the fit" in line for line in body["missing"])
    assert any("cell's own axes" in line for line in body["notes"])
    session, source = read_session(first), read_session(SOURCE)
    assert check(first).ok
    for made, case in zip(session.cases, source.cases, strict=False):
        assert {k: v for k, v in made.masses_g.items() if v} == {k: v for k, v in case.masses_g.items() if v}
        assert (made.posture, made.location) == (case.posture, case.location)
        for name in ("unloaded_s", "loaded_s"):
            window, right = getattr(made, name), getattr(case, name)
            assert max(window[0], right[0]) < min(window[1], right[1])
    assert session.readings_path is not None
    assert source.readings_path is not None
    read, right_block = (next(open_readings(s.readings_path).blocks()) for s in (session, source))  # type: ignore[arg-type]
    count = min(len(read), len(right_block))
    np.testing.assert_allclose(read.wrench[:count], right_block.wrench[:count], rtol=0, atol=2e-6)
    # The next run of the same rig needs no setup, no mapping and no angles.
    again = answered("new", lab / "rig.csv", "--out", tmp_path / "second", *given, "--like", first)
    assert again["cases"] == 16
    assert read_session(tmp_path / "second").specimen == session.specimen
    assert "has a session already" in refused("new", lab / "rig.csv", "--out", first, *given, *rig)


def test_plateaus_that_no_line_names_are_told(lab: Path, tmp_path: Path) -> None:
    lines = (lab / "notes.txt").read_text("utf-8").splitlines()
    (tmp_path / "short.txt").write_text("\n".join(lines[:-3]), "utf-8")
    given = ["--notes", tmp_path / "short.txt", "--setup", lab / "setup.yaml", "--posture", POSTURE, "--yes"]
    body = answered("new", lab / "rig.csv", "--out", tmp_path / "out", *given)
    left_out = [line for line in body["notes"] if line.startswith("no line of the notebook names plateau")]
    assert (body["cases"], len(left_out)) == (13, 1)
    assert len(left_out[0].split(",")) == 3


def test_the_pause_between_two_recordings_is_no_gap(lab: Path, tmp_path: Path) -> None:
    heading, *rows = (lab / "rig.csv").read_bytes().decode("cp1252").splitlines()[1:]
    within = int(len(rows) * 0.4)
    for name, part in (("a.csv", rows[:within]), ("b.csv", rows[within:])):
        (tmp_path / name).write_text("\n".join([heading, *part]) + "\n", "utf-8")
    given = ["--notes", lab / "notes.txt", "--setup", lab / "setup.yaml", "--posture", POSTURE, "--yes"]
    body = answered("new", tmp_path / "a.csv", tmp_path / "b.csv", "--out", tmp_path / "out", *given)
    assert any("2 recordings stand one after the other" in line for line in body["notes"])
    codes = [finding.code for finding in check(tmp_path / "out").findings]
    assert ("time_jump" in codes, "gaps" in codes) == (True, False)


@pytest.mark.parametrize("forgotten", [0, 5])
def test_a_forgotten_line_makes_no_session_unless_what_it_leaves_is_to_be_left_out(
    forgotten: int, tmp_path: Path
) -> None:
    files = data_dir() / "recordings"
    lines = [
        "FDP 380, hook, tip", "FDP 950, hook, tip", "FDS 380, hook, tip", "FDS 950, hook, tip",
        "FDP 285 + FDS 285, hook, bone", "FDP 665 + FDS 665, hook, bone",
    ]  # fmt: skip
    notes = tmp_path / "notes.txt"

    def made(name: str, *more: object) -> list[object]:
        return ["new", files / "rig.csv", "--notes", notes, "--out", tmp_path / name, *more]

    setup: dict[str, object] = {"format": "bench-setup/1", "finger": "an1979_middle", "tension_factor": 0.835}
    setup["specimen"] = {"id": "S01", "species": "human", "digit": "third", "side": "left"}
    (tmp_path / "setup.yaml").write_text(yaml.safe_dump(setup), "utf-8")
    rig = ["--setup", tmp_path / "setup.yaml", "--posture", "hook: MCP 0 PIP 65 DIP 50"]
    notes.write_text("\n".join(lines), "utf-8")
    answered(*made("whole", *rig, "--yes"))
    # The mapping is confirmed, so that all is known without --yes.
    like = ["--like", tmp_path / "whole"]
    assert answered(*made("again", *like))["cases"] == 6
    notes.write_text("\n".join([*lines, "FDP 100"]), "utf-8")
    assert "was found on no plateau: FDP" in refused(*made("more", *like))
    notes.write_text("\n".join(line for i, line in enumerate(lines) if i != forgotten), "utf-8")
    plateau = {0: "2 (4.98 to 8.34 s)", 5: "8 (32.22 to 35.58 s)"}[forgotten]
    unnamed = f"no line of the notebook names plateau {plateau}: left out"
    assert f"{unnamed}; expected a line for each plateau under load" in refused(*made("fewer", *like))
    assert not (tmp_path / "more").exists()
    assert not (tmp_path / "fewer").exists()
    body = answered(*made("fewer", *like, "--yes"))
    assert (body["cases"], unnamed in body["notes"]) == (5, True)
    right = [case for i, case in enumerate(read_session(tmp_path / "whole").cases) if i != forgotten]
    for case, other in zip(read_session(tmp_path / "fewer").cases, right, strict=True):
        assert (case.masses_g, case.location) == (other.masses_g, other.location)
        assert (case.unloaded_s, case.loaded_s) == (other.unloaded_s, other.loaded_s)


def test_a_finger_of_ones_own_goes_along(lab: Path, tmp_path: Path) -> None:
    rig = tmp_path / "rig"
    rig.mkdir()
    (rig / "mine.yaml").write_bytes((data_dir() / "fingers" / "an1979_middle.yaml").read_bytes())
    setup = read_yaml(lab / "setup.yaml") | {"finger": "mine.yaml"}
    (rig / "setup.yaml").write_text(yaml.safe_dump(setup), "utf-8")
    given = ["--notes", lab / "notes.txt", "--posture", POSTURE, "--yes"]
    answered("new", lab / "rig.csv", "--out", tmp_path / "first", "--setup", rig / "setup.yaml", *given)
    (rig / "mine.yaml").unlink()
    assert read_session(tmp_path / "first").finger == "mine.yaml"
    assert check(tmp_path / "first").ok
    # The next session has it of the first one.
    answered("new", lab / "rig.csv", "--out", tmp_path / "second", "--like", tmp_path / "first", *given)
    assert (tmp_path / "second" / "mine.yaml").is_file()


@pytest.mark.parametrize("kind", ["hdf5", "c3d"])
def test_what_is_exported_can_be_a_recording_again(kind: str, lab: Path, tmp_path: Path) -> None:
    given = ["--notes", lab / "notes.txt", "--posture", POSTURE, "--setup", lab / "setup.yaml", "--yes"]
    answered("new", lab / "rig.csv", "--out", tmp_path / "first", *given)
    file = tmp_path / f"out.{'h5' if kind == 'hdf5' else kind}"
    answered("export", tmp_path / "first", "--format", kind, "--out", file)
    answered("new", file, "--out", tmp_path / "second", *given)
    first, second = (measure(read_session(tmp_path / name)).cases for name in ("first", "second"))
    assert [c.case.masses_g for c in second] == [c.case.masses_g for c in first]
    # C3D counts its time from the first reading, and keeps single precision.
    np.testing.assert_allclose([c.wrench for c in second], [c.wrench for c in first], rtol=0, atol=2e-3)


@pytest.mark.parametrize(
    ("without", "said"),
    [
        ("--setup", "specimen, finger, tension_factor not known; expected what no recording tells"),
        ("--posture", "the angles of minor_flexion are not known; expected --posture"),
        ("--notes", "no notebook; expected --notes FILE"),
        ("--yes", "which channel is which was not confirmed; expected --map FILE, or --yes"),
    ],
)
def test_what_cannot_be_known_is_asked_for_and_never_assumed(
    without: str, said: str, lab: Path, tmp_path: Path
) -> None:
    given = {"--notes": lab / "notes.txt", "--setup": lab / "setup.yaml", "--posture": POSTURE, "--yes": None}
    left = [x for k, v in given.items() if k != without for x in ([k] if v is None else [k, v])]
    assert said in refused("new", lab / "rig.csv", "--out", tmp_path / "s", *left)
    assert not (tmp_path / "s").exists()


def test_a_file_that_is_not_there_is_told_before_what_no_file_tells(lab: Path, tmp_path: Path) -> None:
    for recording, notebook, said in (
        ("rig.csv", "nots.txt", "nots.txt cannot"),
        ("rg.csv", "notes.txt", "rg.csv cannot"),
    ):
        assert said in refused("new", lab / recording, "--notes", lab / notebook, "--out", tmp_path / "s", "--yes")


def test_faults_of_notebook_and_recording_are_one_line(lab: Path, tmp_path: Path) -> None:
    rest = ["--setup", lab / "setup.yaml", "--posture", POSTURE, "--yes", "--out", tmp_path / "s"]
    wrong = tmp_path / "notes.txt"
    wrong.write_text("FDX 950, minor_flexion, tip", encoding="utf-8")
    assert "line 1 of the notebook names 'FDX'" in refused("new", lab / "rig.csv", "--notes", wrong, *rest)
    wrong.write_text("FDP 950, große Beugung, tip", encoding="latin-1")
    said = refused("new", lab / "rig.csv", "--notes", wrong, *rest)
    assert "notes.txt is not UTF-8 text (byte 12); expected a notebook as text or CSV in UTF-8. Save it" in said
    plain = tmp_path / "plain.csv"
    plain.write_text((lab / "rig.csv").read_text("cp1252").replace(" [N]", ""), encoding="utf-8")
    assert "gives Kraft x no unit" in refused("new", plain, "--notes", lab / "notes.txt", *rest)
    short = tmp_path / "short.csv"
    short.write_text("\n".join((lab / "rig.csv").read_text("cp1252").splitlines()[:12]) + "\n", encoding="utf-8")
    assert "holds still nowhere" in refused("new", short, "--notes", lab / "notes.txt", *rest)
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize("times", ["twice", "from the start again"])
def test_a_time_that_does_not_go_on_is_one_line_and_no_session(times: str, lab: Path, tmp_path: Path) -> None:
    """A readings file too, whose times no mapping looks at: windows would be of other readings."""
    rows = [f"{0.02 * i:.2f},{i % 9},1,2,3,4,5" for i in range(1500)]
    rows = [*rows[:700], rows[699], *rows[700:]] if times == "twice" else rows[:700] + rows[:700]
    head = "t_s,Fx_N,Fy_N,Fz_N,Tx_Nmm,Ty_Nmm,Tz_Nmm"
    (tmp_path / "r.csv").write_text("\n".join([head, *rows]) + "\n", "utf-8")
    write_readings(tmp_path / "r.parquet", open_readings(tmp_path / "r.csv").blocks())
    given = ["--notes", lab / "notes.txt", "--setup", lab / "setup.yaml", "--posture", POSTURE, "--yes"]
    wrong = "stands still at 13.98 s" if times == "twice" else "goes back from 13.98 s to 0 s"
    assert f"r.csv: reading 701: time {wrong}" in refused("new", tmp_path / "r.csv", "--out", tmp_path / "made", *given)
    before = "13.98 s" if times == "twice" else "0 s"
    said = refused("new", tmp_path / "r.parquet", "--out", tmp_path / "made", *given)
    assert f"r.parquet: reading 701 has the time {before}, and the one before it 13.98 s" in said
    assert not (tmp_path / "made").exists()
