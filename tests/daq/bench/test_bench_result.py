"""The session folder that a bench leaves: read back, checked, measured again; also after a crash or an early end."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.bench.result import write_bench_session
from daq.checks import check
from daq.errors import JournalError, SessionError
from daq.journal.reader import JournalReader
from daq.journal.writer import Journal
from daq.locations import data_dir
from daq.recordings.readings import open_readings
from daq.sessions import own_finger, read_session
from daq.sessions.protocols import Protocol, read_protocol
from daq.signals.corrections import measure
from server.commands.bench import check_session
from tests.daq.bench_plays import Bench, Line, case, journalled, load, setup, tared, truth, wait, whole

FDP = truth("tip", {"FDP": 950})


def written(played: Bench, folder: Path, **more: Any) -> Path:
    assert played.journal is not None
    write_bench_session(played.journal, folder, **more)
    played.journal.close()
    return folder


def test_the_folder_is_a_sound_session_with_the_forces_that_were_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    played = journalled(tmp_path).play(whole())
    shown = played.run.results()
    folder = written(played, tmp_path / "S1")
    session = read_session(folder)
    assert [c.id for c in session.cases] == ["c001", "c002", "c003", "c004"]
    assert [c.role for c in session.cases] == ["identification", "identification", "validation", "identification"]
    assert [w.when for w in session.checks] == ["before", "after"]
    assert {e.kind for e in session.events} == {"tare", "set_posture", "move_cell"}
    assert session.load_cell is not None
    assert (session.load_cell.serial, session.load_cell.calibration) == ("FT1", "SI-25-0.25")
    assert session.tension_factor == 0.835
    report = check(folder)
    assert report.errors == report.warnings == ()
    assert report.facts["recording"]["gaps"] == 0
    measured = measure(session)
    for index, (result, again) in enumerate(zip(shown, measured.cases, strict=True)):
        # The very readings that were confirmed are in the windows of the file.
        assert again.wrench[:3] == pytest.approx(result.force_N, abs=1e-9)
        sd = np.sqrt(np.diag(measured.case_covariance(index))[:3])
        assert sd == pytest.approx(result.sd_N, rel=1e-6)
    check_session(str(folder), None)
    assert "usable" in capsys.readouterr().out


def test_every_reading_of_the_journal_is_in_the_file(tmp_path: Path) -> None:
    played = journalled(tmp_path).play([*whole()[:5], "next", *tared(), *case("tip", FDP=950)])
    assert played.journal is not None
    chunks = list(played.journal.read(played.stream))
    blocks = list(open_readings(written(played, tmp_path / "S1", readings="r.parquet") / "r.parquet").blocks())
    assert np.array_equal(np.concatenate([b.t_s for b in blocks]), np.concatenate([c.t_s for c in chunks]))
    assert np.array_equal(np.concatenate([b.wrench for b in blocks]), np.concatenate([c.wrench for c in chunks]))


def test_what_was_kept_when_the_bench_crashed_is_a_session(tmp_path: Path) -> None:
    # Nobody closed: neither the run nor the journal; a third case was loaded, and not confirmed.
    script: list[Line] = [
        "next", *tared(), *case("tip", FDP=950), "note room at 21 C", "repeat", *case("tip", FDP=950), "next",
        *case("tip", FDS=950)[:-1],
    ]  # fmt: skip
    played = journalled(tmp_path).play(script)
    with JournalReader.open(tmp_path / "bench.ftj") as journal:
        session = write_bench_session(journal, tmp_path / "S1")
    assert [(c.id, c.repeat_of) for c in session.cases] == [("c001", None), ("c001r1", "c001")]
    assert [e.text for e in session.events if e.kind == "note"] == [
        "the known weight before the cases was skipped",
        "room at 21 C",
        "the session was not closed: written from the journal as far as it goes",
    ]
    assert check(tmp_path / "S1").ok
    assert played.journal is not None
    played.journal.close()


def test_a_session_that_was_ended_early_says_what_lacks(tmp_path: Path) -> None:
    played = journalled(tmp_path).play(["next", *tared(), *case("tip", FDP=950), "close"])
    folder = written(played, tmp_path / "S1")
    session = read_session(folder)
    assert session.events[-1].text == "closed without cases c002 c003 c004"
    assert list(session.postures_deg) == ["hook"]
    assert check(folder).ok


@pytest.mark.parametrize(
    "script", [[], ["next", *tared()], ["next", *tared(), *case("tip", FDP=950)[:-1]], [*whole()[:9], "close"]]
)
def test_without_a_complete_case_there_is_no_session(tmp_path: Path, script: list[Line]) -> None:
    played = journalled(tmp_path).play(script)
    with pytest.raises(SessionError, match=r"no complete case; .* The journal keeps the readings\.$"):
        written(played, tmp_path / "S1")
    assert not (tmp_path / "S1").exists()


def test_an_excluded_case_keeps_its_reason_and_its_windows(tmp_path: Path) -> None:
    script: list[Line] = [
        "next", *tared(), *case("tip", FDP=950), "exclude c001 the hanger touched",
        "repeat", *case("tip", FDP=950), "close",
    ]  # fmt: skip
    folder = written(journalled(tmp_path).play(script), tmp_path / "S1")
    first, second = read_session(folder).cases
    assert (first.excluded, first.recorded, second.repeat_of) == ("the hanger touched", True, "c001")
    assert [m.case.id for m in measure(read_session(folder)).cases] == ["c001r1"]


def test_a_slip_is_an_event_and_no_tare_reaches_across_it(tmp_path: Path) -> None:
    script: list[Line] = [
        "next", *tared(), *case("tip", FDP=950), "slipped suture", *tared(), "next", *case("tip", FDS=950), "close",
    ]  # fmt: skip
    folder = written(journalled(tmp_path).play(script), tmp_path / "S1")
    slip = next(e for e in read_session(folder).events if e.kind == "slip")
    assert slip.text == "suture"
    assert "stale_tare" not in {f.code for f in check(folder).findings}


def test_overload_is_flagged_in_the_readings(tmp_path: Path) -> None:
    hard = np.array([0.0, -40.0, 0.0, 0.0, 0.0, 0.0])
    script: list[Line] = ["next", *tared(), *case("tip", FDP=950), load(hard), wait(1.0), load(FDP), wait(1.0), "close"]
    folder = written(journalled(tmp_path).play(script), tmp_path / "S1")
    report = check(folder)
    assert report.facts["recording"]["flagged_readings"] > 50
    assert not {f.code for f in report.findings} & {"flagged_window", "saturated_window"}


def test_a_protocol_of_the_users_own_goes_along_and_a_shipped_one_is_named(tmp_path: Path) -> None:
    script: list[Line] = ["next", *tared(), *case("tip", FDP=950), "close"]
    own = written(journalled(tmp_path / "a").play(script), tmp_path / "own")
    assert read_session(own).protocol == "protocol.yaml"
    assert read_protocol("protocol.yaml", own).id == "small"
    levels = setup(protocol=read_protocol("synek2019"), protocol_name="synek2019")
    script = ["next", *tared(), *case("tip", FDS=950), "close"]
    shipped = written(journalled(tmp_path / "b", levels).play(script), tmp_path / "shipped")
    assert read_session(shipped).protocol == "synek2019"
    assert not (shipped / "protocol.yaml").exists()
    # One that only has the name of a shipped one is not that one.
    small = setup(protocol=Protocol.model_validate(setup().protocol.model_dump()), protocol_name="synek2019")
    script = ["next", *tared(), *case("tip", FDP=950), "close"]
    named = written(journalled(tmp_path / "c", small).play(script), tmp_path / "named")
    assert read_session(named).protocol == "protocol.yaml"


def test_a_finger_of_the_users_own_lies_beside_the_session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copyfile(data_dir() / "fingers" / "an1979_middle.yaml", "mine.yaml")
    own = setup(finger="mine.yaml", finger_document=own_finger("mine.yaml"))
    script: list[Line] = ["next", *tared(), *case("tip", FDP=950), "close"]
    folder = written(journalled(tmp_path, own).play(script), tmp_path / "S1")
    assert own_finger("mine.yaml", folder) == own.finger_document
    assert "finger_document" not in (folder / "session.yaml").read_text(encoding="utf-8")


def test_a_tension_factor_that_cannot_be_estimated_is_stated_and_said(tmp_path: Path) -> None:
    wanted = setup(tension_factor={"estimate": "force_balance"})
    script: list[Line] = ["next", *tared(), *case("tip", FDP=950), "close"]
    folder = written(journalled(tmp_path, wanted).play(script), tmp_path / "S1")
    session = read_session(folder)
    assert session.tension_factor == 0.835
    assert "tension factor 0.835 as published" in (session.events[-1].text or "")
    assert check(folder).ok


def test_an_estimate_stays_one_where_tip_and_bone_are_there(tmp_path: Path) -> None:
    document = setup().protocol.model_dump()
    for block in document["blocks"]:
        block |= {"postures": ["hook"], "masses_g": [{"FDP": 950}]}
    both = setup(protocol=Protocol.model_validate(document), tension_factor={"estimate": "force_balance"})
    script: list[Line] = [
        "next", *tared(), *case("tip", FDP=950), "next", "next", "cell_moved", *tared(), *case("bone", FDP=950),
        "close",
    ]  # fmt: skip
    folder = written(journalled(tmp_path, both).play(script), tmp_path / "S1")
    assert measure(read_session(folder)).tension_factor_source.startswith("estimated")


def test_a_session_is_never_written_over(tmp_path: Path) -> None:
    played = journalled(tmp_path).play(["next", *tared(), *case("tip", FDP=950), "close"])
    assert played.journal is not None
    folder = tmp_path / "S1"
    write_bench_session(played.journal, folder)
    with pytest.raises(SessionError, match=r"has a session\.yaml"):
        write_bench_session(played.journal, folder)
    played.journal.close()


def test_a_journal_without_a_bench_session_says_so(tmp_path: Path) -> None:
    with Journal.create(tmp_path / "j.ftj", "b", reserve_bytes=0) as journal:
        journal.add_stream("simulated", {}, {})
        with pytest.raises(JournalError, match="0 streams"):
            write_bench_session(journal, tmp_path / "S1")


def test_the_setup_survives_the_journal(tmp_path: Path) -> None:
    given = setup(environment={"room_C": 21.5}, budget="certificate", unloaded_state="hanger_on")
    folder = written(
        journalled(tmp_path, given).play(["next", *tared(), *case("tip", FDP=950), "close"]), tmp_path / "S1"
    )
    session = read_session(folder)
    assert session.environment is not None
    assert (session.environment.room_C, session.budget) == (21.5, "certificate")
    assert session.cases[0].unloaded_state == "hanger_on"
    assert isinstance(session.provenance, dict)
    assert session.provenance["driver"] == "simulated"
    assert json.dumps(given.as_value())
