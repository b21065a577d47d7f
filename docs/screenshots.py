"""Pictures of the pages for the documentation: `python docs/screenshots.py [NAME …]`.

A service of its own is started on a temporary folder, with shipped sessions; the missing effect is searched and added
in the pages themselves, as a user would, and each page is taken as it then stands.
"""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from PIL import Image

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
from tests.browser.bench_story import bench as running_bench  # noqa: E402
from tests.browser.pages import Watched, browsing, served, watched  # noqa: E402

SESSION, OTHERS = "DEV-02", ("DEV-08", "synek2019_H01")
IMAGES = HERE / "images"
RECORDINGS = HERE.parent / "data" / "recordings"
SIZE = {"width": 1280, "height": 800}
MOST_BYTES = 200_000
BENCH = "bench"
# A picture is taken once the page has shown nothing new for so long [ms].
SETTLED_MS = 700
TO_SECTION = "e => e.closest('section').scrollIntoView()"


def sessions(seen: Watched) -> None:
    """The list of sessions and specimens."""
    seen.open("", "Sessions")
    seen.page.get_by_role("heading", name="Specimens").wait_for()


def compare(seen: Watched) -> None:
    """Predicted against measured."""
    seen.open(f"sessions/{SESSION}/compare", f"{SESSION}: predicted against measured")
    seen.drawn()


def case(seen: Watched) -> None:
    """One load case with its readings and windows."""
    seen.open(f"sessions/{SESSION}/compare?case=c010", f"{SESSION}: predicted against measured")
    seen.drawn(2)
    seen.page.locator("#case").scroll_into_view_if_needed()
    seen.page.evaluate("document.getElementById('case').scrollIntoView()")


def find(seen: Watched) -> None:
    """The verdict and what it stands on."""
    seen.open(f"sessions/{SESSION}/find", f"{SESSION}: find the missing effect")
    seen.drawn()


def explanations(seen: Watched) -> None:
    """Explanations, and what was tested and ruled out."""
    find(seen)
    seen.page.get_by_role("heading", name="Explanations").evaluate("e => e.closest('section').scrollIntoView()")


def effect(seen: Watched) -> None:
    """What an effect is."""
    seen.open(f"sessions/{SESSION}/find", f"{SESSION}: find the missing effect")
    seen.page.get_by_role("link", name="What is that?").click()
    seen.drawn(2)


def fall(seen: Watched) -> None:
    """The fall of the error."""
    seen.open(f"sessions/{SESSION}/fall", f"{SESSION}: the fall of the error")
    seen.drawn(2)


def before_after(seen: Watched) -> None:
    """Before and after, on the finger."""
    fall(seen)
    seen.page.get_by_role("heading", name="The step", exact=True).evaluate("e => e.closest('section').scrollIntoView()")


def report(seen: Watched) -> None:
    """The report, to be printed or saved."""
    seen.open(f"sessions/{SESSION}/report", f"{SESSION}: report")
    seen.page.get_by_text("Ready. The browser's own dialogue").wait_for()


def forces(seen: Watched) -> None:
    """Forces inside the finger, beside what really hung."""
    seen.open(f"sessions/{SESSION}/forces?closure=least_squares", f"{SESSION}: forces inside the finger")
    seen.drawn(2)
    seen.page.get_by_role("heading", name="Muscle forces", exact=True).evaluate(TO_SECTION)


def fingers(seen: Watched) -> None:
    """A finger, and what drives it in a movement."""
    seen.open("fingers?finger=wu2008_index", "Fingers")
    seen.page.get_by_role("button", name="Work it out").click()
    seen.drawn(2)
    seen.page.get_by_role("heading", name="Forces in a movement").evaluate(TO_SECTION)


def studies(seen: Watched) -> None:
    """A published study, every figure beside ours."""
    seen.open("studies?study=wu2008", "Published studies")
    seen.page.get_by_role("button", name=re.compile("Compute")).click()
    seen.page.get_by_text(re.compile("figures that can be recomputed agree")).wait_for(timeout=600_000)
    seen.drawn()
    seen.page.get_by_role("heading", name="Published and ours").evaluate(TO_SECTION)


def new(seen: Watched) -> None:
    """A lab's recording with the notebook laid onto its plateaus."""
    seen.open("new", "New session from a recording")
    seen.page.get_by_label("Recordings", exact=True).set_input_files([RECORDINGS / "rig.csv"])
    seen.page.get_by_role("button", name="That is right").click()
    seen.page.get_by_label("Typed or pasted").fill((RECORDINGS / "notes.txt").read_text("utf-8"))
    seen.page.get_by_role("button", name="Lay onto the plateaus").click()
    seen.drawn(2)
    seen.page.mouse.move(0, 0)
    # The lower trace and the table below it.
    seen.page.get_by_text("8 plateaus;").evaluate("e => window.scrollBy(0, e.getBoundingClientRect().top - 390)")


