"""The story as a user meets it: compare, find, look at the effect, add it, see the error fall, print the report."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.browser.one_value import Shown
from tests.browser.pages import BEYOND, Watched, click_point, require_browser, served, violations, watched

require_browser()

SESSION, EMPTY = "DEV-02", "EMPTY"
BENCH = f"sessions/{SESSION}/bench"


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    from fingertwin.client import Client

    with served(tmp_path_factory.mktemp("service"), readers=True) as (address, process):
        with Client(address) as twin:
            twin.upload(SESSION)
        with process.client() as client:
            client.post("/api/v1/sessions", json={"id": EMPTY}).raise_for_status()
        yield address


@pytest.fixture
def searched(url: str) -> None:
    """What is missing was searched for, by a test before or now."""
    from fingertwin.client import Client

    with Client(url) as twin:
        if not [j for j in twin.jobs(SESSION, "done") if j.kind == "diagnose"]:
            twin.session(SESSION).diagnose().result(timeout_s=240.0)


@pytest.fixture
def added(url: str, searched: None) -> None:
    """And the effect that was found is in force."""
    from fingertwin.client import Client

    with Client(url) as twin:
        if not twin.session(SESSION).history():
            twin.session(SESSION).add("hanger_mass").result(timeout_s=240.0)


def test_a_missing_effect_is_found_and_what_was_ruled_out_is_said(seen: Watched) -> None:
    seen.open(f"sessions/{SESSION}/find", f"{SESSION}: find the missing effect")
    seen.page.get_by_text("Nothing was searched for yet.").wait_for()
    seen.page.get_by_role("button", name="Find the missing effect").click()
    seen.page.get_by_role("progressbar", name="Fitting every effect").wait_for()
    assert "Nothing was searched for yet." not in seen.text()
    seen.page.get_by_role("heading", name="The verdict").wait_for(timeout=240_000)
    assert "Found: the hanger was not weighed" in seen.text()
    # As the tutorial calls it.
    assert seen.page.get_by_role("button", name="Add hanger_mass, and refit").count() == 1
    ruled_out = seen.page.locator("section", has=seen.page.get_by_role("heading", name="Tested and ruled out"))
    assert ruled_out.get_by_role("row").count() > 10
    assert "hanger_mass explains the same readings better" in ruled_out.inner_text()
    seen.drawn()
    # Every figure of the answer can be drawn, and a cell of the map leads to its load cases.
    for name in ("missing_torque", "ranking", "size", "sensitivity", "confounding", "held_out", "residual_map"):
        seen.page.get_by_label("Figure").select_option(name)
        seen.drawn()
    click_point(seen.page, 0, [0, 0])
    seen.page.get_by_role("heading", name=f"{SESSION}: predicted against measured").wait_for()
    seen.page.get_by_text(re.compile("cases of that point or cell|c001: ")).first.wait_for()


@pytest.mark.usefixtures("searched")
def test_next_cases_go_onto_the_checklist_for_everybody(seen: Watched, browser: Any) -> None:
    other = watched(browser, seen.url)
    for page in (seen, other):
        page.open(f"sessions/{SESSION}/find", f"{SESSION}: find the missing effect")
        page.page.get_by_role("button", name="Onto the checklist").first.wait_for()
    seen.page.get_by_role("button", name="Onto the checklist").first.click()
    seen.page.get_by_role("button", name="On the checklist: take back").wait_for()
    # The other one sees it without a reload, and takes it back.
    other.page.get_by_role("button", name=re.compile("^Take back: ")).click()
    other.page.get_by_text("is off the checklist").wait_for()
    seen.page.get_by_role("button", name="On the checklist: take back").wait_for(state="detached")
    other.page.get_by_role("button", name="Undo").click()
    seen.page.get_by_role("button", name="On the checklist: take back").wait_for()
    assert (other.complaints, other.elsewhere) == ([], [])
    other.page.close()


@pytest.mark.usefixtures("searched")
def test_only_what_the_answer_proposes_is_offered(seen: Watched) -> None:
    def unknown(route: Any) -> None:
        answer = route.fetch()
        job = answer.json()
        job["result"] |= {"verdict": "none_of_catalogue", "effects": [], "candidates": []}
        route.fulfill(response=answer, json=job)

    seen.page.route("**/api/v1/jobs/*", unknown)
    seen.open(f"sessions/{SESSION}/find", f"{SESSION}: find the missing effect")
    seen.page.get_by_role("link", name="Report, to print or save").wait_for()
    assert seen.page.get_by_role("button", name=re.compile("^Add ")).count() == 0
    assert seen.page.get_by_role("link", name="What is that?").count() == 0


@pytest.mark.usefixtures("searched")
def test_an_effect_is_shown_and_added_and_the_error_falls(seen: Watched) -> None:
    seen.open(f"sessions/{SESSION}/find", f"{SESSION}: find the missing effect")
    seen.page.get_by_role("link", name="What is that?").click()
    seen.page.get_by_role("heading", level=1, name="hanger_mass").wait_for()
    seen.drawn()
    text = seen.text()
    assert "T_i += c g m0 wherever a mass hangs" in text
    assert "Source: weight of an unweighed hanger" in text
    seen.page.get_by_role("img", name=re.compile("It acts on tension")).wait_for()
    seen.page.get_by_text("It changes case").wait_for()
    seen.page.get_by_role("button", name="Add and refit").click()
    seen.page.get_by_role("heading", name=f"{SESSION}: the fall of the error").wait_for(timeout=240_000)
    seen.page.get_by_role("heading", name=re.compile("with hanger_mass")).wait_for()
    seen.drawn()
    assert "in force" in seen.text()
    # The search shows another refit with nothing added, and another evidence: the page says why.
    assert "A search tells of fits of its own" in seen.text()
    shown = seen.page.locator(".js-plotly-plot").nth(1)
    kinds = shown.evaluate("plot => plot.data.map((t) => t.meta?.kind)")
    assert {"measured", "predicted", "before_predicted"} <= set(kinds)
    falls = seen.page.get_by_role("row", name=re.compile("validation at the tip")).inner_text()
    assert "\N{MINUS SIGN}0.2" in falls


@pytest.mark.usefixtures("added")
def test_steps_go_back_and_forth_by_keys_and_by_buttons(seen: Watched) -> None:
    seen.open(f"sessions/{SESSION}/fall", f"{SESSION}: the fall of the error")
    with_it = seen.page.get_by_role("heading", name=re.compile("with hanger_mass"))
    start = seen.page.get_by_role("heading", name="an1979_middle: the start")
    with_it.wait_for()
    seen.page.keyboard.press("ArrowLeft")
    start.wait_for()
    seen.page.keyboard.press("ArrowRight")
    with_it.wait_for()
    seen.page.get_by_role("button", name="Step back").click()
    start.wait_for()
    seen.page.get_by_role("button", name=re.compile("^DEV-02-")).press("Enter")
    with_it.wait_for()
    for name in ("bone", "scatter", "scatter_validation", "errors", "z"):
        seen.page.get_by_label("Figure").select_option(name)
        seen.drawn()


@pytest.mark.usefixtures("added")
def test_a_change_after_the_fit_is_said_and_the_step_is_of_the_session_as_it_is(seen: Watched, url: str) -> None:
    from fingertwin.client import Client

    alone = seen.page.get_by_role("columnheader", name="refitted alone")
    said = seen.page.get_by_text("The session was changed since the fit of")
    seen.open(f"sessions/{SESSION}/fall", f"{SESSION}: the fall of the error")
    alone.wait_for()
    assert said.count() == 0
    with Client(url) as twin:
        edit = twin.session(SESSION).exclude("c081", "the suture had slipped")
        said.wait_for()
        alone.wait_for(state="detached")
        twin.session(SESSION).undo(edit)
    alone.wait_for()
    assert said.count() == 0


@pytest.mark.usefixtures("added")
def test_a_number_that_is_shown_twice_has_one_value(seen: Watched) -> None:
    client = f"fetch('/api/v1/sessions/{SESSION}/%s').then((r) => r.json())"
    seen.open(f"sessions/{SESSION}/find", f"{SESSION}: find the missing effect")
    (job,) = [j["id"] for j in seen.page.evaluate(client % "diagnoses")["jobs"] if j["state"] == "done"]
    (revision,) = [r["id"] for r in seen.page.evaluate(client % "revisions")["revisions"]]
    shown = Shown(seen, SESSION)
    shown.walk(job, revision, "hanger_mass", "hanger_mass.m0", "c008")
    assert shown.differing() == []
    alone = [key for key, found in shown.numbers.items() if len(found) < 2]
    assert alone == [], "what is shown once only is no comparison"


@pytest.mark.usefixtures("added")
def test_the_report_has_every_section_and_figure_on_paper(seen: Watched, tmp_path: Path) -> None:
    import pypdfium2

    seen.open(f"sessions/{SESSION}/report", f"{SESSION}: report")
    button = seen.page.get_by_role("button", name="Print or save as PDF")
    seen.page.get_by_text("Ready. The browser's own dialogue").wait_for()
    seen.page.evaluate("void (window.print = () => { window.printed = (window.printed || 0) + 1; })")
    button.click()
    assert seen.page.evaluate("window.printed") == 1
    headings = seen.page.locator(".sheet h2").all_inner_texts()
    assert {"Verdict", "What to do", "The finger with hanger mass", "The fall of the error", "Load cases"} <= set(
        headings
    )
    figures = seen.page.locator(".sheet .js-plotly-plot")
    assert figures.count() == 16
    seen.page.set_viewport_size({"width": 1400, "height": 800})
    assert figures.first.evaluate("(e) => e.offsetWidth <= e.closest('figure').clientWidth")
    assert seen.page.locator(".sheet details[open]").count() == 0, "details are folded on the screen"
    titles = seen.page.evaluate(
        "[...document.querySelectorAll('.sheet .js-plotly-plot')].map((p) => p.layout.title.text.split('<br>')[0])"
    )
    file = tmp_path / "report.pdf"
    seen.page.pdf(path=str(file), prefer_css_page_size=True)
    with pypdfium2.PdfDocument(file) as paper:
        pages = [page.get_textpage().get_text_bounded() for page in paper]
        sizes = {tuple(round(v) for v in page.get_size()) for page in paper}
        pictures = [page.render(scale=0.5).to_numpy() for page in paper]
    text = re.sub(r"\s+", " ", " ".join(pages))
    assert sizes == {(595, 842)}
    assert [h for h in headings if h not in text] == []
    assert [t for t in titles if t not in text] == []
    assert "Print or save" not in text
    # Nothing runs over the edge of the paper, and no page is empty.
    for picture in pictures:
        assert (picture[:, -12:] > 250).all()
        assert (picture[:, :12] > 250).all()
        assert (picture < 200).any()
    assert [c["id"] for c in cases(seen)] == re.findall(r"\bc\d{3}(?= [a-z_]+ (?:ident|valid))", text)


def cases(seen: Watched) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = seen.page.evaluate(
        f"fetch('/api/v1/sessions/{SESSION}/comparison').then((r) => r.json()).then((b) => b.cases)"
    )
    return found


PATHS = [
    "", BENCH, *(f"sessions/{SESSION}/{v}" for v in ("compare?case=c010", "find")),
    *(
        pytest.param(path, marks=pytest.mark.full)
        for path in (
            "help", "audit", f"sessions/{SESSION}/fall", f"sessions/{SESSION}/report",
            f"sessions/{SESSION}/effect?name=worn_pulley.FDP", f"sessions/{EMPTY}/compare",
            f"sessions/{EMPTY}/find", f"sessions/{EMPTY}/fall",
        )
    ),
]  # fmt: skip


# Elements that can be used or looked at and have no name.
UNNAMED = """() => [...document.querySelectorAll('button, a[href], input, select, textarea, canvas, [role=img]')]
.filter((e) => e.checkVisibility() && !e.closest('.js-plotly-plot'))
.filter((e) => !(e.getAttribute('aria-label') || e.innerText?.trim() || e.labels?.length))
.map((e) => e.outerHTML.slice(0, 120))"""


@pytest.mark.usefixtures("added")
@pytest.mark.parametrize("path", PATHS)
def test_every_page_can_be_used_by_anybody(browser: Any, url: str, path: str) -> None:
    """By keyboard, read aloud, light and dark, on a tablet: axe-core has nothing against it, and nothing is cut off."""
    seen = watched(browser, url, color_scheme="light")
    seen.page.goto(f"{url}/#/{path}")
    seen.page.locator("h1").wait_for()

    def settle() -> None:
        if SESSION in path and path != BENCH:
            seen.drawn()
        seen.page.wait_for_timeout(300)

    settle()
    assert seen.page.evaluate(UNNAMED) == []
    assert seen.page.evaluate("document.querySelectorAll('h1').length") == 1
    assert seen.page.evaluate("document.documentElement.lang") == "en"
    assert seen.page.evaluate(BEYOND) <= 0
    seen.page.keyboard.press("Tab")
    assert seen.page.evaluate("document.activeElement !== document.body")
    if path != BENCH:
        assert violations(seen.page) == []
    seen.page.set_viewport_size({"width": 820, "height": 1180})
    seen.page.emulate_media(color_scheme="dark")
    settle()
    assert seen.page.evaluate(BEYOND) <= 0
    if path != BENCH:
        assert violations(seen.page) == []
    assert seen.elsewhere == []
    seen.page.close()


@pytest.mark.usefixtures("added")
def test_any_step_is_put_in_force_again_the_start_too(seen: Watched) -> None:
    seen.open(f"sessions/{SESSION}/fall", f"{SESSION}: the fall of the error")
    seen.page.get_by_role("button", name="Step back").click()
    # The finger as it came is no revision: it is fitted once more without what was added.
    seen.page.get_by_role("button", name="Put it in force again, refitted without hanger_mass").click()
    seen.page.get_by_role("heading", name=re.compile(": without hanger_mass")).wait_for(timeout=240_000)
    seen.page.get_by_text("It stands for the specimen.").wait_for()
    assert "It holds no effect." in seen.text()
    seen.page.get_by_role("button", name="Step back").click()
    seen.page.get_by_role("button", name="Step back").click()
    seen.page.get_by_text("it is fitted without hanger_mass").wait_for()
    seen.page.get_by_role("button", name="Step forth").click()
    seen.page.get_by_label("Put it in force again, because").fill("weighed: the hanger counts")
    seen.page.get_by_role("button", name="Put it in force again", exact=True).click()
    seen.page.get_by_text("It stands for the specimen.").wait_for()
    assert "with hanger_mass" in seen.page.get_by_role("heading", level=3).first.inner_text()
