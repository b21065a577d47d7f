"""The bench page with a running bench: the whole story from the first tare to the report, and what goes wrong in it."""

from __future__ import annotations

import re
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.browser.bench_pages import (
    KEY_PX,
    LARGE_PX,
    NOTHING_DRAWN,
    PATIENCE_MS,
    aged,
    hung,
    key,
    measured,
    now,
    opened,
    tared,
    to_the_report,
    traces_drawn,
    until,
    until_stored,
)
from tests.browser.bench_story import HOLD_ANSWERS, Story, bench, cases, wrenches
from tests.browser.pages import Watched, require_browser, served, violations, watched

require_browser()


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[float]]:
    return wrenches(tmp_path_factory.mktemp("rig"))


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """One service for tests that leave it running, each with a session of its own."""
    with served(tmp_path_factory.mktemp("service")) as (address, _):
        yield address


def test_the_whole_story_from_the_first_tare_to_the_report(
    browser: Any, url: str, rig: dict[str, list[float]], tmp_path: Path
) -> None:
    with bench(tmp_path, url, "whole", rig) as story:
        seen = opened(browser, url, story)
        assert "Give the known weight" in now(seen)
        key(seen, "next").click()
        tared(seen, story, 1)
        for k, (name, (posture, masses)) in enumerate(cases().items()):
            if posture == "relaxed":
                until(seen, "() => document.querySelector('.now-todo').textContent.includes('Set posture relaxed')")
                key(seen, "posture_set").click()
                story.wait_for("set posture")
                tared(seen, story, 2)
            hung(seen, story, name)
            told = now(seen)
            (load,) = masses.items()
            assert f"{load[0]} {load[1]:g} g · {posture} · tip" in told
            force = float(seen.page.locator(".now-number").inner_text())
            assert force == pytest.approx(sum(f * f for f in rig[name][:3]) ** 0.5, abs=0.05)
            # Nothing tells of a validation case what the model says.
            blind = posture == "relaxed"
            assert ("prediction hidden" in told) == blind
            assert bool(re.search(r"predicted \d", told)) != blind
            assert (seen.page.locator('.legend [data-kind="predicted"]').inner_text() == "predicted –") == blind
            measured(seen, story, k + 1)
            mark = seen.page.locator(f'[data-step="{name}"]')
            mark.and_(seen.page.locator(".measured")).wait_for()
            if k == 0:
                excluded_and_included(seen, story, name)
            if name == "c007":
                seen.page.evaluate(HOLD_ANSWERS)
            key(seen, "next").click()
            story.wait_for("  step;", k + 2)
        assert seen.page.locator('[data-step="c007"]').get_attribute("aria-label").endswith("N")
        drawn = traces_drawn(seen)
        assert min(drawn) > 200, drawn
        # While it runs, nothing can be searched for: the page says so, and what a search is, until it is closed.
        finding = watched(browser, url)
        finding.open(f"sessions/{story.session}/find", f"{story.session}: find the missing effect")
        finding.page.get_by_text("The bench is still running").wait_for()
        finding.page.get_by_text("The search fits every effect").wait_for()
        find = finding.page.get_by_role("button", name="Find the missing effect")
        assert find.is_disabled()
        # Closing is asked about, which the answer to the key before does not end, and can be thought better of.
        seen.page.keyboard.press("q")
        seen.page.evaluate("() => window.answer()")
        until(seen, "() => document.querySelector('.said').textContent.endsWith('done')")
        seen.page.get_by_role("button", name="Cancel").click()
        assert story.log.poll() is None
        key(seen, "close").click()
        seen.page.get_by_role("button", name="Close it, show the predictions").click()
        until(seen, "() => document.querySelector('.now-todo').textContent.includes('session is closed')")
        assert re.search(r"predicted \d", now(seen))
        assert key(seen, "next").count() == 0
        assert story.log.wait(60) == 0, "".join(story.said)
        finding.page.get_by_text("The bench is still running").wait_for(state="detached")
        assert find.is_enabled()
        assert finding.complaints == []
        finding.page.close()
        to_the_report(seen, story.session)
        seen.page.close()
        assert seen.complaints == []
        assert seen.elsewhere == []


