"""The page of a running bench, as somebody works with it."""

from __future__ import annotations

import re
import time
from typing import Any

from tests.browser.bench_story import Story
from tests.browser.pages import Watched, watched

# A machine that has other work to do takes its time.
PATIENCE_MS = 60_000
LARGE_PX, KEY_PX = 40, 64
NO_PLATEAU = "there is no plateau to confirm"


def opened(browser: Any, url: str, story: Story, **given: Any) -> Watched:
    story.wait_for("bench started")
    seen = watched(browser, url, **given)
    seen.open(f"sessions/{story.session}/bench", f"{story.session}: the bench")
    key(seen, "next").wait_for()
    return seen


def key(seen: Watched, command: str) -> Any:
    return seen.page.locator(f'.keypad [data-command="{command}"]')


def now(seen: Watched) -> str:
    return str(seen.page.locator(".bench-now").inner_text())


# Whether the page of a bench has drawn nothing for a while; one that draws does so five times a second at least.
NOTHING_DRAWN = """() => {
    const drawn = document.querySelector('.bench').dataset.frames;
    if (window.rest?.drawn !== drawn) window.rest = { drawn, since: performance.now() };
    return performance.now() - window.rest.since > 1500;
}"""


def until(seen: Watched, met: str, given: Any = None) -> None:
    seen.page.wait_for_function(met, arg=given, timeout=PATIENCE_MS)


def aged(route: Any) -> None:
    """The bench's state as the service has it, but with warnings, and a tare that is old after a second."""
    answer = route.fetch()
    state = answer.json()
    state["tare"] |= {"stale_after_s": 1.0}
    state["warnings"] = [
        {"code": code, "at_s": 1.0, "title": "Something is wrong", "to_do": "Look at it.", "text": "found"}
        for code in ("doubtful_force", "zero_moved", "not_steady")
    ]
    route.fulfill(response=answer, json=state)


def tared(seen: Watched, story: Story, count: int) -> None:
    story.rig("off")
    time.sleep(0.15)
    key(seen, "tare").click()
    story.wait_for("  tare;", count)
    until(seen, "() => [...document.querySelectorAll('.chip')].some((c) => /^tare \\d+ s ago/.test(c.textContent))")


def hung(seen: Watched, story: Story, case: str, what: str | None = None) -> None:
    """Hang a case's weights, or others, mark them, and wait until there is a plateau to confirm."""
    story.rig(f"hang {what or case}")
    time.sleep(0.15)
    seen.page.keyboard.press("l")
    until(seen, "() => document.querySelector('[data-command=confirm].suggested')")
    until(seen, "(c) => document.querySelector('.now-kind').textContent === `${c} now`", case)
    # The model is compiled once.
    until(seen, "() => !document.querySelector('.now-prediction').textContent.includes('being computed')")


def measured(seen: Watched, story: Story, count: int) -> None:
    """Confirm the plateau; again where the cell was silent just before, as it is on a busy machine."""
    while True:
        refused = story.count(NO_PLATEAU)
        seen.page.keyboard.press("Enter")
        deadline = time.monotonic() + PATIENCE_MS / 1000.0
        while story.count("  measured;") < count and story.count(NO_PLATEAU) == refused:
            assert time.monotonic() < deadline, "".join(story.said[-20:])
            time.sleep(0.05)
        if story.count("  measured;") >= count:
            return
        until(seen, "() => document.querySelector('[data-command=confirm].suggested')")


def to_the_report(seen: Watched, session: str) -> None:
    """Compare, diagnose, add, see the error fall, open the report."""
    seen.open(f"sessions/{session}/compare", f"{session}: predicted against measured")
    seen.page.locator(".js-plotly-plot").first.wait_for()
    seen.open(f"sessions/{session}/find", f"{session}: find the missing effect")
    seen.page.get_by_role("button", name="Find the missing effect").click()
    seen.page.get_by_role("heading", name="The verdict").wait_for(timeout=240_000)
    assert "the hanger was not weighed" in seen.text()
    seen.page.get_by_role("button", name="Add hanger_mass").first.click()
    seen.page.get_by_role("heading", level=1, name=f"{session}: the fall of the error").wait_for(timeout=240_000)
    seen.page.get_by_role("heading", name=re.compile("with hanger_mass")).first.wait_for()
    seen.page.get_by_role("link", name=re.compile("^Report")).first.click()
    seen.page.get_by_role("heading", level=1, name=f"{session}: report").wait_for()
    seen.page.locator("article.sheet").get_by_text(re.compile("hanger")).first.wait_for()


def traces_drawn(seen: Watched) -> list[int]:
    """How many pixels of each trace have ink of its colour."""
    found: list[int] = seen.page.evaluate("""() => [...document.querySelectorAll('.trace canvas')].map((c) => {
        const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
        let n = 0;
        for (let i = 0; i < d.length; i += 4) if (d[i + 3] > 100 && d[i + 2] > d[i] + 60) n++;
        return n;
    })""")
    return found


def until_stored(seen: Watched, readings: str) -> None:
    """Wait until the service has stored some: a busy one may have none yet when the bench begins."""
    deadline = time.monotonic() + PATIENCE_MS / 1000.0
    while not ((answer := seen.page.request.get(readings)).ok and answer.json()["samples"]):
        assert time.monotonic() < deadline
        seen.page.wait_for_timeout(100)
