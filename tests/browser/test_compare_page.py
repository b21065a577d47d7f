"""Compare: from any point to its case, windows moved and back, cases left out, two people at once, folders taken in."""

from __future__ import annotations

import gzip
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from daq.sessions import find_session
from tests.browser.pages import Watched, click_point, require_browser, served, shade, watched

require_browser()

SESSION, PUBLISHED = "DEV-02", "synek2019_H01"
TITLE = f"{SESSION}: predicted against measured"
# The last element of a selector is the same for half a second.
STANDS = """selector => {
  const last = [...document.querySelectorAll(selector)].at(-1);
  if (window.stood?.last !== last) window.stood = { last, since: performance.now() };
  return last && performance.now() - window.stood.since > 500;
}"""


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    from fingertwin.client import Client

    with served(tmp_path_factory.mktemp("service")) as (address, _):
        with Client(address) as twin:
            twin.upload(SESSION)
            twin.upload(PUBLISHED)
        yield address


def figure(seen: Watched, name: str) -> None:
    """Show a figure, and wait for it."""
    seen.page.get_by_label("Figure").select_option(name)
    seen.page.wait_for_timeout(100)
    seen.page.locator(".drawn:not([aria-busy]) .js-plotly-plot").first.wait_for()


def test_from_the_list_of_sessions_to_a_case_and_its_readings(seen: Watched) -> None:
    seen.open("", "Sessions")
    seen.page.get_by_label("Search by session or specimen").fill("dev")
    seen.page.get_by_text("1 of 2 sessions").wait_for()
    seen.page.get_by_role("link", name=SESSION).click()
    seen.page.get_by_role("heading", name=TITLE).wait_for()
    seen.page.locator(".js-plotly-plot").first.wait_for()
    assert "never fitted" in seen.text()
    seen.page.get_by_role("button", name="c010", exact=True).press("Enter")
    seen.page.get_by_role("heading", name="c010: FDS 950 g, minor flexion, tip").wait_for()
    seen.page.get_by_role("heading", name="Loaded window Fy [N]", exact=True).wait_for()
    seen.page.get_by_text("independent readings").first.wait_for()
    # The drawing beside it has the sizes in its plane.
    assert "2.60 N measured in space; 2.59 N predicted" in seen.page.locator("#case").inner_text()