def excluded_and_included(seen: Watched, story: Story, case: str) -> None:
    """The case that is meant stands in the field before a reason is typed."""
    seen.page.keyboard.press("x")
    field = seen.page.get_by_label("Which case is left out, and why?")
    until(seen, "() => document.activeElement.id === 'bench-text'")
    assert field.input_value() == f"{case} "
    seen.page.keyboard.type("it slipped")
    seen.page.keyboard.press("Enter")
    story.wait_for(f"excluded; case {case}; reason it slipped")
    seen.page.locator(f'[data-step="{case}"].excluded').wait_for()
    key(seen, "include").click()
    again = seen.page.get_by_label("Which case is taken in again?")
    assert again.input_value() == case
    again.press("Enter")
    story.wait_for(f"included; case {case}")
    seen.page.locator(f'[data-step="{case}"].measured').wait_for()


# Where hint, force and keys are [px] while the hint has a second line.
TWO_LINES = """(hint) => {
    const told = hint.textContent;
    hint.append(document.createElement('br'), told);
    const number = document.querySelector('.now-number').getBoundingClientRect();
    const keys = [...document.querySelectorAll('.keypad button')].map((key) => key.getBoundingClientRect());
    const out = [hint.getBoundingClientRect().bottom, number.bottom, Math.min(...keys.map((k) => k.top)),
        Math.max(...keys.map((k) => k.bottom))];
    hint.textContent = told;
    return out;
}"""


def test_what_goes_wrong_is_said_while_the_weight_hangs_and_leaves_with_its_cause(
    browser: Any, rig: dict[str, list[float]], tmp_path: Path
) -> None:
    with served(tmp_path / "service") as (url, process), bench(tmp_path / "bench", url, wrench=rig) as story:
        seen = opened(browser, url, story)
        key(seen, "next").click()
        tared(seen, story, 1)
        alert = seen.page.get_by_role("alert", name="Look now")
        assert alert.inner_text() == ""
        # FDS where FDP should hang.
        hung(seen, story, "c001", "c003")
        alert.get_by_text("The force can hardly be right").wait_for()
        assert "Leave it on and look: right tendon" in alert.inner_text()
        # What it reads like can be read from afar too, with room for a second line of it; the keys stay in sight.
        hint = alert.get_by_text("c001 reads like FDS 900 g: is a weight on FDS?")
        assert hint.evaluate("e => parseFloat(getComputedStyle(e).fontSize)") >= LARGE_PX
        seen.page.set_viewport_size({"width": 1280, "height": 720})
        # A busy machine may lose readings, which is told for twenty seconds.
        until(seen, "() => document.querySelector('[aria-label=\"Look now\"]').childElementCount === 1")
        hint_end, number_end, keys_begin, keys_end = hint.evaluate(TWO_LINES)
        assert hint_end <= keys_begin
        assert number_end <= keys_begin
        assert keys_end <= 720
        seen.page.screenshot(path=tmp_path / "hint.png")
        seen.page.set_viewport_size({"width": 1280, "height": 800})
        assert seen.page.locator(".now-todo").is_hidden()
        hung(seen, story, "c001")
        until(seen, "() => !document.querySelector('[aria-label=\"Look now\"]').childElementCount")
        # The cable is pulled, and comes back.
        story.rig("pull")
        alert.get_by_text("The load cell's cable is out").wait_for()
        until(seen, "() => document.querySelector('.now-number').textContent === '–'")
        story.rig("plug")
        until(seen, "() => !document.querySelector('[aria-label=\"Look now\"]').childElementCount")
        seen.page.get_by_text("readings/s").wait_for()
        # The cell falls silent with its cable in, and speaks again.
        story.rig("mute")
        alert.get_by_text("The load cell is silent").wait_for()
        assert "Look at its cable and its power." in alert.inner_text()
        story.rig("speak")
        until(seen, "() => !document.querySelector('[aria-label=\"Look now\"]').childElementCount")
        # The log hangs: nothing comes, not even that the cell is silent.
        story.log.send_signal(signal.SIGSTOP)
        alert.get_by_text("Nothing comes from the bench").wait_for()
        story.log.send_signal(signal.SIGCONT)
        until(seen, "() => !document.querySelector('[aria-label=\"Look now\"]').childElementCount")
        # The service is away, and comes back without the page being loaded anew or the note lost.
        key(seen, "note").click()
        field = seen.page.get_by_label("Note:")
        field.fill("tendon looks dry")
        seen.page.evaluate("window.sameDocument = true")
        process.process.kill()
        alert.get_by_text("The service does not answer").wait_for()
        port = int(url.rsplit(":", 1)[1])
        with served(tmp_path / "service", port):
            until(seen, "() => !document.querySelector('[aria-label=\"Look now\"]').textContent.includes('does not')")
            key(seen, "confirm").wait_for()
            assert field.input_value() == "tendon looks dry"
            assert seen.page.evaluate("window.sameDocument") is True
            until(seen, "() => document.querySelector('.chips').textContent.includes('readings/s')")
            field.press("Enter")
            story.wait_for("note; text tendon looks dry")
            the_page_draws_little_and_keeps_nothing(seen, story)
        seen.page.close()
        assert [c for c in seen.complaints if "ERR_CONNECTION_" not in c and "WebSocket" not in c] == []
        assert seen.elsewhere == []


