"""Failures look like failures: the exit code says so, and what was read lies where the user can find it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from daq.journal.check import check
from daq.sessions import find_session
from tests.daq.lab_bombs import BOMBS
from tests.server.command_line import run


def test_a_replay_that_nobody_takes_fails_and_keeps_the_readings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("server.commands.forwarding.FLUSH_S", 0.5)
    for folder in ("DEV-02-replay", "DEV-02-replay-2"):
        answer = run("replay", "DEV-02", "--to", "http://127.0.0.1:9", "--speed", "max")
        assert answer.code == 2
        assert f"The readings are in {folder}" in answer.err
        # With its description: the kept readings alone would make a session without cases.
        assert "fingertwin replay DEV-02 --to http://127.0.0.1:9 --session DEV-02 sends all again" in answer.err
        named = re.findall(r"\S+journal\.sqlite3", answer.out + answer.err)
        assert [path for path in named if not Path(path).is_file()] == []
        report = check(tmp_path / folder / "journal.sqlite3")
        assert report.faults == ()
        assert sum(report.chunks.values()) > 0


def test_a_replay_into_a_folder_names_that(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("server.commands.forwarding.FLUSH_S", 0.5)
    out = tmp_path / "kept"
    answer = run("replay", "DEV-02", "--to", "http://127.0.0.1:9", "--speed", "max", "--out", out)
    assert (answer.code, str(out) in answer.err) == (2, True)


@pytest.mark.parametrize("name", BOMBS)
def test_a_recording_that_claims_far_more_than_it_holds_is_refused(name: str, tmp_path: Path) -> None:
    answer = run("import", BOMBS[name](tmp_path / name))
    assert (answer.code, answer.err.count("\n")) == (2, 1)
    assert name in answer.err
    assert [p.name for p in tmp_path.iterdir()] == [name]


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


def test_a_session_is_replayed_under_its_own_name_whatever_its_folder_is_called(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(find_session("DEV-02").parent, tmp_path / "another name")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("server.commands.forwarding.FLUSH_S", 0.5)
    answer = run("replay", tmp_path / "another name", "--to", "http://127.0.0.1:9", "--speed", "max")
    assert "not all of DEV-02 is at" in answer.err


def test_a_replay_to_nowhere_keeps_its_folder_and_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    answer = run("replay", "DEV-02", "--speed", "max")
    assert answer.code == 0
    assert f"13000 readings in 520.0 s: {Path('DEV-02-replay', 'journal.sqlite3')}" in answer.out
    assert check(tmp_path / "DEV-02-replay" / "journal.sqlite3").faults == ()


@pytest.mark.parametrize(
    "arguments",
    [
        ("check", "FILE"), ("compare", "DEV-02", "--model", "FILE"), ("export", "FILE"), ("add", "hanger_mass", "FILE"),
        ("move", "FILE"), ("activate", "FILE"), ("scale", "FILE", "--out", "s.yaml"), ("species", "--of", "FILE"),
        ("simulate", "FILE", "--out", "new"), ("import", "FILE"), ("friction", "FILE"), ("reproduce", "FILE"),
        ("journal", "check", "FILE"), ("diagnose", "DEV-02", "--effect", "FILE"), ("restore", "FILE", "--data", "none"),
    ],
    ids=lambda a: a[0],
)  # fmt: skip
def test_a_file_of_another_kind_is_told_in_one_line_without_jargon(
    arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("run.csv").write_text("t_s,Fx_N\n0,1\n", encoding="utf-8")
    answer = run(*("run.csv" if a == "FILE" else a for a in arguments))
    assert answer.code == 2
    said = answer.err or answer.out
    assert "run.csv" in said
    assert "expected" in said
    for jargon in ("Input should", "instance of", "b't_s", "unicode string", "Traceback", "pydantic", "Errno"):
        assert jargon not in said
