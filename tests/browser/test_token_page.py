"""The pages of a service that wants a token: asked for once, kept in the tab, sent with all that the pages do."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fingertwin.client import Client
from tests.browser.pages import require_browser, watched
from tests.server.service.processes import Process

require_browser()

SESSION = "DEV-02"


def new_token(folder: Path, role: str) -> str:
    command = ["token", "create", "tablet", "--role", role, "--data", str(folder), "--json", "-"]
    made = subprocess.run([sys.executable, "-m", "server.cli", *command], capture_output=True, check=True)  # noqa: S603
    return str(json.loads(made.stdout)["token"])


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, str]]:
    """Address and token of a service that others can reach."""
    folder = tmp_path_factory.mktemp("service")
    token = new_token(folder, "write")
    every = "0.0.0.0"  # noqa: S104
    process = Process(["-m", "server.cli", "serve", "--host", every, "--port", "0", "--data", str(folder)])
    url = process.address()
    with Client(url, token=token) as client:
        client.upload(SESSION)
    yield url, token
    process.close()


def test_a_token_is_asked_for_once_and_opens_everything(browser: Any, service: tuple[str, str], tmp_path: Path) -> None:
    url, token = service
    seen = watched(browser, url)
    page = seen.page
    page.goto(url)
    field = page.get_by_role("textbox", name="Token")
    field.fill("ft_00000000_" + "0" * 64)
    page.get_by_role("button", name="Go on").click()
    page.get_by_text("not valid").wait_for()
    field.fill(token)
    page.get_by_role("button", name="Go on").click()
    page.get_by_role("link", name=SESSION).first.wait_for()
    seen.open(f"sessions/{SESSION}/compare", f"{SESSION}: predicted against measured")
    page.locator(".plot .main-svg").first.wait_for()
    page.get_by_text(f"live: {SESSION}").wait_for()
    seen.open(f"sessions/{SESSION}/report", f"{SESSION}: report")
    with page.expect_download() as download:
        page.get_by_role("link", name="Save as one HTML file").click()
    download.value.save_as(tmp_path / "report.html")
    assert SESSION in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.locator("dialog").count() == 0
    # Refusals that led to the question are told by the browser itself.
    assert [c for c in seen.complaints if "401" not in c and "WebSocket" not in c] == []
    assert seen.elsewhere == []
    page.close()


def test_who_has_none_sees_nothing_and_is_asked_again(browser: Any, service: tuple[str, str]) -> None:
    url, _ = service
    seen = watched(browser, url)
    page = seen.page
    page.goto(url)
    page.get_by_role("button", name="Not now").click()
    page.get_by_text("no token").first.wait_for()
    assert SESSION not in seen.text()
    page.close()
