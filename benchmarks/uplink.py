"""Fast load cells logged and forwarded at once: what arrives at the service, and what it costs the bench's computer.

    python -m benchmarks.uplink [--minutes 10] [--benches 1] [--service | --to URL --sessions A,B] [--out FILE]

Every part is a process of its own: stand-ins for Net F/T boxes that send 7000 readings a second of six axes, one
`fingertwin log --to` each (journal, uplink and live path on), and a receiver: the small one of the tests, the whole
service, or whatever answers at an address. Processor time and memory are read from /proc (Linux).
"""

from __future__ import annotations

import argparse
import datetime as dt
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from benchmarks.machine import commit, use_all_cores
from benchmarks.uplink_parts import (
    SETTINGS,
    Usage,
    caught_up,
    compared,
    play,
    receive,
    share,
    started,
    surroundings,
    waiting,
)
from benchmarks.uplink_parts import usage as usage_of

RATE_HZ = 7000.0
HERE = Path(__file__).parent
# Until modules are loaded and the first connections made: not counted.
WARM_S = 10.0
LOOK_S = 1.0
FAULTS = ("gap", "overrun", "damaged", "disconnected", "uplink_refused", "quarantined", "not_sent", "service_ahead")


def command(address: str, rate_hz: float, out: Path, url: str, session: str, seconds: float | None) -> list[str]:
    """The command line of a log."""
    settings = [x for name, value in {**SETTINGS, "rate_hz": rate_hz}.items() for x in ("--set", f"{name}={value}")]
    given = ["--serial", "BENCHMARK", "--calibration", "none", "--to", url, "--session", session, "--json", "-"]
    end = [] if seconds is None else ["--seconds", f"{seconds:g}"]
    log = ["log", "--driver", "ati-netft", "--port", address, "--out", str(out), *settings, *given, *end]
    return [sys.executable, "-c", "from server.cli import main; main()", *log]


def logged(minutes: float, benches: int, to: str | None, sessions: list[str], folder: Path) -> dict[str, Any]:
    """Log and forward for so long; return what was seen."""
    seconds = 60.0 * minutes
    with ExitStack() as held:
        receiver = None
        url, names = to or "", sessions
        if to is None:
            receiver, end, (url, names) = held.enter_context(started(receive, folder / "received.sqlite", benches, 0))
        cells = [held.enter_context(started(play, RATE_HZ, seconds + 60.0)) for _ in range(benches)]
        loggers = []
        for k, (_, _, (address, _)) in enumerate(cells):
            line = command(address, RATE_HZ, folder / f"log{k}", url, names[k], seconds)
            loggers.append(held.enter_context(subprocess.Popen(line, stdout=subprocess.PIPE, text=True)))
        watched = {p.pid: list[Usage]() for p in loggers}
        if receiver is not None:
            watched[receiver.pid or 0] = []
        began = time.monotonic()
        busy = os.getloadavg()[0]
        while time.monotonic() - began < seconds and all(p.poll() is None for p in loggers):
            time.sleep(LOOK_S)
            if time.monotonic() - began > min(WARM_S, 0.2 * seconds):
                for pid, course in watched.items():
                    course.append(usage_of(pid))
            busy = max(busy, os.getloadavg()[0])
        told = [json.loads(p.communicate(timeout=120.0)[0]) for p in loggers]
        journals = [folder / f"log{k}" / "journal.sqlite3" for k in range(benches)]
        late = [waiting(j) for j in journals]
        for journal, name, count in zip(journals, names, late, strict=True):
            if count:
                caught_up(journal, url, name)
        if receiver is not None:
            end.send("end")
            end.recv()
            receiver.join(10.0)
    return {
        "told": told,
        "loggers": [watched[p.pid] for p in loggers],
        "receiver": None if receiver is None else watched[receiver.pid or 0],
        "received": (
            [compared(j, folder / "received.sqlite", n) for j, n in zip(journals, names, strict=True)]
            if to is None
            else [at_service(url, n, t) for n, t in zip(names, told, strict=True)]
        ),
        "late": late,
        "faults": [sum(events_of(j).get(kind, 0) for kind in FAULTS) for j in journals],
        "journal_mib": [j.stat().st_size / 2**20 for j in journals],
        "load": busy,
    }


def events_of(journal: Path) -> dict[str, int]:
    """How often each kind of event is in a journal."""
    from collections import Counter

    from daq.journal.reader import JournalReader

    with JournalReader.open(journal) as reader:
        return dict(Counter(e.kind for e in reader.events()))


def at_service(url: str, session: str, told: dict[str, Any]) -> str:
    """What a service says that it has of a log: of another's store only its own word is known."""
    from daq.uplink.link import open_client
    from daq.uplink.wire import Cursor, stream_path
    from server.commands.forwarding import TOKEN

    with open_client(url, os.environ.get(TOKEN)) as client:
        cursor = Cursor.of_answer(client.get(stream_path(session, told["stream"]) + "/cursor").json())
    lacking = max(told["samples"] - cursor.next_seq, 0) + sum(b - a for a, b in cursor.missing)
    return f"{cursor.next_seq} of {told['samples']} samples, {lacking} missing"


