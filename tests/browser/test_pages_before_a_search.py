"""Pages of sessions in which nothing was searched for yet: the menu, figures, and what is said of what is not there."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest

from tests.browser.pages import Watched, require_browser, served, watched

require_browser()

SESSION, PUBLISHED, EMPTY = "DEV-02", "synek2019_H01", "EMPTY"


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    from fingertwin.client import Client

    with served(tmp_path_factory.mktemp("service"), readers=True) as (address, process):
        with Client(address) as twin:
            twin.upload(SESSION)
            twin.upload(PUBLISHED)
        with process.client() as client:
            client.post("/api/v1/sessions", json={"id": EMPTY}).raise_for_status()
        yield address


BEGUN = """(id) => fetch('/api/v1/sessions', { method: 'POST', headers: { 'Content-Type': 'application/json' },
    body: JSON.stringify({ id }) }).then((r) => r.status)"""


def test_an_answer_that_was_overtaken_is_not_shown(seen: Watched) -> None:
    """What was asked for later is on the page already: an older answer that comes after it takes nothing away."""
    seen.open("", "Sessions")
    seen.page.get_by_role("link", name=PUBLISHED, exact=True).first.wait_for()
    held: list[Any] = []

    def hold(route: Any) -> None:
        if held:
            route.continue_()
        else:
            held.append((route, route.fetch()))

    seen.page.route("**/api/v1/sessions?*", hold)
    assert seen.page.evaluate(BEGUN, "FIRST") == 201
    while not held:
        seen.page.wait_for_timeout(50)
    assert seen.page.evaluate(BEGUN, "LATER") == 201
    later = seen.page.get_by_role("link", name="LATER", exact=True)
    later.first.wait_for()
    route, answer = held[0]
    route.fulfill(response=answer)
    seen.page.wait_for_timeout(1000)
    assert later.count() >= 1


# What a page makes of an answer whose second half never comes: it was left meanwhile, or the connection broke.
HALF = """async (why) => {
    const { get } = await import('/pages/api.js');
    const fetched = window.fetch;
    const error = why === 'left' ? new DOMException('left', 'AbortError') : new TypeError('network error');
    window.fetch = async () => ({ ok: true, status: 200, json: async () => { throw error; } });
    try { return `taken as ${JSON.stringify(await get('/sessions'))}`; }
    catch (error) { return error.name === 'AbortError' ? 'left' : error.constructor.name; }
    finally { window.fetch = fetched; }
}"""


def test_a_page_that_is_declared_is_in_the_menu(browser: Any, url: str) -> None:
    """In order, each leading to itself and marked there; a page of one line more as well."""
    seen = watched(browser, url)

    def with_one_more(route: Any) -> None:
        body = route.fetch().text()
        one_more = '  tare: ["Count of sessions", () => import("./views/help.js"), "Count"],\n  help: ['
        assert body.count("  help: [") == 1
        route.fulfill(body=body.replace("  help: [", one_more), content_type="text/javascript")

    seen.page.route("**/main.js*", with_one_more)
    seen.open("help", "Help")
    names = ["Sessions", "Together", "Fingers", "Studies", "Changes", "Count", "Help"]
    menu = seen.page.locator("#nav a")
    assert menu.all_inner_texts() == names
    for name in names:
        menu.get_by_text(name, exact=True).click()
        seen.page.locator("#nav a[aria-current=page]", has_text=name).wait_for()
        assert seen.page.locator("#nav a[aria-current=page]").count() == 1
    assert seen.page.title() == "Help – fingertwin"
    seen.page.goto(f"{url}/#/new")
    seen.page.locator("#nav a[aria-current=page]", has_text="Sessions").wait_for()
    seen.open(f"sessions/{EMPTY}/compare", EMPTY)
    of_session = ["Sessions", "Bench", "Compare", "Forces", "Find the missing effect", "The fall of the error"]
    assert menu.all_inner_texts() == [*of_session, "Together", "Fingers", "Studies", "Count", "Help"]
    assert seen.page.locator("#nav a[aria-current=page]").all_inner_texts() == ["Compare"]
    seen.page.close()


def test_figures_fill_their_place_and_follow_the_window(seen: Watched) -> None:
    seen.open(f"sessions/{SESSION}/compare", f"{SESSION}: predicted against measured")
    seen.drawn()
    # Its tools save and enlarge; none would send the figure elsewhere.
    tools = seen.page.locator(".js-plotly-plot").first.locator(".modebar-btn")
    names = tools.evaluate_all("buttons => buttons.map((b) => b.dataset.title)")
    assert any(name.startswith("Download plot") for name in names)
    assert [name for name in names if re.search("share|cloud|studio", name, re.IGNORECASE)] == []
    for width in (1280, 900, 1400):
        seen.page.set_viewport_size({"width": width, "height": 800})
        seen.page.wait_for_function(
            """() => { const plot = document.querySelector('.js-plotly-plot'); const place = plot.closest('.drawn');
            return Math.abs(plot._fullLayout.width - place.clientWidth) < 5; }"""
        )
    # In a place that is a little narrower than a figure can be, it is drawn smaller: nothing has to be scrolled.
    seen.page.set_viewport_size({"width": 700, "height": 800})
    seen.page.wait_for_function(
        """() => { const plot = document.querySelector('.js-plotly-plot'); const box = plot.closest('figure');
        return plot.style.transform && box.clientWidth < 720 && box.scrollWidth === box.clientWidth; }"""
    )
    # Turned dark, it is drawn anew in the colours of the page.
    light = seen.page.evaluate("document.querySelector('.js-plotly-plot').layout.font.color")
    seen.page.emulate_media(color_scheme="dark")
    seen.page.wait_for_function("c => document.querySelector('.js-plotly-plot')?.layout.font.color !== c", arg=light)


def test_a_formula_is_checked_while_it_is_typed(seen: Watched) -> None:
    seen.open(f"sessions/{SESSION}/find", f"{SESSION}: find the missing effect")
    formula = seen.page.get_by_label("Formula")
    take = seen.page.get_by_role("button", name="Let it take part")
    # A refusal is an answer; the browser's console names its status.
    formula.fill("__import__('os')")
    seen.page.get_by_role("alert").filter(has_text="expected").first.wait_for()
    assert take.is_disabled()
    formula.fill("torque[PIP] += k * t_EDC * sin(q_PIP)")
    seen.page.get_by_text("Sound: torque").wait_for()
    take.click()
    seen.page.get_by_text("takes part in the next search").wait_for()
    assert seen.page.get_by_role("checkbox", name=re.compile("sin")).is_checked()
    seen.complaints = [c for c in seen.complaints if "422" not in c]


def test_what_is_not_there_is_said_with_a_way_on(seen: Watched) -> None:
    for view in ("compare", "find", "fall"):
        seen.page.goto(f"{seen.url}/#/sessions/nothing/{view}")
        seen.page.get_by_text("there is no session nothing").first.wait_for()
        seen.page.get_by_role("button", name="Try again").wait_for()
        seen.page.get_by_role("link", name="To the sessions").wait_for()
    seen.page.goto(f"{seen.url}/#/sessions/nothing/report")
    seen.page.get_by_role("button", name="Try again").wait_for()
    seen.page.goto(f"{seen.url}/#/sessions/{SESSION}/effect?name=gremlins")
    seen.page.get_by_text("no effect gremlins").wait_for()
    seen.page.goto(f"{seen.url}/#/sessions/{SESSION}/compare?model=gremlin")
    seen.page.get_by_text("There is no model 'gremlin'.", exact=True).first.wait_for()
    # What cannot be decoded too.
    for path in ("nowhere", "help", "%", "help", "sessions/%E0%A4%A/compare"):
        seen.page.goto(f"{seen.url}/#/{path}")
        seen.page.get_by_role("heading", level=1, name="Help" if path == "help" else "There is no such page").wait_for()
    expected = ("404", "422", "WebSocket")
    seen.complaints = [c for c in seen.complaints if not any(e in c for e in expected)]


def test_a_session_without_a_measured_case_says_what_it_waits_for(seen: Watched) -> None:
    seen.open(f"sessions/{EMPTY}/compare", f"{EMPTY}: predicted against measured")
    seen.page.get_by_text("no load case yet").first.wait_for()
    seen.page.get_by_role("link", name="to the bench").wait_for()
    seen.open(f"sessions/{EMPTY}/find", f"{EMPTY}: find the missing effect")
    seen.page.get_by_role("button", name="Find the missing effect").click()
    seen.page.get_by_role("alert").filter(has_text="no load case yet").wait_for()
    seen.open(f"sessions/{EMPTY}/fall", f"{EMPTY}: the fall of the error")
    seen.page.get_by_text("No revision of this session's model yet").wait_for()
    seen.page.get_by_role("button", name="Refit the model without any").click()
    seen.page.get_by_role("alert").filter(has_text="no load case yet").wait_for()
    seen.complaints = [c for c in seen.complaints if "422" not in c]


def test_a_search_is_cancelled_and_one_that_failed_says_why(seen: Watched) -> None:
    seen.open(f"sessions/{PUBLISHED}/find", f"{PUBLISHED}: find the missing effect")
    seen.page.get_by_role("button", name="Find the missing effect").click()
    seen.page.get_by_role("button", name="Cancel").click()
    seen.page.get_by_text("Fitting every effect: cancelled.").wait_for()
    seen.page.get_by_role("button", name="Try again").wait_for()
    assert seen.page.get_by_role("button", name="Find the missing effect").is_enabled()
    # A worker that dies is nothing that a test can order: the answer of such a job is given instead.
    why = {"detail": "The worker was killed; expected enough memory."}
    failed = {"id": "x", "kind": "diagnose", "session": PUBLISHED, "state": "failed", "progress": 0.4, "problem": why}
    seen.page.route(f"**/sessions/{PUBLISHED}/diagnoses", lambda route: route.fulfill(status=202, json=failed))
    seen.page.get_by_role("button", name="Try again").click()
    seen.page.get_by_role("alert").filter(has_text="The worker was killed").wait_for()
    seen.page.get_by_role("button", name="Try again").wait_for()


@pytest.mark.parametrize(("why", "told"), [("left", "left"), ("broken", "Away")])
def test_half_an_answer_is_no_answer(seen: Watched, why: str, told: str) -> None:
    seen.open("", "Sessions")
    assert seen.page.evaluate(HALF, why) == told
