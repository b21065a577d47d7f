"""Kill the service with -9 again and again while two benches send and refits run, and look at what is left.

    python -m benchmarks.service_kills [--kills 200] [--database sqlite|postgresql] [--seed 0] [--out FILE]

Two journals of known chunks and events are sent by two uplinks; refits are asked for one after the other; a live client
connects again after the last message that it heard. One in nine kills falls into a start, one in twelve shortly after
a refit's end, the others anywhere.
"""

from __future__ import annotations

import argparse
import datetime as dt
import os
import statistics
import tempfile
import time
from pathlib import Path

from benchmarks.machine import commit, use_all_cores
from benchmarks.uplink_parts import surroundings
from tests.server.service.killing import Killed
from tests.server.service.postgres import postgres_url

HERE = Path(__file__).parent
TEXT = """\
Looked at after every kill, in the dead service's database: every chunk, event and job that was acknowledged is there;
each stream's cursor is that of its chunks; each session's version and messages are those of its streams and events; a
job is done where its revision is kept, and nowhere else; the file is sound; no worker lives on. In the end: the
stored chunks are those of the journals byte by byte, the events the same, each once. Each start became ready by itself.
A refit that is killed three times is a failed job with that reason. Other programs ran on the machine at the same time,
so that the times to ready are not those of a quiet one.
"""


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, help="by default 200, and 100 with PostgreSQL")
    parser.add_argument("--database", choices=("sqlite", "postgresql"), default="sqlite")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="by default service_kills.md, or service_kills_postgresql.md")
    given = parser.parse_args()
    postgres = given.database == "postgresql"
    aim = 100 if postgres else 200
    kills = given.kills or aim
    out = given.out or HERE / f"service_kills{'_postgresql' if postgres else ''}.md"
    use_all_cores()
    os.environ["FINGERTWIN_LOG_LEVEL"] = "warning"
    url = None
    if postgres:
        url = os.environ["FINGERTWIN_DATABASE_URL"] = postgres_url()
    where, began = surroundings(), time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        tally = Killed(Path(folder), url, given.seed).run(kills)
    told = tally.acknowledged
    kinds = ", ".join(f"{name} {n}" for name, n in sorted(tally.kills.items()))
    states = ", ".join(f"{name} {n}" for name, n in sorted(tally.jobs.items()))
    rows = [
        ("services killed with -9", f"{tally.kills.total()} ({kinds})", f"{aim}"),
        ("chunks, events, jobs acknowledged", f"{told['chunks']}, {told['events']}, {told['jobs']}", ""),
        ("jobs at the end", states, ""),
        ("messages that the live client heard", f"{tally.heard}", "each that was kept, once, in order"),
        (
            "start to ready, median and longest [s]",
            f"{statistics.median(tally.ready_s):.1f}, {max(tally.ready_s):.1f}",
            "",
        ),
        ("rules that were broken", f"{len(tally.wrong)}", "0"),
    ]
    command = f"python -m benchmarks.service_kills --kills {kills} --database {given.database} --seed {given.seed}"
    lines = [
        "# Killing the service while benches send and refits run",
        "",
        f"Made by `{command}`",
        f"on {dt.datetime.now(dt.UTC).date()}, commit {commit()}, in {time.monotonic() - began:.0f} s. {where}",
        "",
        "| figure | value | aim |",
        "|---|---|---|",
        *(f"| {what} | {value} | {aim} |" for what, value, aim in rows),
        "",
        *TEXT.splitlines(),
        "",
        *(f"- {line}" for line in tally.wrong[:50]),
    ]
    text = "\n".join(lines).rstrip() + "\n"
    out.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
