"""The pages in Chromium: how soon each is there, and whether the bench page's memory grows while a cell sends on.

    python -m benchmarks.pages [--minutes 5] [--out FILE]

The whole service and the browser run on this machine. A page is opened anew several times, the service being warm. The
bench page is then left open while this process plays a load cell of 7000 readings a second into its session, with a
weight hanging; each minute the browser clears its memory, and says how much is left.
"""

from __future__ import annotations

import argparse
import datetime as dt
import os
import statistics
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from benchmarks.live import RATE_HZ, SESSION, begun, hang
from benchmarks.machine import commit, publish, use_all_cores
from tests.browser.pages import Watched, browsing, served, watched

HERE = Path(__file__).parent
RECORDED, TIMES = "DEV-02", 5
PAGES = {
    "Sessions": "",
    "Bench": f"sessions/{RECORDED}/bench",
    "Compare": f"sessions/{RECORDED}/compare",
    "Find the missing effect": f"sessions/{RECORDED}/find",
    "The fall of the error": f"sessions/{RECORDED}/fall",
    "Forces": f"sessions/{RECORDED}/forces",
    "Fingers": "fingers?finger=synek2019_optimised",
    "Studies": "studies",
    "Help": "help",
}
# What the browser needs until it has seen all that it will see again.
WARM_S = 15.0
PAINTED = "() => performance.getEntriesByName('first-contentful-paint')[0]?.startTime"
HEADED = """() => document.querySelector('main h1')?.checkVisibility() && (window.headedMs ??= performance.now())"""
FRAMES = "Number(document.querySelector('.bench').dataset.frames)"
# Looks from which a trend is worth telling.
MANY = 10
Row = tuple[str, str, str]


def first_paints(browser: Any, url: str) -> list[Row]:
    """Open each page several times; return when something, and when its heading, could be seen."""
    rows = []
    for name, path in PAGES.items():
        painted, headed = [], []
        for _ in range(TIMES + 1):
            seen = watched(browser, url)
            seen.page.goto(f"{url}/#/{path}")
            headed.append(float(seen.page.wait_for_function(HEADED, polling="raf").json_value()))
            painted.append(float(seen.page.wait_for_function(PAINTED).json_value()))
            # What one page has asked for is answered before the next one is opened.
            seen.page.wait_for_load_state("networkidle")
            seen.page.close()
        # The first time warms the service up.
        median = statistics.median(painted[1:])
        rows.append((f"{name}: first paint", f"{median:.0f} ms, {max(painted[1:]):.0f} at most", "300 ms"))
        rows.append((f"{name}: heading", f"{statistics.median(headed[1:]):.0f} ms", ""))
    return rows


class Heap:
    """What a page holds and does.

    Args:
        seen: the page.
    """

    def __init__(self, seen: Watched) -> None:
        self._page = seen.page
        self._session = seen.page.context.new_cdp_session(seen.page)
        self._session.send("HeapProfiler.enable")
        self._session.send("Performance.enable")

    def now(self) -> dict[str, float]:
        """Memory that is in use once the browser has cleared it, what it has worked, and what the page has drawn."""
        self._session.send("HeapProfiler.collectGarbage")
        found = {m["name"]: float(m["value"]) for m in self._session.send("Performance.getMetrics")["metrics"]}
        kept = {k: found[k] for k in ("JSHeapUsedSize", "Nodes", "TaskDuration")}
        return kept | {"frames": float(self._page.evaluate(FRAMES)), "at_s": time.monotonic()}


