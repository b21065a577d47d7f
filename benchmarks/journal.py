"""Time appending to a journal against SQLite alone, and kill its writer at random moments.

    python -m benchmarks.journal [--kills 200] [--seed 0] [--folder DIR] [--out FILE]

The folder is to lie on the disk that counts; by default it is the system's temporary one.
"""

from __future__ import annotations

import argparse
import datetime as dt
import hashlib
import io
import sqlite3
import time
from contextlib import closing, redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.machine import commit, publish, table, wait_until_quiet
from benchmarks.uplink_parts import surroundings
from daq.journal.check import check
from daq.journal.writer import Journal
from tests.daq.journal_kills import kill_many
from tests.daq.journal_writer import made_chunk

RATE_HZ, CHUNK_S = 7000, 0.1
COUNT = int(RATE_HZ * CHUNK_S)
CHUNKS = 1000
TARGET = 0.8


def main() -> None:
    """Run both and write what came out."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200, help="writers to kill; 0 for none")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".md"))
    given = parser.parse_args()
    where, page = surroundings(), io.StringIO()
    with redirect_stdout(page):
        _measure(given.folder, given.kills, given.seed)
    lines = [
        "# Appending to a journal",
        "",
        f"Made by `python -m benchmarks.journal --kills {given.kills} --seed {given.seed}`",
        f"on {dt.datetime.now(dt.UTC).date()}, commit {commit()}. {where} One core was used.",
        "",
        page.getvalue().strip(),
        "",
    ]
    publish(given.out, lines)


def _measure(where: Path | None, kills: int, seed: int) -> None:
    with TemporaryDirectory(dir=where, ignore_cleanup_errors=True) as name:
        folder = Path(name)
        _time(folder)
        if kills:
            began = time.perf_counter()
            acknowledged, kept = kill_many(folder / "kills.journal", kills, seed)
            seconds = time.perf_counter() - began
            table(
                f"{kills} writers killed at random moments (seed {seed}, {seconds:.0f} s)",
                ["samples acknowledged", "samples kept", "acknowledged and lost", "doubled"],
                [[f"{acknowledged}", f"{kept}", "0", "0"]],
                "Every chunk is compared with the one that was appended; the benchmark ends with an error at the first "
                "that differs. What is kept beyond what was acknowledged had been written, not yet said.",
            )


def _time(folder: Path) -> None:
    chunks = [made_chunk(i * COUNT, COUNT) for i in range(CHUNKS)]
    blobs = [chunk.to_bytes() for chunk in chunks]
    wait_until_quiet()
    names = (
        "SQLite alone: blobs, one table",
        "SQLite alone: and an outbox with SHA-256",
        "ours: `append`, from samples",
    )
    seconds = np.zeros((len(names), CHUNKS))
    with (
        closing(_bare(folder / "one.sqlite")) as one,
        closing(_bare(folder / "two.sqlite")) as two,
        Journal.create(folder / "ours.journal", "benchmark") as journal,
    ):
        stream = journal.add_stream("made", {}, {})
        for i, (chunk, blob) in enumerate(zip(chunks, blobs, strict=True)):
            # In turn, so that a disk that is slower for a while is slower for all.
            moments = [time.perf_counter()]
            _insert(one, i, blob)
            moments.append(time.perf_counter())
            _insert(two, i, blob, hashlib.sha256(blob).hexdigest())
            moments.append(time.perf_counter())
            journal.append(stream, chunk)
            moments.append(time.perf_counter())
            seconds[:, i] = np.diff(moments)
    began = time.perf_counter()
    assert not check(folder / "ours.journal").faults
    reading_s = time.perf_counter() - began
    size_MB = sum(map(len, blobs)) / 1e6
    table(
        f"Appending {RATE_HZ / 1000:g} kHz × 6 in chunks of {1e3 * CHUNK_S:g} ms, `synchronous=FULL` (target: at least "
        f"{TARGET:g} of SQLite alone)",
        ["", "mean [ms a chunk]", "median [ms]", "99 % [ms]", "MB/s", "speed / SQLite alone", "the same, of medians"],
        [
            [
                name,
                f"{1e3 * taken.mean():.2f}",
                f"{1e3 * np.median(taken):.2f}",
                f"{1e3 * np.quantile(taken, 0.99):.2f}",
                f"{size_MB / taken.sum():.0f}",
                f"{seconds[0].sum() / taken.sum():.2f}",
                f"{np.median(seconds[0]) / np.median(taken):.2f}",
            ]
            for name, taken in zip(names, seconds, strict=True)
        ],
        f"{CHUNKS} chunks of {len(blobs[0]) / 1e3:.0f} kB, a transaction each, the three in turn, emptying the log "
        "included. SQLite alone is given finished blobs, ours samples. Checking ours, every checksum of it: "
        f"{size_MB / reading_s:.0f} MB/s.",
    )


def _bare(path: Path) -> sqlite3.Connection:
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute("PRAGMA synchronous=FULL")
    columns = "stream INTEGER, first_seq INTEGER, payload BLOB, UNIQUE (stream, first_seq)"
    connection.execute(f"CREATE TABLE chunks ({columns})")
    connection.execute("CREATE TABLE outbox (id INTEGER PRIMARY KEY, sha256 TEXT)")
    return connection


def _insert(connection: sqlite3.Connection, i: int, blob: bytes, digest: str | None = None) -> None:
    connection.execute("BEGIN IMMEDIATE")
    connection.execute("INSERT INTO chunks VALUES (1, ?, ?)", (i * COUNT, blob))
    if digest is not None:
        connection.execute("INSERT INTO outbox (sha256) VALUES (?)", (digest,))
    connection.execute("COMMIT")


if __name__ == "__main__":
    main()
