"""The report of a comparison in a real browser, without any network: every figure is drawn, nothing complains."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.requirements import demanded

NAMES = ("chromium", "chromium-browser", "google-chrome")
HEADINGS = ("Summary", "Force components", "Tip forces", "metacarpal", "errors", "Load cases")
PNG = b"\x89PNG\r\n\x1a\n"
BROWSER = next((path for name in NAMES if (path := shutil.which(name))), None)

if BROWSER is None and not demanded("browser"):
    pytest.skip("chromium is not installed: the report is not opened in a browser", allow_module_level=True)


class Page(NamedTuple):
    source: str
    dom: str
    log: str


class Elements(HTMLParser):
    """Counts what the page holds: headings, figures, and those that Plotly has drawn into."""

    def __init__(self) -> None:
        super().__init__()
        self.headings: list[str] = []
        self.figures: list[str] = []
        self.drawn: list[str] = []
        self.addresses: list[str] = []
        self._in_heading = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attrs}
        classes = values.get("class", "").split()
        self._in_heading = tag in ("h1", "h2")
        if self._in_heading:
            self.headings.append("")
        if "plot" in classes:
            self.figures.append(values["id"])
            if "js-plotly-plot" in classes:
                self.drawn.append(values["id"])
        if tag in ("script", "link", "img", "iframe"):
            self.addresses += [v for k in ("src", "href") if (v := values.get(k)) and not v.startswith("data:")]

    def handle_endtag(self, tag: str) -> None:
        self._in_heading = False

    def handle_data(self, data: str) -> None:
        if self._in_heading:
            self.headings[-1] += data


def elements(text: str) -> Elements:
    out = Elements()
    out.feed(text)
    return out


@pytest.fixture(scope="module")
def browser() -> str:
    if BROWSER is None:
        pytest.fail("chromium is not installed, and FINGERTWIN_REQUIRE asks for a browser")
    return BROWSER


def opened(browser: str, page: Path, folder: Path, *what: str) -> subprocess.CompletedProcess[str]:
    """Open a page in a fresh profile that resolves no address."""
    options = [
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-background-networking",
        "--disable-dev-shm-usage",
    ]
    options += ["--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={folder / 'profile'}", "--hide-scrollbars"]
    options += ["--enable-logging=stderr", "--v=0", "--virtual-time-budget=20000", "--window-size=1300,4000"]
    return subprocess.run(  # noqa: S603
        [browser, *options, *what, page.as_uri()], capture_output=True, text=True, timeout=120, check=True
    )


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    command = [sys.executable, "-m", "server.cli", "compare", "synek2019_H01", "--figures", str(folder)]
    subprocess.run(command, check=True, capture_output=True, timeout=300)  # noqa: S603
    return folder / "compare.html"


@pytest.fixture(scope="module")
def page(browser: str, file: Path, tmp_path_factory: pytest.TempPathFactory) -> Page:
    done = opened(browser, file, tmp_path_factory.mktemp("browser"), "--dump-dom")
    return Page(file.read_text(encoding="utf-8"), done.stdout, done.stderr)


def test_every_figure_is_drawn(page: Page) -> None:
    wanted, found = elements(page.source), elements(page.dom)
    assert len(wanted.figures) >= 5
    assert found.figures == found.drawn == wanted.figures
    # Plotly lays three drawings over each other in every figure.
    svg = re.findall(r'<svg[^>]* class="main-svg"', page.dom)
    assert len(svg) == 3 * len(wanted.figures)


def test_the_browser_complains_of_nothing(page: Page) -> None:
    assert [line for line in page.log.splitlines() if "CONSOLE" in line] == []
    assert "Uncaught" not in page.log


def test_headings_and_tables_are_there(page: Page) -> None:
    headings = elements(page.dom).headings
    assert "synek2019_H01" in headings[0]
    assert [h for h in HEADINGS if not any(h in found for found in headings)] == []
    assert page.dom.count("<tr>") > 40


def test_the_page_asks_for_nothing_else(page: Page) -> None:
    assert elements(page.source).addresses == []


def test_a_complaint_would_be_seen(browser: str, tmp_path: Path) -> None:
    broken = tmp_path / "broken.html"
    broken.write_text("<script>console.error('no'); fetch('https://example.org/x')</script>", encoding="utf-8")
    log = opened(browser, broken, tmp_path, "--dump-dom").stderr
    assert len([line for line in log.splitlines() if "CONSOLE" in line]) >= 2


def test_a_picture_of_the_page_can_be_taken(browser: str, file: Path, tmp_path: Path) -> None:
    picture = tmp_path / "page.png"
    opened(browser, file, tmp_path, f"--screenshot={picture}")
    data = picture.read_bytes()
    assert data.startswith(PNG)
    assert len(data) > 100_000