@pytest.mark.parametrize(
    "name",
    ["scatter", "vectors", *(pytest.param(n, marks=pytest.mark.full) for n in ("scatter_validation", "z", "bone"))],
)
def test_a_click_on_any_point_opens_its_case(seen: Watched, name: str) -> None:
    seen.open(f"sessions/{SESSION}/compare", TITLE)
    figure(seen, name)
    address = f"/api/v1/figures/comparison/{name}?session={SESSION}&role=all"
    found = seen.page.evaluate(f"fetch('{address}').then((r) => r.json()).then((b) => b.cases)")
    points = [
        (curve, at, case)
        for curve, cases in enumerate(found)
        for at, case in enumerate(cases if isinstance(cases, list) else [cases] if cases else [])
        if case
    ]
    # Of arrows their heads, whose first point is the tip; of symbols the first and the last one of some traces.
    kinds = seen.page.evaluate("document.querySelector('.js-plotly-plot').data.map((t) => t.meta?.kind || null)")
    chosen = [p for p in points if kinds[p[0]] is None or "head" in str(kinds[p[0]]) or name == "z"]
    for curve, at, _ in (chosen[0], chosen[len(chosen) // 2], chosen[-1]):
        click_point(seen.page, curve, at)
        opened = seen.page.locator("#case h2")
        seen.page.wait_for_function("() => document.querySelector('#case h2').textContent.includes(': ')")
        seen.page.wait_for_timeout(150)
        # Symbols of several cases may lie upon each other; the one that is opened lies there too.
        name_of = opened.inner_text().split(":")[0]
        assert any(apart(seen, (k, i), (curve, at)) < 16 for k, i, c in points if c == name_of)


def apart(seen: Watched, one: tuple[int, int], other: tuple[int, int]) -> float:
    """How far two points of a figure are from each other [px]; of an arrow, any of its points."""
    script = """([one, other]) => { const p = document.querySelector('.js-plotly-plot');
    const axis = (n) => p._fullLayout[n.replace(/^([xy])/, '$1axis')];
    const at = ([k, i]) => { const t = p.data[k]; const [x, y] = [axis(t.xaxis || 'x'), axis(t.yaxis || 'y')];
      return [x._offset + x.d2p(t.x[i]), y._offset + y.d2p(t.y[i])]; };
    const [a, b] = [at(one), at(other)];
    return Math.hypot(a[0] - b[0], a[1] - b[1]); }"""
    return float(seen.page.evaluate(script, [list(one), list(other)]))


def test_a_bar_leads_to_all_of_its_cases(seen: Watched) -> None:
    seen.open(f"sessions/{SESSION}/compare", TITLE)
    figure(seen, "errors")
    click_point(seen.page, 0, 0, aside=6)
    seen.page.get_by_text(re.compile(r"the \d+ load cases of that point")).wait_for()
    rows = seen.page.locator("section", has=seen.page.get_by_role("heading", name="Load cases")).get_by_role("row")
    hung = rows.locator("td:nth-child(5)").all_inner_texts()
    assert len(hung) > 3
    assert {h.split()[0] for h in hung} == {"FDP"}
    seen.page.get_by_role("button", name="Show all").click()
    seen.page.get_by_text("96 of 96 load cases").wait_for()


def test_filters_and_the_plane_hold_for_figure_and_table(seen: Watched) -> None:
    seen.open(f"sessions/{SESSION}/compare", TITLE)
    seen.page.get_by_label("Mount").select_option("bone")
    seen.page.get_by_label("Tendons").select_option("FDP")
    seen.page.get_by_label("Forces").select_option("sagittal")
    seen.page.get_by_text(re.compile("^2 of 96 load cases")).wait_for()
    # Of the figures on the way there the last one stays: of the bone, and of two components.
    seen.page.wait_for_function(
        """() => {
          const layout = document.querySelector('.js-plotly-plot')?.layout;
          const axes = Object.keys(layout || {}).filter((k) => /^xaxis/.test(k)).length;
          return axes === 2 && layout.title.text.includes('bone force components');
        }"""
    )
    assert "in the sagittal plane" in seen.page.get_by_role("region", name=re.compile("^Errors in the")).inner_text()
    seen.page.get_by_label("by", exact=True).select_option("by_posture")
    seen.page.get_by_role("cell", name="hyperextension").first.wait_for()
    # Loaded again, or come back to, the page shows what was chosen.
    seen.page.get_by_label("Model", exact=True).select_option("an1979_middle")
    seen.page.get_by_role("link", name="Fingers", exact=True).click()
    seen.page.get_by_role("heading", name="Fingers").first.wait_for()
    for again in (seen.page.go_back, seen.page.reload):
        again()
        seen.page.get_by_text(re.compile("^2 of 96 load cases")).wait_for()
        assert seen.page.get_by_label("Model", exact=True).input_value() == "an1979_middle"
        assert seen.page.get_by_label("Forces", exact=True).input_value() == "sagittal"
    # Nothing is left by these: the figure says so instead of being empty.
    seen.page.get_by_label("Role").select_option("validation")
    seen.page.get_by_text("No figure: none of these load cases is a validation case").wait_for()


def test_a_table_is_sorted_by_a_click_on_a_heading_and_stays_so(seen: Watched) -> None:
    seen.open(f"sessions/{SESSION}/compare", TITLE)
    table = seen.page.locator("section", has=seen.page.get_by_role("heading", name="Load cases", exact=True))
    table.get_by_role("button", name="c001", exact=True).wait_for()
    for expected in ("ascending", "descending"):
        table.get_by_role("button", name="z", exact=True).click()
        table.locator(f"th[aria-sort={expected}]", has_text="z").wait_for()
        z = [float(text) for text in table.locator("tbody td:nth-child(9)").all_inner_texts()]
        assert z == sorted(z, reverse=expected == "descending")
        assert len(z) == 96
    # A case that is opened draws the table anew.
    table.get_by_role("button", name="c008", exact=True).click()
    seen.page.get_by_role("heading", name="c008: FDP 950 g, minor flexion, tip").wait_for()
    assert [float(text) for text in table.locator("tbody td:nth-child(9)").all_inner_texts()] == z


FIRST = """(cell) => {
  const [box, place] = [cell, cell.closest('.scroll')].map((e) => e.getBoundingClientRect());
  return Math.abs(box.left - place.left) < 2 && cell.contains(document.elementFromPoint(box.left + 12, box.top + 12));
}"""


@pytest.mark.parametrize("width", [1440, 900, 390])
def test_a_table_that_goes_on_beyond_its_edges_says_so(seen: Watched, width: int) -> None:
    seen.page.set_viewport_size({"width": width, "height": 900})
    seen.open(f"sessions/{SESSION}/compare", TITLE)
    seen.drawn()
    place = seen.page.get_by_role("region", name=re.compile("of 96 load cases"))
    caption = place.locator("caption").bounding_box()
    assert caption is not None
    assert caption["x"] + caption["width"] <= width
    end = "(place, [x, y]) => place.scrollTo(x * place.scrollWidth, y * place.scrollHeight)"
    there = {side: shade(place, side) for side in ("below", "right")}
    place.evaluate(end, [1, 1])
    gone = {side: shade(place, side) for side in ("below", "right")}
    # Whatever stands at the right end, its row's case is still named at the left, and on top of all.
    assert place.locator("tbody tr").last.locator("td").first.evaluate(FIRST)
    assert there["below"] > gone["below"] + 10
    assert (there["right"] > gone["right"] + 10) is (width < 1440)


def test_a_window_is_moved_by_typing_and_by_dragging_and_back(seen: Watched) -> None:
    seen.open(f"sessions/{SESSION}/compare?case=c001", TITLE)
    force = seen.page.locator("#case .big")
    force.wait_for()
    before = force.inner_text()
    seen.page.locator("#from-loaded_s").fill("4.5")
    seen.page.locator("#to-loaded_s").fill("5.5")
    seen.page.get_by_role("button", name="Move the window").nth(1).click()
    seen.page.get_by_text("Changed, and computed anew. A window of c001 is moved.").wait_for()
    changed = "before => (document.querySelector('#case .big')?.innerText ?? before) !== before"
    seen.page.wait_for_function(changed, arg=before)
    seen.page.get_by_role("button", name="Undo", exact=True).click()
    same = "before => document.querySelector('#case .big')?.innerText === before"
    seen.page.wait_for_function(same, arg=before)
    # The case is drawn again once its change is announced; a drawing that has gone cannot be dragged in.
    seen.page.wait_for_function(STANDS, arg="#case canvas.plateau")
    # The end of the loaded window is drawn to the left by its edge.
    canvas = seen.page.get_by_role("img", name=re.compile("^Loaded: readings"))
    canvas.scroll_into_view_if_needed()
    to = seen.page.locator("#to-loaded_s")
    first, start = float(to.input_value()), float(seen.page.locator("#from-loaded_s").input_value())
    box = canvas.bounding_box()
    assert box is not None
    wide, span = box["width"] - 64, first - start
    # Two seconds are shown before and after the window.
    x = box["x"] + 56 + wide * (2 + span) / (span + 4)
    seen.page.mouse.move(x, box["y"] + 40)
    seen.page.mouse.down()
    seen.page.mouse.move(x - wide / (span + 4), box["y"] + 40, steps=4)
    seen.page.mouse.up()
    assert float(to.input_value()) == pytest.approx(first - 1.0, abs=0.1)
    assert float(seen.page.locator("#from-loaded_s").input_value()) == pytest.approx(start, abs=0.02)
    seen.page.get_by_role("button", name="Move the window").nth(1).click()
    seen.page.get_by_text("A window of c001 is moved.").wait_for()
    # It stands among the changes, and can be undone from there too.
    held: list[Any] = []
    seen.page.route("**/undo", lambda route: held.append(route))  # noqa: PLW0108 - a bound method takes no attribute
    with seen.page.expect_request("**/undo"):
        seen.page.get_by_role("button", name="Undo: c001 window moved").first.click()
    # What is typed while the change is under way stays; an end before the start is not sent.
    seen.page.locator("#to-loaded_s").fill("1")
    with seen.page.expect_response("**/undo"):
        held[0].continue_()
    seen.page.get_by_text("This case was changed meanwhile.").wait_for()
    assert to.input_value() == "1"
    seen.page.get_by_role("button", name="Move the window").nth(1).click()
    assert (
        seen.page.locator("#to-loaded_s").evaluate("e => e.validationMessage") == "The end must come after the start."
    )


def test_two_people_see_each_others_changes_and_sessions_do_not_mix(seen: Watched, browser: Any) -> None:
    other, apart = watched(browser, seen.url), watched(browser, seen.url)
    for page in (seen, other):
        page.open(f"sessions/{SESSION}/compare?case=c002", TITLE)
        page.page.get_by_role("heading", name=re.compile("^c002: ")).wait_for()
        page.page.get_by_text(f"live: {SESSION}").wait_for()
    apart.open(f"sessions/{PUBLISHED}/compare", f"{PUBLISHED}: predicted against measured")
    apart.page.locator(".js-plotly-plot").first.wait_for()
    alone = apart.text()
    asked: list[str] = []
    apart.page.on("request", lambda r: asked.append(r.url))
    seen.page.get_by_label("Leave it out, because").fill("the suture slipped")
    seen.page.get_by_role("button", name="Exclude").click()
    for page in (seen, other):
        page.page.get_by_text("1 excluded: c002 (the suture slipped)").wait_for()
        page.page.get_by_role("button", name="Take it in again").wait_for()
    # The other one is typing about another case: that stays while the list changes.
    other.page.get_by_role("button", name="c003", exact=True).click()
    other.page.get_by_label("Leave it out, because").fill("half a reas")
    seen.page.get_by_role("button", name="Take it in again").click()
    other.page.get_by_text("1 excluded").wait_for(state="detached")
    assert other.page.get_by_label("Leave it out, because").input_value() == "half a reas"
    # And where that very case changes, it is said instead of being swept away.
    seen.page.get_by_role("button", name="c003", exact=True).click()
    seen.page.get_by_role("heading", name=re.compile("^c003: ")).wait_for()
    seen.page.locator("#to-loaded_s").fill(str(float(seen.page.locator("#to-loaded_s").input_value()) - 0.5))
    seen.page.get_by_role("button", name="Move the window").nth(1).click()
    other.page.get_by_text("This case was changed meanwhile.").wait_for()
    assert other.page.get_by_label("Leave it out, because").input_value() == "half a reas"
    seen.page.get_by_role("button", name="Undo", exact=True).click()
    assert (apart.text(), asked) == (alone, [])
    for page in (other, apart):
        assert (page.complaints, page.elsewhere) == ([], [])
        page.page.close()


def folder_of(name: str, to: Path) -> Path:
    """A shipped session's folder, among other files that are no part of it."""
    to.mkdir()
    for file in find_session(name).parent.iterdir():
        (to / file.name).write_bytes(file.read_bytes())
    (to / "notes.docx").write_bytes(b"private")
    return to


def test_a_folder_is_taken_in_and_compared(seen: Watched, tmp_path: Path) -> None:
    folder = folder_of("DEV-03", tmp_path / "bench")
    sent: list[str] = []
    seen.page.on("request", lambda r: sent.append(r.post_data or "") if r.url.endswith("/imports") else None)
    seen.open("", "Sessions")
    seen.page.get_by_label("A session's folder").set_input_files(folder)
    seen.page.get_by_text("DEV-03 is here: 96 load cases measured.").wait_for()
    assert "session.yaml" in sent[0]
    assert "notes.docx" not in sent[0]
    # The list shows it without a reload.
    seen.page.get_by_role("cell", name="DEV-03").first.wait_for()
    seen.page.get_by_role("link", name="Compare it").click()
    seen.page.get_by_role("heading", name="DEV-03: predicted against measured").wait_for()
    # Readings as plain text are packed on the way; another name keeps both.
    packed = folder / "readings.csv.gz"
    (folder / "readings.csv").write_bytes(gzip.decompress(packed.read_bytes()))
    packed.unlink()
    text = (folder / "session.yaml").read_text().replace("readings.csv.gz", "readings.csv")
    (folder / "session.yaml").write_text(text)
    seen.open("", "Sessions")
    seen.page.get_by_label("Under another name").fill("bench-2")
    seen.page.get_by_label("A session's folder").set_input_files(folder)
    seen.page.get_by_text("bench-2 is here: 96 load cases measured.").wait_for()
    assert len(sent[1]) < 2 * len(sent[0])


DROP = """([node, files]) => { const given = new DataTransfer();
for (const [name, text] of files) given.items.add(new File([text], name));
node.dispatchEvent(new DragEvent('drop', { dataTransfer: given, bubbles: true, cancelable: true })); }"""


def test_files_that_are_dropped_are_taken_in_too(seen: Watched) -> None:
    seen.open("", "Sessions")
    text = (find_session(PUBLISHED)).read_text().replace(f"id: {PUBLISHED}", "id: dropped", 1)
    node = seen.page.locator(".drop", has_text="drop the folder").element_handle()
    seen.page.evaluate(DROP, [node, [["session.yaml", text]]])
    seen.page.get_by_text("dropped is here").wait_for()


REFUSED = {
    "no session": "There is no session.yaml among the",
    "no readings": "which is not among the files",
    "a column lacks": "Tz_Nmm",
    "not a number": "expected a finite number",
    "wrong units": "Fx_furlong",
}


@pytest.mark.parametrize("fault", list(REFUSED))
def test_a_folder_that_cannot_be_used_is_refused_in_one_line(seen: Watched, tmp_path: Path, fault: str) -> None:
    folder = folder_of("DEV-03", tmp_path / "bench")
    file = folder / "readings.csv.gz"
    lines = gzip.decompress(file.read_bytes()).decode().splitlines()
    said = REFUSED[fault]
    if fault == "no session":
        (folder / "session.yaml").unlink()
    elif fault == "no readings":
        file.unlink()
    elif fault == "a column lacks":
        lines = [line.rpartition(",")[0] for line in lines]
    elif fault == "not a number":
        lines[5] = re.sub(r"^([^,]*),[^,]*", r"\1,nan", lines[5])
    else:
        lines[0] = lines[0].replace("Fx_N", "Fx_furlong")
    if file.exists():
        file.write_bytes(gzip.compress("\n".join(lines).encode(), 1))
    seen.open("", "Sessions")
    seen.page.get_by_label("Under another name").fill("refused")
    seen.page.get_by_label("A session's folder").set_input_files(folder)
    alert = seen.page.get_by_role("alert").filter(has_text=said)
    alert.wait_for()
    assert "\n" not in alert.inner_text()
    assert seen.page.get_by_role("link", name="refused", exact=True).count() == 0
    seen.complaints = [c for c in seen.complaints if "422" not in c]


@pytest.mark.parametrize("name", ["csv", "parquet", "folder"])
def test_a_session_is_exported(seen: Watched, name: str) -> None:
    titles = {"csv": "cases, CSV", "parquet": "cases, Parquet", "folder": "the session's folder"}
    seen.open("", "Sessions")
    seen.page.locator(f"summary[aria-label='Export {PUBLISHED}']").click()
    with seen.page.expect_download() as found:
        seen.page.get_by_role("link", name=titles[name]).and_(seen.page.locator(f"[href*='{PUBLISHED}']")).click()
    assert found.value.suggested_filename.startswith(PUBLISHED)
    assert Path(found.value.path()).stat().st_size > 500


def test_with_the_service_away_the_list_says_so_and_comes_back(browser: Any, tmp_path: Path) -> None:
    folder = tmp_path / "service"
    with served(folder) as (address, process):
        seen = watched(browser, address)
        seen.open("help", "Help")
        seen.page.get_by_text("live", exact=True).wait_for()
        # What the page still needs is loaded; then the service goes.
        seen.open("", "Sessions")
        seen.page.get_by_text("No session yet.").wait_for()
        process.process.kill()
        seen.page.get_by_text("The service does not answer; trying again").wait_for()
        seen.page.goto(f"{address}/#/help")
        seen.page.get_by_role("alert").filter(has_text="The service does not answer").first.wait_for()
    with served(folder, int(address.rsplit(":", 1)[1])):
        seen.page.goto(f"{address}/#/")
        seen.page.get_by_text("No session yet.").wait_for()
        seen.page.get_by_role("button", name="Load an example").click()
        seen.page.get_by_role("heading", name=TITLE).wait_for()
    assert seen.elsewhere == []
    seen.page.close()
