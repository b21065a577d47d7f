"""A fast load cell logged for minutes: what is lost, how much of a core it takes, whether memory grows; and replay.

    python -m benchmarks.acquisition [--minutes 10] [--out FILE]

A stand-in for a Net F/T box plays 7000 readings a second over UDP on loopback, in a process of its own; this process
logs them, journal and all. Then the journal is replayed through the decoder as fast as it goes.
"""

from __future__ import annotations

import argparse
import datetime as dt
import multiprocessing
import resource
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Timer
from typing import Any

import numpy as np

from benchmarks.machine import commit, publish

RATE_HZ = 7000.0
HERE = Path(__file__).parent


def played(minutes: float) -> Iterator[Any]:
    """A slow wave on all axes, in blocks of ten seconds."""
    from daq.recordings.readings import ReadingBlock

    n = int(10 * RATE_HZ)
    for k in range(int(minutes * 6) + 6):
        t_s = (k * n + np.arange(n)) / RATE_HZ
        yield ReadingBlock(t_s, np.outer(np.sin(t_s), np.arange(1.0, 7.0)))


def play(end: Connection, minutes: float) -> None:
    """The device's process."""
    from daq.standins import stand_in
    from daq.standins.run import Player
    from daq.standins.wires import UdpWire

    wire = UdpWire()
    end.send(wire.address)
    player = Player(stand_in("ati-netft")(), wire, played(minutes))
    player.run(end.poll)
    wire.close()


def logged(minutes: float, folder: Path) -> dict[str, Any]:
    """Log and measure."""
    from daq.acquisition.acquire import Acquisition
    from daq.acquisition.transports import connect
    from daq.drivers import driver
    from daq.journal.writer import Journal
    from server.commands.log import Logging

    ours, theirs = multiprocessing.Pipe()
    context = multiprocessing.get_context("spawn")
    device = context.Process(target=play, args=(theirs, minutes), daemon=True)
    device.start()
    address = ours.recv()
    settings = {"counts_per_N": 1e6, "counts_per_Nmm": 1e3, "rate_hz": RATE_HZ, "buffered": "yes"}
    cell = driver("ati-netft")(settings)
    run = Acquisition(cell, lambda: connect(cell, address))
    sizes: list[int] = []
    with closing(Journal.create(folder / "journal.sqlite3", "benchmark")) as journal:
        run.start()
        timer = Timer(minutes * 60.0, run.stop)
        timer.start()
        logging = Logging(journal, cell, {}, quiet=True)
        began, used = time.perf_counter(), time.process_time()
        every = Timer(15.0, lambda: sizes.append(_resident()))
        every.start()
        told = logging.run(run)
        wall, used = time.perf_counter() - began, time.process_time() - used
        every.cancel()
        sizes.append(_resident())
    ours.send("end")
    device.join(10.0)
    lost = sum(v for k, v in told["events"].items() if k in ("gap", "overrun", "damaged", "disconnected"))
    return {**told, "wall_s": wall, "core": used / wall, "mib": [s / 2**20 for s in sizes], "faults": lost}


def replayed(path: Path) -> dict[str, float]:
    """Decode a journal's bytes again, as fast as it goes."""
    from daq.acquisition.acquire import Acquisition
    from daq.acquisition.transports import connect
    from daq.journal.replay import JournalReplay

    cell = JournalReplay(path, speed=0.0)
    began, count = time.perf_counter(), 0
    run = Acquisition(cell, lambda: connect(cell, str(path)), waiting=10_000)
    run.start()
    last_s = 0.0
    for record in run.records():
        if record.chunk is not None and len(record.chunk):
            count += len(record.chunk)
            last_s = float(record.chunk.t_s[-1])
    seconds = time.perf_counter() - began
    return {"samples": count, "seconds": seconds, "per_s": count / seconds, "times_real": last_s / seconds}


def from_file(folder: Path) -> float:
    """Readings a second of a readings file (1 kHz, ten minutes) through the replay driver into a journal."""
    from daq.acquisition.acquire import Acquisition
    from daq.acquisition.transports import connect
    from daq.drivers import driver
    from daq.journal.writer import Journal
    from daq.recordings.readings import ReadingBlock, write_readings
    from server.commands.log import Logging

    t_s = np.arange(600_000) / 1000.0
    path = write_readings(folder / "r.parquet", [ReadingBlock(t_s, np.outer(np.sin(t_s), np.arange(1.0, 7.0)))])
    cell = driver("replay")({"speed": 0.0})
    run = Acquisition(cell, lambda: connect(cell, str(path)))
    with closing(Journal.create(folder / "file.sqlite3", "benchmark")) as journal:
        began = time.perf_counter()
        run.start()
        told = Logging(journal, cell, {}, quiet=True).run(run)
        return float(told["samples"] / (time.perf_counter() - began))


def _resident() -> int:
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return pages * resource.getpagesize()
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--out", type=Path, default=HERE / "acquisition.md")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        told = logged(given.minutes, Path(folder))
        again = replayed(Path(folder) / "journal.sqlite3")
        size = (Path(folder) / "journal.sqlite3").stat().st_size / 2**20
        file = from_file(Path(folder))
    share = 100 * told["samples"] / (RATE_HZ * told["seconds"])
    rows = [
        (
            "readings logged",
            f"{told['samples']} in {told['seconds']:.1f} s, {share:.3f} % of the stated rate",
            "no loss",
        ),
        ("gaps, overruns, damage, disconnections", f"{told['faults']}", "0"),
        ("share of one core", f"{100 * told['core']:.1f} %", "15 %"),
        ("resident memory after 15 s, at the end", f"{', '.join(f'{m:.0f}' for m in told['mib'])} MiB", "flat"),
        ("journal", f"{size:.0f} MiB", ""),
        ("replay of that journal", f"{again['per_s'] / RATE_HZ:.0f} times real time at 7 kHz", ""),
        ("replay of a readings file at 1 kHz into a journal", f"{file / 1e3:.0f} times real time", "1000"),
    ]
    lines = [
        "# Logging a fast load cell",
        "",
        f"Made by `python -m benchmarks.acquisition --minutes {given.minutes:g}` on {dt.datetime.now(dt.UTC).date()},",
        f"commit {commit()}: a stand-in for a Net F/T box on loopback, {RATE_HZ:g} readings a second of six axes,",
        "buffered, journal on.",
        "",
        "| figure | value | aim |",
        "|---|---|---|",
        *(f"| {what} | {value} | {aim} |" for what, value, aim in rows),
        "",
    ]
    publish(given.out, lines)


if __name__ == "__main__":
    main()
