"""Failures look like failures: the exit code says so, and what was read lies where the user can find it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from daq.journal.check import check
from tests.server.test_cli import run


def test_a_replay_that_nobody_takes_fails_and_keeps_the_readings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("server.commands.forwarding.FLUSH_S", 0.5)
    for folder in ("DEV-02-replay", "DEV-02-replay-2"):
        answer = run("replay", "DEV-02", "--to", "http://127.0.0.1:9", "--speed", "max")
        assert answer.code == 2
        assert f"The readings are in {folder}" in answer.err
        report = check(tmp_path / folder / "journal.sqlite3")
        assert report.faults == ()
        assert sum(report.chunks.values()) > 0


def test_a_replay_into_a_folder_names_that(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("server.commands.forwarding.FLUSH_S", 0.5)
    out = tmp_path / "kept"
    answer = run("replay", "DEV-02", "--to", "http://127.0.0.1:9", "--speed", "max", "--out", out)
    assert (answer.code, str(out) in answer.err) == (2, True)


@pytest.mark.skipif(sys.platform == "win32", reason="a pipe that is closed there is another error")
def test_a_reader_that_has_gone_is_no_failure() -> None:
    root = Path(__file__).parents[2]
    command = [sys.executable, "-m", "server.cli", "compare", "DEV-02"]
    with subprocess.Popen(  # noqa: S603
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=os.environ | {"PYTHONPATH": str(root)}
    ) as child:
        assert child.stdout is not None
        assert child.stderr is not None
        child.stdout.readline()
        child.stdout.close()
        assert (child.wait(120.0), child.stderr.read()) == (0, b"")
