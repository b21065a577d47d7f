"""From a sample to a WebSocket client: how late, for how much of a core, and whether memory grows.

    python -m benchmarks.live [--seconds 60] [--clients 4] [--url http://127.0.0.1:8765 --pid PID] [--out FILE]

This process plays a load cell of 7000 readings a second through the live path of a bench, and listens as several
clients at 30 Hz. The service is a whole one in a process of its own; with `--url`, one that runs already. In the
second half of the time a weight hangs, so that its reading is estimated too. A latency is the age of the oldest
reading in an envelope when a client has it.
"""

from __future__ import annotations

import argparse
import datetime as dt
import hashlib
import json
import os
import tempfile
import threading
import time
import uuid
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from benchmarks.machine import commit, publish
from benchmarks.service import service

RATE_HZ, DATAGRAM = 7000.0, 40
# Another each time, as a service that runs already may have been measured before.
SESSION, STREAM, EPOCH = f"live-{uuid.uuid4().hex[:8]}", "a" * 32, uuid.uuid4().hex
# Before it is measured.
WARM_S = 10.0
HERE = Path(__file__).parent


@dataclass
class Heard:
    """What one client heard.

    Attributes:
        late_s: age of the oldest reading of each envelope.
        frames: number of frames with a trace; dropped: traces that it was not sent; estimates: that it was.
    """

    late_s: list[float] = field(default_factory=list)
    frames: int = 0
    dropped: int = 0
    estimates: int = 0


class Listener:
    """A client at 30 Hz in a thread of its own."""

    def __init__(self, url: str) -> None:
        from websockets.sync.client import connect

        self.heard = Heard()
        self._stack = ExitStack()
        address = f"{url.replace('http', 'ws', 1)}/api/v1/live?session={SESSION}&rate_hz=30"
        self._socket = self._stack.enter_context(connect(address, compression=None))
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        for text in self._socket:
            now, traced = time.monotonic(), 0
            for message in json.loads(text):
                if message["kind"] == "trace" and not message["body"]["recent"]:
                    self.heard.late_s += [now - from_s for from_s in message["body"]["from_s"]]
                    traced = 1
                self.heard.dropped += message["count"] if message["kind"] == "dropped" else 0
                self.heard.estimates += message["kind"] == "estimate"
            self.heard.frames += traced

    def stop(self) -> None:
        """Hang up."""
        self._stack.close()
        self._thread.join(5.0)


class Player:
    """A load cell: 7000 noisy readings a second of six axes, in datagrams, to the live path."""

    def __init__(self, url: str) -> None:
        from daq.uplink.live_tail import LiveTail

        self.tail = LiveTail(url, SESSION)
        self._halt = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.tail.start()
        self._thread.start()

    def _run(self) -> None:
        noise = np.random.default_rng(0).normal(scale=0.02, size=(70_000, 6))
        over = np.zeros(DATAGRAM, dtype=bool)
        next_s, k = time.monotonic(), 0
        while not self._halt.is_set():
            next_s += DATAGRAM / RATE_HZ
            if (wait_s := next_s - time.monotonic()) > 0.0:
                time.sleep(wait_s)
            elif wait_s < -1.0:
                next_s -= wait_s  # this process was held up: readings of the past are not what is measured
            t_s = next_s + (np.arange(DATAGRAM) - DATAGRAM + 1) / RATE_HZ
            at = k * DATAGRAM % 70_000
            self.tail.offer(STREAM, t_s, noise[at : at + DATAGRAM], over)
            k += 1

    def stop(self) -> None:
        """Fall silent."""
        self._halt.set()
        self._thread.join(5.0)
        self.tail.stop()


class Events:
    """Tells the service what happens at the bench."""

    def __init__(self, client: httpx.Client) -> None:
        self._client, self._number = client, 0

    def tell(self, kind: str, at_s: float, value: Any) -> None:
        """Send an event, as the uplink does."""
        from daq.journal.rows import Event
        from daq.uplink.events import encoded
        from daq.uplink.wire import EPOCH as EPOCH_HEADER
        from daq.uplink.wire import SHA256, events_path

        body = encoded(Event(kind, at_s, value, STREAM, time.time()))
        headers = {
            "Content-Type": "application/json", SHA256: hashlib.sha256(body).hexdigest(), EPOCH_HEADER: EPOCH,
        }  # fmt: skip
        path = f"{events_path(SESSION, EPOCH)}/{self._number}"
        self._client.put(path, content=body, headers=headers).raise_for_status()
        self._number += 1


def setup() -> Any:
    """A bench of one case, with the timing of a real one."""
    from daq.bench.record import BenchSetup
    from daq.sessions.protocols import Protocol

    protocol = {
        "format": "protocol/1", "id": "one", "postures_deg": {"hook": {"MCP": 0, "PIP": 65, "DIP": 50}},
        "timing": {"tare_s": 4.0, "load_s": 5.0, "settle_s": 1.0, "guard_s": 0.3},
        "blocks": [{"role": "identification", "location": "tip", "postures": ["hook"], "masses_g": [{"FDP": 950}]}],
    }  # fmt: skip
    specimen = {"id": "P1", "species": "human", "digit": "third", "side": "left"}
    cell = {"model": "ATI Nano17-E SI-25-0.25", "serial": "FT1", "calibration": "SI-25-0.25", "mounts": {"tip": {}}}
    return BenchSetup(SESSION, specimen, "an1979_middle", Protocol.model_validate(protocol), cell, 0.835)


