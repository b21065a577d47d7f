"""Pages that were open while the service was killed and started again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.browser.pages import require_browser, served, watched

require_browser()

PUBLISHED = "synek2019_H01"
CASE = "minor_flexion-FDS-950-tip"


def test_the_pages_are_live_again_after_a_restart_and_keep_what_was_typed(browser: Any, tmp_path: Path) -> None:
    from fingertwin.client import Client

    folder = tmp_path / "service"
    with served(folder) as (address, process):
        with Client(address) as twin:
            twin.upload(PUBLISHED)
        seen = watched(browser, address)
        seen.open(f"sessions/{PUBLISHED}/find", f"{PUBLISHED}: find the missing effect")
        seen.page.get_by_label("Formula").fill("torque[PIP] += k")
        seen.page.get_by_text(f"live: {PUBLISHED}").wait_for()
        other = watched(browser, address)
        other.open(f"sessions/{PUBLISHED}/compare?case={CASE}", f"{PUBLISHED}: predicted against measured")
        other.page.get_by_label("Leave it out, because").fill("the suture")
        other.page.get_by_text(f"live: {PUBLISHED}").wait_for()
        process.process.kill()
        seen.page.get_by_text("The service does not answer").first.wait_for()
        # Whatever is asked for meanwhile is refused in words, with a way to ask again.
        seen.page.get_by_role("button", name="Find the missing effect").click()
        seen.page.get_by_role("alert").filter(has_text="The service does not answer").first.wait_for()
        other.page.get_by_role("button", name="Exclude").click()
        other.page.get_by_role("alert").filter(has_text="The service does not answer").first.wait_for()
    with served(folder, int(address.rsplit(":", 1)[1])):
        seen.page.get_by_text(f"live: {PUBLISHED}").wait_for()
        other.page.get_by_text(f"live: {PUBLISHED}").wait_for()
        assert seen.page.get_by_label("Formula").input_value() == "torque[PIP] += k"
        assert other.page.get_by_label("Leave it out, because").input_value() == "the suture"
        other.page.get_by_role("button", name="Exclude").click()
        other.page.get_by_text(f"{CASE} is left out: the suture.").wait_for()
    for page in (seen, other):
        assert page.elsewhere == []
        page.page.close()
