"""Every driver against damaged streams: no crash, no wrong reading where there is a checksum, back within two frames.

    python -m benchmarks.driver_fuzz [--streams 10000] [--drivers a,b] [--out FILE]

The damage and the conditions are those of `tests/contracts/test_drivers.py`, which tries a few; every stream is told
by its seed.
"""

from __future__ import annotations

import argparse
import datetime as dt
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from benchmarks.machine import commit

HERE = Path(__file__).parent
PORTION = 500


def tried(job: tuple[str, int, int]) -> list[str]:
    """Try streams of one driver; return what went wrong."""
    from tests.contracts.test_drivers import check_mutated

    name, first, count = job
    out = []
    for seed in range(first, first + count):
        try:
            check_mutated(name, seed)
        except Exception as error:
            out.append(f"{name} seed {seed}: {type(error).__name__} {str(error).splitlines()[0][:200]}")
    return out


def main() -> None:
    """Run and write."""
    from daq.standins import REGISTRY

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--streams", type=int, default=10_000)
    parser.add_argument("--drivers", default=",".join(REGISTRY))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=HERE / "driver_fuzz.md")
    given = parser.parse_args()
    lines = [
        "# Drivers against damaged streams",
        "",
        f"Made by `python -m benchmarks.driver_fuzz --streams {given.streams}` on {dt.datetime.now(dt.UTC).date()},",
        f"commit {commit()}. Damage: bits flipped, pieces deleted, inserted, doubled, cut off, overwritten.",
        "",
        "| driver | streams | failures | seconds |",
        "|---|---|---|---|",
    ]
    wrong: list[str] = []
    with ProcessPoolExecutor(given.workers) as pool:
        for name in given.drivers.split(","):
            began = time.perf_counter()
            jobs = [(name, a, min(PORTION, given.streams - a)) for a in range(0, given.streams, PORTION)]
            found = [text for part in pool.map(tried, jobs) for text in part]
            wrong += found
            lines.append(f"| {name} | {given.streams} | {len(found)} | {time.perf_counter() - began:.0f} |")
            print(lines[-1], flush=True)
    lines += ["", *(f"- {text}" for text in wrong[:20]), ""]
    given.out.write_text("\n".join(lines).rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