def usage(pid: int) -> tuple[float, float]:
    """Processor time [s] and resident memory [MiB] of a process; NaN where the system does not tell."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
        ticks, pages = int(fields[11]) + int(fields[12]), int(fields[21])
        return ticks / os.sysconf("SC_CLK_TCK"), pages * os.sysconf("SC_PAGE_SIZE") / 2**20
    except (OSError, IndexError, ValueError):
        return float("nan"), float("nan")


def wait(seconds: float, loops_s: list[float]) -> None:
    """Wait, and time a short loop now and then: where others share the core, it takes more processor time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        time.sleep(min(0.25, max(end - time.monotonic(), 0.0)))
        began = time.thread_time()
        sum(k * k for k in range(20_000))
        loops_s.append(time.thread_time() - began)


def begun(url: str, client: httpx.Client, held: ExitStack) -> tuple[Events, Player]:
    """Begin a session whose bench has started, and a load cell that plays until the stack is left."""
    client.post("/api/v1/sessions", json={"id": SESSION}).raise_for_status()
    events = Events(client)
    events.tell("bench_started", time.monotonic(), setup().as_value())
    player = Player(url)
    held.callback(player.stop)
    return events, player


def hang(events: Events) -> None:
    """From now on a weight hangs, after a tare."""
    now = time.monotonic()
    events.tell("tare", now, {"window_s": [now - 5.0, now - 1.0], "brackets": []})
    events.tell("loaded", now, {"step": "c001"})


def measured(url: str, pid: int, seconds: float, clients: int) -> dict[str, Any]:
    """Play, listen and measure."""
    with httpx.Client(base_url=url, timeout=10.0) as client, ExitStack() as stack:
        events, player = begun(url, client, stack)
        listeners = [Listener(url) for _ in range(clients)]
        for listener in listeners:
            stack.callback(listener.stop)
        loops_s: list[float] = []
        wait(WARM_S, loops_s)
        marks, late = [usage(pid)], []
        for half in range(2):
            if half:
                hang(events)
            for listener in listeners:
                listener.heard = Heard()
            wait(seconds / 2, loops_s)
            marks.append(usage(pid))
            late.append([listener.heard for listener in listeners])
        dropped = player.tail.dropped
    return {"marks": marks, "heard": late, "dropped": dropped, "loops_s": loops_s}


def rows_of(found: dict[str, Any], seconds: float) -> list[tuple[str, str, str]]:
    """What came out, and what was wanted."""
    marks, half_s = found["marks"], seconds / 2
    late_ms = 1e3 * np.concatenate([h.late_s for half in found["heard"] for h in half])
    frames = [h.frames / half_s for half in found["heard"] for h in half]
    shares = [100.0 * (b[0] - a[0]) / half_s for a, b in pairwise(marks)]
    memory = ", ".join(f"{m[1]:.1f}" for m in marks)
    slowed = np.median(found["loops_s"]) / np.min(found["loops_s"])
    middle, high, highest = np.percentile(late_ms, [50, 99, 100])
    return [
        ("oldest sample of an envelope to the client, median", f"{middle:.0f} ms", ""),
        ("the same, 99th percentile", f"{high:.0f} ms", "100 ms"),
        ("the same, the latest of all", f"{highest:.0f} ms", ""),
        ("frames with a trace a second, each client", f"{min(frames):.1f} to {max(frames):.1f}", "30"),
        ("traces dropped for slow clients", f"{sum(h.dropped for half in found['heard'] for h in half)}", "0"),
        ("envelopes that the bench could not send", f"{found['dropped']}", "0"),
        ("share of one core, traces alone", f"{shares[0]:.1f} %", "5 %, later 3 %"),
        ("share of one core, a weight hanging", f"{shares[1]:.1f} %", "5 %"),
        ("processor time of a loop meanwhile, median over least", f"{slowed:.2f}", "1, at the core's full speed"),
        ("share of a core at full speed (over the row before), traces alone", f"{shares[0] / slowed:.1f} %", "3 %"),
        ("estimates a second", f"{found['heard'][1][0].estimates / half_s:.1f}", "5"),
        ("resident memory: beginning, middle, end", f"{memory} MiB", "flat"),
    ]


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--clients", type=int, default=4)
    parser.add_argument("--url", help="of a service that runs already")
    parser.add_argument("--pid", type=int, default=0, help="of its process")
    parser.add_argument("--out", type=Path, default=HERE / "live.md")
    given = parser.parse_args()
    before = os.getloadavg()
    with ExitStack() as stack:
        url, pid = given.url, given.pid
        if not url:
            folder = stack.enter_context(tempfile.TemporaryDirectory())
            url, pid, _ = stack.enter_context(service(Path(folder)))
        found = measured(url, pid, given.seconds, given.clients)
    after = os.getloadavg()
    lines = [
        "# The live path",
        "",
        f"Made by `python -m benchmarks.live --seconds {given.seconds:g} --clients {given.clients}` on",
        f"{dt.datetime.now(dt.UTC).date()}, commit {commit()}: {RATE_HZ:g} readings a second of six axes, sent as",
        f"envelopes, {given.clients} clients at 30 Hz, all on loopback; {os.cpu_count()} cores, load average",
        f"{before[0]:.1f} before and {after[0]:.1f} after.",
        "",
        "| figure | value | aim |",
        "|---|---|---|",
        *(f"| {what} | {value} | {aim} |" for what, value, aim in rows_of(found, given.seconds)),
        "",
    ]
    publish(given.out, lines)


if __name__ == "__main__":
    main()
