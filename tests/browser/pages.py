"""The pages in a real Chromium against a service of their own, watched for whatever goes wrong."""

from __future__ import annotations

import io
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from tests.requirements import demanded
from tests.server.service.processes import Process

BROWSER = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
OFFLINE = "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1"


def require_browser() -> None:
    """Skip, with a line, where there is no Chromium and none is required."""
    if BROWSER is None and not demanded("browser"):
        pytest.skip("chromium is not installed: the pages are not opened in a browser", allow_module_level=True)


@dataclass
class Watched:
    """A page, and what it complained of.

    Attributes:
        page: of Playwright.
        url: of the service.
        complaints: of the console, and scripts that failed.
        elsewhere: addresses that were asked for and are not the service's.
    """

    page: Any
    url: str
    complaints: list[str] = field(default_factory=list)
    elsewhere: list[str] = field(default_factory=list)

    def open(self, path: str, heading: str) -> None:
        """Go to a page and wait for its heading."""
        self.page.goto(f"{self.url}/#/{path}")
        self.page.get_by_role("heading", level=1, name=heading).wait_for()

    def drawn(self, least: int = 1) -> None:
        """Wait until so many figures are drawn, and none is being drawn."""
        self.page.locator(".js-plotly-plot").nth(least - 1).wait_for()
        self.page.wait_for_function(
            "() => !document.querySelector('[aria-busy]') && ![...document.querySelectorAll('p')]"
            ".some((p) => p.textContent === 'Drawing …')"
        )

    def text(self) -> str:
        """All that can be read."""
        return str(self.page.locator("main").inner_text())


def violations(page: Any) -> list[str]:
    """What axe-core has against a page as it stands."""
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page).response["violations"]
    return [f"{v['id']}: {n['html'][:200]}" for v in found for n in v["nodes"]]


# By how much a page is wider than its window [px].
BEYOND = "document.documentElement.scrollWidth - document.documentElement.clientWidth"


def shade(place: Any, side: str = "right") -> float:
    """How dark the edge of a place that scrolls is, at its right or below, between what is written there."""
    import numpy as np
    from PIL import Image

    picture = np.asarray(Image.open(io.BytesIO(place.screenshot(animations="disabled"))).convert("L")).astype(float)
    # Nine in ten of its dots are darker than that: what is bright there is the paper. Above stand headings, and at
    # the left the first column: they stay in sight, and hide the shade.
    edge = picture[-3:-1, picture.shape[1] // 4 :] if side == "below" else picture[len(picture) // 2 : -20, -3:-1]
    return 255.0 - float(np.percentile(edge, 90))


# Where a point of a figure is on the page: [x, y] in px; a cell of a map is named by row and column.
PLACE = """([number, curve, at]) => {
  const plot = document.querySelectorAll('.js-plotly-plot')[number];
  const trace = plot.data[curve];
  const [row, column] = Array.isArray(at) ? at : [at, at];
  const axis = (name) => plot._fullLayout[name.replace(/^([xy])/, '$1axis')];
  const [x, y] = [axis(trace.xaxis || 'x'), axis(trace.yaxis || 'y')];
  plot.scrollIntoView({ block: 'center' });
  const box = plot.getBoundingClientRect();
  return [box.left + x._offset + x.d2p(trace.x[column]), box.top + y._offset + y.d2p(trace.y[row])];
}"""


def click_point(page: Any, curve: int, at: Any, number: int = 0, aside: float = 0.0) -> None:
    """Click on a point of a figure with the mouse.

    Args:
        page: of Playwright.
        curve: number of the trace.
        at: number of the point, or row and column of a map.
        number: of the figure on the page.
        aside: so many px to the left, such as into a bar.
    """
    x, y = page.evaluate(PLACE, [number, curve, at])
    page.mouse.move(x - aside - 1, y)
    page.mouse.move(x - aside, y)
    page.wait_for_timeout(100)
    page.mouse.click(x - aside, y)


@contextmanager
def browsing() -> Iterator[Any]:
    """A browser without any network but this machine's."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", OFFLINE]
        browser = playwright.chromium.launch(executable_path=BROWSER, args=arguments)
        yield browser
        browser.close()


def watched(browser: Any, url: str, **given: Any) -> Watched:
    """Open a new page that is watched."""
    page = browser.new_page(**({"viewport": {"width": 1280, "height": 800}} | given))
    page.set_default_timeout(60_000)
    out = Watched(page, url)
    page.on(
        "console",
        lambda m: out.complaints.append(f"{m.text} ({m.location['url']})") if m.type in ("error", "warning") else None,
    )
    page.on("pageerror", lambda error: out.complaints.append(str(error)))
    page.on("request", lambda r: None if r.url.startswith((url, "data:", "blob:")) else out.elsewhere.append(r.url))
    return out


@contextmanager
def served(folder: Path, port: int = 0, *, readers: bool = False) -> Iterator[tuple[str, Process]]:
    """A service with its address.

    Args:
        folder: for its data.
        port: or any.
        readers: whether a process of its own answers what only reads: it takes as long to start as the service.
    """
    command = ["-m", "server.cli", "serve", "--data", str(folder), "--port", str(port)]
    process = Process(command, FINGERTWIN_READER_PROCESS=str(readers))
    try:
        yield process.address(), process
    finally:
        process.close()
