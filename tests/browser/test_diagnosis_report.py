"""The report of a diagnosis in a real browser, without any network: every figure is drawn, nothing complains."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from server.application.diagnosis_report import draw_diagnosis
from tests.browser.pages import browsing
from tests.browser.test_report import BROWSER, PNG, Page, elements, opened
from tests.server.diagnosis_answers import HISTORY, found, hostile, nothing_missing
from tests.server.diagnosis_pages import HEADINGS, NAMES


@pytest.fixture(scope="module")
def browser() -> str:
    if BROWSER is None:
        pytest.fail("chromium is not installed, and FINGERTWIN_REQUIRE asks for a browser")
    return BROWSER


@pytest.fixture(scope="module", params=["found", "nothing_missing", "hostile"])
def file(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    answers = {"found": found(), "nothing_missing": nothing_missing(), "hostile": hostile(found())}
    history = HISTORY if request.param == "found" else None
    return draw_diagnosis(answers[request.param], tmp_path_factory.mktemp(request.param), history, static=False)


@pytest.fixture(scope="module")
def page(browser: str, file: Path, tmp_path_factory: pytest.TempPathFactory) -> Page:
    done = opened(browser, file, tmp_path_factory.mktemp("browser"), "--dump-dom")
    return Page(file.read_text(encoding="utf-8"), done.stdout, done.stderr)


def test_every_figure_is_drawn_and_nothing_complains(page: Page) -> None:
    wanted, drawn = elements(page.source), elements(page.dom)
    assert 3 <= len(wanted.figures) <= len(NAMES)
    assert drawn.figures == drawn.drawn == wanted.figures
    # Plotly lays three drawings over each other in every figure.
    assert len(re.findall(r'<svg[^>]* class="main-svg"', page.dom)) == 3 * len(wanted.figures)
    # A "$" in a name looks to Plotly like a formula, for which it misses a library that is not wanted.
    said = [line for line in page.log.splitlines() if "CONSOLE" in line and "MathJax is not loaded" not in line]
    assert said == []
    assert "Uncaught" not in page.log
    assert elements(page.source).addresses == []


def test_the_verdict_is_the_largest_sentence_and_comes_first(page: Page) -> None:
    assert elements(page.dom).headings[1:] == list(HEADINGS)
    verdict = page.dom[page.dom.index('<section id="verdict">') :]
    assert verdict.startswith('<section id="verdict"><h2>Verdict</h2>\n<p>')
    assert "#verdict > p:first-of-type { font-size: 25px" in page.source


def test_a_picture_of_the_page_can_be_taken(browser: str, file: Path, tmp_path: Path) -> None:
    picture = tmp_path / "page.png"
    opened(browser, file, tmp_path, f"--screenshot={picture}")
    data = picture.read_bytes()
    assert data.startswith(PNG)
    assert len(data) > 100_000


@pytest.mark.usefixtures("browser")
def test_on_a_small_screen_what_would_settle_an_error_of_the_rig_can_be_read(tmp_path: Path) -> None:
    answer = found()
    error = {"name": "posture_angle.major_flexion.MCP", "value": -4.97, "widths": -5.0, "stated_sd": 1.0, "unit": "deg"}
    answer["where"]["bent"] = [error | {"remedy": "measure the joint angles of major flexion again"}]
    file = draw_diagnosis(answer, tmp_path, None, static=False)
    with browsing() as chromium:
        page = chromium.new_page(viewport={"width": 400, "height": 900})
        page.goto(file.as_uri())
        page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
        assert page.get_by_role("columnheader", name="what would settle it").bounding_box()["width"] > 150
        page.close()
