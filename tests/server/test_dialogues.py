"""What `new`, `plan` and `import` ask at a terminal: a wrong answer is said and asked again, and nothing is assumed."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from daq.checks import check
from daq.lab.files import read_mapping
from daq.sessions import plain_document, read_session, read_yaml
from daq.sessions.protocols import plan, read_protocol
from daq.signals.corrections import measure
from fingermodel.fingers.files import read_finger
from tests.server.lab import POSTURE, lab_files
from tests.server.terminal import answering

ANGLES = POSTURE.partition(": ")[2]
SAME_AGAIN = ["", "", "left", "", "0.835", "", ""]


ROOT = Path(__file__).parents[2]
LEFT = [
    [],
    ["y"],
    ["y", "S01", "", "", "left"],
    ["y", "S01", *SAME_AGAIN[:-1]],
    ["y", "S01", *SAME_AGAIN, "RI 260, x, tip"],
]


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lab_files(tmp_path_factory.mktemp("lab"))


@pytest.fixture(scope="module")
def notes(lab: Path) -> list[str]:
    return (lab / "notes.txt").read_text("utf-8").splitlines()


def test_a_session_is_made_by_answers_and_wrong_ones_lose_nothing(lab: Path, notes: list[str], tmp_path: Path) -> None:
    out = tmp_path / "monday"
    factor = read_yaml(lab / "setup.yaml")["tension_factor"]
    answers = [
        "maybe", "y",
        "", "S01", "", "", "both", "left",
        "an1979_midle", "", "", "much", "2", f"{factor}".replace(".", ","),
        "ATI Nano17", "often", "inf", "100",
        "", "FDX 1, hook, tip", *notes[:3], "FDP nothing", *notes[3:], "",
        "99 tare", "tomorrow", "3 RI", "3 skip", f"3 {notes[1]}", "",
        "PIP", "PIP 55 WRIST 3", "MCP 0 PIP 65", "MCP 0 PIP 650 DIP 50", ANGLES,
    ]  # fmt: skip
    code, shown, err = answering(answers, "new", lab / "rig.csv", "--out", out)
    assert (code, err) == (0, "")
    for said in (
        "no answer; expected one",
        "no finger 'an1979_midle'; expected a file, or one of",
        "'much'; expected a number",
        "a factor of 2; expected 0 < factor",
        "'often'; expected a number",
        "'inf'; expected a number",
        "the notebook is empty",
        "line 1 of the notebook names 'FDX'",
        "line 4 of the notebook has 'FDP nothing'",
        "'99 tare'; expected a number from 1 to 17",
        "3 is now skip",
        "posture 'minor_flexion: PIP'; expected a name and angles",
        "sets WRIST; expected angles of MCP",
        "posture minor_flexion lacks DIP; expected joint angles in degrees",
        "posture minor_flexion.PIP is 650; expected an angle within ±180 degrees",
    ):
        assert said in shown
    session = read_session(out)
    assert check(out).ok
    assert (session.specimen.id, session.specimen.side, len(session.cases)) == ("S01", "left", 16)
    document = plain_document(session)
    assert (document["tension_factor"], document["load_cell"]["rate_hz"]) == (factor, 100)
    assert document["load_cell"]["model"] == "ATI Nano17"
    assert document["load_cell"]["mounts"] == {"tip": {"frame": "distal_phalanx"}, "bone": {"frame": "metacarpal"}}
    # The mapping that was confirmed serves the next run.
    assert read_mapping(out / "map.yaml").confirmed


def test_the_tutorial_shows_what_its_files_give(tmp_path: Path) -> None:
    files = ROOT / "data" / "recordings"
    answers = ["y", "S01", "", "", "left", "", "0.835", "", "", "", "MCP 0 PIP 65 DIP 50"]
    given = ["new", files / "rig.csv", "--notes", files / "notes.txt", "--out", tmp_path / "monday"]
    code, shown, err = answering(answers, *given)
    assert (code, err) == (0, "")
    tutorial = (ROOT / "docs" / "tutorial-from-your-csv.md").read_text("utf-8")
    rows = [line for line in tutorial.splitlines() if re.match(r"  (\d  \d|t   |Fx  |not sure)", line)]
    assert [row for row in rows if row not in shown] == []
    assert len(rows) == 15
    assert [line for line in shown.splitlines() if line.startswith("  not sure") and line not in rows] == []
    assert (files / "notes.txt").read_text("utf-8") in tutorial
    # They are cut out of a session whose forces are known.
    source = {c.case.id: c for c in measure(read_session("DEV-02")).cases}
    made = measure(read_session(tmp_path / "monday")).cases
    for case, name in zip(made, ("c055", "c056", "c057", "c058", "c094", "c093"), strict=True):
        hung = {k: v for k, v in source[name].case.masses_g.items() if v}
        assert (case.case.masses_g, case.case.location) == (hung, source[name].case.location)
        np.testing.assert_allclose(case.wrench[:3], source[name].wrench[:3], rtol=0, atol=0.02)


@pytest.mark.parametrize("interrupted", [False, True])
@pytest.mark.parametrize("answers", LEFT)
def test_a_dialogue_that_is_left_keeps_nothing(
    answers: list[str], interrupted: bool, lab: Path, tmp_path: Path
) -> None:
    code, _, err = answering(answers, "new", lab / "rig.csv", "--out", tmp_path / "s", interrupted=interrupted)
    assert (code, err.strip()) == (130, "fingertwin: Interrupted; nothing that was already written is lost.")
    assert not (tmp_path / "s").exists()


def test_nothing_is_asked_where_the_notebook_is_not_there(lab: Path, tmp_path: Path) -> None:
    code, shown, err = answering([], "new", lab / "rig.csv", "--notes", tmp_path / "nots.txt", "--out", tmp_path / "s")
    assert (code, shown.strip()) == (2, "")
    assert "nots.txt cannot be read" in err


def nameless(lab: Path, target: Path, time: bool = True) -> Path:
    """The recording with six names that tell nothing, and no units; also without its time."""
    rows = [line.split(";") for line in (lab / "rig.csv").read_text("cp1252").splitlines()[1:]]
    rows[0] = ["Zeit [ms]", *(f"Kanal {x}" for x in "abcdef")]
    target.write_text("\n".join(";".join(row if time else row[1:]) for row in rows) + "\n", "utf-8")
    return target


def test_six_channels_without_names_are_proposed_by_their_place_and_confirmed(lab: Path, tmp_path: Path) -> None:
    recording = nameless(lab, tmp_path / "run.csv")
    given = ["new", recording, "--out", tmp_path / "s", "--notes", lab / "notes.txt", "--setup", lab / "setup.yaml"]
    given += ["--posture", POSTURE]
    code, _, err = answering([], *given, "--yes")
    assert (code, err.count("\n")) == (2, 1)
    assert "only their place in run.csv says which channels are Fx Fy Fz Tx Ty Tz; expected --map FILE" in err
    answers = ["apples", "N", "", "", "N-m", "", "", "n", "Fx 4", "n", "Fq 1", "n", "Fx 9", "n", "Fx 2", "y", ""]
    code, shown, err = answering(answers, *given)
    assert (code, err) == (0, "")
    assert "their names tell nothing, so Kanal a, Kanal b" in shown
    assert "'apples' is no unit of force; expected one of N mN" in shown
    assert "'Fq'; expected one of Fx" in shown
    assert "'9'; expected the number of a channel, from 1 to 7" in shown
    mapping = read_mapping(tmp_path / "s" / "map.yaml")
    assert [(t.channel, t.unit) for t in mapping.channels.values()] == [
        (f"Kanal {x}", "N" if x < "d" else "N-m") for x in "abcdef"
    ]
    assert len(read_session(tmp_path / "s").cases) == 16


def test_a_recording_without_time_is_counted_at_a_rate_that_is_asked_for(lab: Path, tmp_path: Path) -> None:
    recording = nameless(lab, tmp_path / "run.csv", time=False)
    answers = ["0", "100", "N", "", "", "N-m", "", "", "y"]
    code, shown, err = answering(answers, "import", recording, "--out", tmp_path / "r.parquet")
    assert (code, err) == (0, "")
    assert "run.csv has no channel of time and states no increment" in shown
    assert read_mapping(tmp_path / "run.csv.map.yaml").model_dump()["time"] == {"increment_s": 0.01}


def test_counted_channels_without_a_unit_are_gauges_only_where_somebody_says_so(tmp_path: Path) -> None:
    recording = tmp_path / "run.csv"
    head = "time (s)," + ",".join(f"CH{i}" for i in range(1, 7))
    recording.write_text(head + "\n" + "".join(f"{i / 100},1,2,3,4,5,6\n" for i in range(9)), "utf-8")
    answers = ["n", "N", "", "", "Nmm", "", "", "y"]
    code, shown, err = answering(answers, "import", recording, "--out", tmp_path / "r.parquet")
    assert (code, err) == (0, "")
    assert "whether their order is Fx Fy Fz Tx Ty Tz" in shown
    assert read_mapping(tmp_path / "run.csv.map.yaml").channels["Tz"].channel == "CH6"


def test_what_no_name_tells_is_asked_for_by_number(tmp_path: Path) -> None:
    recording = tmp_path / "run.csv"
    head = "time (s),a,b,c,d,e,f,g,h"
    recording.write_text(head + "\n" + "".join(f"{i / 100},1,2,3,4,5,6,7,8\n" for i in range(9)), "utf-8")
    answers = ["2", "2", "x", "3", "4", "6", "7", "8", "N", "", "", "Nm", "", "", "n", ""]
    code, shown, _ = answering(answers, "import", recording, "--out", tmp_path / "r.parquet")
    assert "a is taken already" in shown
    # What was left unconfirmed is refused as it was before.
    assert code == 2
    assert not (tmp_path / "r.parquet").exists()


def test_a_bench_day_is_planned_by_answers(tmp_path: Path) -> None:
    out = tmp_path / "day"
    answers = [
        "somebody", "", "long", "-3", "48", "", "", "FDP", "",
        "fists", "own", "tare", "", "FDX 9, hook, tip", "FDP 950, hook, tip", "FDS 300", "",
        "PIPP 9", "MCP 0 PIP 65 DIP 50",
    ]  # fmt: skip
    code, shown, err = answering(answers, "plan", "--out", out)
    assert (code, err) == (0, "")
    for said in (
        "no finger 'somebody'", "'long'; expected a number", "-3 mm; expected a length above 0 mm",
        "no protocol 'fists'", "the notebook names no load", "names 'FDX'", "sets PIPP; expected angles of",
    ):  # fmt: skip
        assert said in shown
    protocol = read_protocol(str(out / "protocol.yaml"))
    cases, _ = plan(protocol)
    assert [c.masses_g for c in cases] == [{"FDP": 950}, {"FDS": 300}]
    assert protocol.postures_deg["hook"] == {"MCP": 0, "PIP": 65, "DIP": 50}
    assert read_finger(str(out / "finger.yaml")).id == "day"


def test_a_length_that_cannot_be_is_asked_for_again(tmp_path: Path) -> None:
    answers = ["", "4.8", "", "", "", "48", "", "", "", "levels", "fist", "hook, relaxed"]
    code, shown, err = answering(answers, "plan", "--out", tmp_path / "day")
    assert (code, err) == (0, "")
    assert "PP=4.8 is 0.1" in shown
    assert "has no posture 'fist'" in shown
    cases, _ = plan(read_protocol(str(tmp_path / "day" / "protocol.yaml")))
    assert {c.posture for c in cases} == {"hook", "relaxed"}


@pytest.mark.parametrize("interrupted", [False, True])
@pytest.mark.parametrize("answers", [[], [""], ["", "", "", "", "own", "FDP 950, hook, tip"]])
def test_a_plan_that_is_left_keeps_nothing(answers: list[str], interrupted: bool, tmp_path: Path) -> None:
    code, _, err = answering(answers, "plan", "--out", tmp_path / "day", interrupted=interrupted)
    assert (code, err.strip()) == (130, "fingertwin: Interrupted; nothing that was already written is lost.")
    assert not (tmp_path / "day").exists()
