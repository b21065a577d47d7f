"""The page of a running bench, as somebody works with it."""

from __future__ import annotations

import time
from typing import Any

from tests.browser.bench_story import Story
from tests.browser.pages import Watched, watched

# A machine that has other work to do takes its time.
PATIENCE_MS = 60_000
LARGE_PX, KEY_PX = 40, 64


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


def until(seen: Watched, met: str, given: Any = None) -> None:
    seen.page.wait_for_function(met, arg=given, timeout=PATIENCE_MS)


def aged(route: Any) -> None:
    """The bench's state as the service has it, but a tare is old after a second instead of a quarter of an hour."""
    answer = route.fetch()
    state = answer.json()
    state["tare"] |= {"stale_after_s": 1.0}
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
