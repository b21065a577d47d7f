"""The bench page while a load cell is logged without a protocol, after the log was killed, and after it ended."""

from __future__ import annotations

import re
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.browser.pages import Watched, require_browser, served, watched
from tests.server.service.processes import Process

require_browser()

SESSION = "plain"


@pytest.fixture
def link(tmp_path: Path) -> Iterator[Path]:
    """A load cell that plays a recording."""
    cell = Process(["-m", "server.cli", "simulate-cell", "robotiq-ft300", "--link", str(tmp_path / "cell")])
    try:
        cell.wait_for("Ctrl-C ends it", "out")
        yield tmp_path / "cell"
    finally:
        cell.close()


@contextmanager
def logged(link: Path, url: str, folder: Path) -> Iterator[Process]:
    """A log without a protocol that sends to a service."""
    cell = ["--driver", "robotiq-ft300", "--port", str(link), "--serial", "STAND-IN", "--calibration", "none"]
    log = Process(["-m", "server.cli", "log", *cell, "--out", str(folder), "--to", url, "--session", SESSION])
    try:
        log.wait_for("started", "out")
        yield log
    finally:
        log.close()


def told(seen: Watched, text: str) -> None:
    seen.page.locator(".now-todo").get_by_text(text).wait_for()


def test_a_log_is_called_a_log_and_one_that_begins_again_shows_its_own_readings_alone(
    browser: Any, link: Path, tmp_path: Path
) -> None:
    with served(tmp_path / "service") as (url, process), process.client() as client:

        def opened() -> Watched:
            seen = watched(browser, url)
            seen.open(f"sessions/{SESSION}/bench", f"{SESSION}: the bench")
            return seen

        with logged(link, url, tmp_path / "first") as log:
            while client.get(f"/api/v1/sessions/{SESSION}").status_code == 404:
                pass
            first = opened()
            told(first, "A load cell is being logged: its readings are coming in")
            first.page.locator(".chip").get_by_text("logging").wait_for()
            first.page.wait_for_timeout(6000)
            log.process.kill()
        first.page.get_by_role("alert", name="Look now").get_by_text("Nothing comes from the bench").wait_for()
        with logged(link, url, tmp_path / "second") as log:
            told(first, "its readings are coming in")
            second = opened()
            told(second, "its readings are coming in")
            first.page.wait_for_timeout(1500)
            log.process.send_signal(signal.SIGINT)
            log.process.wait(60)
        for seen in (first, second, opened()):
            told(seen, "The log has ended: its readings are stored")
            seen.page.locator(".chip").get_by_text("log ended").wait_for()
            last = seen
        # What is shown after the end is the second stream, from its beginning to its end.
        _, stream = client.get(f"/api/v1/sessions/{SESSION}").json()["streams"]
        path = f"/api/v1/sessions/{SESSION}/readings"
        _, end_s = client.get(path, params={"stream": stream["id"]}).json()["stream_s"]
        shown = last.page.get_by_text(re.compile(r" s until \d")).inner_text()
        assert float(shown.split(" until ")[1].removesuffix(" s")) == pytest.approx(end_s, abs=0.1)
        for seen in (first, second, last):
            seen.page.close()
            # Of a stream that begins nothing is stored yet: the page expects that, and the browser tells it by itself.
            assert [c for c in seen.complaints if "404" not in c or "/readings?" not in c] == []