def bench_page(browser: Any, url: str, minutes: float) -> list[Row]:
    """Leave the bench page open under full load; return how its memory went."""
    with httpx.Client(base_url=url, timeout=30.0) as client, ExitStack() as held:
        events, _ = begun(url, client, held)
        seen = watched(browser, url)
        seen.open(f"sessions/{SESSION}/bench", f"{SESSION}: the bench")
        time.sleep(6.0)
        hang(events)
        time.sleep(WARM_S)
        heap = Heap(seen)
        looks = [heap.now()]
        every_s = min(60.0, 60.0 * minutes / 2)
        while looks[-1]["at_s"] - looks[0]["at_s"] < 60.0 * minutes - 1.0:
            time.sleep(every_s)
            looks.append(heap.now())
        seen.page.close()
    took_s = looks[-1]["at_s"] - looks[0]["at_s"]
    drawn = (looks[-1]["frames"] - looks[0]["frames"]) / took_s
    worked = 100.0 * (looks[-1]["TaskDuration"] - looks[0]["TaskDuration"]) / took_s
    said = f"Bench at {RATE_HZ:g} readings/s, looked at every {every_s:.0f} s"
    return [
        *memory_rows(said, [look["JSHeapUsedSize"] for look in looks], took_s / 60.0),
        ("elements of the document", course([look["Nodes"] for look in looks], 0), "flat"),
        ("frames drawn a second", f"{drawn:.1f}", "at most 30"),
        ("share of one core, the page's main thread", f"{worked:.1f} %", ""),
        ("complaints of the browser", f"{len(seen.complaints)}", "0"),
        ("requests elsewhere than to the service", f"{len(seen.elsewhere)}", "0"),
    ]


def course(values: Sequence[float], digits: int) -> str:
    """Values in order; of many, the medians of twelve parts."""
    parts = np.array_split(np.asarray(values), min(12, len(values)))
    return ", ".join(f"{np.median(part):.{digits}f}" for part in parts)


def memory_rows(what: str, sizes: Sequence[float], minutes: float) -> list[Row]:
    """How a page's memory went: `sizes` [bytes] at even times over some minutes."""
    held = [size / 2**20 for size in sizes]
    rows = [
        (f"{what}: JS heap, in order", f"{course(held, 2)} MiB", "flat"),
        ("the same, least and most", f"{min(held):.2f} and {max(held):.2f} MiB", ""),
        ("the same, from the first to the last", f"{held[-1] - held[0]:+.2f} MiB in {minutes:.0f} minutes", "0"),
    ]
    later = [1024.0 * size for size in held[len(held) // 2 :]]
    if len(later) > MANY:
        trend, covariance = np.polyfit(np.arange(len(later)) * minutes / (len(held) - 1), later, 1, cov=True)
        said = f"{trend[0]:+.1f} ± {2.0 * covariance[0, 0] ** 0.5:.1f} KiB/min"
        rows.append(("the same, trend of the second half with two standard errors", said, "0"))
    return rows


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--out", type=Path, default=HERE / "pages.md")
    given = parser.parse_args()
    # Service, browser and player share the machine, as on a bench's PC.
    use_all_cores()
    before = os.getloadavg()
    with tempfile.TemporaryDirectory() as folder, served(Path(folder)) as (url, _), browsing() as browser:
        from fingertwin.client import Client

        with Client(url) as twin:
            twin.upload(RECORDED)
        rows = first_paints(browser, url)
        rows += bench_page(browser, url, given.minutes)
        version = browser.version
    after = os.getloadavg()
    lines = [
        "# The pages in a browser",
        "",
        f"Made by `python -m benchmarks.pages --minutes {given.minutes:g}` on {dt.datetime.now(dt.UTC).date()}, commit",
        f"{commit()}: Chromium {version}, headless, 1280 x 800; service, browser and a load cell of",
        f"{RATE_HZ:g} readings a second on one machine; {os.cpu_count()} cores, load average {before[0]:.1f} before",
        f"and {after[0]:.1f} after. First paints are the browser's own `first-contentful-paint`, medians of {TIMES}",
        "pages that were opened anew, each once all that the one before had asked for was answered.",
        "",
        "| figure | value | aim |",
        "|---|---|---|",
        *(f"| {what} | {value} | {aim} |" for what, value, aim in rows),
        "",
    ]
    publish(given.out, lines)


if __name__ == "__main__":
    main()
