"""`fingertwin log --copy-to` as a user runs it: whatever ends the log, there is a copy, or a line that says why not."""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daq.acquisition.acquire import Acquisition
from daq.bench.run import BenchRun
from daq.journal.check import check
from daq.journal.writer import Journal
from daq.recordings.readings import ReadingBlock, write_readings
from server.cli import main
from server.commands.log import Logging

Run = Callable[..., tuple[int, str, str]]
SETUP = {
    "format": "bench-setup/1",
    "specimen": {"id": "S1", "species": "human", "digit": "third", "side": "left"},
    "finger": "an1979_middle",
    "load_cell": {"model": "ATI Nano17-E SI-25-0.25", "serial": "FT1", "calibration": "C1"},
    "tension_factor": 0.835,
}


@pytest.fixture
def run(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """Log a recording of ten seconds as fast as it goes, in a folder with another disk in it."""
    monkeypatch.chdir(tmp_path)
    t_s = np.arange(0.0, 10.0, 0.01)
    write_readings(tmp_path / "played.csv", [ReadingBlock(t_s, np.outer(np.sin(t_s), np.arange(1.0, 7.0)))])
    (tmp_path / "disk").mkdir()

    def log(*arguments: str) -> tuple[int, str, str]:
        common = ["log", "--driver", "replay", "--port", "played.csv", "--set", "speed=0", "--out", "monday"]
        monkeypatch.setattr(sys, "argv", ["fingertwin", *common, *arguments])
        with pytest.raises(SystemExit) as left:
            main()
        said = capsys.readouterr()
        return int(left.value.code or 0), said.out, said.err

    return log


def copied_samples() -> list[int]:
    """Samples in each of the copies, all sound."""
    reports = [check(path) for path in sorted(Path("disk").iterdir())]
    assert all(r.faults == () for r in reports)
    return [sum(r.samples.values()) for r in reports]


def test_a_log_that_ended_is_copied_once_more_each_time(run: Run) -> None:
    code, text, err = run("--copy-to", "disk")
    assert (code, err) == (0, "")
    [copy] = Path("disk").iterdir()
    assert f"Copy, read back: {copy}" in text
    assert copied_samples() == [1000]
    copy.rename("disk/a.sqlite3")
    # The folder is gone on with: its copy is another file.
    code, text, _ = run("--copy-to", "disk", "--json", "-")
    assert code == 0
    assert json.loads(text)["samples"] == 1000
    assert copied_samples() == [1000, 2000]


def test_a_folder_that_is_not_there_stops_the_log_before_it_begins(run: Run) -> None:
    code, text, err = run("--copy-to", "share")
    assert (code, text, err.count("\n")) == (2, "", 1)
    assert "there is no folder share for the copy" in err
    assert not Path("monday").exists()
    assert not Path("share").exists()


def test_a_disk_that_goes_away_costs_the_copy_and_says_so(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    logged = Logging.run

    def pulled(logging: Logging, acquisition: Acquisition, **how: Any) -> dict[str, Any]:
        shutil.rmtree("disk")
        return logged(logging, acquisition, **how)

    monkeypatch.setattr(Logging, "run", pulled)
    code, text, err = run("--copy-to", "disk")
    assert code == 2
    # All else is as ever.
    assert "1000 readings in" in text
    assert err.count("\n") == 1
    assert "no closing copy in disk: the folder disk has gone" in err
    assert f"The log itself is whole: {Path('monday/journal.sqlite3')}" in err
    assert check("monday/journal.sqlite3").faults == ()
    assert not Path("disk").exists()


def test_a_log_that_fails_is_copied_as_far_as_it_came(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda folder: SimpleNamespace(free=(Path(folder).name == "disk") << 30))
    code, text, err = run("--copy-to", "disk")
    assert (code, err.count("\n")) == (2, 1)
    assert "disk full: journal.sqlite3 cannot grow" in err
    assert "Copy, read back" in text
    assert copied_samples() == [0]


@pytest.mark.skipif(sys.platform == "win32", reason="what is open cannot be deleted there")
def test_a_journal_that_was_deleted_meanwhile_is_found_in_another_file(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    logged = Logging.run

    def deleted(logging: Logging, acquisition: Acquisition, **how: Any) -> dict[str, Any]:
        Path("monday/journal.sqlite3").unlink()
        return logged(logging, acquisition, **how)

    monkeypatch.setattr(Logging, "run", deleted)
    code, text, err = run("--copy-to", "disk")
    other = Path("monday/journal-2.sqlite3")
    assert (code, err.count("\n")) == (2, 1)
    assert "journal.sqlite3 was deleted or moved away while it was written" in err
    assert f"All 0 readings from before, and all since, are in {other}" in err
    # At once, before anything else is said.
    assert text.startswith("WARNING: journal.sqlite3 was deleted or moved away")
    assert f"1000 readings in 10.0 s: {other}" in text
    assert sum(check(other).samples.values()) == 1000
    assert copied_samples() == [1000]


@pytest.mark.skipif(sys.platform == "win32", reason="what is open cannot be deleted there")
def test_a_bench_session_says_so_as_well(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    Path("setup.yaml").write_text(json.dumps(SETUP))
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    started = BenchRun.start

    def deleted(bench: BenchRun) -> Any:
        Path("monday/journal.sqlite3").unlink()
        return started(bench)

    monkeypatch.setattr(BenchRun, "start", deleted)
    code, text, err = run("--protocol", "levels", "--setup", "setup.yaml")
    assert code == 2
    assert "warning; code displaced; text journal.sqlite3 was deleted or moved away" in text
    lines = err.splitlines()
    assert len(lines) == 2
    assert "are in monday/journal-2.sqlite3" in lines[0]
    assert "no complete case" in lines[1]


def test_a_log_that_never_began_is_not_copied(run: Run) -> None:
    assert run()[0] == 0
    Path("played.csv").unlink()
    code, _, err = run("--copy-to", "disk")
    assert (code, err.count("\n")) == (2, 1)
    assert list(Path("disk").iterdir()) == []


def test_a_bench_session_is_copied_also_without_a_case(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    Path("setup.yaml").write_text(json.dumps(SETUP))
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    code, text, err = run("--protocol", "levels", "--setup", "setup.yaml", "--copy-to", "disk")
    assert (code, err.count("\n")) == (2, 1)
    assert "no complete case" in err
    assert "Copy, read back" in text
    assert copied_samples() == [1000]


def heeded(name: str) -> int:
    """A signal that a child heeds, even where these tests were started with nohup, which has SIGHUP ignored."""
    number = getattr(signal, name)
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, signal.SIG_DFL)
    return int(number)


@pytest.mark.skipif(sys.platform == "win32", reason="a process cannot be sent Ctrl-C alone there")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_ends_the_log_and_leaves_a_copy(run: Run, tmp_path: Path, name: str) -> None:
    number = heeded(name)
    command = [
        sys.executable, "-m", "server.cli", "log", "--driver", "replay", "--port", "played.csv", "--out", "monday",
        "--copy-to", "disk",
    ]  # fmt: skip
    environment = os.environ | {"PYTHONUNBUFFERED": "1", "PYTHONPATH": str(Path(__file__).parents[2])}
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env=environment) as child:  # noqa: S603
        assert child.stdout is not None
        assert child.stderr is not None
        assert "started" in child.stdout.readline()
        child.send_signal(number)
        text, err = child.stdout.read(), child.stderr.read()
    assert (child.returncode, err) == (0, "")
    assert "readings in" in text
    assert "Copy, read back" in text
    assert copied_samples()[0] < 1000


@pytest.mark.skipif(sys.platform == "win32", reason="a process cannot be sent such a signal alone there")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_breaks_a_bench_session_off_and_leaves_a_copy(run: Run, tmp_path: Path, name: str) -> None:
    Path("setup.yaml").write_text(json.dumps(SETUP))
    number = heeded(name)
    command = [
        sys.executable, "-m", "server.cli", "log", "--driver", "replay", "--port", "played.csv", "--out", "monday",
        "--protocol", "levels", "--setup", "setup.yaml", "--copy-to", "disk",
    ]  # fmt: skip
    environment = os.environ | {"PYTHONUNBUFFERED": "1", "PYTHONPATH": str(Path(__file__).parents[2])}
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True, env=environment) as child:  # noqa: S603
        assert child.stdout is not None
        assert child.stderr is not None
        while "started" not in child.stdout.readline():
            pass
        child.send_signal(number)
        text, err = child.stdout.read(), child.stderr.read()
    # How to go on is said, and all that was read is kept.
    assert (child.returncode, err.count("\n")) == (130, 1)
    assert "--resume goes on" in text
    assert "Copy, read back" in text
    assert not (tmp_path / "monday" / "session.yaml").exists()
    with Journal.open(tmp_path / "monday" / "journal.sqlite3", 0) as journal:
        assert [e.kind for e in journal.events()][-1] == "ended"
