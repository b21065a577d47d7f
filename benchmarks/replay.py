"""Replay as fast as it goes: a readings file into a journal, and a journal's bytes through the driver that read them.

    python -m benchmarks.replay [--minutes 10] [--times 7] [--out FILE]

Both are what `fingertwin replay --speed max` does, journal and all. The journals that are replayed are of a Net F/T box
that gathers 40 readings a datagram, in chunks of 100 ms.
"""

from __future__ import annotations

import argparse
import datetime as dt
import statistics
import tempfile
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np

from benchmarks.machine import commit, use_all_cores, wait_until_quiet
from benchmarks.uplink_parts import SETTINGS, surroundings
from daq.acquisition.acquire import Acquisition
from daq.acquisition.blocks import Chunk
from daq.acquisition.transports import connect
from daq.drivers import driver
from daq.drivers.base import LoadCell
from daq.journal.replay import JournalReplay
from daq.journal.writer import Journal
from daq.recordings.readings import ReadingBlock, write_readings
from daq.standins import stand_in
from server.commands.log import Logging

HERE = Path(__file__).parent
CHUNK_S, DATAGRAM = 0.1, 40
AIM = 1000.0


def recorded_file(path: Path, rate_hz: float, seconds: float) -> Path:
    """A readings file: a slow wave on all axes."""
    t_s = np.arange(int(rate_hz * seconds)) / rate_hz
    return write_readings(path, [ReadingBlock(t_s, np.outer(np.sin(t_s), np.arange(1.0, 7.0)))])


def recorded_journal(path: Path, rate_hz: float, seconds: float) -> Path:
    """A journal as a log leaves it."""
    cell, device = driver("ati-netft")({**SETTINGS, "rate_hz": rate_hz}), stand_in("ati-netft")()
    decoder, seq, total = cell.decoder(), 0, round(rate_hz * seconds)
    with closing(Journal.create(path, "benchmark")) as journal:
        stream = journal.add_stream(cell.name, cell.values, {}, cell.clock)
        while seq < total:
            n = min(int(rate_hz * CHUNK_S), total - seq)
            t_s = (seq + np.arange(n)) / rate_hz
            records = device.encode(np.outer(np.sin(t_s), np.arange(1.0, 7.0)), seq + np.arange(n), t_s)
            datagrams = [b"".join(records[a : a + DATAGRAM]) for a in range(0, n, DATAGRAM)]
            arrivals = t_s[np.minimum(np.arange(DATAGRAM, n + DATAGRAM, DATAGRAM), n) - 1]
            read = [decoder.feed(d) for d in datagrams]
            wrench, status = np.concatenate([r.wrench for r in read]), np.concatenate([r.status for r in read])
            reads = [(len(d), float(at)) for d, at in zip(datagrams, arrivals, strict=True)]
            chunk = Chunk(seq, t_s, wrench, status, status != 0, b"".join(datagrams), reads, 1.8e9 + t_s[-1])
            seq = journal.append(stream, chunk)
    return path


def replayed(cell: LoadCell, port: Path, into: Path) -> tuple[int, float, float]:
    """Replay into a new journal; return readings, seconds, and processor time over that."""
    run = Acquisition(cell, lambda: connect(cell, str(port)))
    with closing(Journal.create(into, "benchmark")) as journal:
        began, used = time.perf_counter(), time.process_time()
        run.start()
        told = Logging(journal, cell, {}, quiet=True).run(run)
        seconds = time.perf_counter() - began
    into.unlink()
    return int(told["samples"]), seconds, (time.process_time() - used) / seconds


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--times", type=int, default=7)
    parser.add_argument("--out", type=Path, default=HERE / "replay.md")
    given = parser.parse_args()
    use_all_cores()
    where, rows, seconds = surroundings(), [], 60.0 * given.minutes
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        parquet = recorded_file(folder / "readings.parquet", 1000.0, seconds)
        text = recorded_file(folder / "readings.csv", 1000.0, seconds)
        slow = recorded_journal(folder / "slow.sqlite3", 1000.0, seconds)
        fast = recorded_journal(folder / "fast.sqlite3", 7000.0, seconds / 7.0)
        kinds: list[tuple[str, float, float, Path, Callable[[], LoadCell], str]] = [
            ("readings file, Parquet", 1000.0, seconds, parquet, _file_cell, f"{AIM:g}"),
            ("readings file, CSV", 1000.0, seconds, text, _file_cell, ""),
            ("journal, byte for byte", 1000.0, seconds, slow, lambda: JournalReplay(slow, speed=0.0), ""),
            ("journal, byte for byte", 7000.0, seconds / 7.0, fast, lambda: JournalReplay(fast, speed=0.0), ""),
        ]
        for what, rate_hz, length_s, port, cell, aim in kinds:
            wait_until_quiet()
            runs = [replayed(cell(), port, folder / "into.sqlite3") for _ in range(given.times)]
            assert all(n == round(rate_hz * length_s) for n, _, _ in runs), "readings were lost"
            best, median = min(s for _, s, _ in runs), statistics.median(s for _, s, _ in runs)
            cores = statistics.median(c for _, _, c in runs)
            rows.append(
                f"| {what} | {rate_hz:g} | {length_s:.0f} | {best:.2f} | {length_s / best:.0f} "
                f"| {length_s / median:.0f} | {cores:.2f} | {aim} |"
            )
    lines = [
        "# Replay as fast as it goes, into a journal",
        "",
        f"Made by `python -m benchmarks.replay --minutes {given.minutes:g} --times {given.times}`",
        f"on {dt.datetime.now(dt.UTC).date()}, commit {commit()}. {where}",
        "",
        "| what is replayed | rate [Hz] | length [s] | best [s] | times real time, best | median | cores used | aim |",
        "|---|---|---|---|---|---|---|---|",
        *rows,
        "",
        "Every reading is written to the journal, on the disk at the end. Cores used: processor time over the wall",
        "clock; what is missing to 1 is waiting for the disk or for a core that others had.",
        "",
    ]
    page = "\n".join(lines)
    given.out.write_text(page, encoding="utf-8")
    print(page)


def _file_cell() -> LoadCell:
    return driver("replay")({"speed": 0.0})


if __name__ == "__main__":
    main()
