"""A journal on a disk that fails, is mended and loses power, in orders that Hypothesis draws: what is lost or made up.

    python -m benchmarks.journal_faults [--runs 300] [--out FILE]

The machine is that of `tests/daq/journal/test_journal_faults.py`, which says what must hold after each step.
"""

from __future__ import annotations

import argparse
import datetime as dt
import time
from pathlib import Path

from hypothesis import HealthCheck, settings
from hypothesis.stateful import run_state_machine_as_test

from benchmarks.journal_damage import share
from benchmarks.machine import commit, publish
from benchmarks.uplink_parts import surroundings
from tests.daq.journal.test_journal_faults import FailingDisk

HERE = Path(__file__).parent
KINDS = ("write", "sync", "truncate", "read", "map")


def main() -> None:
    """Run, and write what came to pass; ends with an error at the first run in which a law does not hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--out", type=Path, default=HERE / "journal_faults.md")
    given = parser.parse_args()
    where, began = surroundings(), time.monotonic()
    run_state_machine_as_test(
        FailingDisk,
        settings=settings(
            max_examples=given.runs, stateful_step_count=30, deadline=None, database=None, derandomize=True,
            suppress_health_check=list(HealthCheck),
        ),
    )  # fmt: skip
    tally = FailingDisk.tally
    lines = [
        "# A journal on a disk that fails",
        "",
        f"Made by `python -m benchmarks.journal_faults --runs {given.runs}`",
        f"on {dt.datetime.now(dt.UTC).date()}, commit {commit()}, in {time.monotonic() - began:.0f} s. {where}",
        "",
        "| came to pass | count |",
        "|---|---|",
        *(f"| {name} | {tally[name]} |" for name in sorted(set(tally) - set(KINDS))),
        *(f"| operations of SQLite that failed: {kind} | {tally[kind]} |" for kind in KINDS),
        "",
        f"Of {given.runs} runs none may lose what was acknowledged, or make something up: {share(0, given.runs)}.",
        "",
        "A run appends chunks and events and notes what was sent, while SQLite is told that the disk is full, that it",
        "cannot write, read, sync, cut or map; writes may be short. After a failed sync what was not synced is lost,",
        "as Linux does it. A power cut leaves what was synced and any part of what was written since.",
        "",
    ]
    publish(given.out, lines)


if __name__ == "__main__":
    main()
