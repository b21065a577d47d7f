"""A journal on a disk that fails, is mended and loses power, in orders that Hypothesis draws: what is lost or made up.

    python -m benchmarks.journal_faults [--service] [--runs 300] [--out FILE]

The machine is that of `tests/daq/journal/test_journal_faults.py`, which says what must hold after each step; with
--service, that of `tests/server/service/storage/test_service_faults.py`.
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
from tests.server.service.storage.test_service_faults import FailingService

HERE = Path(__file__).parent
KINDS = ("write", "sync", "truncate", "read", "map")


def main() -> None:
    """Run, and write what came to pass; ends with an error at the first run in which a law does not hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--service", action="store_true")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    machine, name = (FailingService, "service") if given.service else (FailingDisk, "journal")
    where, began = surroundings(), time.monotonic()
    run_state_machine_as_test(
        machine,
        settings=settings(
            max_examples=given.runs, stateful_step_count=30, deadline=None, database=None, derandomize=True,
            suppress_health_check=list(HealthCheck),
        ),
    )  # fmt: skip
    tally = machine.tally
    lines = [
        f"# A {name} on a disk that fails",
        "",
        f"Made by `python -m benchmarks.journal_faults {'--service ' * given.service}--runs {given.runs}`",
        f"on {dt.datetime.now(dt.UTC).date()}, commit {commit()}, in {time.monotonic() - began:.0f} s. {where}",
        "",
        "| came to pass | count |",
        "|---|---|",
        *(f"| {name} | {tally[name]} |" for name in sorted(set(tally) - set(KINDS))),
        *(f"| operations of SQLite that failed: {kind} | {tally[kind]} |" for kind in KINDS),
        "",
        f"Of {given.runs} runs none may lose what was acknowledged, or make something up: {share(0, given.runs)}.",
        "",
        "In a run three benches send chunks at once, and events, while SQLite is told that the disk is full, that it"
        if given.service
        else "In a run chunks, events and what was sent are noted, while SQLite is told that the disk is full, that it",
        "cannot write, read, sync, cut or map; writes may be short. After a failed sync what was not synced is lost,",
        "as Linux does it. A power cut leaves what was synced and any part of what was written since.",
        "",
    ]
    publish(given.out or HERE / f"{name}_faults.md", lines)


if __name__ == "__main__":
    main()
