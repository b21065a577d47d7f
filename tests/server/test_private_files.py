"""Readings, tokens and copies are their owner's alone, whatever mask the user has set and whatever was there before."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from daq.sessions import find_session
from tests.server.command_line import run

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has other rights")


@pytest.fixture(autouse=True)
def open_to_all() -> Iterator[None]:
    """A mask that takes nothing away."""
    before = os.umask(0)
    yield
    assert os.umask(before) == 0


def open_files(folder: Path) -> list[str]:
    """What others may do anything with."""
    return [str(p.relative_to(folder)) for p in folder.rglob("*") if p.stat().st_mode & 0o077]


def test_a_log_and_its_copy(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    recording = find_session("DEV-02").parent
    where = ("--out", tmp_path / "monday" / "log", "--copy-to", tmp_path / "disk")
    answer = run("log", "--driver", "replay", "--port", recording, "--set", "speed=0", *where)
    assert answer.code == 0, answer.err
    assert open_files(tmp_path) == ["disk"]
    assert list((tmp_path / "disk").iterdir())


@pytest.mark.parametrize(("before", "closed"), [([], True), (["notes.txt"], False)])
def test_a_folder_that_was_made_for_a_log_is_closed_and_one_in_use_is_left(
    before: list[str], closed: bool, tmp_path: Path
) -> None:
    out = tmp_path / "log"
    out.mkdir()
    out.chmod(0o777)
    for name in before:
        (out / name).touch()
    recording = find_session("DEV-02").parent
    answer = run("log", "--driver", "replay", "--port", recording, "--set", "speed=0", "--out", out)
    assert answer.code == 0, answer.err
    assert (out.stat().st_mode & 0o077 == 0) == closed
    assert (out / "journal.sqlite3").stat().st_mode & 0o077 == 0


def test_a_services_data_and_backup(tmp_path: Path) -> None:
    data = tmp_path / "data"
    data.mkdir(mode=0o777)
    assert run("token", "create", "bench", "--role", "read", "--data", data).code == 0
    assert data.stat().st_mode & 0o077 == 0
    assert run("backup", tmp_path / "copy.sqlite3", "--data", data).code == 0
    assert open_files(tmp_path) == []