def help_page(seen: Watched) -> None:
    """Help."""
    seen.open("help", "Help")


# Name of the picture, what brings the page there, light or dark.
PAGES: list[tuple[str, Callable[[Watched], None], str]] = [
    ("sessions", sessions, "light"),
    ("compare", compare, "light"),
    ("compare-dark", compare, "dark"),
    ("case", case, "light"),
    ("find", find, "light"),
    ("explanations", explanations, "light"),
    ("effect", effect, "light"),
    ("fall", fall, "light"),
    ("before-after", before_after, "light"),
    ("report", report, "light"),
    ("forces", forces, "light"),
    ("fingers", fingers, "light"),
    ("studies", studies, "light"),
    ("new", new, "light"),
    ("help", help_page, "light"),
]


def found_and_added(seen: Watched) -> None:
    """Search for the missing effect and add it."""
    seen.open(f"sessions/{SESSION}/find", f"{SESSION}: find the missing effect")
    seen.page.get_by_role("button", name="Find the missing effect").click()
    seen.page.get_by_role("heading", name="The verdict").wait_for(timeout=600_000)
    seen.page.get_by_role("button", name=re.compile("^Add .*, and refit$")).first.click()
    seen.page.get_by_role("heading", name=f"{SESSION}: the fall of the error").wait_for(timeout=600_000)


def take_bench(browser: Any, url: str, folder: Path) -> Path:
    """The bench while a weight hangs, with a stand-in for the load cell on a terminal's wire."""
    with running_bench(folder, url, session="finger-7") as story:
        story.wait_for("bench started")
        seen = opened(browser, url, "light")
        seen.open(f"sessions/{story.session}/bench", f"{story.session}: the bench")
        key = seen.page.locator
        key('.keypad [data-command="next"]').click()
        story.rig("off")
        seen.page.wait_for_timeout(SETTLED_MS)
        key('.keypad [data-command="tare"]').click()
        story.wait_for("  tare;")
        story.rig("hang c001")
        seen.page.wait_for_timeout(SETTLED_MS)
        key('.keypad [data-command="loaded"]').click()
        key('[data-command="confirm"].suggested').wait_for()
        seen.page.wait_for_function(
            "() => !document.querySelector('.now-prediction').textContent.includes('being computed')"
        )
        file = take(seen, BENCH)
        if seen.complaints or seen.elsewhere:
            raise SystemExit(f"{BENCH}: {seen.complaints + seen.elsewhere}")
        seen.page.close()
        return file


def take(seen: Watched, name: str) -> Path:
    """Keep the page as it stands as a small picture."""
    seen.page.wait_for_timeout(SETTLED_MS)
    whole = Image.open(io.BytesIO(seen.page.screenshot())).convert("RGB")
    file = IMAGES / f"{name}.png"
    whole.quantize(colors=96, dither=Image.Dither.NONE).save(file, optimize=True)
    if file.stat().st_size > MOST_BYTES:
        raise SystemExit(f"{file.name} has {file.stat().st_size} bytes; expected at most {MOST_BYTES}")
    return file


def main(wanted: list[str]) -> None:
    """Take the pictures that are named, or all."""
    from fingertwin.client import Client

    names = [BENCH, *(name for name, _, _ in PAGES)]
    unknown = set(wanted) - set(names)
    if unknown:
        raise SystemExit(f"no picture {', '.join(sorted(unknown))}; there are {', '.join(names)}")
    IMAGES.mkdir(exist_ok=True)
    with TemporaryDirectory(prefix="fingertwin-") as folder, served(Path(folder)) as (url, _), browsing() as browser:
        if not wanted or BENCH in wanted:
            with TemporaryDirectory(prefix="fingertwin-") as other:
                said(take_bench(browser, url, Path(other) / "bench"))
        if wanted == [BENCH]:
            return
        with Client(url) as twin:
            for name in (SESSION, *OTHERS):
                twin.upload(name)
        first = opened(browser, url, "light")
        found_and_added(first)
        first.page.close()
        for name, bring, colours in PAGES:
            if wanted and name not in wanted:
                continue
            seen = opened(browser, url, colours)
            bring(seen)
            file = take(seen, name)
            if seen.complaints or seen.elsewhere:
                raise SystemExit(f"{name}: {seen.complaints + seen.elsewhere}")
            seen.page.close()
            said(file)


def said(file: Path) -> None:
    """Say that a picture was taken."""
    print(f"{file.relative_to(HERE.parent)}  {file.stat().st_size / 1000:.0f} kB")


def opened(browser: Any, url: str, colours: str) -> Watched:
    """A new page of the size of the pictures."""
    return watched(browser, url, viewport=SIZE, color_scheme=colours)


if __name__ == "__main__":
    main(sys.argv[1:])
