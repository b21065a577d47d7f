"""Fifty clients at once, some of whom read much: how long benches, watchers and each other wait for an answer.

    python -m benchmarks.mixed_load [--seconds 30] [--out FILE]

Readers ask again half a second after each answer: catalogue, sessions, cases, comparisons, figures, readings, exports.
Each second, four benches send four chunks of 250 ms at 7 kHz and two watchers ask for health and metrics.
"""

from __future__ import annotations

import argparse
import asyncio
import datetime as dt
import multiprocessing
import os
import resource
import tempfile
import time
from collections import defaultdict
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path

import httpx
import numpy as np
import psutil

from benchmarks.machine import commit, publish, use_all_cores
from benchmarks.service import CHUNK_S, RATE_HZ, SESSION, service, used, wait_for_readers
from daq.acquisition.blocks import Chunk
from daq.uplink.wire import COUNT, EPOCH, SHA256, stream_path
from server.service.operation.reader_process import NICENESS as READERS_NICE
from server.service.storage.checksums import digest_of

HERE = Path(__file__).parent
_OF = f"/api/v1/sessions/{SESSION}"
# Address and number of clients; those that take long are few in any lab.
READERS = {
    "/api/v1/effects": 10,
    "/api/v1/sessions": 6,
    _OF: 6,
    f"{_OF}/cases": 6,
    f"{_OF}/comparison": 6,
    f"{_OF}/readings?points=2000": 4,
    f"/api/v1/figures/comparison/scatter?session={SESSION}": 2,
    f"{_OF}/export?format=csv": 2,
    f"{_OF}/check": 1,
    f"{_OF}/report": 1,
}
WATCHED = ("/api/v1/health", "/metrics", "/api/v1/health/live")
BENCHES, WATCHERS, THOUGHT_S = 4, 2, 0.5
# Load cases of a request for predictions.
PREDICTED = 50_000
EPOCH_1 = "1" * 32
Times = dict[str, list[float]]


async def _asked(took: Times, kind: str, ask: Callable[[], Awaitable[httpx.Response]]) -> None:
    at = time.perf_counter()
    answer = await ask()
    took[kind].append(time.perf_counter() - at)
    if answer.status_code >= 400:
        took[f"{kind} refused {answer.status_code}"].append(0.0)


async def _reader(client: httpx.AsyncClient, took: Times, address: str, until: float) -> None:
    while time.monotonic() < until:
        await _asked(took, "readers", lambda: client.get(address))
        await asyncio.sleep(THOUGHT_S)


async def _predicting(client: httpx.AsyncClient, took: Times, until: float) -> None:
    angles = np.linspace(5.0, 60.0, PREDICTED).tolist()
    body = {"postures_deg": {"MCP": angles, "PIP": angles}, "masses_g": {"FDP": [950.0]}}
    while time.monotonic() < until:
        await _asked(took, "predicting", lambda: client.post("/api/v1/predictions", json=body))
        await asyncio.sleep(THOUGHT_S)


async def _watcher(client: httpx.AsyncClient, took: Times, until: float) -> None:
    while time.monotonic() < until:
        for address in WATCHED:
            await _asked(took, "watchers", lambda address=address: client.get(address))  # type: ignore[misc]
        await asyncio.sleep(0.5)


async def _bench(client: httpx.AsyncClient, took: Times, name: str, until: float) -> None:
    n, path = int(RATE_HZ * CHUNK_S), stream_path(name, "a" * 32)
    none, wrench = np.zeros(n, np.int64), np.random.default_rng(0).normal(size=(n, 6))
    (await client.post("/api/v1/sessions", json={"id": name})).raise_for_status()
    (await client.put(path, json={"driver": "made"}, headers={EPOCH: EPOCH_1})).raise_for_status()
    began, k = time.monotonic(), 0
    while time.monotonic() < until:
        await asyncio.sleep(max(0.0, began + k * CHUNK_S - time.monotonic()))
        t_s = (k * n + np.arange(n)) / RATE_HZ
        body = Chunk(k * n, t_s, wrench, none, none > 0, bytes(36 * n), [(36 * n, t_s[0])], time.time()).to_bytes()
        headers = {COUNT: str(n), SHA256: digest_of(body), EPOCH: EPOCH_1}
        await _asked(
            took,
            "benches",
            lambda k=k, body=body, headers=headers: client.put(  # type: ignore[misc]
                f"{path}/chunks/{k * n}", content=body, headers=headers
            ),
        )
        k += 1


