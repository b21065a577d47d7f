"""The pages as a user meets them: compare, look into a case, move a window and back, find, add, see the error fall."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.browser.pages import Watched, browsing, require_browser, served, watched

require_browser()

SESSION = "DEV-02"


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    from fingertwin.client import Client

    with served(tmp_path_factory.mktemp("service")) as (address, _):
        with Client(address) as twin:
            twin.upload(SESSION)
            twin.upload("synek2019_H01")
        yield address


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with browsing() as found:
        yield found


@pytest.fixture
def seen(browser: Any, url: str) -> Iterator[Watched]:
    out = watched(browser, url)
    yield out
    out.page.close()
    assert out.complaints == []
    assert out.elsewhere == []


def test_from_the_list_of_sessions_to_a_case_and_its_readings(seen: Watched) -> None:
    seen.open("", "Sessions")
    seen.page.get_by_label("Search").fill("dev")
    seen.page.get_by_role("link", name=SESSION).click()
    seen.page.get_by_role("heading", name=f"{SESSION}: predicted against measured").wait_for()
    seen.page.locator(".js-plotly-plot").first.wait_for()
    assert "never fitted" in seen.text()
    seen.page.get_by_role("button", name=re.compile("^c010 ")).press("Enter")
    seen.page.get_by_role("heading", name="c010: FDS 950 g, minor flexion, tip").wait_for()
    seen.page.get_by_role("heading", name="Loaded window Fy [N]", exact=True).wait_for()
    assert "independent readings" in seen.text()


def test_a_window_is_moved_and_the_move_undone(seen: Watched) -> None:
    seen.open(f"sessions/{SESSION}/compare?case=c001", f"{SESSION}: predicted against measured")
    force = seen.page.locator("#case .big")
    before = force.inner_text()
    seen.page.locator("#from-loaded_s").fill("4.5")
    seen.page.locator("#to-loaded_s").fill("5.5")
    seen.page.get_by_role("button", name="Move the window").nth(1).click()
    seen.page.get_by_text("Changed, and computed anew.").wait_for()
    seen.page.wait_for_function(
        "before => (document.querySelector('#case .big')?.innerText ?? before) !== before", arg=before
    )
    seen.page.get_by_role("button", name="Undo").click()
    seen.page.wait_for_function("before => document.querySelector('#case .big')?.innerText === before", arg=before)


def test_a_missing_effect_is_found_and_added_and_the_error_falls(seen: Watched) -> None:
    seen.open(f"sessions/{SESSION}/find", f"{SESSION}: find the missing effect")
    seen.page.get_by_role("button", name="Find the missing effect").click()
    seen.page.get_by_role("heading", name="The verdict").wait_for(timeout=240_000)
    assert "Found: the hanger was not weighed" in seen.text()
    seen.page.locator(".js-plotly-plot").first.wait_for()
    seen.page.get_by_role("button", name="Add hanger_mass, and refit").first.click()
    seen.page.get_by_role("heading", name=f"{SESSION}: the fall of the error").wait_for(timeout=240_000)
    seen.page.get_by_role("heading", name=re.compile("with hanger_mass")).wait_for()
    seen.page.locator(".js-plotly-plot").first.wait_for()
    assert "in force" in seen.text()


def test_a_formula_is_checked_while_it_is_typed(seen: Watched) -> None:
    seen.open(f"sessions/{SESSION}/find", f"{SESSION}: find the missing effect")
    formula = seen.page.get_by_label("Formula")
    formula.fill("torque[PIP] += k * t_EDC * sin(q_PIP)")
    seen.page.get_by_text("Sound: torque").wait_for()
    # A refusal is an answer; the browser's console names its status.
    formula.fill("__import__('os')")
    seen.page.get_by_role("alert").filter(has_text="expected").first.wait_for()
    seen.complaints = [c for c in seen.complaints if "422" not in c]


def test_what_is_not_there_is_said_with_a_way_on(seen: Watched) -> None:
    seen.page.goto(f"{seen.url}/#/sessions/nothing/compare")
    seen.page.get_by_role("button", name="Try again").wait_for()
    assert "there is no session nothing" in seen.text()
    seen.page.goto(f"{seen.url}/#/nowhere")
    seen.page.get_by_role("heading", name="There is no such page").wait_for()
    seen.complaints = [c for c in seen.complaints if "404" not in c and "WebSocket" not in c]


PATHS = ["", "help", *(f"sessions/{SESSION}/{v}" for v in ("bench", "compare", "find", "fall"))]
# Elements that can be used or looked at and have no name.
UNNAMED = """() => [...document.querySelectorAll('button, a[href], input, select, textarea, canvas, [role=img]')]
.filter((e) => e.checkVisibility() && !e.closest('.js-plotly-plot'))
.filter((e) => !(e.getAttribute('aria-label') || e.innerText?.trim() || e.labels?.length))
.map((e) => e.outerHTML.slice(0, 120))"""


@pytest.mark.parametrize("path", PATHS)
def test_every_page_can_be_used_by_keyboard_and_read_aloud(seen: Watched, path: str) -> None:
    seen.page.goto(f"{seen.url}/#/{path}")
    seen.page.locator("h1").wait_for()
    seen.page.wait_for_timeout(500)
    unnamed = seen.page.evaluate(UNNAMED)
    assert unnamed == []
    assert seen.page.evaluate("document.querySelectorAll('h1').length") == 1
    assert seen.page.evaluate("document.documentElement.lang") == "en"
    seen.page.keyboard.press("Tab")
    assert seen.page.evaluate("document.activeElement !== document.body")
    wide = seen.page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
    assert wide <= 0


def test_the_pages_are_live_again_after_a_restart_and_keep_what_was_typed(browser: Any, tmp_path: Path) -> None:
    from fingertwin.client import Client

    folder = tmp_path / "service"
    with served(folder) as (address, process):
        with Client(address) as twin:
            twin.upload("synek2019_H01")
        seen = watched(browser, address)
        seen.open("sessions/synek2019_H01/find", "synek2019_H01: find the missing effect")
        seen.page.get_by_label("Formula").fill("torque[PIP] += k")
        seen.page.get_by_text("live: synek2019_H01").wait_for()
        process.process.kill()
        seen.page.get_by_text("The service does not answer").wait_for()
    with served(folder, int(address.rsplit(":", 1)[1])):
        seen.page.get_by_text("live: synek2019_H01").wait_for()
        assert seen.page.get_by_label("Formula").input_value() == "torque[PIP] += k"
    seen.page.close()