def the_page_draws_little_and_keeps_nothing(seen: Watched, story: Story) -> None:
    frames = "Number(document.querySelector('.bench').dataset.frames)"
    began, first = time.monotonic(), seen.page.evaluate(frames)
    seen.page.wait_for_timeout(3000)
    drawn = (seen.page.evaluate(frames) - first) / (time.monotonic() - began)
    assert 5.0 < drawn <= 31.0
    # No reading, nothing to draw; and nothing is drawn for a page that nobody sees.
    story.rig("pull")
    seen.page.get_by_role("alert", name="Look now").get_by_text("cable is out").wait_for()
    until(seen, NOTHING_DRAWN)


def test_a_page_that_is_there_before_the_live_stream_goes_live_with_it(
    browser: Any, url: str, rig: dict[str, list[float]], tmp_path: Path
) -> None:
    """Until something comes all that was stored is shown; then it is what a page that waited for nothing shows."""
    held: list[Any] = []
    ends: list[Any] = []
    through = False

    def hold(page_end: Any) -> None:
        ends.append(page_end)

        def take(message: str | bytes) -> None:
            if through:
                page_end.send(message)
            else:
                held.append(lambda: page_end.send(message))

        page_end.connect_to_server().on_message(take)

    with bench(tmp_path, url, "before", rig) as story:
        story.wait_for("bench started")
        seen = watched(browser, url)
        until_stored(seen, f"{url}/api/v1/sessions/{story.session}/readings")
        seen.page.route_web_socket(re.compile("/live"), hold)
        seen.open(f"sessions/{story.session}/bench", f"{story.session}: the bench")
        seen.page.get_by_text(re.compile(r"s until \d")).wait_for()
        through = True
        for send in held:
            send()
        seen.page.get_by_text("the last 30 s").wait_for()
        live = seen.page.get_by_role("button", name="Live")
        assert live.get_attribute("aria-pressed") == "true"
        # Who looks back goes on doing so when the connection is lost and there again.
        seen.page.get_by_role("group", name=re.compile("^Six traces")).press("ArrowLeft")
        looked_at = seen.page.get_by_text(re.compile(r"^30 s until \d")).inner_text()
        ends[-1].close()
        came = seen.page.locator(".trace-value").first
        before, deadline = came.inner_text(), time.monotonic() + PATIENCE_MS / 1000.0
        while len(ends) < 2 or came.inner_text() == before:
            assert time.monotonic() < deadline
            seen.page.wait_for_timeout(100)
        seen.page.wait_for_timeout(500)
        assert live.get_attribute("aria-pressed") == "false"
        assert seen.page.get_by_text(looked_at).count() == 1
        seen.page.close()


SMALL = """(least) => [...document.querySelectorAll('.bench-now *')]
.filter((e) => e.checkVisibility() && [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim()))
.filter((e) => parseFloat(getComputedStyle(e).fontSize) < least).map((e) => e.className)"""


