"""Ctrl-C: one line and 130, wherever it comes."""

from __future__ import annotations

import gc
import importlib
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

import pytest

from tests.server.command_line import H01, run


def test_an_interrupt_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object, **__: object) -> NoReturn:
        raise KeyboardInterrupt

    monkeypatch.setattr("server.commands.twin.Session.open", interrupt)
    answer = run("refit", H01)
    assert (answer.code, answer.out, answer.err.count("\n")) == (130, "", 1)
    assert answer.err.startswith("fingertwin: Interrupted")


def _collected_with(callback: Callable[..., object]) -> None:
    """Collect garbage until a callback was called; while another thread collects, asking for it does nothing."""
    while callback in gc.callbacks:
        gc.collect()


@pytest.mark.parametrize("busy_s", [0.0, 0.4])
def test_an_interrupt_within_a_callback_of_the_garbage_collector_is_not_lost(
    monkeypatch: pytest.MonkeyPatch, busy_s: float
) -> None:
    """Nor on a machine so busy that it comes again before the callback has ended."""
    plain, stalls = threading.Timer.start, [busy_s]

    def start(self: threading.Timer) -> None:
        plain(self)
        time.sleep(stalls.pop() if stalls else 0.0)

    monkeypatch.setattr(threading.Timer, "start", start)

    def interrupt(*_: object) -> NoReturn:
        gc.callbacks.remove(interrupt)
        raise KeyboardInterrupt

    def collect(*_: object, **__: object) -> NoReturn:
        gc.callbacks.append(interrupt)
        _collected_with(interrupt)
        for _n in range(500):
            time.sleep(0.01)
        pytest.fail("it went on")

    monkeypatch.setattr("server.commands.twin.Session.open", collect)
    answer = run("refit", H01)
    assert (answer.code, answer.out, answer.err.count("\n")) == (130, "", 1)


def test_an_interrupt_while_another_error_of_a_callback_is_reported_is_not_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def report(what: Any) -> None:
        assert what.exc_type is ValueError
        signal.raise_signal(signal.SIGINT)

    def fail(*_: object) -> NoReturn:
        gc.callbacks.remove(fail)
        raise ValueError

    def collect(*_: object, **__: object) -> NoReturn:
        gc.callbacks.append(fail)
        _collected_with(fail)
        time.sleep(5.0)
        pytest.fail("it went on")

    monkeypatch.setattr(sys, "unraisablehook", report)
    monkeypatch.setattr("server.commands.twin.Session.open", collect)
    answer = run("refit", H01)
    assert (answer.code, answer.out, answer.err.count("\n")) == (130, "", 1)


def test_an_interrupt_within_an_import_is_raised_after_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    text = "import signal\nsignal.raise_signal(signal.SIGINT)\nwhole = True\n"
    (tmp_path / "interrupted_import.py").write_text(text, encoding="utf-8")

    def imports(*_: object, **__: object) -> NoReturn:
        importlib.import_module("interrupted_import")
        time.sleep(5.0)
        pytest.fail("it went on")

    monkeypatch.setattr("server.commands.twin.Session.open", imports)
    answer = run("refit", H01)
    assert (answer.code, answer.out, answer.err.count("\n")) == (130, "", 1)
    assert sys.modules.pop("interrupted_import").whole


def said_until_interrupted(code: str) -> str:
    """What a process of such code says before it ends as interrupted, with one line of it."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)  # noqa: S603
    assert (done.returncode, done.stderr.count("\n")) == (130, 1)
    assert done.stderr.startswith("fingertwin: Interrupted")
    return done.stdout


@pytest.mark.parametrize("delay_s", [0.02, 0.1, 0.4, 0.6, 0.8, 1.0])
def test_an_interrupt_while_the_command_starts_is_one_line(delay_s: float) -> None:
    code = (
        "import _thread, sys, threading, server.__main__\n"
        "sys.argv = ['fingertwin', 'diagnose', 'DEV-02']\n"
        f"timer = threading.Timer({delay_s}, _thread.interrupt_main)\n"
        "timer.daemon = True\n"
        "timer.start()\n"
        "server.__main__.main()"
    )
    assert said_until_interrupted(code) == ""


def test_an_interrupted_command_ends_with_all_that_it_said_and_runs_nothing_more() -> None:
    """The end of the interpreter crashed about every third time, where JAX had been compiling."""
    code = (
        "import atexit, os, sys, server.__main__, server.commands.twin as twin\n"
        "def interrupt(*_, **__):\n"
        "    print('so far')\n"
        "    raise KeyboardInterrupt\n"
        "twin.Session.open = interrupt\n"
        "atexit.register(os.abort)\n"
        "sys.argv = ['fingertwin', 'refit', 'DEV-02']\n"
        "server.__main__.main()"
    )
    assert said_until_interrupted(code) == "so far\n"
