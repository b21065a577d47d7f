"""The bench page of a session that is recorded, replayed, or not there, and what it keeps of readings."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import pytest

from tests.browser.bench_pages import key, traces_drawn, until
from tests.browser.pages import BEYOND, require_browser, served, shade, violations, watched
from tests.server.service.processes import Process

require_browser()


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Process]]:
    """One service with its address, for sessions of different names."""
    with served(tmp_path_factory.mktemp("service")) as found:
        yield found


def test_a_recorded_session_and_one_that_is_not_there_have_a_page_too(
    browser: Any, service: tuple[str, Process]
) -> None:
    from fingertwin.client import Client

    url, _ = service
    with Client(url) as twin:
        twin.upload("DEV-02")
    seen = watched(browser, url)
    seen.open("sessions/DEV-02/bench", "DEV-02: the bench")
    seen.page.get_by_text("no bench is running").first.wait_for()
    until(seen, "() => document.querySelectorAll('.protocol-grid .mark.measured').length > 10")
    seen.page.locator(".finger-title").wait_for()
    until(seen, "() => document.querySelector('[data-kind=measured]').textContent.includes(' N')")
    assert "Model: an1979_middle." in seen.page.locator(".finger-views").inner_text()
    assert "range not known" not in seen.text()
    assert key(seen, "next").count() == 0
    assert min(traces_drawn(seen)) > 100
    for width in (1440, 900, 390):
        seen.page.set_viewport_size({"width": width, "height": 900})
        seen.page.wait_for_timeout(300)
        assert seen.page.evaluate(BEYOND) <= 0
        number, panel = (seen.page.locator(s).bounding_box() for s in (".now-force", ".bench-now"))
        assert number["x"] + number["width"] <= panel["x"] + panel["width"]
        cut = seen.page.locator(".protocol-scroll")
        assert cut.evaluate("e => { e.scrollTo(0, 0); return e.scrollWidth > e.clientWidth; }")
        before = shade(cut)
        cut.evaluate("e => e.scrollTo(e.scrollWidth, 0)")
        assert before > shade(cut) + 10
    assert violations(seen.page) == []
    seen.page.goto(f"{url}/#/sessions/nothing/bench")
    seen.page.get_by_role("button", name="Try again").wait_for()
    assert "There is no session nothing" in seen.text()
    seen.page.close()
    assert [c for c in seen.complaints if "404" not in c and "WebSocket" not in c] == []


# Every headline and every state of the bench that a page shows from the beginning, in window.shown.
REMEMBER = """(() => {
  window.shown = [];
  const look = () => {
    for (const e of document.querySelectorAll('.now-todo, .chip')) {
      const text = e.checkVisibility() ? e.textContent : '';
      if (text && !window.shown.includes(text)) window.shown.push(text);
    }
  };
  const all = { subtree: true, childList: true, characterData: true, attributes: true };
  new MutationObserver(look).observe(document, all);
})()"""


@pytest.mark.parametrize("speed", [1, pytest.param(40, marks=pytest.mark.full)])
def test_while_a_recording_is_replayed_the_headline_says_so_and_afterwards_that_no_bench_is_running(
    browser: Any, service: tuple[str, Process], speed: int
) -> None:
    (url, process), name = service, f"replayed-{speed}"
    with process.client() as client:
        words = ["replay", "DEV-02", "--to", url, "--session", name, "--speed", str(speed)]
        replay = Process(["-m", "server.cli", *words])
        try:
            while client.get(f"/api/v1/sessions/{name}").status_code == 404:
                time.sleep(0.1)
            seen = watched(browser, url)
            seen.page.add_init_script(REMEMBER)
            seen.open(f"sessions/{name}/bench", f"{name}: the bench")
            seen.page.locator(".now-todo").get_by_text("a recording is being replayed").wait_for()
            seen.page.wait_for_timeout(5000)
            assert replay.process.poll() is None, "the replay was over before it was looked at"
            shown = seen.page.evaluate("window.shown")
            assert [text for text in shown if "no bench is running" in text or text == "recorded"] == []
            assert "replaying" in shown
            # However fast cases follow each other, each that is drawn is drawn.
            seen.page.locator(".finger-title").get_by_text("cell at the").wait_for()
            replay.process.terminate()
            seen.page.locator(".now-todo").get_by_text("no bench is running").wait_for()
            seen.page.close()
        finally:
            replay.close()


RING = """async () => {
    const { Ring, Rate } = await import('/pages/views/bench_ring.js');
    const ring = new Ring(16);
    const six = (v) => [v, v, v, v, null, v];
    const body = (t) => ({ from_s: [t], to_s: [t + 0.5], count: [7], least: [six(t - 1)], most: [six(t + 1)],
        latest: [six(t)], mean: [six(t)], overload: [t === 97] });
    let readings = 0;
    for (let t = 0; t < 100; t++) readings += ring.take(body(t));
    const again = ring.take(body(98));
    const low = ring.low[ring.at(0) * 6];
    const rate = new Rate();
    for (let ms = 0; ms < 10000; ms += 20) rate.add(20, ms);
    const high = ring.high[ring.at(15) * 6];
    const found = ring.to[ring.at(ring.find(90))];
    const out = { readings, again, count: ring.count, first: ring.firstS, last: ring.lastS, low, high, found,
        nothing: Number.isNaN(ring.low[4]), over: ring.overloadedSince(96), not: ring.overloadedSince(98.2),
        hz: rate.hz(10000), silent: rate.hz(20000), room: ring.low.length };
    ring.take(body(3));
    return { ...out, anew: [ring.count, ring.lastS] };
}"""


def test_the_page_keeps_the_last_minutes_in_arrays_that_never_grow(browser: Any, service: tuple[str, Process]) -> None:
    url, _ = service
    seen = watched(browser, url)
    seen.page.goto(url)
    found = seen.page.evaluate(RING)
    seen.page.close()
    assert (found["readings"], found["again"]) == (700, 0)
    assert (found["count"], found["first"], found["last"]) == (16, 84.0, 99.5)
    assert (found["low"], found["high"], found["nothing"], found["room"]) == (83.0, 100.0, True, 96)
    assert (found["found"], found["over"], found["not"]) == (90.5, True, False)
    assert found["hz"] == pytest.approx(1000.0, rel=0.02)
    assert found["silent"] is None
    # The bench's clock began anew.
    assert found["anew"] == [1, 3.5]