def clients(url: str, seconds: float, which: str, predicting: int, end: multiprocessing.connection.Connection) -> None:
    """Be the readers, or the others; send how long each answer took [s]."""

    async def main() -> Times:
        took: Times = defaultdict(list)
        until = time.monotonic() + seconds
        async with httpx.AsyncClient(
            base_url=url, timeout=60, trust_env=False, limits=httpx.Limits(max_connections=None, keepalive_expiry=2.0)
        ) as client:
            if which == "readers":
                work = [_reader(client, took, a, until) for a, count in READERS.items() for _ in range(count)]
                work += [_predicting(client, took, until) for _ in range(predicting)]
            else:
                work = [_bench(client, took, f"bench{k}", until) for k in range(BENCHES)]
                work += [_watcher(client, took, until) for _ in range(WATCHERS)]
            await asyncio.gather(*work)
        return took

    end.send(dict(asyncio.run(main())))


def under_load(url: str, seconds: float, predicting: int = 0) -> Times:
    """All clients at once; readers are another process than benches, whose waiting is told alone."""
    context = multiprocessing.get_context("spawn")
    ends, processes = [], []
    for which in ("readers", "others"):
        ours, theirs = context.Pipe()
        processes.append(context.Process(target=clients, args=(url, seconds, which, predicting, theirs)))
        processes[-1].start()
        ends.append(ours)
    took = {kind: times for end in ends for kind, times in end.recv().items()}
    for process in processes:
        process.join()
    return took


def _waited_s(pid: int) -> tuple[float, float]:
    """Time that a process's threads, as far as they live, ran and waited for a core although they could run [s]."""
    ran = waited = 0.0
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(OSError):
            fields = (task / "schedstat").read_text(encoding="ascii").split()
            ran, waited = ran + 1e-9 * int(fields[0]), waited + 1e-9 * int(fields[1])
    return ran, waited


def _cores(pid: int) -> np.ndarray:
    """Processor time of the service, its readers' process, finished clients and the whole machine; waited [s]."""
    readers = [p for p in psutil.Process(pid).children() if p.nice() == READERS_NICE]
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    busy = psutil.cpu_times()
    idle = busy.idle + busy.iowait
    return np.array([
        used(pid)[1], sum(used(p.pid)[1] for p in readers), ended.ru_utime + ended.ru_stime, sum(busy[:8]) - idle,
        *_waited_s(pid), time.monotonic(),
    ])  # fmt: skip


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--predicting", type=int, default=0, help=f"more clients, for {PREDICTED} load cases each time")
    parser.add_argument("--out", type=Path, default=HERE / "mixed_load.md")
    given = parser.parse_args()
    from fingertwin.client import Client

    use_all_cores()
    load_before = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder, service(Path(folder)) as (url, pid, _):
        with Client(url) as twin:
            twin.upload(SESSION)
            twin.session(SESSION).compare(model=None)
        with httpx.Client(base_url=url) as client:
            wait_for_readers(client)
        before = _cores(pid)
        took = under_load(url, given.seconds, given.predicting)
        own, reading, asking, busy, ran, waited, wall = _cores(pid) - before
    cores = (os.cpu_count() or 1) * wall
    aims = {"readers": "p99 1000 ms", "benches": "p99 100 ms", "watchers": "p99 100 ms", "predicting": ""}
    rows = []
    for kind, times in sorted(took.items()):
        p50, p99, most = (1e3 * float(v) for v in (*np.percentile(times, [50, 99]), max(times)))
        rows.append(f"| {kind} | {len(times)} | {p50:.0f} | {p99:.0f} | {most:.0f} | {aims.get(kind, '0 answers')} |")
    publish(
        given.out,
        [
            "# Fifty clients at once",
            "",
            f"Made by `python -m benchmarks.mixed_load --seconds {given.seconds:g} --predicting {given.predicting}`",
            f"on {dt.datetime.now(dt.UTC).date()}, commit {commit()}, {os.cpu_count()} cores; load {load_before:.1f}.",
            "",
            f"{sum(READERS.values())} readers, {given.predicting} that ask for predictions, {BENCHES} benches,",
            f"{WATCHERS} watchers; clients run on the same cores.",
            "",
            "| who | answers | p50 [ms] | p99 [ms] | longest [ms] | aim |",
            "|---|---|---|---|---|---|",
            *rows,
            "",
            f"Of {cores:.0f} s of the cores the service had {own:.1f} s, its readers' process {reading:.1f} s, the",
            f"clients {asking:.1f} s and other programs {busy - own - reading - asking:.1f} s. The service's",
            f"threads ran {ran:.1f} s; for another {waited:.1f} s they could have run and waited for a core.",
            "",
        ],
    )


if __name__ == "__main__":
    main()
