"""The model service under load: ingest of four benches, comparisons beside it, predictions, start, memory.

    python -m benchmarks.service [--minutes 2] [--benches 4] [--out FILE]

A real service process on loopback and a folder of its own. Each bench is a process that puts chunks of 250 ms at 7 kHz
with six axes, as an uplink does; one more asks for a comparison of 96 load cases fifty times a second.
"""

from __future__ import annotations

import argparse
import datetime as dt
import hashlib
import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from benchmarks.machine import commit, publish, use_all_cores

HERE = Path(__file__).parent
RATE_HZ, CHUNK_S, ASKED_HZ, SESSION = 7000.0, 0.25, 50.0, "DEV-01"
_SERVE = "from server.cli import main; main()"


def wait_for_readers(client: httpx.Client) -> None:
    """Wait until the readers' process answers: until then the service answers by itself."""
    while "fingertwin_reader_process 1.0" not in client.get("/metrics").text:
        time.sleep(0.1)


@contextmanager
def service(folder: Path) -> Iterator[tuple[str, int, float]]:
    """Run a service; yield its address, process id, and the time until it was ready [s]."""
    arguments = [sys.executable, "-c", _SERVE, "serve", "--port", "0", "--data", str(folder), "--json", "-"]
    environment = os.environ | {"FINGERTWIN_LOG_LEVEL": "error"}
    began = time.perf_counter()
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, env=environment)
    try:
        assert process.stdout is not None
        text = b""
        while not text.rstrip().endswith(b"}"):
            text += process.stdout.readline()
        url = str(json.loads(text)["url"])
        with httpx.Client(base_url=url) as client:
            while client.get("/api/v1/health/ready").status_code != 200:
                time.sleep(0.02)
        yield url, process.pid, time.perf_counter() - began
    finally:
        process.terminate()
        process.wait(30)


