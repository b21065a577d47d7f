"""A long afternoon at the bench: does the memory of the logger or of the service grow?

    python -m benchmarks.endurance [--minutes 60] [--out FILE]

A stand-in for a Net F/T box (7000 readings a second of six axes, buffered), a `fingertwin log --to` with journal,
uplink and live path, a whole `fingertwin serve`, and two live clients at 30 Hz; each a process of its own. Linux.
"""

from __future__ import annotations

import argparse
import datetime as dt
import json
import os
import subprocess
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from benchmarks.machine import commit, publish, use_all_cores
from benchmarks.service import service
from benchmarks.uplink import FAULTS, RATE_HZ, at_service, command, events_of
from benchmarks.uplink_parts import Usage, play, share, started, surroundings, usage, waiting

HERE = Path(__file__).parent
SESSION = "endurance"
# Until modules are loaded and the first connections made: not counted.
WARM_S, LOOK_S = 60.0, 5.0
CLIENTS, COLUMNS = 2, 7


def listen(end: Any, url: str) -> None:
    """A live client's process: counts frames until it is told to end."""
    from websockets.sync.client import connect

    frames = 0
    address = f"{url.replace('http', 'ws', 1)}/api/v1/live?session={SESSION}&rate_hz=30"
    with connect(address, compression=None) as socket:
        end.send("listening")
        while not end.poll():
            socket.recv(timeout=30.0)
            frames += 1
    end.send(frames)


def watched(minutes: float, folder: Path) -> dict[str, Any]:
    """Log for so long; return the course of both processes' memory."""
    with ExitStack() as held:
        url, pid, _ = held.enter_context(service(folder / "service"))
        with httpx.Client(base_url=url) as client:
            client.post("/api/v1/sessions", json={"id": SESSION}).raise_for_status()
        seconds = WARM_S + 60.0 * minutes
        _, _, (address, _) = held.enter_context(started(play, RATE_HZ, seconds + 60.0))
        line = command(address, RATE_HZ, folder / "log", url, SESSION, seconds)
        logger = held.enter_context(subprocess.Popen(line, stdout=subprocess.PIPE, text=True))
        listeners = [held.enter_context(started(listen, url)) for _ in range(CLIENTS)]
        time.sleep(WARM_S)
        courses: dict[str, list[Usage]] = {"logger": [], "service": []}
        busy = os.getloadavg()[0]
        while logger.poll() is None:
            for name, process in (("logger", logger.pid), ("service", pid)):
                courses[name].append(usage(process))
            busy = max(busy, os.getloadavg()[0])
            time.sleep(LOOK_S)
        told = json.loads(logger.communicate(timeout=120.0)[0])
        frames = []
        for _, end, _ in listeners:
            end.send("end")
            frames.append(end.recv())
        return {
            "told": told,
            "courses": {name: course[:-1] for name, course in courses.items()},
            "arrived": at_service(url, SESSION, told),
            "waiting": waiting(folder / "log" / "journal.sqlite3"),
            "faults": sum(events_of(folder / "log" / "journal.sqlite3").get(kind, 0) for kind in FAULTS),
            "frames_hz": [n / told["seconds"] for n in frames],
            "load": busy,
        }


def growth(course: list[Usage]) -> float:
    """Slope of the memory over the second half [MiB an hour]."""
    late = course[len(course) // 2 :]
    return 3600.0 * float(np.polyfit([u.at_s for u in late], [u.mib for u in late], 1)[0])


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--out", type=Path, default=HERE / "endurance.md")
    given = parser.parse_args()
    use_all_cores()
    where = surroundings()
    with tempfile.TemporaryDirectory() as folder:
        seen = watched(given.minutes, Path(folder))
    told, lines = seen["told"], []
    at = np.linspace(0.0, 1.0, COLUMNS)
    heads = " | ".join(f"{given.minutes * x:.0f} min" for x in at)
    for name, course in seen["courses"].items():
        values = " | ".join(f"{course[round(x * (len(course) - 1))].mib:.0f}" for x in at)
        lines.append(f"| {name} | {values} | {growth(course):+.1f} | {share(course):.1f} % |")
    frames = ", ".join(f"{hz:.1f}" for hz in seen["frames_hz"])
    publish(
        given.out,
        [
            "# A long afternoon",
            "",
            f"Made by `python -m benchmarks.endurance --minutes {given.minutes:g}` on",
            f"{dt.datetime.now(dt.UTC).date()}, commit {commit()}. {where}",
            f"The highest while it ran: {seen['load']:.1f}.",
            "",
            "One bench of 7000 readings a second of six axes, logged, forwarded and shown; "
            f"{CLIENTS} live clients at 30 Hz.",
            "",
            f"Resident memory [MiB] from {WARM_S:.0f} s after the start, its slope over the second half [MiB an hour],",
            "and share of one core.",
            "",
            f"| process | {heads} | slope | core |",
            "|" + "---|" * (COLUMNS + 3),
            *lines,
            "",
            f"Logged {told['samples']} readings in {told['seconds']:.1f} s "
            f"({100.0 * told['samples'] / (RATE_HZ * told['seconds']):.3f} % of the rate); gaps, overruns, damage,",
            f"refusals: {seen['faults']}; at the service {seen['arrived']}; waiting at the end: {seen['waiting']};",
            f"messages a second at the clients: {frames}.",
            "",
        ],
    )


if __name__ == "__main__":
    main()
