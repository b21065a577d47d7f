"""Every address of the service's OpenAPI document asked by schemathesis, on SQLite or PostgreSQL.

    python -m benchmarks.openapi_fuzz [--cases 20000] [--database sqlite|postgresql] [--seed 0] [--out FILE]

A service runs as a process of its own on loopback, with sessions, readings, a revision and jobs in it. Asked are the
documented examples, the edges of every schema, random cases right and wrong, and chains of requests by their links.
"""

from __future__ import annotations

import argparse
import datetime as dt
import os
import re
import tempfile
import time
from collections.abc import Iterable, Mapping
from pathlib import Path

from benchmarks.machine import commit, use_all_cores
from tests.server.service.asking import Tally, asked, prepared
from tests.server.service.postgres import postgres_url
from tests.server.service.processes import running, whole

HERE = Path(__file__).parent
PHASES = ("examples", "coverage", "fuzzing", "stateful")
# Of each operation and round; the first round has the edges too, the next ones draw anew.
EXAMPLES = 50
TITLE = {"sqlite": "SQLite", "postgresql": "PostgreSQL"}


def fuzzed(cases: int, seed: int, folder: Path) -> tuple[Tally, str]:
    """Ask until there are as many cases; return what came of it, and what the service logged."""
    tally = Tally()
    with running(whole(folder)) as service:
        url = service.address()
        with service.client() as client:
            ids = prepared(client)
        round_ = 0
        while sum(tally.cases.values()) < cases:
            phases = PHASES if round_ == 0 else PHASES[2:]
            tally.add(asked(url, ids, examples=EXAMPLES, seed=seed + round_, phases=phases))
            round_ += 1
            print(f"{sum(tally.cases.values())} cases, {len(tally.failures)} failures", flush=True)
        return tally, service.log


def report(tally: Tally, log: str, database: str, command: str, seconds: float) -> list[str]:
    """Lines of a section."""
    total = sum(tally.cases.values())
    failed = sum(n for status, n in tally.statuses.items() if status >= 500)
    faults = len(re.findall(r"^Traceback", log, re.MULTILINE))
    lines = [
        f"## {TITLE[database]}",
        "",
        f"Made by `{command}` on {dt.datetime.now(dt.UTC).date()}, commit {commit()}, in {seconds:.0f} s.",
        "",
        "| figure | value | aim |",
        "|---|---|---|",
        f"| cases | {total} | 20000 |",
        f"| addresses and methods | {len(tally.cases)} | all |",
        f"| answers of 500 and above | {failed} | 0 |",
        f"| failures in the service's log | {faults} | 0 |",
        f"| checks that failed, by address | {len(tally.failures)} | 0 |",
        f"| errors of schemathesis | {len(tally.errors)} | 0 |",
        "",
        "Cases by phase: " + _counted(tally.phases) + ".",
        "Answers by status: " + _counted(tally.statuses) + ".",
        "",
        "| address | cases |",
        "|---|---|",
        *(f"| {label} | {n} |" for label, n in sorted(tally.cases.items(), key=lambda r: r[0].split()[::-1])),
        "",
    ]
    for (label, check), text in sorted(tally.failures.items()):
        lines += [f"- {label}, {check}:", "", *(f"      {line[:300]}" for line in text.splitlines()[:12]), ""]
    return lines + [f"- {error.splitlines()[0][:300]}" for error in tally.errors]


def _counted(counts: Mapping[str, int] | Mapping[int, int]) -> str:
    return ", ".join(f"{k} {n}" for k, n in sorted(counts.items(), key=str))


HEAD = """\
# Every address of the OpenAPI document, asked by schemathesis

Checks: no answer of 500 and above, no status and no media type that is not documented, every body as its schema says,
headers as documented, wrong data refused, a missing header refused, methods that are not documented answered by 405
with the others in `Allow`, nothing there any more once it is deleted, and what was created can be found.

Not checked: that all data that fit the schema are accepted (`positive_data_acceptance`), because what is well formed
may name nothing that exists; tokens (`ignored_auth`), because on loopback none is needed. Passed over:
`unsupported_method` at `…/events/{epoch}/cursor`, where PUT is taken for an event whose number is no number (422).
Ids of a session, cases, a stream, an edit, a revision and jobs that exist are drawn for four in five of the addresses;
bodies of chunks and events that fit their schema carry their true SHA-256; jobs are cancelled after a second.
"""


def merged(out: Path, section: Iterable[str], database: str) -> str:
    """The file with one section made anew, and the other kept."""
    found = out.read_text(encoding="utf-8") if out.exists() else ""
    parts = {m[1]: m[0].rstrip() for m in re.finditer(r"^## (\w+)\n.*?(?=^## |\Z)", found, re.MULTILINE | re.DOTALL)}
    parts[TITLE[database]] = "\n".join(section).rstrip()
    return "\n\n".join([HEAD.rstrip(), *(parts[t] for t in TITLE.values() if t in parts)]) + "\n"


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=20_000)
    parser.add_argument("--database", choices=list(TITLE), default="sqlite")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=HERE / "openapi_fuzz.md")
    given = parser.parse_args()
    use_all_cores()
    os.environ["FINGERTWIN_LOG_LEVEL"] = "warning"
    if given.database == "postgresql":
        os.environ["FINGERTWIN_DATABASE_URL"] = postgres_url()
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        tally, log = fuzzed(given.cases, given.seed, Path(folder))
    command = f"python -m benchmarks.openapi_fuzz --cases {given.cases} --database {given.database} --seed {given.seed}"
    section = report(tally, log, given.database, command, time.monotonic() - began)
    given.out.write_text(merged(given.out, section, given.database), encoding="utf-8")
    print("\n".join(section))


if __name__ == "__main__":
    main()