def _memory(course: list[Usage]) -> str:
    """Resident memory at the first look, half way and at the last [MiB]."""
    looks = (course[0], course[len(course) // 2], course[-1])
    return ", ".join(f"{u.mib:.0f}" for u in looks)


def rows_of(seen: dict[str, Any]) -> list[tuple[str, list[str], str]]:
    """Figure, its value for each bench, and the aim."""
    told = seen["told"]
    received = [
        c if isinstance(c, str) else f"{c.lost} lost, {c.doubled} twice, {c.different} chunks differ"
        for c in seen["received"]
    ]
    percent = [100.0 * t["samples"] / (RATE_HZ * t["seconds"]) for t in told]
    rows = [
        (
            "readings logged",
            [f"{t['samples']} in {t['seconds']:.1f} s: {p:.3f} %" for t, p in zip(told, percent, strict=True)],
            "as sent",
        ),
        ("gaps, overruns, damage, refusals", [f"{n}" for n in seen["faults"]], "0"),
        ("readings that waited in the journal at the end of the log", [f"{n}" for n in seen["late"]], "0"),
        ("at the receiver, after those", received, "all, once"),
        ("share of one core: logger", [f"{share(c):.1f} %" for c in seen["loggers"]], "15 %"),
        ("memory of the logger: soon, half way, at the end [MiB]", [_memory(c) for c in seen["loggers"]], "flat"),
        ("journal [MiB]", [f"{m:.0f}" for m in seen["journal_mib"]], ""),
    ]
    if seen["receiver"] is not None:
        blank = [""] * (len(told) - 1)
        first = [c for c in seen["received"] if not isinstance(c, str)]
        events = [f"{c.events_lost} lost, {c.events_doubled} twice" for c in first]
        rows.insert(4, ("events at the receiver", events, "all, once"))
        rows.append(("share of one core: receiver, of all benches", [f"{share(seen['receiver']):.1f} %", *blank], ""))
        rows.append(("memory of the receiver [MiB]", [_memory(seen["receiver"]), *blank], ""))
    return rows


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--benches", type=int, default=1)
    parser.add_argument("--service", action="store_true", help="the whole service as the receiver, started here")
    parser.add_argument("--to", help="address of a service; by default the tests' small receiver")
    parser.add_argument("--sessions", help="there, one for each bench, separated by commas")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    if given.to and given.service:
        parser.error("--to and --service exclude each other")
    if given.to and len((given.sessions or "").split(",")) != given.benches:
        parser.error("--to needs --sessions, one for each bench")
    use_all_cores()
    where = surroundings()
    with ExitStack() as held:
        folder = Path(held.enter_context(tempfile.TemporaryDirectory()))
        url, names = given.to, (given.sessions or "").split(",")
        if given.service:
            from benchmarks.service import service

            url, _, _ = held.enter_context(service(folder / "service"))
            names = [f"BENCH-{k + 1}" for k in range(given.benches)]
        seen = logged(given.minutes, given.benches, url, names, folder)
    rows = rows_of(seen)
    heads = [f"bench {k + 1}" for k in range(given.benches)] if given.benches > 1 else ["value"]
    options = (
        f"--minutes {given.minutes:g} --benches {given.benches}"
        + (" --to …" if given.to else "")
        + (" --service" if given.service else "")
    )
    shares = [share(c) for c in seen["loggers"]]
    lines = [
        "# Logging and forwarding fast load cells" + (f", {given.benches} at once" if given.benches > 1 else ""),
        "",
        f"Made by `python -m benchmarks.uplink {options}` on {dt.datetime.now(dt.UTC).date()}, commit {commit()}.",
        f"{where} The highest while it ran: {seen['load']:.1f}.",
        "",
        f"Each bench is a stand-in for a Net F/T box on loopback ({RATE_HZ:g} readings a second of six axes, buffered)",
        "and a `fingertwin log --to`, with journal, uplink and live path; each process by itself.",
        "",
        f"| figure | {' | '.join(heads)} | aim |",
        "|" + "---|" * (len(heads) + 2),
        *(f"| {what} | {' | '.join(values)} | {aim} |" for what, values, aim in rows),
        "",
        f"Processor time is counted from {WARM_S:g} s on. Mean share of the loggers: {statistics.mean(shares):.1f} %.",
        *(
            ["Live envelopes go over the bench's WebSocket, as in a lab; a receiver without one is posted each."]
            if given.service
            else []
            if given.to
            else [
                "The receiver is the small one of the tests, in Python and on one SQLite file: its share says little",
                "of a real service. Every byte in its file is compared with the journal's.",
            ]
        ),
        "",
    ]
    text = "\n".join(lines)
    kind = "_service" if given.service else ""
    out = given.out or HERE / (f"uplink{kind}.md" if given.benches == 1 else f"uplink{kind}_{given.benches}.md")
    out.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
