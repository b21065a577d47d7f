"""Several sessions together on the pages: chosen, diagnosed, and what they share drawn and told."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.browser.pages import Watched, require_browser, served

require_browser()

SPECIMENS = ("synek2019_H01", "synek2019_H02", "synek2019_H03")


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A service with three published specimens."""
    from fingertwin.client import Client

    with served(tmp_path_factory.mktemp("service")) as (address, _):
        with Client(address) as twin:
            for name in SPECIMENS:
                twin.upload(name)
        yield address


def test_three_specimens_are_diagnosed_together(seen: Watched, tmp_path: Path) -> None:
    seen.open("together", "Several sessions together")
    start = seen.page.get_by_role("button", name="Diagnose together")
    seen.page.get_by_role("checkbox", name=f"Take {SPECIMENS[0]}").check()
    assert start.is_disabled()
    for name in SPECIMENS[1:]:
        seen.page.get_by_role("checkbox", name=f"Take {name}").check()
    start.click()
    seen.page.get_by_role("heading", name="What they miss alike, beyond the catalogue").wait_for(timeout=240_000)
    seen.page.locator(".js-plotly-plot").nth(2).wait_for()
    text = seen.text()
    assert "Beyond the catalogue they share" in text
    assert "torque[PIP] += k * t_FDS * q_MCP" in text
    assert "Held against each other: torque[" in text
    for heading, columns in (("What would decide", "information [nat]"), ("Which law it resembles", "left out")):
        told = seen.page.locator("section", has=seen.page.get_by_role("heading", name=heading))
        assert columns in told.inner_text()
    seen.page.screenshot(path=tmp_path / "together.png", full_page=True)
    # Loaded again, the page shows the same answer; begun anew, it offers it.
    seen.page.reload()
    seen.page.locator(".js-plotly-plot").nth(2).wait_for()
    assert seen.text().count("Beyond the catalogue they share") == 1
    seen.open("fingers", "Fingers")
    seen.open("together", "Several sessions together")
    seen.page.get_by_text("Diagnosed before (1)").click()
    seen.page.get_by_role("link", name=", ".join(SPECIMENS)).click()
    seen.page.locator(".js-plotly-plot").nth(2).wait_for()
    seen.page.get_by_role("link", name=SPECIMENS[1], exact=True).click()
    seen.page.get_by_role("heading", name=f"{SPECIMENS[1]}: find the missing effect").wait_for()
