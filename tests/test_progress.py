"""What a log of a long run of tests says of it every minute."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.progress import Progress

SLOW = """
import time

def test_that_takes_long():
    time.sleep(1.5)

def test_that_takes_no_time():
    pass
"""
OFTEN = """
from tests.progress import Progress

def pytest_configure(config):
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(Progress(0.3))
"""


def test_it_says_how_many_are_done_and_which_run() -> None:
    progress = Progress()
    assert progress.line(3) == "0 min: 0 of 3 tests; now none"
    progress.pytest_runtest_logstart("a.py::test_one")
    progress.pytest_runtest_logstart("b.py::test_two")
    progress.pytest_runtest_logfinish("a.py::test_one")
    assert progress.line(3) == "0 min: 1 of 3 tests; now b.py::test_two (0 s)"


def test_it_says_so_while_a_test_runs(tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_text(OFTEN, encoding="utf-8")
    (tmp_path / "test_slow.py").write_text(SLOW, encoding="utf-8")
    options = ["-n", "1", "-p", "no:cacheprovider", "-p", "no:schemathesis", "-p", "no:hypothesispytest"]
    command = [sys.executable, "-m", "pytest", *options, str(tmp_path), f"--rootdir={tmp_path}"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)  # noqa: S603
    started = "0 min: 0 of 2 tests; now test_slow.py::test_that_takes_long ("
    assert any(line.startswith(started) for line in done.stdout.splitlines()), done.stdout
    assert "2 passed" in done.stdout