def test_it_can_be_read_from_two_metres_pressed_with_gloves_and_looked_back_in(
    browser: Any, url: str, rig: dict[str, list[float]], tmp_path: Path
) -> None:
    with bench(tmp_path, url, "read", rig) as story:
        seen = opened(browser, url, story)
        key(seen, "next").click()
        tared(seen, story, 1)
        hung(seen, story, "c001")
        assert seen.page.evaluate(SMALL, LARGE_PX) == []
        assert violations(seen.page) == []
        box = seen.page.locator(".bench-now").bounding_box()
        assert box["y"] + box["height"] < 0.6 * 800
        for button in seen.page.locator(".keypad button").all():
            its = button.bounding_box()
            assert its["height"] >= KEY_PX
            assert its["width"] >= KEY_PX
            assert button.evaluate("(e) => e.scrollWidth <= e.clientWidth")
        # A letter that is typed into a field is a letter, and Escape takes the field away.
        key(seen, "note").click()
        seen.page.keyboard.type("next")
        assert seen.page.get_by_label("Note:").input_value() == "next"
        seen.page.keyboard.press("Escape")
        assert seen.page.get_by_label("Note:").count() == 0
        # What the bench refuses is said.
        key(seen, "next").click()
        story.wait_for("  step;", 2)
        key(seen, "confirm").click()
        seen.page.get_by_text("there is no plateau to confirm").wait_for()
        seen.complaints = [c for c in seen.complaints if "409" not in c]
        # What was skipped is gone back to: it stands in the field, being the one that was left.
        seen.page.keyboard.press("r")
        assert seen.page.get_by_label("Which case is done once more").input_value() == "c001"
        seen.page.keyboard.press("Enter")
        story.wait_for("step; id c001; back True")
        seen.page.locator('[data-step="c001"].now').wait_for()
        key(seen, "next").click()
        story.wait_for("  step;", 4)
        # Looking back: it stays where it is while more comes, and the service gives what the page never had.
        traces = seen.page.get_by_role("group", name=re.compile("^Six traces"))
        live = seen.page.get_by_role("button", name="Live")
        traces.press("+")
        seen.page.get_by_text("the last 20 s").wait_for()
        traces.press("ArrowLeft")
        assert live.get_attribute("aria-pressed") == "false"
        shown = seen.page.get_by_text(re.compile(r"^20 s until ")).inner_text()
        seen.page.wait_for_timeout(700)
        assert seen.page.get_by_text(shown).count() == 1
        live.click()
        seen.page.get_by_text("the last 20 s").wait_for()
        for size in ({"width": 390, "height": 844}, {"width": 820, "height": 1180}, {"width": 1280, "height": 800}):
            seen.page.set_viewport_size(size)
            assert seen.page.locator(".now-force").evaluate("e => e.scrollWidth <= e.clientWidth")
            wide = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
            assert seen.page.evaluate(wide) <= 0
        # A tare that is older than it should be is asked for again.
        alert = seen.page.get_by_role("alert", name="Look now")
        assert "The tare is old" not in alert.inner_text()
        seen.page.route("**/bench/state", aged)
        seen.page.reload()
        seen.page.get_by_text("The tare is old").wait_for()
        assert "With the next weight off, tare again." in seen.page.locator("main").inner_text()
        # However much there is to warn of and wherever the page stands, every key is on a low screen.
        seen.page.set_viewport_size({"width": 1280, "height": 720})
        for down in (0, 1e6):
            seen.page.evaluate("y => scrollTo(0, y)", down)
            keys = [button.bounding_box() for button in seen.page.locator(".keypad button").all()]
            assert min(k["y"] for k in keys) >= 0
            assert max(k["y"] + k["height"] for k in keys) <= 720
        # What a key asks does not scroll the force away.
        seen.page.evaluate("scrollTo(0, 0)")
        key(seen, "close").click()
        cancel = seen.page.get_by_role("button", name="Cancel")
        assert cancel.evaluate("e => [e === document.activeElement, scrollY]") == [True, 0]
        seen.page.keyboard.press("Escape")
        seen.page.unroute("**/bench/state")
        # A case that is picked is drawn, and what hangs now when it is let go.
        seen.page.locator('[data-step="c007"]').click()
        seen.page.locator(".finger-title").get_by_text("relaxed").wait_for()
        seen.page.locator('[data-step="c007"]').click()
        seen.page.locator(".finger-title").get_by_text("hook").wait_for()
        # Another browser that comes later, and has no control over when it comes, sees the same and can press.
        other = opened(browser, url, story)
        until(other, "() => document.querySelector('[data-step=c001]')?.classList.contains('measured') === false")
        key(other, "note").click()
        other.page.keyboard.type("from the other side")
        other.page.keyboard.press("Enter")
        story.wait_for("note; text from the other side")
        for each in (seen, other):
            each.page.close()
            assert each.complaints == []
