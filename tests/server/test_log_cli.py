"""`fingertwin log` and `simulate-cell` as a user runs them: a played device, a recording, and what is refused."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.journal.reader import JournalReader
from daq.journal.writer import Journal
from daq.recordings.readings import ReadingBlock, open_readings, write_readings
from server.cli import main
from tests.daq.cal_files import nano17
from tests.daq.journal_writer import made_chunk
from tests.daq.lab_files import tdms


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    t_s = np.arange(0.0, 30.0, 0.01)
    return write_readings(tmp_path / "played.csv", [ReadingBlock(t_s, np.outer(np.sin(t_s), np.arange(1.0, 7.0)))])


def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *arguments: str) -> tuple[int, str, str]:
    monkeypatch.setattr(sys, "argv", ["fingertwin", *arguments])
    with pytest.raises(SystemExit) as left:
        main()
    said = capsys.readouterr()
    return int(left.value.code or 0), said.out, said.err


def played(recording: Path, device: str, *faults: str) -> tuple[subprocess.Popen[str], dict[str, Any]]:
    """A stand-in in a process of its own, and what it said."""
    said = recording.parent / "said.json"
    process = subprocess.Popen(  # noqa: S603 - our own command
        [sys.executable, "-m", "server.cli", "simulate-cell", device, "--play", str(recording), "--seconds", "25",
         "--wire", "udp" if device == "ati-netft" else "tcp", "--json", str(said), *faults],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    for _ in range(300):
        if said.exists():
            return process, json.loads(said.read_text())
        time.sleep(0.05)
    process.kill()
    raise AssertionError(process.communicate()[0])


@pytest.mark.parametrize("device", ["robotiq-ft300", "ati-serial", "ati-netft", "bota-sensone", "gauge-volts"])
def test_a_played_device_is_logged_checked_and_exported(
    device: str, recording: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    process, said = played(recording, device)
    out = recording.parent / "log"
    # What it said is a line that works as it stands, but for the folder.
    program, *line, folder = said["log_with"].split()
    assert (program, folder) == ("fingertwin", "LOG")
    try:
        code, text, err = run(capsys, monkeypatch, *line, str(out), "--seconds", "1.5")
    finally:
        process.kill()
        process.communicate()
    assert code == 0, err
    assert "readings in 1." in text
    journal = out / "journal.sqlite3"
    code, text, _ = run(capsys, monkeypatch, "journal", "check", str(journal))
    assert code == 0, text
    assert "sound" in text
    target = out / "readings.parquet"
    code, _, err = run(
        capsys, monkeypatch, "journal", "export", str(journal), "--out", str(target), "--format", "parquet"
    )
    assert code == 0, err
    wrench = np.concatenate([b.wrench for b in open_readings(target).blocks()])
    assert len(wrench) > 100
    # What was played: each component is so many times the first.
    assert wrench[:, 2] == pytest.approx(3.0 * wrench[:, 0], abs=0.06)
    events = json.loads((out / "readings.parquet.events.json").read_text())
    assert {"started", "ended"} <= {e["kind"] for e in events["events"]}


def test_gauge_volts_are_played_and_logged_by_a_calibration_of_the_users_own(
    recording: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    own = nano17(recording.parent)
    process, said = played(recording, "gauge-volts", "--set", f"calibration={own}", "--drift-N-per-min", "-600")
    out = recording.parent / "log"
    try:
        code, _, err = run(capsys, monkeypatch, *said["log_with"].split()[1:-1], str(out), "--seconds", "1.5")
    finally:
        process.kill()
        process.communicate()
    assert code == 0, err
    with JournalReader.open(out / "journal.sqlite3") as journal:
        [stream] = journal.streams()
        chunks = list(journal.read(stream.id))
    # Whose calibration it is, and what it says, is in the log, though nobody stated it on the command line.
    assert stream.cell["serial"] == "FT14048"
    assert stream.cell["model"] == "ATI Nano17 SI-50-0.5"
    assert stream.cell["calibration_text"] == own.read_text("utf-8")
    t_s = np.concatenate([c.t_s for c in chunks])
    # Of Fz - 3 Fx, in which what is played cancels, the drift of -10 N/s is left twice, upwards.
    left = np.concatenate([c.wrench[:, 2] - 3.0 * c.wrench[:, 0] for c in chunks])
    assert len(left) > 50
    assert np.polyfit(t_s, left, 1)[0] == pytest.approx(20.0, rel=0.1)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["robotiq-ft300", "--set", "calibration=x"], "has no setting calibration"),
        (["gauge-volts", "--set", "calibration=none.cal"], "none.cal cannot be read"),
        (["gauge-volts", "--set", "calibration"], "expected NAME=VALUE"),
        (["gauge-volts", "--set", "calibration=a", "--set", "calibration=b"], "--set calibration is given twice"),
        (["gauge-volts", "--noise-N", "-1"], "noise-N is -1"),
        (["gauge-volts", "--noise-N", "1", "--noise-correlation", "1"], "noise-correlation is 1"),
        (["gauge-volts", "--flip-per-s", "nan"], "flipped-per-s is nan; expected a number, 0 or more"),
        (["gauge-volts", "--rate-hz", "0"], "--rate-hz 0; expected a rate above 0"),
        (["gauge-volts", "--rate-hz", "nan"], "--rate-hz nan; expected a rate above 0"),
        (["gauge-volts", "--seconds", "-1"], "--seconds -1; expected a time above 0"),
        (["gauge-volts", "--port", "99999"], "--port 99999; expected 0 to 65535"),
        (["ati-netft", "--port", "-3"], "--port -3; expected 0 to 65535"),
    ],
)
def test_what_cannot_be_played_is_said_in_one_line(
    arguments: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, text, err = run(capsys, monkeypatch, "simulate-cell", *arguments, "--wire", "tcp")
    assert (code, text) == (2, "")
    assert said in err
    assert err.count("\n") == 1


def test_a_port_that_is_taken_is_said_in_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        code, text, err = run(capsys, monkeypatch, "simulate-cell", "gauge-volts", "--wire", "tcp", "--port", port)
    assert (code, text, err.count("\n")) == (2, "", 1)
    assert f"port {port} cannot be had" in err


def test_a_recording_is_logged_as_it_is(
    recording: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = recording.parent / "log"
    arguments = ["log", "--driver", "replay", "--port", str(recording), "--out", str(out), "--json", "-"]
    code, text, err = run(capsys, monkeypatch, *arguments, "--set", "speed=0")
    assert code == 0, err
    told = json.loads(text)
    assert told["schema"] == "fingertwin/log/1"
    assert told["samples"] == 3000
    assert told["rate_hz"] == pytest.approx(100.0)
    target = out / "again.csv"
    code, _, err = run(capsys, monkeypatch, "journal", "export", str(out / "journal.sqlite3"), "--out", str(target))
    assert code == 0, err
    old, new = (np.concatenate([b.wrench for b in open_readings(p).blocks()]) for p in (recording, target))
    assert (old == new).all()
    # The journal itself can be replayed into another.
    again = ["log", "--driver", "replay", "--port", str(out / "journal.sqlite3"), "--out", str(out / "2")]
    code, text, err = run(capsys, monkeypatch, *again, "--set", "speed=0", "--json", "-")
    assert code == 0, err
    assert json.loads(text)["samples"] == 3000
    # So can the recording, by the command of that name, which answers as that command.
    again = ["replay", str(recording), "--speed", "max", "--out", str(out / "3"), "--json", "-"]
    code, text, err = run(capsys, monkeypatch, *again)
    assert code == 0, err
    replayed = json.loads(text)
    assert replayed["schema"] == "fingertwin/replay/1"
    assert [replayed[key] for key in ("driver", "samples", "rate_hz")] == [told["driver"], 3000, told["rate_hz"]]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--driver", "foo"], "no driver 'foo'"),
        (["--driver", "robotiq-ft300", "--out", "x"], "the cell's serial number or calibration is not stated"),
        (["--driver", "replay", "--port", "nothing.csv", "--out", "x"], "nothing.csv cannot be read"),
        (["--driver", "replay", "--port", "a.csv"], "no --out"),
        (["--driver", "replay", "--port", "a.csv", "--out", "x", "--set", "speed"], "--set speed; expected NAME=VALUE"),
        (["--driver", "replay", "--port", "a.csv", "--out", "x", "--set", "pace=2"], "replay has no setting pace"),
        (["--driver", "replay", "--port", "a.csv", "--out", "x", "--set", "speed=fast"], "speed is 'fast'"),
        (["--driver", "ati-netft", "--out", "x", "--serial", "1", "--calibration", "1"], "lacks counts_per_N"),
        (["--driver", "replay", "--port", "a.csv", "--out", "x", "--seconds", "0"], "--seconds 0"),
        (["--driver", "replay", "--port", "DEV-02", "--out", "x", "--to", "nonsense"], "the address 'nonsense'"),
        (
            ["--driver", "replay", "--port", "DEV-02", "--out", "my log", "--to", "http://127.0.0.1:9"],
            "session name 'my log'; expected letters, digits and . _ -, at most 100",
        ),
        (
            [
                "--driver",
                "replay",
                "--port",
                "DEV-02",
                "--out",
                "x",
                "--to",
                "http://127.0.0.1:9",
                "--session",
                "Prüfling",
            ],
            "session name 'Prüfling'; expected letters",
        ),
    ],
)
def test_what_cannot_be_logged_is_said_in_one_line(
    arguments: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, text, err = run(capsys, monkeypatch, "log", *arguments)
    assert (code, text) == (2, "")
    assert said in err
    assert err.count("\n") == 1
    # Nothing is left behind.
    assert not list(tmp_path.iterdir())


def test_the_list_of_drivers_has_settings_and_an_example_for_each(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    code, text, _ = run(capsys, monkeypatch, "log", "--driver", "list", "--json", "-")
    assert code == 0
    listed = {d["name"]: d for d in json.loads(text)["drivers"]}
    assert {"ati-netft", "robotiq-ft300", "gauge-volts", "replay"} <= set(listed)
    assert all(d["example"].startswith(f"fingertwin log --driver {name}") for name, d in listed.items())
    code, text, _ = run(capsys, monkeypatch, "log", "--driver", "list")
    assert "--set counts_per_N=" in text


def test_help_of_a_replay_says_what_a_speed_of_zero_means(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, text, _ = run(capsys, monkeypatch, "replay", "--help")
    assert "max, or 0, is as fast as possible" in " ".join(text.split())


def test_a_second_logger_on_the_same_journal_is_refused(
    recording: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from daq.journal.writer import Journal

    out = recording.parent / "log"
    with Journal.create(out / "journal.sqlite3", "bench"):
        arguments = ["log", "--driver", "replay", "--port", str(recording), "--out", str(out)]
        code, _, err = run(capsys, monkeypatch, *arguments)
    assert code == 2
    assert err.count("\n") == 1
    assert "is being written by process" in err


def test_a_recording_of_the_lab_is_imported_once_its_mapping_is_confirmed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    axes = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
    columns = {f"ATI/{name}": np.arange(50.0) * k for k, name in enumerate(axes, start=1)}
    units = {name: "N" if "F" in name else "Nm" for name in columns}
    path = tdms(tmp_path / "old.tdms", columns, units, wf_increment=0.01)
    code, text, err = run(capsys, monkeypatch, "import", str(path))
    assert code == 0, err
    assert "set confirmed: true" in text
    assert "not sure:" in text
    assert not (tmp_path / "old.parquet").exists()
    code, _, err = run(capsys, monkeypatch, "import", str(path))
    assert (code, err.count("\n")) == (2, 1)
    assert "confirmed" in err
    mapping = tmp_path / "old.tdms.map.yaml"
    mapping.write_text(mapping.read_text().replace("confirmed: false", "confirmed: true"))
    code, text, err = run(capsys, monkeypatch, "import", str(path))
    assert code == 0, err
    block = next(open_readings(tmp_path / "old.parquet").blocks())
    assert block.wrench[2] == pytest.approx([2.0, 4.0, 6.0, 8000.0, 10000.0, 12000.0])
    assert np.diff(block.t_s) == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("changed", "arguments", "said"),
    [
        ({}, ["--protocol", "levels"], "--protocol without --setup"),
        ({}, ["--setup", "setup.yaml"], "--setup without --protocol"),
        ({}, ["--protocol", "nothing", "--setup", "setup.yaml"], "no protocol 'nothing'"),
        ({"format": "x"}, ["--protocol", "levels", "--setup", "setup.yaml"], "setup.yaml is not a setup"),
        ({"specimen": None}, ["--protocol", "levels", "--setup", "setup.yaml"], "specimen lacks"),
        ({"donor": "J. D."}, ["--protocol", "levels", "--setup", "setup.yaml"], "'donor' is not known"),
        (
            {"load_cell": {"model": "X"}},
            ["--protocol", "levels", "--setup", "setup.yaml"],
            "serial and calibration lack",
        ),
        ({"tension_factor": 7}, ["--protocol", "levels", "--setup", "setup.yaml"], "tension_factor"),
    ],
)
def test_a_bench_session_that_could_not_be_used_later_is_refused_now(
    changed: dict[str, Any], arguments: list[str], said: str, recording: Path,
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(recording.parent)
    setup = {
        "format": "bench-setup/1",
        "specimen": {"id": "S1", "species": "human", "digit": "third", "side": "left"},
        "finger": "an1979_middle",
        "load_cell": {"model": "ATI Nano17-E SI-25-0.25", "serial": "FT1", "calibration": "C1"},
        "tension_factor": 0.835,
    } | changed
    kept = {key: value for key, value in setup.items() if value is not None}
    Path("setup.yaml").write_text(json.dumps(kept))
    common = ["log", "--driver", "replay", "--port", str(recording), "--out", "out"]
    code, _, err = run(capsys, monkeypatch, *common, *arguments)
    assert (code, err.count("\n")) == (2, 1)
    assert said in err
    assert not Path("out").exists()


def test_a_log_without_a_reading_fails_and_says_what_came_instead(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # As a load cell at the wrong speed: the journal of one is played.
    bytes_alone = replace(made_chunk(0, 0), raw=b"?" * 500, reads=[(500, 0.5)])
    with Journal.create(tmp_path / "odd.sqlite3", "bench", 0) as journal:
        journal.keep(journal.add_stream("robotiq-ft300", {}, {}), bytes_alone)
    arguments = ["log", "--driver", "replay", "--port", str(tmp_path / "odd.sqlite3"), "--set", "speed=0"]
    code, text, err = run(capsys, monkeypatch, *arguments, "--out", str(tmp_path / "log"), "--json", "-")
    assert (code, err.count("\n")) == (2, 1)
    assert "500 bytes came and made no reading: 500 times 3f; expected records of" in err
    kept = tmp_path / "log" / "journal.sqlite3"
    assert f"the bytes are kept in {kept}" in err
    told = json.loads(text)
    assert (told["samples"], told["undecoded_bytes"]) == (0, 500)
    code, text, _ = run(capsys, monkeypatch, "journal", "check", str(kept))
    assert code == 0
    assert "500 bytes that made no reading" in text