def used(pid: int) -> tuple[float, float]:
    """Resident memory [MiB] and processor time [s] of a process."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    memory = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS")) / 1024
    ticks = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
    return memory, (int(ticks[11]) + int(ticks[12])) / os.sysconf("SC_CLK_TCK")


def bench(url: str, name: str, seconds: float) -> None:
    """Put chunks at the rate of a fast cell; the last one ends the stream."""
    from daq.acquisition.blocks import Chunk
    from daq.uplink.wire import COUNT, EPOCH, SHA256, stream_path

    n, path = int(RATE_HZ * CHUNK_S), stream_path(name, "a" * 32)
    rng, none = np.random.default_rng(0), np.zeros(n, np.int64)
    wrench = rng.normal(size=(n, 6))
    raw = rng.bytes(36 * n)
    with httpx.Client(base_url=url, timeout=30) as client:
        client.post("/api/v1/sessions", json={"id": name}).raise_for_status()
        client.put(path, json={"driver": "made"}, headers={EPOCH: "1" * 32}).raise_for_status()
        began = time.monotonic()
        for k in range(int(seconds / CHUNK_S)):
            time.sleep(max(0.0, began + k * CHUNK_S - time.monotonic()))
            t_s = (k * n + np.arange(n)) / RATE_HZ
            body = Chunk(k * n, t_s, wrench, none, none > 0, raw, [(len(raw), t_s[0])], time.time()).to_bytes()
            headers = {COUNT: str(n), SHA256: hashlib.sha256(body).hexdigest(), EPOCH: "1" * 32}
            client.put(f"{path}/chunks/{k * n}", content=body, headers=headers).raise_for_status()


def ask(url: str, seconds: float, end: Any) -> None:
    """Ask for the comparison, whole, at an even pace; send the times that it took [s]."""
    took = []
    with httpx.Client(base_url=url, timeout=30) as client:
        began = time.monotonic()
        for k in range(int(seconds * ASKED_HZ)):
            time.sleep(max(0.0, began + k / ASKED_HZ - time.monotonic()))
            at = time.perf_counter()
            client.get(f"/api/v1/sessions/{SESSION}/comparison").raise_for_status()
            took.append(time.perf_counter() - at)
    end.send(took)


def under_load(url: str, pid: int, benches: int, seconds: float) -> dict[str, Any]:
    """Ingest and comparisons at once."""
    ours, theirs = multiprocessing.Pipe()
    context = multiprocessing.get_context("spawn")
    names = [f"bench{k}" for k in range(benches)]
    processes = [context.Process(target=bench, args=(url, name, seconds)) for name in names]
    processes.append(context.Process(target=ask, args=(url, seconds, theirs)))
    for process in processes:
        process.start()
    memory, (_, cpu), began = [], used(pid), time.perf_counter()
    took: list[float] = []
    while any(p.is_alive() for p in processes):
        time.sleep(1.0)
        memory.append(used(pid)[0])
        if ours.poll():
            took = ours.recv()
    share = (used(pid)[1] - cpu) / (time.perf_counter() - began)
    wanted = int(seconds / CHUNK_S) * int(RATE_HZ * CHUNK_S)
    lost = 0
    with httpx.Client(base_url=url) as client:
        for name in names:
            cursor = client.get(f"/api/v1/sessions/{name}/streams/{'a' * 32}/cursor").json()
            lost += wanted - cursor["next_seq"] + sum(b - a for a, b in cursor["missing"])
    quarter = max(len(memory) // 4, 1)
    ends = [float(np.mean(memory[:quarter])), float(np.mean(memory[-quarter:])), max(memory)]
    return {
        "samples": wanted * benches, "lost": lost, "core_pct": 100 * share,
        "p50_ms": 1e3 * float(np.percentile(took, 50)), "p99_ms": 1e3 * float(np.percentile(took, 99)),
        "memory_MiB": [round(m) for m in ends],
    }  # fmt: skip


def predictions(url: str) -> dict[str, float]:
    """Predictions a second: in requests of 10,000, and one by one."""
    rng, n = np.random.default_rng(1), 10_000
    many = {
        "postures_deg": {j: list(rng.uniform(10, 60, n)) for j in ("MCP", "PIP", "DIP")},
        "masses_g": {m: list(rng.uniform(0, 900, n)) for m in ("FDP", "FDS", "EDC")},
    }
    one = {"postures_deg": {"MCP": [10], "PIP": [40], "DIP": [30]}, "masses_g": {"FDP": [950]}}
    out = {}
    with httpx.Client(base_url=url, timeout=60) as client:
        for name, body, rows, times in (("many", many, n, 15), ("one", one, 1, 1000)):
            content = json.dumps(body).encode()
            headers = {"Content-Type": "application/json"}
            for _ in range(3):
                client.post("/api/v1/predictions", content=content, headers=headers).raise_for_status()
            began = time.perf_counter()
            for _ in range(times):
                client.post("/api/v1/predictions", content=content, headers=headers)
            out[name] = rows * times / (time.perf_counter() - began)
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=2.0)
    parser.add_argument("--benches", type=int, default=4)
    parser.add_argument("--out", type=Path, default=HERE / "service.md")
    given = parser.parse_args()
    from fingertwin.client import Client

    use_all_cores()
    load_before = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder:
        with service(Path(folder)):
            pass  # what is compiled and kept on the disk is there from here on
        with service(Path(folder)) as (url, pid, ready_s):
            with Client(url) as twin:
                twin.upload(SESSION)
                twin.session(SESSION).compare(model=None)
            with httpx.Client(base_url=url) as client:
                wait_for_readers(client)
            alone = used(pid)[0]
            told = predictions(url)
            loaded = under_load(url, pid, given.benches, 60 * given.minutes)
    first, last, most = loaded["memory_MiB"]
    rows = [
        ("start to ready, warm cache", f"{ready_s:.1f} s", "under 3 s"),
        (f"ingest, {given.benches} benches of 7 kHz × 6 for {given.minutes:g} min",
         f"{loaded['samples']:,} samples, {loaded['lost']} lost", "no loss"),
        ("service's processor time meanwhile", f"{loaded['core_pct']:.0f} % of a core", ""),
        ("comparison of 96 cases, 50 a second meanwhile, median and 99th percentile",
         f"{loaded['p50_ms']:.1f} and {loaded['p99_ms']:.1f} ms", "99th under 25 ms"),
        ("memory of the service: with a session, first and last quarter of the load, most",
         f"{alone:.0f}, {first}, {last}, {most} MiB", "under 600 MB, flat"),
        ("predictions in requests of 10,000", f"{told['many']:,.0f} /s", "over 100,000 /s"),
        ("predictions one by one, one client", f"{told['one']:,.0f} /s", "300 /s"),
    ]  # fmt: skip
    lines = [
        "# The service under load", "",
        f"`python -m benchmarks.service --minutes {given.minutes:g} --benches {given.benches}`, "
        f"{dt.datetime.now(dt.UTC).date()}, commit {commit()}, {os.cpu_count()} cores; load average {load_before:.1f} "
        "before. Clients and benches run on the same machine.", "",
        "| what | measured | aim |", "|---|---|---|", *(f"| {a} | {b} | {c} |" for a, b, c in rows), "",
    ]  # fmt: skip
    publish(given.out, lines)


if __name__ == "__main__":
    main()
